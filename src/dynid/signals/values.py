"""Checks of single columns: not a number, degrees, full turns, torque scale, flat tops, repeated samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, NotFinite, PositionInDegrees, TorqueScale, WrongMessageType
from dynid.log import Log
from dynid.robot import Joint, Robot
from dynid.signals.columns import in_amperes, to_dh, units
from dynid.signals.motion import moving, per_joint, runs, speed
from dynid.signals.stamps import with_findings

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

#: An arm may overrun its limits a little; degrees overrun them 57 times.
BEYOND_RANGE = 1.2
BEYOND_SPEED = 3.0
#: Torque sensors go to about 1.5 times the rating before they saturate; three times it is another unit.
BEYOND_RATING = 3.0
#: A jump by a full turn is recognised when what is left of it is below this [rad].
TURN_REST = 0.5
#: Share of steps below which jumps by full turns are taken for what they are.
RARE_TURNS = 0.01
#: So many equal samples in a row at the largest value are a flat top: a motion passes its peak in one or two.
FLAT_RUN = 5
#: At a flat top the largest value is this many times as frequent as the next one; at a quantised peak 1.4 times.
FLAT_SHARE = 3.0
#: Above this share of repeated samples in motion the driver publishes faster than it reads.
REPEAT_SHARE = 0.2
#: Noise of the positions beyond which it also scatters the regressor [rad, m]: with 1e-4 rad of white noise 93 % of the
#: true parameters lie within two standard errors, with 2e-3 rad 84 % (benchmarks/odd_noise.md).
POSITION_NOISE = (1e-3, 1e-4)
#: What third differences make of white noise of unit variance: sqrt(1 + 9 + 9 + 1).
_THIRD = 20**0.5
#: No sensor reads more in any unit; a flipped bit in a bag, which carries no checksum, does.
LARGEST = 1e9
#: A percentile of speeds needs no more samples than this.
SPEED_SAMPLES = 100_000
#: Bad samples closer than this [s] go into one --exclude; more intervals than MOST_INTERVALS into one for all.
TOGETHER = 0.2
MOST_INTERVALS = 4
_MARGIN = 0.001


def measurable(values: Floats) -> Flags:
    """Return which values are finite and of a size that a sensor can read."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) < LARGEST, dtype=bool)


def check_finite(log: Log, robot: Robot) -> None:
    """Raise when a used column has values that are not numbers, with the --exclude that leaves them out.

    Raises:
        NotFinite: names joint, quantity, count, first time and row.
    """
    columns = {"position": log.q, "torque": log.tau} | ({"velocity": log.qd} if log.qd is not None else {})
    bad = np.zeros(len(log), dtype=bool)
    first: tuple[int, str] | None = None
    for quantity, values in columns.items():
        wrong = ~measurable(values)
        bad |= wrong.any(axis=1)
        for j in np.flatnonzero(wrong.any(axis=0)):
            row = int(np.flatnonzero(wrong[:, j])[0])
            value = float(values[row, j])
            kind = (
                "not a number"
                if np.isnan(value)
                else "infinite"
                if np.isinf(value)
                else f"{value:.0e}, not measurable,"
            )
            count = int(wrong[:, j].sum())
            text = f"{robot.joint_names[j]} {quantity} is {kind} in {count} samples"
            if first is None or row < first[0]:
                first = (row, text)
    if first is None:
        return
    row, text = first
    fix = "record again; no sample is whole" if bad.all() else f"leave it out: {_exclude_options(log.t[bad])}"
    raise NotFinite(f"{text}, first at t = {log.t[row]:.3f} s (row {row + 1})", where=log.topic, fix=fix)


def _exclude_options(t: Floats) -> str:
    parts = np.split(t, np.flatnonzero(np.diff(t) > TOGETHER) + 1)
    if len(parts) > MOST_INTERVALS:
        parts = [t]
    return " ".join(f"--exclude {max(p[0] - _MARGIN, 0):.3f}-{p[-1] + _MARGIN:.3f}" for p in parts)


def _usual_speed(log: Log) -> Floats:
    """Return the speed that a joint exceeds in one of twenty samples, (n,)."""
    every = max(1, len(log) // SPEED_SAMPLES)
    return np.asarray(np.percentile(np.abs(speed(log)[::every]), 95, axis=0))


def check_degrees(log: Log, robot: Robot) -> None:
    """Raise when positions [declared rad] break the limits but would keep them as degrees; needs increasing time.

    Why: joints without position limits are judged by their speed limit.

    Raises:
        PositionInDegrees: with the line for the robot file.
    """
    as_is = to_dh(log, robot)
    if units(log, robot)["position"] != "rad":
        return
    as_degrees = to_dh(replace(log, q=np.radians(log.q)), robot)
    fast, slow = (_usual_speed(each) for each in (as_is, as_degrees))
    for j, joint in enumerate(robot.joints):
        if not joint.revolute:
            continue
        beyond = _beyond_range(as_is.q[:, j], as_degrees.q[:, j], joint)
        limit = joint.limits.velocity
        quick = limit is not None and fast[j] > BEYOND_SPEED * limit and slow[j] <= limit
        if beyond or quick:
            raise PositionInDegrees(
                f"{joint.name} position spans {np.ptp(log.q[:, j]):.1f}: degrees? {_limit_text(joint, beyond)}",
                where=log.topic,
                fix=_degrees_fix(as_is, robot),
            )


def _beyond_range(q: Floats, in_degrees: Floats, joint: Joint) -> bool:
    if joint.limits.position is None:
        return False
    low, high = joint.limits.position
    slack = 0.05 * (high - low)
    turns = _full_turns(q)
    # Why: a joint that is read modulo a full turn jumps now and then; degrees look like turns all the time.
    if np.mean(turns != 0) < RARE_TURNS:
        q = q - 2 * np.pi * np.concatenate([[0.0], np.cumsum(turns)])
    outside = np.ptp(q) > BEYOND_RANGE * (high - low)
    return bool(outside and in_degrees.min() > low - slack and in_degrees.max() < high + slack)


def _limit_text(joint: Joint, by_range: bool) -> str:
    if by_range and joint.limits.position is not None:
        low, high = joint.limits.position
        return f"limits are +-{high:.2f} rad" if np.isclose(-low, high) else f"limits are {low:.2f} to {high:.2f} rad"
    return f"the speed limit is {joint.limits.velocity:.2f} rad/s"


def _degrees_fix(log: Log, robot: Robot) -> str:
    """Name the velocity's unit too where it follows the position."""
    given = {"position": "deg"}
    if log.qd is not None:
        v = speed(log)
        if 0.5 < float(np.sum(log.qd * v) / max(np.sum(v * v), 1e-12)) < 1.5:
            given["velocity"] = "deg/s"
    return unit_fix(robot, given)


def unit_fix(robot: Robot, given: dict[str, str]) -> str:
    """Return the sentence that says which units to declare in the robot file."""
    inner = ", ".join(f"{key}: {value}" for key, value in given.items())
    file = robot.path or "the robot file"
    if robot.driver is None:
        return f"add `driver: {{kind: generic, units: {{{inner}}}}}` to {file}"
    return f"add `units: {{{inner}}}` under `driver:` in {file}"


def unwrapped(log: Log, robot: Robot) -> Log:
    """Return the log without jumps by full turns (W315)."""
    q = log.q.copy()
    findings = []
    for j, joint in enumerate(robot.joints):
        if not joint.revolute:
            continue
        step, turns = np.diff(q[:, j]), _full_turns(q[:, j])
        where = np.flatnonzero(turns)
        if len(where):
            q[1:, j] -= 2 * np.pi * np.cumsum(turns)
            more = f" and {len(where) - 1} times more" if len(where) > 1 else ""
            at = float(log.t[where[0] + 1])
            text = f"{joint.name} jumps by {step[where[0]]:.2f} rad at {at:.2f} s{more}; unwrapped"
            findings.append(Finding("W315", "warning", text, {"joint": joint.name, "at_s": log.t[where + 1].tolist()}))
    return with_findings(replace(log, q=q), *findings)


def _full_turns(q: Floats) -> Floats:
    """Return how many full turns each step of a joint jumps by, (N - 1,)."""
    step = np.diff(q)
    turns = np.round(step / (2 * np.pi))
    turns[np.abs(step - 2 * np.pi * turns) > TURN_REST] = 0
    return turns


def check_torque_scale(log: Log, robot: Robot) -> None:
    """Raise when torques are no torques of this arm.

    Raises:
        WrongMessageType: the effort is zero in every sample.
        TorqueScale: far beyond the rating.
    """
    if not np.any(log.tau):
        raise WrongMessageType(
            "effort is 0 in every sample of every joint",
            where=log.topic,
            fix="make the driver publish the joint torques",
        )
    if in_amperes(log, robot) and log.tau_unit == "A":
        return
    for j, joint in enumerate(robot.joints):
        rating = joint.limits.torque
        if rating is None:
            continue
        # Why: a lone spike is a bad sample, not another unit.
        high = float(np.percentile(np.abs(log.tau[:, j]), 99))
        if high > BEYOND_RATING * rating:
            top = f"{np.max(np.abs(log.tau[:, j])):,.0f}".replace(",", " ")
            unit = joint.torque_unit.replace(" ", "")
            guess, fix = "raw counts", "find out what the driver publishes; give the gain under `torque:`"
            if high / 1000 <= BEYOND_RATING * rating:
                guess, fix = "mNm", unit_fix(robot, {"effort": "mNm"})
            text = f"{joint.name} torque reaches {top}: {guess}? rating {rating:g} {unit}"
            raise TorqueScale(text, where=log.topic, fix=fix)


def clipped_samples(log: Log, robot: Robot) -> tuple[Flags, tuple[Finding, ...]]:
    """Return which torques sit at their largest value, (N, n), and findings W319; in the driver's columns."""
    mask = np.zeros(log.tau.shape, dtype=bool)
    alive: Flags = np.asarray(moving(log, robot).any(axis=1))
    for j in range(log.tau.shape[1]):
        for sign in (1.0, -1.0):
            mask[:, j] |= _flat_top(sign * log.tau[:, j], alive)
    findings = []
    for k in np.flatnonzero(mask.any(axis=0)):
        share = float(np.mean(mask[:, k]))
        level = float(np.max(np.abs(log.tau[mask[:, k], k])))
        unit = "A" if log.tau_unit == "A" else robot.joints[k].torque_unit.replace(" ", "")
        text = (
            f"{robot.joint_names[k]} torque sits at {level:.4g} {unit} for {mask[:, k].sum() / log.rate:.2g} s: "
            f"clipped samples are left out ({100 * share:.1f} %)"
        )
        findings.append(
            Finding("W319", "warning", text, {"joint": robot.joint_names[k], "share": share, "level": level})
        )
    return mask, tuple(findings)


def _flat_top(values: Floats, alive: Flags) -> Flags:
    """Return the samples of runs at the maximum while the arm moves, if there are suspiciously many."""
    top = float(values.max())
    if top <= 0:
        return np.zeros(len(values), dtype=bool)
    at_top = (values >= top - 1e-9 * abs(top)) & alive
    flat = np.zeros(len(values), dtype=bool)
    for run in runs(at_top, FLAT_RUN):
        flat[run] = True
    if not flat.any():
        return flat
    below = values[values < top - 1e-9 * abs(top)]
    second = int(np.sum(below == below.max())) if len(below) else 0
    near = int(np.sum(below > top - 0.01 * np.ptp(values)))
    count = int(flat.sum())
    return flat if count >= FLAT_SHARE * second and count >= near else np.zeros(len(values), dtype=bool)


def check_repeats(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return finding W314 when many samples in motion repeat the positions before them."""
    alive: Flags = np.asarray(moving(log, robot).any(axis=1))[1:]
    repeated = np.all(np.diff(log.q, axis=0) == 0, axis=1) & alive
    share = float(repeated.sum() / alive.sum()) if alive.any() else 0.0
    if share < REPEAT_SHARE:
        return ()
    fresh = log.rate * (1 - share)
    text = f"{100 * share:.0f} % of the samples in motion repeat old positions: new ones come at {fresh:.0f} Hz"
    return (Finding("W314", "warning", text, {"share": share}),)


def check_position_noise(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return finding W327 when positions scatter so much that the intervals of the parameters are too narrow.

    Why: least squares takes the regressor for exact; noise of the positions biases it, and no interval knows.
    """
    noise = np.median(np.abs(np.diff(log.q, 3, axis=0)), axis=0) * 1.4826 / _THIRD
    bad = np.flatnonzero(noise > per_joint(POSITION_NOISE, robot))
    if not len(bad) or "q_ref" in log.extra:
        return ()
    k = int(bad[np.argmax(noise[bad])])
    unit = "rad" if robot.joints[k].revolute else "m"
    text = (
        f"{robot.joint_names[k]} position scatters by {noise[k]:.1g} {unit}: parameters are biased by it and their "
        "intervals are too narrow; record the commanded positions too (--method iv), or use a finer encoder"
    )
    return (Finding("W327", "warning", text, {"noise": noise.tolist()}),)
