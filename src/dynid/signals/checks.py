"""From a raw log to a clean one in DH quantities, with every check in its order.

Reads a ``Log`` as it came from disk or from arrays; gives back a ``Log`` that is ``checked``, with names and columns of
the robot, findings, and ``extra["clipped"]``, (N, n) bool. Cutting at gaps and filtering come later, in ``condition``.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import compress

import numpy as np
from numpy.typing import NDArray

from dynid.drivers.interface import driver_of
from dynid.errors import (
    Finding,
    JointNamesDiffer,
    NotFinite,
    PositionInDegrees,
    TorqueScale,
    VelocityInconsistent,
    WrongMessageType,
)
from dynid.log import Log
from dynid.model.regressor import expected_torque
from dynid.robot import Joint, Robot
from dynid.signals import tuning
from dynid.signals.columns import (
    in_amperes,
    in_si,
    joint_of_motor,
    matching_columns,
    robot_columns,
    to_dh,
    units,
)
from dynid.signals.filters import check_position_noise
from dynid.signals.motion import (
    any_moves,
    check_amount,
    moving,
    per_joint,
    rest_slices,
    runs,
    speed,
)
from dynid.signals.stamps import (
    check_gaps,
    check_rate,
    same_rows,
    with_even_clock,
    with_findings,
    with_rising_time,
    without_intervals,
    without_stale,
)

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


def prepare(
    log: Log,
    robot: Robot,
    *,
    exclude: Sequence[tuple[float, float]] = (),
    sort_time: bool = False,
    identify: bool = True,
    alone: bool = True,
) -> Log:
    """Return the log in DH quantities of the robot, checked.

    Args:
        log: as read from disk or made from arrays; of one that is checked already only ``exclude`` and ``identify``
            are looked at.
        robot: the arm, with its driver map.
        exclude: intervals to leave out, first and last time in the log's own clock [s].
        sort_time: whether samples are put in the order of their stamps.
        identify: whether the log must also move enough to identify from (E313, E401).
        alone: whether the amount of motion is judged here; of several logs their sum is.

    Returns:
        The log with the robot's columns in chain order, warnings appended to its findings. A velocity that the driver
        is known to distort is moved to ``extra["qd_reported"]``; ``extra["driver_columns"]`` has the names of the
        columns before the driver's map was applied, none where they had none.

    Raises:
        DynidError: the first serious fault, by code E303 to E401 of the catalogue.
    """
    log = without_intervals(log, exclude)
    if log.checked:
        log = robot_columns(log, robot)
        few = check_amount([log], robot) if identify and alone else ()
        return with_findings(log, *(finding for finding in few if finding not in log.findings))
    named = tuple(log.names[k] for k in matching_columns(log, robot)[0]) if log.names else ()
    in_dh = log.dh
    log = _usable_velocity(robot_columns(log, robot), robot)
    gone = np.asarray(np.isnan(log.tau).all(axis=0))
    if not gone.all():
        log = replace(log, tau=np.where(gone, 0.0, log.tau))
    log = with_rising_time(log, sort_time=sort_time)
    check_finite(log, robot)
    findings = list(check_gaps(log, exclude))
    log = without_stale(in_si(log, robot), robot)
    check_degrees(log, robot)
    flat, flat_findings = clipped_samples(log, robot, gone)
    log = with_even_clock(unwrapped(to_dh(log, robot), robot))
    check_order(log, robot)
    findings += check_slopes(log, robot)
    findings += check_ranges(log, robot)
    check_torque_scale(log, robot, gone)
    check_rate(log, robot)
    findings += check_repeats(log, robot) + check_position_noise(log, robot)
    findings += check_zero(log, robot)
    if identify and alone:
        findings += check_amount([log], robot)
    clipped = flat if robot.coupling is None else flat @ joint_of_motor(robot)
    extra = {**log.extra, "clipped": clipped}
    if not in_dh:
        extra["driver_columns"] = named
    log = replace(log, checked=True, extra=extra)
    return _trusted_velocity(with_findings(log, *findings, *flat_findings), robot)


def _usable_velocity(log: Log, robot: Robot) -> Log:
    """Drop a velocity that was never measured: all zero while positions change, or not a number throughout.

    Why: a velocity that the driver distorts anyway must not fail the log because it is not a number in places.
    """
    if log.qd is None:
        return log
    known = measurable(log.qd)
    usable = known.any() if driver_of(robot).velocity_trusted else known.all()
    still = usable and not np.any(log.qd)
    return replace(log, qd=None) if not usable or (still and not np.all(same_rows(log.q))) else log


def _trusted_velocity(log: Log, robot: Robot) -> Log:
    """Put aside a velocity that the driver is known to distort, and say so."""
    driver = driver_of(robot)
    if log.qd is None or driver.velocity_trusted:
        return log
    ratio = slopes(log, robot)
    shown = ", ".join("-" if np.isnan(value) else f"{value:.2f}" for value in ratio)
    text = (
        f"the reported velocity is not used ({driver.velocity_note}); its slope to dq/dt is {shown}"
    )
    evidence = {"slope": [None if np.isnan(value) else float(value) for value in ratio]}
    kept = [finding for finding in log.findings if finding.code != "W308"]
    log = replace(log, qd=None, extra={**log.extra, "qd_reported": log.qd}, findings=tuple(kept))
    return with_findings(log, Finding("W308", "info", text, evidence))


def measurable(values: Floats) -> Flags:
    """Return which values are finite and of a size that a sensor can read."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) < tuning.LARGEST, dtype=bool)


def check_finite(log: Log, robot: Robot) -> None:
    """Raise when a used column has values that are not numbers, with the --exclude that leaves them out.

    Raises:
        NotFinite: names joint, quantity, count, first time and row.
    """
    columns = {"position": log.q, "torque": log.tau}
    columns |= {"velocity": log.qd} if log.qd is not None else {}
    wrong = {quantity: ~measurable(x) for quantity, x in columns.items()}
    bad = np.any([flags.any(axis=1) for flags in wrong.values()], axis=0)
    if not bad.any():
        return
    row = int(np.argmax(bad))
    quantity, flags = next((key, flags) for key, flags in wrong.items() if flags[row].any())
    j = int(np.argmax(flags[row]))
    value = float(columns[quantity][row, j])
    kind = (
        "not a number"
        if np.isnan(value)
        else "infinite"
        if np.isinf(value)
        else f"{value:.0e}, not measurable,"
    )
    text = f"{robot.joint_names[j]} {quantity} is {kind} in {int(flags[:, j].sum())} samples"
    fix = (
        "record again: no sample is complete"
        if bad.all()
        else f"leave it out: {_exclude_options(log.t[bad])}"
    )
    raise NotFinite(
        f"{text}, first at t = {log.t[row]:.3f} s (row {row + 1})", where=log.topic, fix=fix
    )


def _exclude_options(t: Floats) -> str:
    parts = np.split(t, np.flatnonzero(np.diff(t) > tuning.EXCLUDED_TOGETHER_S) + 1)
    if len(parts) > tuning.MOST_INTERVALS:
        parts = [t]
    return " ".join(
        f"--exclude {max(p[0] - tuning.EXCLUDE_MARGIN_S, 0):.3f}-{p[-1] + tuning.EXCLUDE_MARGIN_S:.3f}"
        for p in parts
    )


def _usual_speed(log: Log) -> Floats:
    """Return the speed that a joint exceeds in one of twenty samples, (n,)."""
    return np.asarray(np.percentile(np.abs(speed(log)), 95, axis=0))


def check_degrees(log: Log, robot: Robot) -> None:
    """Raise when positions [declared rad] break the limits but would keep them as degrees; needs increasing time.

    Why: joints without position limits are judged by their speed limit.

    Raises:
        PositionInDegrees: with the line for the robot file.
    """
    if units(log, robot)["position"] != "rad":
        return
    as_is = to_dh(log, robot)
    fast = _usual_speed(as_is)
    wide = [
        joint.revolute and _beyond_range(as_is.q[:, j], joint)
        for j, joint in enumerate(robot.joints)
    ]
    fastest = [(joint.revolute and joint.limits.velocity) or np.inf for joint in robot.joints]
    if not any(wide) and not np.any(fast > tuning.BEYOND_SPEED * np.array(fastest)):
        return
    as_degrees = to_dh(replace(log, q=np.radians(log.q)), robot)
    slow, low, high = (
        _usual_speed(as_degrees),
        as_degrees.q.min(axis=0),
        as_degrees.q.max(axis=0),
    )
    for j, joint in enumerate(robot.joints):
        beyond = wide[j] and _within_range(float(low[j]), float(high[j]), joint)
        quick = fast[j] > tuning.BEYOND_SPEED * fastest[j] and slow[j] <= fastest[j]
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
    least, most, (where, turns) = q.min(), q.max(), _full_turns(q)
    # Why: a joint that is read modulo a full turn jumps now and then; degrees look like turns all the time.
    if len(where) < tuning.RARE_TURNS * (len(q) - 1) and len(where):
        ends = [(part.min(), part.max()) for part in np.split(q, where)]
        back = 2 * np.pi * np.concatenate([[0.0], np.cumsum(turns)])
        least, most = (
            f(e[k] - b for e, b in zip(ends, back, strict=True)) for k, f in enumerate((min, max))
        )
    return bool(most - least > tuning.BEYOND_RANGE * (high - low))


def _limit_text(joint: Joint, by_range: bool) -> str:
    if by_range and joint.limits.position is not None:
        low, high = joint.limits.position
        return (
            f"limits are +-{high:.2f} rad"
            if np.isclose(-low, high)
            else f"limits are {low:.2f} to {high:.2f} rad"
        )
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
    file = robot.editable
    if robot.driver is None:
        return f"add `driver: {{kind: generic, units: {{{inner}}}}}` to {file}"
    return f"add `units: {{{inner}}}` under `driver:` in {file}"


def unwrapped(log: Log, robot: Robot) -> Log:
    """Return the log without jumps by full turns (W315)."""
    q, findings = log.q, list[Finding]()
    for j in (j for j, joint in enumerate(robot.joints) if joint.revolute):
        where, turns = _full_turns(log.q[:, j])
        if not len(where):
            continue
        q = q if findings else q.copy()
        jumps = np.zeros(len(log))
        jumps[where] = turns
        q[:, j] -= 2 * np.pi * np.cumsum(jumps)
        name, row = robot.joint_names[j], int(where[0])
        more = f" and {len(where) - 1} times more" if len(where) > 1 else ""
        at, step = float(log.t[row]), float(log.q[row, j] - log.q[row - 1, j])
        text = f"{name} jumps by {step:.2f} rad at {at:.2f} s{more}; unwrapped"
        evidence = {"joint": name, "at_s": log.t[where].tolist()}
        findings.append(Finding("W315", "warning", text, evidence))
    return with_findings(replace(log, q=q), *findings) if findings else log


def _full_turns(q: Floats) -> tuple[NDArray[np.intp], Floats]:
    """Return the samples that a joint gets to by a jump of full turns, (k,), and the number of turns, (k,)."""
    step = np.diff(q)
    turns = np.round(step / (2 * np.pi))
    turns[np.abs(step - 2 * np.pi * turns) > tuning.TURN_REST] = 0
    where = np.flatnonzero(turns)
    return where + 1, turns[where]


def check_torque_scale(log: Log, robot: Robot, gone: Flags) -> None:
    """Raise when torques are no torques of this arm; joints without any, (n,), are known.

    Raises:
        WrongMessageType: the effort of a joint that moves, or of all, is zero in every sample, or nearly.
        TorqueScale: far beyond the rating.
    """
    largest = np.abs(log.tau).max(axis=0)
    if not np.any(largest >= tuning.LEAST_TORQUE):
        raise WrongMessageType(
            "effort is 0 in every sample of every joint",
            where=log.topic,
            fix="make the driver publish the joint torques",
        )
    moves = np.ptp(log.q, axis=0) > per_joint(tuning.STILL_SPAN, robot)
    silent = compress(robot.joint_names, moves & ~gone & (largest < tuning.LEAST_TORQUE))
    if names := ", ".join(silent):
        raise WrongMessageType(
            f"effort is 0 in every sample of {names}, which moves",
            where=log.topic,
            fix="make the driver publish the torques of all joints",
        )
    if in_amperes(log, robot) and log.tau_unit == "A":
        return
    for j, joint in enumerate(robot.joints):
        rating = joint.limits.torque
        if rating is None or largest[j] <= tuning.BEYOND_RATING * rating:
            continue
        # Why: a lone spike is a bad sample, not another unit.
        high = float(np.percentile(np.abs(log.tau[:, j]), 99))
        if high > tuning.BEYOND_RATING * rating:
            top = f"{largest[j]:,.0f}".replace(",", " ")
            unit = joint.torque_unit.replace(" ", "")
            guess, fix = (
                "raw counts",
                "find out what the driver publishes; give the gain under `torque:`",
            )
            if high / 1000 <= tuning.BEYOND_RATING * rating:
                guess, fix = "mNm", unit_fix(robot, {"effort": "mNm"})
            raise TorqueScale(
                f"{joint.name} torque reaches {top}: {guess}? rating {rating:g} {unit}",
                where=log.topic,
                fix=fix,
            )


def clipped_samples(log: Log, robot: Robot, gone: Flags) -> tuple[Flags, tuple[Finding, ...]]:
    """Return which torques are none, (N, n), and findings W319; in the driver's columns.

    They sit at their largest value, or stay at any value while their joint moves to and fro, or nobody measured them
    (``gone``, (n,)).
    """
    mask, alive, findings = np.tile(gone, (len(log), 1)), any_moves(log, robot), []
    if none := ", ".join(compress(robot.joint_names, gone)):
        text = f"the log has no torque for {none}: predicted from the other joints and the prior"
        findings.append(Finding("W319", "warning", text, {"joint": none, "share": 1.0}))
    moved = per_joint(tuning.STILL_SPAN, robot)
    for j in np.flatnonzero(~gone).tolist():
        joint, x = robot.joints[j], log.tau[:, j]
        clipped = _flat_top(x, alive) | _flat_top(-x, alive)
        stuck = _stuck(x, log.q[:, j], float(moved[j]), round(tuning.STUCK_S * log.rate)) & ~clipped
        mask[:, j] = clipped | stuck
        unit = "A" if log.tau_unit == "A" else joint.torque_unit.replace(" ", "")
        for flags, does, which in (
            (clipped, "sits at", ": clipped"),
            (stuck, "stays at", " while the joint moves to and fro: these"),
        ):
            if not flags.any():
                continue
            share, some = float(np.mean(flags)), x[flags]
            level = float(some[0] if flags is stuck else np.abs(some).max())
            size = f"{level:.4g} {unit} for {len(some) / log.rate:.2g} s"
            text = f"{joint.name} torque {does} {size}{which} samples are left out ({100 * share:.1f} %)"
            evidence = {"joint": joint.name, "share": share, "level": level}
            findings.append(Finding("W319", "warning", text, evidence))
    return mask, tuple(findings)


def _stuck(x: Floats, q: Floats, moved: float, least: int) -> Flags:
    """Return the samples of a torque that does not change at all while its joint moves one way and back.

    Args:
        x: torques of a joint, (N,).
        q: its positions, (N,).
        moved: a path that counts as motion [rad or m].
        least: so many samples without any change are more than friction, gravity and noise allow.
    """
    same = np.append(same_rows(x[:, None]), False)
    found = np.zeros(len(x), dtype=bool)
    for run in runs(same, least):
        some = q[run]
        there = np.maximum.accumulate(some) - some, some - np.minimum.accumulate(some)
        if min(float(way.max()) for way in there) > moved:
            found[run.start : run.stop + 1] = True
    # Why: a coarse torque stays the same for long as well.
    coarse = np.sum(same & ~found) >= tuning.STUCK_OTHERS * np.sum(~found)
    return np.zeros(len(x), dtype=bool) if coarse and not found.all() else found


def _flat_top(x: Floats, alive: Flags) -> Flags:
    """Return the samples of runs at the maximum while the arm moves, if there are suspiciously many.

    Args:
        x: torques of a joint, (N,).
        alive: at which samples the arm moves, (N,).
    """
    top, bottom, flat = float(x.max()), float(x.min()), np.zeros(len(x), dtype=bool)
    least = top - 1e-9 * abs(top)
    for run in runs((x >= least) & alive & (top > 0), tuning.FLAT_RUN):
        flat[run] = True
    if not flat.any():
        return flat
    below = x[x < least]
    near = int(np.sum(below > top - 0.01 * (top - bottom)))
    second = int(np.sum(below == below.max(initial=-np.inf)))
    count = int(flat.sum())
    return flat & (count >= max(tuning.FLAT_SHARE * second, near))


def check_repeats(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return finding W314 when many samples in motion repeat the positions before them."""
    alive = any_moves(log, robot)[1:]
    repeated = same_rows(log.q) & alive
    share = float(repeated.sum() / alive.sum()) if alive.any() else 0.0
    if share < tuning.REPEAT_SHARE:
        return ()
    new = log.rate * (1 - share)
    return (
        Finding(
            "W314",
            "warning",
            f"{100 * share:.0f} % of the samples in motion repeat old positions: new ones come at {new:.0f} Hz",
            {"share": share},
        ),
    )


def check_zero(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return findings W316 for joints that read a torque at rest although they carry no weight there.

    Why: only for sensors behind the gear; a motor at rest holds any torque up to its friction.
    """
    poses = rest_slices(log, robot)
    if (
        robot.torque.source not in ("joint_sensor", "unknown", "gravity_free")
        or log.tau_unit == "A"
        or not poses
    ):
        return ()
    q, tau = (
        np.array([np.mean(values[part], axis=0) for part in poses]) for values in (log.q, log.tau)
    )
    load = np.abs(expected_torque(q, robot))
    if robot.torque.source == "gravity_free":
        load = np.zeros_like(load)
    findings = []
    for j, joint in enumerate(robot.joints):
        rows = load[:, j] <= tuning.UNLOADED * max(load.max(), 1e-9)
        rating = joint.limits.torque
        if rating is None or not rows.any():
            continue
        mean = float(np.mean(tau[rows, j]))
        if abs(mean) > tuning.ZERO_SHARE * rating:
            unit = joint.torque_unit.replace(" ", "")
            text = (
                f"{joint.name} reads {mean:+.2g} {unit} with the arm at rest and gravity balanced: "
                "zero the sensors before recording"
            )
            findings.append(Finding("W316", "warning", text, {"joint": joint.name, "mean": mean}))
    return tuple(findings)


def slopes(log: Log, robot: Robot) -> Floats:
    """Return the slope of measured velocity on the change of position, (n,); NaN for a joint that does not move."""
    if log.qd is None:
        return np.full(robot.n, np.nan)
    v = speed(log)
    alive = np.abs(v) > per_joint(tuning.MOVING_SPEED, robot)
    v[~alive] = 0.0
    both, own = (np.einsum("ij,ij->j", v, x) for x in (log.qd, v))
    enough = alive.sum(axis=0) >= tuning.LEAST_SAMPLES
    return np.where(enough, both / np.where(own > 0.0, own, 1.0), np.nan)


def check_order(log: Log, robot: Robot) -> None:
    """Raise when velocity columns follow the positions of other joints.

    Why: one wrong pair may correlate by chance, so the best assignment of all columns decides.

    Raises:
        JointNamesDiffer: names the joints that look swapped.
    """
    if log.qd is None:
        return
    rows = moving(log, robot).sum(axis=0)
    joints = np.flatnonzero((rows >= tuning.LEAST_SAMPLES) & (np.ptp(log.qd, axis=0) > 0.0))
    if len(joints) < 2:
        return
    k = len(joints)
    # Why: a reversed sign is another mistake (E308), so it must not look like a wrong column.
    likeness = np.abs(_correlation(log, joints))
    if np.all(np.diag(likeness) >= tuning.WRONG_COLUMN):
        return
    from scipy.optimize import linear_sum_assignment

    best = linear_sum_assignment(-likeness)[1]
    for i in np.flatnonzero(best != np.arange(k)):
        labelled, swapped = float(likeness[i, i]), float(likeness[i, best[i]])
        if swapped > tuning.WRONG_COLUMN > labelled:
            one, other = robot.joint_names[joints[i]], robot.joint_names[joints[best[i]]]
            raise JointNamesDiffer(
                f"{one} and {other} look swapped (correlation {swapped:.2f} swapped, {labelled:.2f} as labelled)",
                where=log.topic,
                why="the velocity column of one joint follows the position of the other",
                fix="correct the columns of the log; if only the velocities are swapped: --velocity derived",
            )


def _correlation(log: Log, joints: NDArray[np.intp]) -> Floats:
    """Return how the change of position of each joint correlates with the measured velocity of each, (k, k)."""
    assert log.qd is not None
    v, qd = speed(log), log.qd
    covariance = v.T @ qd / len(log) - np.outer(v.mean(axis=0), qd.mean(axis=0))
    size = np.outer(v.std(axis=0)[joints], qd.std(axis=0)[joints])
    return np.asarray(covariance[np.ix_(joints, joints)] / size)


def check_slopes(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return finding W308 for velocities that agree only roughly with the change of position.

    Raises:
        VelocityInconsistent: unit or sign is wrong.
    """
    findings = []
    for joint, slope in zip(robot.joints, slopes(log, robot), strict=True):
        if np.isnan(slope) or tuning.SLOPE_AGREES[0] <= slope <= tuning.SLOPE_AGREES[1]:
            continue
        if joint.revolute:
            _check_unit(joint.name, float(slope), log, robot)
        if tuning.SLOPE_REVERSED[0] <= slope <= tuning.SLOPE_REVERSED[1]:
            raise VelocityInconsistent(
                f"{joint.name} velocity has the opposite sign (slope {slope:.2f} to the change of position)",
                where=log.topic,
                fix="correct the sign of the velocity or of the position in the log, or use --velocity derived",
            )
        text = f"{joint.name} velocity is {slope:.2f} x the change of position; --velocity derived is better"
        findings.append(
            Finding("W308", "warning", text, {"joint": joint.name, "slope": float(slope)})
        )
    return tuple(findings)


def _check_unit(name: str, slope: float, log: Log, robot: Robot) -> None:
    declared = units(log, robot)["velocity"]
    text = f"{name} velocity is {slope:.3g} x the change of position"
    if tuning.SLOPE_DEGREES[0] <= abs(slope) <= tuning.SLOPE_DEGREES[1]:
        raise VelocityInconsistent(f"{text}: deg/s", where=log.topic, fix=_fix(robot, "deg/s"))
    if tuning.SLOPE_RADIANS[0] <= abs(slope) <= tuning.SLOPE_RADIANS[1]:
        right = "rad/s" if declared == "deg/s" else ""
        fix = (
            _fix(robot, right)
            if right
            else "are positions in degrees? declare `units:` under `driver:` in the robot file"
        )
        raise VelocityInconsistent(
            f"{text}: rad/s, while positions are in degrees?", where=log.topic, fix=fix
        )


def _fix(robot: Robot, unit: str) -> str:
    return f"{unit_fix(robot, {'velocity': unit})}, or use --velocity derived"


def beyond(joint: Joint, low: float, high: float) -> float:
    """Return how far a joint that moves from ``low`` to ``high`` leaves its limits [rad or m], but for full turns."""
    if joint.limits.position is None:
        return 0.0
    least, most = joint.limits.position
    if joint.revolute:
        turns = 2 * math.pi * round((least + most - low - high) / (4 * math.pi))
        low, high = low + turns, high + turns
    return float(max(0.0, least - low, high - most))


def check_ranges(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return findings W332, one for each joint of a log in DH quantities that moves beyond its limits."""
    findings = []
    for joint, low, high in zip(robot.joints, log.q.min(axis=0), log.q.max(axis=0), strict=True):
        too_far = beyond(joint, float(low), float(high))
        if too_far <= tuning.BEYOND_LIMITS:
            continue
        unit, factor = ("deg", math.degrees(1.0)) if joint.revolute else ("m", 1.0)
        least, most = joint.limits.position or (0.0, 0.0)
        quarters = (90, -90, 180) if joint.revolute else ()
        fits = [
            q for q in quarters if not beyond(joint, *(np.array([low, high]) + math.radians(q)))
        ]
        text = (
            f"{joint.name} moves from {factor * low:.3g} to {factor * high:.3g} {unit}, {factor * too_far:.3g} {unit} "
            f"beyond its limits ({factor * least:.4g} to {factor * most:.4g}): its offset or these limits are wrong"
        )
        text += (
            f"; an offset of {' or '.join(f'{q:+d}' for q in fits)} deg would fit" if fits else ""
        )
        findings.append(Finding("W332", "warning", text, {"joint": joint.name, "beyond": too_far}))
    return tuple(findings)
