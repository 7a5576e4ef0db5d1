"""Recordings of real arms: what a result predicts on rows and motions that it has not seen, and what it said beforehand.

PYTHONPATH=src python benchmarks/real_arms.py ../shared/data > benchmarks/real_arms.md

The recordings are not part of the project. LWR4+: runs 1 and 2 have the same command, run 3 another one. AIRBOT Play: one path with two
timings. The Shanghai cobot: three motions, whose wrists nobody can explain; it is fitted with --anyway where it is refused. LBR Med 7: its
torques have the other sign than its URDF, which is mended. Of the other arms the first seconds are fitted and the rest is predicted.
"""

import itertools
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import study
from dynid import IdentifyOptions, Log, Robot, identify, load_log, load_robot, validate
from dynid.errors import DynidError
from dynid.estimation.least_squares import relative_error
from dynid.robot import DriverSpec, JointMap
from dynid.signals.columns import take_samples
from dynid.workflows.parameters import observe
from runner import rows

#: Robot, recording, and the seconds that are fitted.
PARTS = """
ur10         | ur10_salerno/exc.npz  | 18 13 9
staubli_tx40 | tx40/exc.npz          | 5 3.5 2.5
franka_panda | panda_salerno/exc.npz | 16 13 10
"""
#: Share of the prior's variance from which on a parameter comes from the data.
DOMINATED = 0.9
RUNS = ((1,), (2,), (3,), (1, 2), (1, 3), (2, 3))


@dataclass(frozen=True)
class Pair:
    """What is fitted and what is predicted."""

    name: str
    robot: Robot
    fitted: tuple[Log, ...]
    unseen: tuple[tuple[str, Log], ...]


@dataclass(frozen=True)
class Outcome:
    """Total relative torque errors [%] of the default, its parameters alone, the plain estimate, and least squares."""

    name: str
    in_force: str
    default: float
    alone: float
    plain: float
    expected: float
    ols: float
    wls: float


def part(log, first, last):
    """Return what a log holds between two times since its begin [s]."""
    inside = (log.t - log.t[0] >= first) & (log.t - log.t[0] < last)
    return replace(take_samples(log, np.flatnonzero(inside)), sha256="")


def pairs(data):
    """Yield all pairs of the recordings."""
    arm = load_robot("kuka_lwr4plus")
    logs = {k: load_log(data / f"kuka_lwr4plus/run{k}.bag", arm) for k in (1, 2, 3)}
    yield from several("LWR4+ run", arm, logs, RUNS)
    for robot, recording, seconds in rows(PARTS):
        arm = load_robot(robot)
        log = load_log(data / recording, arm)
        for each in seconds.split():
            yield begun(arm, log, float(each))
    arm = load_robot(data / "rokae_xmate3/rokae.yaml")
    log = load_log(data / "rokae_xmate3/joint_all.csv", arm)
    halves = {"A": part(log, 0.0, 10.0), "B": part(log, 10.0, 1e9)}
    yield from both(arm, halves)
    arm = load_robot(data / "airbot_play/airbot.urdf")
    names = "chirp", "trapezoid"
    yield from both(arm, {k: load_log(data / f"airbot_play/{k}.csv", arm) for k in names})
    arm = load_robot(data / "shanghai_cobot/shanghai.yaml")
    logs = {k: load_log(data / f"shanghai_cobot/traj{k}.csv", arm) for k in (1, 2, 3)}
    yield from several("Shanghai motion", arm, logs, RUNS[::-1])
    arm = load_robot(data / "lbr_med7/med7.urdf")
    mirrored = JointMap((1.0,) * 7, (0.0,) * 7, (-1.0,) * 7)
    arm = replace(arm, driver=DriverSpec("generic", mirrored, joint_names=arm.joint_names))
    log = load_log(data / "lbr_med7/med7.csv", arm)
    # Why 10 s: it moves for 9 s from 3.7 s on.
    yield begun(replace(arm, name="LBR Med 7"), log, 10.0)


def begun(arm, log, seconds):
    """Return a recording of which the first seconds are fitted and the rest is predicted."""
    parts = part(log, 0.0, seconds), part(log, seconds, 1e9)
    return Pair(f"{arm.name}, first {seconds:g} s", arm, parts[:1], (("the rest", parts[1]),))


def several(title, arm, logs, chosen):
    """Yield numbered recordings, some of which are fitted and the others predicted."""
    for runs in chosen:
        rest = tuple((f"{title.split()[1]} {k}", logs[k]) for k in logs if k not in runs)
        fitted = tuple(logs[k] for k in runs)
        yield Pair(f"{title} {' and '.join(map(str, runs))}", arm, fitted, rest)


def both(arm, logs):
    """Yield two recordings, each fitted and the other one predicted."""
    for (name, log), (other, unseen) in itertools.permutations(logs.items(), 2):
        yield Pair(f"{arm.name} {name}", arm, (log,), ((other, unseen),))


def least_squares(factors, weight):
    """Return least squares of rows, each joint with a weight; the shortest where rank is short."""
    W = (factors * weight[:, None, None]).reshape(-1, factors.shape[-1])
    length = np.linalg.norm(W[:, :-1], axis=0)
    length[length == 0.0] = 1.0
    return np.linalg.lstsq(W[:, :-1] / length, W[:, -1], rcond=1e-10)[0] / length


def baseline(pair, unseen, cutoff):
    """Return the errors of ordinary and weighted least squares of the filtered rows on unseen ones [%]."""
    # Each log for itself: stacking two of one file would leave one out.
    options = IdentifyOptions(cutoff=cutoff, delay=0.0)
    fitted, test = (observe(pair.robot, logs, options).stack for logs in (pair.fitted, [unseen]))
    factors, counts = fitted.factors, fitted.counts
    found = [least_squares(factors, np.ones(len(factors)))] * 2
    for _ in range(20):
        rms = np.linalg.norm(factors @ np.append(found[1], -1.0), axis=1) / np.sqrt(counts)
        found[1] = least_squares(factors, 1.0 / rms)
    return tuple(relative_error(test.factors, theta) for theta in found)


def outcomes(pair):
    """Return the errors on what was not fitted, and the default result."""
    options = IdentifyOptions(holdout=None)
    try:
        result, refused = identify(pair.robot, pair.fitted, options), ""
    except DynidError as error:
        print(f"{pair.name}: {error}", file=sys.stderr)
        options = replace(options, anyway=True)
        result, refused = identify(pair.robot, pair.fitted, options), ", --anyway"
    plain = identify(
        pair.robot, pair.fitted, replace(options, feasible=False, drop_weak=True, anyway=True)
    )
    found = []
    for name, log in pair.unseen:
        seen = validate(result, log)
        alone = validate(result, log, residual_model=False)
        other = validate(plain, log)
        errors = (each.relative_error_percent for each in (seen, alone, other))
        least = baseline(pair, log, result.cutoff)
        expected = seen.expected_percent or np.nan
        text = f"{result.method}, {result.in_force}{refused}"
        found.append(Outcome(f"{pair.name} -> {name}", text, *errors, expected, *least))
    return found, result


def from_data(result):
    """Return which base parameters' variance is mostly gone, compared with that of the prior alone, (p,)."""
    full = result.physical
    prior = full.std_error**2 / np.maximum(1.0 - full.data_share, 1e-12)
    return np.asarray(
        np.diag(result.covariance) < (1.0 - DOMINATED) * (result.reduction.K**2 @ prior)
    )


def apart(data, results):
    """Yield two results of one arm that were made from different rows."""
    for title in ("LWR4+ run", "Shanghai motion"):
        for one, two in itertools.combinations((1, 2, 3), 2):
            same = (results[f"{title} {k}"] for k in (one, two))
            yield f"{title.split()[0]} {one}, {two}", *same
    names = "rokae_xmate3/rokae.yaml", "airbot_play/airbot.urdf"
    rokae, airbot = (load_robot(data / name).name for name in names)
    yield "Rokae halves", results[f"{rokae} A"], results[f"{rokae} B"]
    yield "AIRBOT chirp, trapezoid", results[f"{airbot} chirp"], results[f"{airbot} trapezoid"]
    for robot, recording, every in rows(PARTS):
        arm, seconds = load_robot(robot), float(every.split()[1])
        log = load_log(data / recording, arm)
        try:
            halves = [
                identify(arm, part(log, a, b), holdout=None, drop_weak=True)
                for a, b in ((0, seconds), (seconds, 1e9))
            ]
        except DynidError as error:
            print(f"{arm.name} halves: {error}", file=sys.stderr)
            continue
        yield f"{arm.name} first {seconds:g} s, rest", halves[0], halves[1]


def intervals(a, b):
    """Return how many parameters agree within their errors, and the median of |z|: in force, from the data, plain."""
    cells, ours = [], from_data(a) & from_data(b)
    for theta, covariance, chosen in (
        ("theta", "covariance", slice(None)),
        ("theta", "covariance", ours),
        ("plain", "plain_covariance", slice(None)),
    ):
        spread = np.diag(getattr(a, covariance)) + np.diag(getattr(b, covariance))
        z = (np.abs(getattr(a, theta) - getattr(b, theta)) / np.sqrt(spread))[chosen]
        z = z[np.isfinite(z)]
        cells.append(
            f"{np.sum(z < 1.96)} of {len(z)} = {100 * np.mean(z < 1.96):.0f} %, {np.median(z):.2f}"
        )
    return cells


def main():
    """Print the table."""
    data = Path(sys.argv[1])
    results, every, refused = {}, [], []
    for pair in pairs(data):
        try:
            found, results[pair.name] = outcomes(pair)
            every += found
        except DynidError as error:
            refused.append(f"\nRefused: {pair.name}: {error}.")
    ratio = np.array([o.default / o.expected for o in every])
    within, wide = (100 * np.mean((ratio < 1.5) & (ratio > low)) for low in (1 / 1.5, 0.5))
    lines = []
    for o, over in zip(every, ratio, strict=True):
        figures = (o.default, o.alone, o.plain, o.ols, o.wls, o.expected, over)
        lines.append([o.name, o.in_force, *(f"{x:.2f}" for x in figures)])
    head = "pair | in force | default | parameters alone | plain | OLS | WLS | expected"
    print(f"""\
# Recordings of real arms

Total relative torque error on what was not fitted [%]. OLS and WLS are least
squares of the filtered rows, without anything else.

{study.markdown(f"{head} | true / expected", lines)}
{"".join(refused)}
True over expected error: median {np.median(ratio):.2f}, {within:.0f} % within a factor of 1.5,
{wide:.0f} % between 0.5 and 1.5.

Parameters that agree between two recordings within 1.96 combined standard errors, and median |z|.
Those count as from the data of which both runs took {100 * DOMINATED:.0f} % of the prior's variance.
""")
    lines = [[name, *intervals(a, b)] for name, a, b in apart(data, results)]
    print(study.markdown("recordings | in force | from the data | plain", lines))


if __name__ == "__main__":
    main()
