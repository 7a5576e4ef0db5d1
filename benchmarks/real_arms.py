"""Recordings of real arms: what a result predicts on rows and motions that it has not seen, and what it said beforehand.

PYTHONPATH=src python benchmarks/real_arms.py ../shared/data > benchmarks/real_arms.md

The recordings are not part of the project. LWR4+: runs 1 and 2 have the same command, run 3 another one. Of the other
arms the first seconds are fitted and the rest is predicted.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynid import IdentifyOptions, Log, Robot, identify, load_log, load_robot, validate
from dynid.errors import DynidError
from dynid.estimation.result import Identification
from dynid.workflows.validate import ValidateOptions

#: Robot, recording, and the seconds that are fitted.
PARTS = (
    ("ur10", "ur10_salerno/exc.npz", 18.0), ("ur10", "ur10_salerno/exc.npz", 13.0), ("ur10", "ur10_salerno/exc.npz", 9.0),
    ("staubli_tx40", "tx40/exc.npz", 5.0), ("staubli_tx40", "tx40/exc.npz", 3.5), ("staubli_tx40", "tx40/exc.npz", 2.5),
    ("franka_panda", "panda_salerno/exc.npz", 16.0), ("franka_panda", "panda_salerno/exc.npz", 13.0),
    ("franka_panda", "panda_salerno/exc.npz", 10.0),
)  # fmt: skip
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
    """Total relative torque errors [%] of the default, of its parameters alone and of the plain estimate."""

    name: str
    in_force: str
    default: float
    alone: float
    plain: float
    expected: float


def part(log: Log, first: float, last: float) -> Log:
    """Return what a log holds between two times since its begin [s]."""
    inside = (log.t - log.t[0] >= first) & (log.t - log.t[0] < last)
    extra = {key: value[inside] if np.shape(value)[:1] == log.t.shape else value for key, value in log.extra.items()}
    qd = None if log.qd is None else log.qd[inside]
    return replace(log, t=log.t[inside], q=log.q[inside], tau=log.tau[inside], qd=qd, extra=extra)


def pairs(data: Path) -> Iterator[Pair]:
    """Yield all pairs of the recordings."""
    arm = load_robot("kuka_lwr4plus")
    logs = {k: load_log(data / f"kuka_lwr4plus/run{k}.bag", arm) for k in (1, 2, 3)}
    for runs in RUNS:
        rest = tuple((f"run {k}", logs[k]) for k in logs if k not in runs)
        yield Pair(f"LWR4+ run {' and '.join(map(str, runs))}", arm, tuple(logs[k] for k in runs), rest)
    for robot, recording, seconds in PARTS:
        arm = load_robot(robot)
        log = load_log(data / recording, arm)
        rest = (("the rest", replace(part(log, seconds, 1e9), sha256="")),)
        yield Pair(f"{arm.name}, first {seconds:g} s", arm, (part(log, 0.0, seconds),), rest)


def outcomes(pair: Pair) -> tuple[list[Outcome], Identification]:
    """Return the errors on what was not fitted, and the default result."""
    options = IdentifyOptions(holdout=None)
    result = identify(pair.robot, pair.fitted, options)
    plain = identify(pair.robot, pair.fitted, replace(options, feasible=False, drop_weak=True))
    found = []
    for name, log in pair.unseen:
        seen = validate(result, log)
        alone = validate(result, log, ValidateOptions(residual_model=False))
        other = validate(plain, log)
        errors = (each.relative_error_percent for each in (seen, alone, other))
        found.append(Outcome(f"{pair.name} -> {name}", result.in_force, *errors, seen.expected_percent or np.nan))
    return found, result


def from_data(result: Identification) -> np.ndarray:
    """Return which base parameters' variance is mostly gone, compared with that of the prior alone, (p,)."""
    full = result.physical
    prior = full.std_error**2 / np.maximum(1.0 - full.data_share, 1e-12)
    return np.asarray(np.diag(result.covariance) < (1.0 - DOMINATED) * (result.reduction.K**2 @ prior))


def main() -> None:
    """Print the table."""
    results: dict[str, Identification] = {}
    every, refused = [], []
    for pair in pairs(Path(sys.argv[1])):
        try:
            found, results[pair.name] = outcomes(pair)
        except DynidError as error:
            refused.append(f"{pair.name}: {error}")
            continue
        every += found
    print("# Recordings of real arms\n\nTotal relative torque error on what was not fitted [%].\n")
    print(
        "| pair | in force | default | parameters alone | plain | expected | true / expected |\n| - | - | - | - | - | - | - |"
    )
    for o in every:
        figures = (o.default, o.alone, o.plain, o.expected, o.default / o.expected)
        print(f"| {o.name} | {o.in_force} | " + " | ".join(f"{x:.2f}" for x in figures) + " |")
    for line in refused:
        print(f"\nRefused: {line}.")
    ratio = np.array([o.default / o.expected for o in every])
    within = np.mean((ratio < 1.5) & (ratio > 1 / 1.5))
    print(f"\nTrue over expected error: median {np.median(ratio):.2f}, {100 * within:.0f} % within a factor of 1.5.\n")
    print("Parameters that agree between runs of the LWR4+ within 1.96 combined standard errors, and median |z|.")
    print(f"Those count as from the data of which both runs took {100 * DOMINATED:.0f} % of the prior's variance.\n")
    print("| runs | posterior | from the data | plain |\n| - | - | - | - |")
    for one, two in itertools.combinations((1, 2, 3), 2):
        a, b = (results[f"LWR4+ run {k}"] for k in (one, two))
        cells, ours = [], from_data(a) & from_data(b)
        for theta, covariance, chosen in (
            ("theta", "covariance", slice(None)),
            ("theta", "covariance", ours),
            ("plain", "plain_covariance", slice(None)),
        ):
            spread = np.diag(getattr(a, covariance)) + np.diag(getattr(b, covariance))
            z = (np.abs(getattr(a, theta) - getattr(b, theta)) / np.sqrt(spread))[chosen]
            cells.append(f"{np.sum(z < 1.96)} of {len(z)}, {np.median(z):.2f}")
        print(f"| {one}, {two} | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
