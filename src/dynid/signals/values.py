"""Checks of single columns: not a number, degrees, full turns, torque scale, flat tops, repeated samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, NotFinite, PositionInDegrees, TorqueScale, WrongMessageType
from dynid.log import Log
from dynid.longarrays import empty, spans
from dynid.model.rough_weight import expected_torque
from dynid.robot import Joint, Robot
from dynid.signals.columns import in_amperes, to_dh, units
from dynid.signals.motion import STILL_SPAN, any_moves, per_joint, rest_slices, runs, speeds
from dynid.signals.pieces import changed, extremes
from dynid.signals.stamps import same_rows, with_findings

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
#: No sensor reads more in any unit, and none of torques so little; a flipped bit in a bag, which carries no checksum,
#: does.
LARGEST, LEAST_TORQUE = 1e9, 1e-9
#: A percentile of speeds needs no more samples than this.
SPEED_SAMPLES = 100_000
#: Bad samples closer than this [s] go into one --exclude; more intervals than MOST_INTERVALS into one for all.
TOGETHER = 0.2
MOST_INTERVALS = 4
_MARGIN = 0.001
#: A joint carries no weight when its expected torque is below this share of the largest of any joint.
UNLOADED = 0.02
#: Torque sensors of healthy arms are zero within 1 % of the rating; three times that is worth zeroing.
ZERO_SHARE = 0.03


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
    if all(measurable(values[part]).all() for values in columns.values() for part in spans(len(log))):
        return
    bad = np.zeros(len(log), dtype=bool)
    first: tuple[int, str] | None = None
    # Why whole columns here: what cannot be used need not be quick.
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
    some = [np.abs(v[-part.start % every :: every]) for part, v in speeds(log)]
    speed = np.concatenate(some)
    place = 0.95 * (len(speed) - 1)
    low, high = int(place), min(int(place) + 1, len(speed) - 1)
    part = np.partition(speed, [low, high], axis=0)
    return np.asarray(part[low] + (place - low) * (part[high] - part[low]))


def check_degrees(log: Log, robot: Robot) -> None:
    """Raise when positions [declared rad] break the limits but would keep them as degrees; needs increasing time.

    Why: joints without position limits are judged by their speed limit.

    Raises:
        PositionInDegrees: with the line for the robot file.
    """
    if units(log, robot)["position"] != "rad":
        return
    as_is = changed(log, lambda part: to_dh(part, robot))
    fast = _usual_speed(as_is)
    wide = [joint.revolute and _beyond_range(as_is.q[:, j], joint) for j, joint in enumerate(robot.joints)]
    speed = [(joint.revolute and joint.limits.velocity) or np.inf for joint in robot.joints]
    if not any(wide) and not np.any(fast > BEYOND_SPEED * np.array(speed)):
        return
    as_degrees = changed(log, lambda part: to_dh(replace(part, q=np.radians(part.q)), robot))
    slow, ends = _usual_speed(as_degrees), np.transpose(extremes(as_degrees.q))
    for j, joint in enumerate(robot.joints):
        beyond = wide[j] and _within_range(float(ends[j, 0]), float(ends[j, 1]), joint)
        quick = fast[j] > BEYOND_SPEED * speed[j] and slow[j] <= speed[j]
        if beyond or quick:
            raise PositionInDegrees(
                f"{joint.name} position spans {np.ptp(log.q[:, j]):.1f}: degrees? {_limit_text(joint, beyond)}",
                where=log.topic,
                fix=_degrees_fix(as_is, robot),
            )


def _within_range(least: float, most: float, joint: Joint) -> bool:
    if joint.limits.position is None:
        return False
    low, high = joint.limits.position
    slack = 0.05 * (high - low)
    return least > low - slack and most < high + slack


def _beyond_range(q: Floats, joint: Joint) -> bool:
    if joint.limits.position is None:
        return False
    low, high = joint.limits.position
    (least, most), where, turns = extremes(q), *_full_turns(q)
    # Why: a joint that is read modulo a full turn jumps now and then; degrees look like turns all the time.
    if len(where) < RARE_TURNS * (len(q) - 1) and len(where):
        ends = [extremes(part) for part in np.split(q, where)]
        back = 2 * np.pi * np.concatenate([[0.0], np.cumsum(turns)])
        least, most = (f(e[k] - b for e, b in zip(ends, back, strict=True)) for k, f in enumerate((min, max)))
    return bool(most - least > BEYOND_RANGE * (high - low))


def _limit_text(joint: Joint, by_range: bool) -> str:
    if by_range and joint.limits.position is not None:
        low, high = joint.limits.position
        return f"limits are +-{high:.2f} rad" if np.isclose(-low, high) else f"limits are {low:.2f} to {high:.2f} rad"
    return f"the speed limit is {joint.limits.velocity:.2f} rad/s"


def _degrees_fix(log: Log, robot: Robot) -> str:
    """Name the velocity's unit too where it follows the position."""
    given = {"position": "deg"}
    if log.qd is not None:
        both, own = np.sum([[np.sum(log.qd[part] * v), np.sum(v * v)] for part, v in speeds(log)], axis=0)
        if 0.5 < float(both / max(own, 1e-12)) < 1.5:
            given["velocity"] = "deg/s"
    return unit_fix(robot, given)


def unit_fix(robot: Robot, given: dict[str, str]) -> str:
    """Return the sentence that says which units to declare in the robot file."""
    inner = ", ".join(f"{key}: {value}" for key, value in given.items())
    file = robot.editable
    if robot.driver is None:
        return f"add `driver: {{kind: generic, units: {{{inner}}}}}` to {file}"
    return f"add `units: {{{inner}}}` under `driver:` in {file}"


def unwrapped(log: Log, robot: Robot) -> Log:
    """Return the log without jumps by full turns (W315)."""
    found = {}
    for j, joint in enumerate(robot.joints):
        where, turns = _full_turns(log.q[:, j]) if joint.revolute else (np.zeros(0, dtype=int), np.zeros(0))
        if len(where):
            found[j] = where, 2 * np.pi * np.cumsum(turns)
    if not found:
        return log
    q, findings = empty(log.q.shape), []
    for part in spans(len(log)):
        q[part] = log.q[part]
        for j, (where, back) in found.items():
            # Unit: jumps before each sample.
            count = np.searchsorted(where, np.arange(part.start, part.stop), "right")
            q[part, j] -= np.concatenate([[0.0], back])[count]
    for j, (where, _) in found.items():
        name, row = robot.joint_names[j], int(where[0])
        more = f" and {len(where) - 1} times more" if len(where) > 1 else ""
        at, step = float(log.t[row]), float(log.q[row, j] - log.q[row - 1, j])
        text = f"{name} jumps by {step:.2f} rad at {at:.2f} s{more}; unwrapped"
        findings.append(Finding("W315", "warning", text, {"joint": name, "at_s": log.t[where].tolist()}))
    return with_findings(replace(log, q=q), *findings)


def _full_turns(q: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return the samples that a joint gets to by a jump of full turns, (k,), and the number of turns, (k,)."""
    where, found = [np.zeros(0, dtype=np.intp)], [np.zeros(0)]
    for part in spans(len(q) - 1):
        step = np.diff(q[part.start : part.stop + 1])
        if float(np.abs(step).max()) < np.pi:
            continue
        turns = np.round(step / (2 * np.pi))
        turns[np.abs(step - 2 * np.pi * turns) > TURN_REST] = 0
        some = np.flatnonzero(turns)
        where.append(some + part.start + 1)
        found.append(turns[some])
    return np.concatenate(where), np.concatenate(found)


def check_torque_scale(log: Log, robot: Robot) -> None:
    """Raise when torques are no torques of this arm.

    Raises:
        WrongMessageType: the effort of a joint that moves, or of all, is zero in every sample, or nearly.
        TorqueScale: far beyond the rating.
    """
    low, highest = extremes(log.tau)
    largest = np.maximum(-low, highest)
    if not np.any(largest >= LEAST_TORQUE):
        raise WrongMessageType(
            "effort is 0 in every sample of every joint",
            where=log.topic,
            fix="make the driver publish the joint torques",
        )
    moves = np.subtract(*extremes(log.q)[::-1]) > per_joint(STILL_SPAN, robot)
    silent = [
        joint.name for joint, is_silent in zip(robot.joints, moves & (largest < LEAST_TORQUE), strict=True) if is_silent
    ]
    if silent:
        raise WrongMessageType(
            f"effort is 0 in every sample of {', '.join(silent)}, which moves",
            where=log.topic,
            fix="make the driver publish the torques of all joints",
        )
    if in_amperes(log, robot) and log.tau_unit == "A":
        return
    for j, joint in enumerate(robot.joints):
        rating = joint.limits.torque
        if rating is None or largest[j] <= BEYOND_RATING * rating:
            continue
        # Why: a lone spike is a bad sample, not another unit.
        high = float(np.percentile(np.abs(log.tau[:, j]), 99))
        if high > BEYOND_RATING * rating:
            top = f"{largest[j]:,.0f}".replace(",", " ")
            unit = joint.torque_unit.replace(" ", "")
            guess, fix = "raw counts", "find out what the driver publishes; give the gain under `torque:`"
            if high / 1000 <= BEYOND_RATING * rating:
                guess, fix = "mNm", unit_fix(robot, {"effort": "mNm"})
            text = f"{joint.name} torque reaches {top}: {guess}? rating {rating:g} {unit}"
            raise TorqueScale(text, where=log.topic, fix=fix)


def clipped_samples(log: Log, robot: Robot) -> tuple[Flags, tuple[Finding, ...]]:
    """Return which torques sit at their largest value, (N, n), and findings W319; in the driver's columns."""
    mask = empty(log.tau.shape, bool)
    alive, flat, level = any_moves(log, robot), np.zeros(log.n, dtype=int), np.zeros(log.n)
    low, high = extremes(log.tau)
    for j in range(log.n):
        above = _flat_top(log.tau[:, j], 1.0, float(high[j]), float(low[j]), alive)
        below = _flat_top(log.tau[:, j], -1.0, float(-low[j]), float(-high[j]), alive)
        mask[:, j], flat[j] = above | below, int(np.sum(above | below))
        level[j] = max(high[j] if above.any() else 0.0, -low[j] if below.any() else 0.0)
    findings = []
    for k in np.flatnonzero(flat):
        share = float(flat[k] / len(log))
        unit = "A" if log.tau_unit == "A" else robot.joints[k].torque_unit.replace(" ", "")
        text = (
            f"{robot.joint_names[k]} torque sits at {level[k]:.4g} {unit} for {flat[k] / log.rate:.2g} s: "
            f"clipped samples are left out ({100 * share:.1f} %)"
        )
        findings.append(
            Finding("W319", "warning", text, {"joint": robot.joint_names[k], "share": share, "level": float(level[k])})
        )
    return mask, tuple(findings)


def _flat_top(x: Floats, sign: float, top: float, bottom: float, alive: Flags) -> Flags:
    """Return the samples of runs at the maximum while the arm moves, if there are suspiciously many.

    Args:
        x: torques of a joint, (N,).
        sign: -1 to look at the other end.
        top: largest of the values times the sign.
        bottom: the smallest.
        alive: at which samples the arm moves, (N,).
    """
    flat, least = np.zeros(len(x), dtype=bool), top - 1e-9 * abs(top)
    if top <= 0:
        return flat
    at_top = np.concatenate([sign * x[part] >= least for part in spans(len(x))]) & alive
    for run in runs(at_top, FLAT_RUN):
        flat[run] = True
    if not flat.any():
        return flat
    near, level, second = 0, -np.inf, 0
    for part in spans(len(x)):
        below = sign * x[part]
        below = below[below < least]
        near += int(np.sum(below > top - 0.01 * (top - bottom)))
        highest = float(below.max(initial=-np.inf))
        second = (second if highest == level else 0) + int(np.sum(below == highest)) if highest >= level else second
        level = max(level, highest)
    count = int(flat.sum())
    return flat if count >= FLAT_SHARE * second and count >= near else np.zeros(len(x), dtype=bool)


def check_repeats(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return finding W314 when many samples in motion repeat the positions before them."""
    alive = any_moves(log, robot)[1:]
    repeated = same_rows(log.q) & alive
    share = float(repeated.sum() / alive.sum()) if alive.any() else 0.0
    if share < REPEAT_SHARE:
        return ()
    fresh = log.rate * (1 - share)
    text = f"{100 * share:.0f} % of the samples in motion repeat old positions: new ones come at {fresh:.0f} Hz"
    return (Finding("W314", "warning", text, {"share": share}),)


def check_zero(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return findings W316 for joints that read a torque at rest although they carry no weight there.

    Why: only for sensors behind the gear; a motor at rest holds any torque up to its friction.
    """
    poses = rest_slices(log, robot)
    if robot.torque.source not in ("joint_sensor", "gravity_free") or log.tau_unit == "A" or not poses:
        return ()
    q, tau = (np.array([np.mean(values[part], axis=0) for part in poses]) for values in (log.q, log.tau))
    load = np.abs(expected_torque(q, robot))
    if robot.torque.source == "gravity_free":
        load = np.zeros_like(load)
    findings = []
    for j, joint in enumerate(robot.joints):
        rows = load[:, j] <= UNLOADED * max(load.max(), 1e-9)
        rating = joint.limits.torque
        if rating is None or not rows.any():
            continue
        mean = float(np.mean(tau[rows, j]))
        if abs(mean) > ZERO_SHARE * rating:
            unit = joint.torque_unit.replace(" ", "")
            text = (
                f"{joint.name} reads {mean:+.2g} {unit} with the arm at rest and gravity balanced: "
                "zero the sensors before recording"
            )
            findings.append(Finding("W316", "warning", text, {"joint": joint.name, "mean": mean}))
    return tuple(findings)
