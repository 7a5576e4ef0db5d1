"""From a raw log to a clean one in DH quantities, with every check in its order.

Reads a ``Log`` as it came from disk or from arrays; gives back a ``Log`` that is ``checked``, with names and columns of
the robot, findings, and ``extra["clipped"]``, (N, n) bool. Cutting at gaps and filtering come later, in ``condition``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import compress
from typing import Any

import numpy as np

from dynid.arrays import Floats, Mask
from dynid.drivers.interface import driver_of
from dynid.errors import (
    Finding,
    JointNamesDiffer,
    NotFinite,
    PositionInDegrees,
    TorqueScale,
    VelocityInconsistent,
    WrongMessageType,
    located,
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
from dynid.signals.filters import check_position_noise, check_rate
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
    same_rows,
    with_even_clock,
    with_findings,
    with_rising_time,
    without_intervals,
    without_stale,
)


def prepare(
    log: Log,
    robot: Robot,
    *,
    exclude: Sequence[tuple[float, float]] = (),
    sort_time: bool = False,
    identify: bool = True,
) -> Log:
    """Return the log in DH quantities of the robot, checked.

    Args:
        log: as read from disk or made from arrays; of one that is checked already only ``exclude`` and ``identify``
            are looked at.
        robot: the arm, with its driver map.
        exclude: intervals to leave out, first and last time in the log's own clock [s].
        sort_time: whether samples are put in the order of their stamps.
        identify: whether the log must also move enough to identify from (E313, E401); of several logs all together
            must.

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
        few = check_amount([log], robot) if identify else ()
        return with_findings(log, *(finding for finding in few if finding not in log.findings))
    with located(log.topic):
        named = tuple(log.names[k] for k in matching_columns(log, robot)) if log.names else ()
        in_dh = log.dh
        log = _usable_velocity(robot_columns(log, robot), robot)
        gone = np.asarray(np.isnan(log.tau).all(axis=0))
        if gone.any() and not gone.all():
            log = replace(log, tau=np.where(gone, 0.0, log.tau))
        log = with_rising_time(log, sort_time=sort_time)
        check_finite(log, robot)
        findings = [*check_gaps(log, exclude)]
        log = without_stale(in_si(log, robot), robot)
        moved = unwrapped(to_dh(log, robot), robot)
        # Why first: poses without the motion between them are as fast as degrees.
        check_rate(moved, robot)
        check_degrees(log, robot)
        flat, flat_findings = clipped_samples(log, robot, gone)
        log = with_even_clock(moved)
        check_order(log, robot)
        findings += check_slopes(log, robot)
        findings += check_ranges(log, robot)
        check_torque_scale(log, robot, gone)
        for check in (check_position_noise, check_zero):
            findings += check(log, robot)
        if identify:
            findings += check_amount([log], robot)
    clipped = flat if robot.coupling is None else flat @ joint_of_motor(robot)
    extra = {**log.extra, "clipped": clipped} | ({} if in_dh else {"driver_columns": named})
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
    ratio = slopes(log, robot).tolist()
    text = f"the reported velocity is not used ({driver.velocity_note})"
    evidence = {"slope": [None if np.isnan(value) else value for value in ratio]}
    kept = [finding for finding in log.findings if finding.code != "W308"]
    log = replace(log, qd=None, extra={**log.extra, "qd_reported": log.qd}, findings=tuple(kept))
    return with_findings(log, Finding("W308", "info", text, evidence))


def measurable(values: Floats) -> Mask:
    """Return which values are finite and of a size that a sensor can read."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) < tuning.LARGEST, dtype=bool)


def check_finite(log: Log, robot: Robot) -> None:
    """Raise when a used column has values that are not numbers, with the --exclude that leaves them out.

    Raises:
        NotFinite: names joint, quantity, count, first time and row.
    """
    every = {"position": log.q, "torque": log.tau, "velocity": log.qd}
    columns = {quantity: x for quantity, x in every.items() if x is not None}
    wrong = {quantity: ~measurable(x) for quantity, x in columns.items()}
    bad = np.any([flags.any(axis=1) for flags in wrong.values()], axis=0)
    if not bad.any():
        return
    row = int(np.argmax(bad))
    quantity = next(key for key, flags in wrong.items() if flags[row].any())
    j = int(np.argmax(wrong[quantity][row]))
    value, count = float(columns[quantity][row, j]), int(wrong[quantity][:, j].sum())
    kind = f"{value:.0e}, not measurable,"
    if not np.isfinite(value):
        kind = "not a number" if np.isnan(value) else "infinite"
    raise NotFinite(
        f"{robot.joint_names[j]} {quantity} is {kind} in {count} samples, "
        f"first at t = {log.t[row]:.3f} s (row {row + 1})",
        fix="record again: no sample is complete"
        if bad.all()
        else f"leave it out: {_exclude_options(log.t[bad])}",
    )


def _exclude_options(t: Floats) -> str:
    parts = np.split(t, np.flatnonzero(np.diff(t) > tuning.EXCLUDED_TOGETHER_S) + 1)
    if len(parts) > tuning.MOST_INTERVALS:
        parts = [t]
    return " ".join(
        f"--exclude {max(p[0] - tuning.EXCLUDE_MARGIN_S, 0):.3f}-{p[-1] + tuning.EXCLUDE_MARGIN_S:.3f}"
        for p in parts
    )


def check_degrees(log: Log, robot: Robot) -> None:
    """Raise when positions [declared rad] break the limits but would keep them as degrees; needs increasing time.

    Why: joints without position limits are judged by their speed limit.

    Raises:
        PositionInDegrees: with the line for the robot file.
    """
    if units(log, robot)["position"] != "rad":
        return
    given = to_dh(log, robot)
    v = speed(given)
    for j, joint in enumerate(robot.joints):
        limits, fits, text = joint.limits, False, ""
        if not joint.revolute:
            continue
        if limits.position is not None:
            low, high = limits.position
            slack = 0.05 * (high - low)
            if _span(given.q[:, j]) > tuning.BEYOND_RANGE * (high - low):
                q = to_dh(replace(log, q=np.radians(log.q)), robot).q[:, j]
                fits = q.min() > low - slack and q.max() < high + slack
            around = f"+-{high:.2f}" if np.isclose(-low, high) else f"{low:.2f} to {high:.2f}"
            text = f"limits are {around} rad"
        if not fits and limits.velocity is not None:
            # Why the percentile: it is a speed that one of twenty samples exceeds.
            fast = np.percentile(np.abs(v[:, j]), 95)
            fits = np.radians(fast) <= limits.velocity < fast / tuning.BEYOND_SPEED
            text = f"the speed limit is {limits.velocity:.2f} rad/s"
        if fits:
            declared = {"position": "deg"}
            if (
                given.qd is not None
                and 0.5 < np.sum(given.qd * v) / max(np.sum(v * v), 1e-12) < 1.5
            ):
                declared["velocity"] = "deg/s"
            raise PositionInDegrees(
                f"{joint.name} position spans {np.ptp(log.q[:, j]):.1f}: degrees? {text}",
                fix=unit_fix(robot, declared),
            )


def _span(q: Floats) -> float:
    """Return the range of a joint; one that is read modulo a full turn jumps now and then, degrees all the time."""
    turns = _full_turns(q)
    if np.count_nonzero(turns) < tuning.RARE_TURNS * (len(q) - 1):
        q = q - 2 * np.pi * np.cumsum(turns)
    return float(np.ptp(q))


def unit_fix(robot: Robot, given: dict[str, str]) -> str:
    """Return the sentence that says which units to declare in the robot file."""
    inner = ", ".join(f"{key}: {value}" for key, value in given.items())
    file = robot.editable
    if robot.driver is None:
        return f"add `driver: {{kind: generic, units: {{{inner}}}}}` to {file}"
    return f"add `units: {{{inner}}}` under `driver:` in {file}"


def unwrapped(log: Log, robot: Robot) -> Log:
    """Return the log without jumps by full turns (W315)."""
    columns, findings = [*log.q.T], list[Finding]()
    for j in (j for j, joint in enumerate(robot.joints) if joint.revolute):
        turns = _full_turns(log.q[:, j])
        where = np.flatnonzero(turns)
        if not len(where):
            continue
        columns[j] = columns[j] - 2 * np.pi * np.cumsum(turns)
        name, row = robot.joint_names[j], int(where[0])
        more = f" and {len(where) - 1} times more" if len(where) > 1 else ""
        at, step = float(log.t[row]), float(log.q[row, j] - log.q[row - 1, j])
        text = f"{name} jumps by {step:.2f} rad at {at:.2f} s{more}; unwrapped"
        evidence = {"joint": name, "at_s": log.t[where].tolist()}
        findings.append(Finding("W315", "warning", text, evidence))
    return with_findings(replace(log, q=np.array(columns).T), *findings) if findings else log


def _full_turns(q: Floats) -> Floats:
    """Return by how many full turns a joint jumps to each sample, (N,)."""
    step = np.diff(q, prepend=q[0])
    if np.abs(step).max() < np.pi:
        return np.zeros_like(step)
    turns = np.round(step / (2 * np.pi))
    return np.where(np.abs(step - 2 * np.pi * turns) > tuning.TURN_REST, 0.0, turns)


def check_torque_scale(log: Log, robot: Robot, gone: Mask) -> None:
    """Raise when torques are no torques of this arm; joints without any, (n,), are known.

    Raises:
        WrongMessageType: the effort of a joint that moves, or of all, is zero in every sample, or nearly.
        TorqueScale: far beyond the rating.
    """
    largest = np.abs(log.tau).max(axis=0)
    silent = largest < tuning.LEAST_TORQUE
    if silent.all():
        raise WrongMessageType(
            "effort is 0 in every sample of every joint",
            fix="make the driver publish the joint torques",
        )
    moves = np.ptp(log.q, axis=0) > per_joint(tuning.STILL_SPAN, robot)
    if names := ", ".join(compress(robot.joint_names, moves & ~gone & silent)):
        raise WrongMessageType(
            f"effort is 0 in every sample of {names}, which moves",
            fix="make the driver publish the torques of all joints",
        )
    if in_amperes(log, robot) and log.tau_unit == "A":
        return
    for j, joint in enumerate(robot.joints):
        rating = joint.limits.torque
        # Why: a lone spike is a bad sample, not another unit.
        high = np.percentile(np.abs(log.tau[:, j]), 99)
        if rating is None or high <= tuning.BEYOND_RATING * rating:
            continue
        guess, fix = "mNm", unit_fix(robot, {"effort": "mNm"})
        if high / 1000 > tuning.BEYOND_RATING * rating:
            guess = "raw counts"
            fix = "find out what the driver publishes; give the gain under `torque:`"
        top = f"{largest[j]:,.0f}".replace(",", " ")
        unit = joint.torque_unit.replace(" ", "")
        raise TorqueScale(
            f"{joint.name} torque reaches {top}: {guess}? rating {rating:g} {unit}", fix=fix
        )


def clipped_samples(log: Log, robot: Robot, gone: Mask) -> tuple[Mask, tuple[Finding, ...]]:
    """Return which torques are none, (N, n), and findings W319; in the driver's columns.

    They sit at their largest value, or nobody measured them (``gone``, (n,)).
    """
    mask, alive, findings = np.tile(gone, (len(log), 1)), any_moves(log, robot), []
    if none := ", ".join(compress(robot.joint_names, gone)):
        text = f"the log has no torque for {none}: predicted from the other joints and the prior"
        findings.append(Finding("W319", "warning", text, {"joint": none, "share": 1.0}))
    for j in np.flatnonzero(~gone).tolist():
        joint, x = robot.joints[j], log.tau[:, j]
        mask[:, j] = clipped = _flat_top(x, alive) | _flat_top(-x, alive)
        if not clipped.any():
            continue
        unit = "A" if log.tau_unit == "A" else joint.torque_unit.replace(" ", "")
        share, level = float(np.mean(clipped)), float(np.abs(x[clipped]).max())
        size = f"{level:.4g} {unit} for {clipped.sum() / log.rate:.2g} s"
        text = f"{joint.name} torque sits at {size}: clipped samples are left out ({100 * share:.1f} %)"
        evidence = {"joint": joint.name, "share": share, "level": level}
        findings.append(Finding("W319", "warning", text, evidence))
    return mask, tuple(findings)


def _flat_top(x: Floats, alive: Mask) -> Mask:
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


def check_zero(log: Log, robot: Robot) -> Iterator[Finding]:
    """Yield findings W316 for joints that read a torque at rest although they carry no weight there.

    Why: only for sensors behind the gear; a motor at rest holds any torque up to its friction.
    """
    sensors, poses = ("joint_sensor", "unknown", "gravity_free"), rest_slices(log, robot)
    if robot.torque.source not in sensors or log.tau_unit == "A" or not poses:
        return
    q, tau = (np.array([x[part].mean(axis=0) for part in poses]) for x in (log.q, log.tau))
    load = np.abs(expected_torque(q, robot)) * (robot.torque.source != "gravity_free")
    unloaded = load <= tuning.UNLOADED * max(load.max(), 1e-9)
    for joint, rows, x in zip(robot.joints, unloaded.T, tau.T, strict=True):
        rating = joint.limits.torque
        if rating is None or not rows.any():
            continue
        mean = float(np.mean(x[rows]))
        if abs(mean) > tuning.ZERO_SHARE * rating:
            unit = joint.torque_unit.replace(" ", "")
            text = (
                f"{joint.name} reads {mean:+.2g} {unit} with the arm at rest and gravity balanced: "
                "zero the sensors before recording"
            )
            yield Finding("W316", "warning", text, {"joint": joint.name, "mean": mean})


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
    # Why: a reversed sign is another mistake (E308), so it must not look like a wrong column.
    likeness = np.abs(_correlation(speed(log), log.qd)[np.ix_(joints, joints)])
    labelled = np.diag(likeness)
    if np.all(labelled >= tuning.WRONG_COLUMN):
        return
    from scipy.optimize import linear_sum_assignment

    best = linear_sum_assignment(-likeness)[1]
    for i, swapped in enumerate(likeness[range(len(joints)), best]):
        if best[i] != i and swapped > tuning.WRONG_COLUMN > labelled[i]:
            one, other = robot.joint_names[joints[i]], robot.joint_names[joints[best[i]]]
            raise JointNamesDiffer(
                f"{one} and {other} look swapped "
                f"(correlation {swapped:.2f} swapped, {labelled[i]:.2f} as labelled)",
                why="the velocity column of one joint follows the position of the other",
                fix="correct the columns of the log; if only the velocities are swapped: --velocity derived",
            )


def _correlation(x: Floats, y: Floats) -> Floats:
    """Return how each column of x correlates with each of y, (n, n), 0 for those that do not change."""
    size = np.outer(x.std(axis=0), y.std(axis=0))
    covariance = x.T @ y / len(x) - np.outer(x.mean(axis=0), y.mean(axis=0))
    return covariance / np.where(size > 0.0, size, 1.0)


def check_slopes(log: Log, robot: Robot) -> Iterator[Finding]:
    """Yield finding W308 for velocities that agree only roughly with the change of position.

    Raises:
        VelocityInconsistent: unit or sign is wrong.
    """
    for joint, slope in zip(robot.joints, slopes(log, robot).tolist(), strict=True):
        if math.isnan(slope) or tuning.SLOPE_AGREES[0] <= slope <= tuning.SLOPE_AGREES[1]:
            continue
        text = f"{joint.name} velocity is {slope:.3g} x the change of position"
        if joint.revolute and tuning.SLOPE_DEGREES[0] <= abs(slope) <= tuning.SLOPE_DEGREES[1]:
            fix = f"{unit_fix(robot, {'velocity': 'deg/s'})}, or use --velocity derived"
            raise VelocityInconsistent(f"{text}: deg/s", fix=fix)
        if joint.revolute and tuning.SLOPE_RADIANS[0] <= abs(slope) <= tuning.SLOPE_RADIANS[1]:
            fix = "are positions in degrees? declare `units:` under `driver:` in the robot file"
            if units(log, robot)["velocity"] == "deg/s":
                fix = f"{unit_fix(robot, {'velocity': 'rad/s'})}, or use --velocity derived"
            raise VelocityInconsistent(f"{text}: rad/s, while positions are in degrees?", fix=fix)
        if tuning.SLOPE_REVERSED[0] <= slope <= tuning.SLOPE_REVERSED[1]:
            raise VelocityInconsistent(
                f"{joint.name} velocity has the opposite sign (slope {slope:.2f} to the change of position)",
                fix="correct the sign of the velocity or of the position in the log, or use --velocity derived",
            )
        text = f"{joint.name} velocity is {slope:.2f} x the change of position; --velocity derived is better"
        yield Finding("W308", "warning", text, {"joint": joint.name, "slope": slope})


def beyond(joint: Joint, low: float, high: float) -> float:
    """Return how far a joint that moves from ``low`` to ``high`` leaves its limits [rad or m], but for full turns."""
    if joint.limits.position is None:
        return 0.0
    least, most = joint.limits.position
    if joint.revolute:
        turns = 2 * math.pi * round((least + most - low - high) / (4 * math.pi))
        low, high = low + turns, high + turns
    return float(max(0.0, least - low, high - most))


def check_ranges(log: Log, robot: Robot) -> Iterator[Finding]:
    """Yield findings W332, one for each joint of a log in DH quantities that moves beyond its limits."""
    ends = np.transpose([log.q.min(axis=0), log.q.max(axis=0)])
    for joint, (low, high) in zip(robot.joints, ends.tolist(), strict=True):
        too_far = beyond(joint, low, high)
        if too_far <= tuning.BEYOND_LIMITS:
            continue
        unit, factor = ("deg", math.degrees(1.0)) if joint.revolute else ("m", 1.0)
        least, most = joint.limits.position or (0.0, 0.0)
        text = (
            f"{joint.name} moves from {factor * low:.3g} to {factor * high:.3g} {unit}, {factor * too_far:.3g} {unit} "
            f"beyond its limits ({factor * least:.4g} to {factor * most:.4g}): its offset or these limits are wrong"
        )
        yield Finding("W332", "warning", text, {"joint": joint.name, "beyond": too_far})


# ---------------------------------------------------------------- the numbers that dynid check shows
def describe(log: Log, robot: Robot) -> dict[str, Any]:
    """Return the numbers of a checked log for JSON; those of each joint in the robot's order and DH quantities.

    ``jitter_share`` is half the spread of the middle 95 % of the sample times; ``velocity_slope``, the measured
    velocity over the change of position, is None where it is not measured or nothing moves, and ``torque_share``, of
    the rating, where that is unknown; ``least_moving`` is the joint that is slowest for its speed limit.
    """
    step = np.diff(log.t)
    usual, top = float(np.median(step)), np.abs(log.tau).max(axis=0)
    low, high = np.percentile(step, [2.5, 97.5])
    rms = np.sqrt(np.mean(speed(log) ** 2, axis=0))
    currents = log.tau_unit == "A"
    ratings = np.full(robot.n, np.nan) if currents else robot.limits("torque", np.nan)
    return {
        "samples": len(log),
        "duration_s": log.duration,
        "rate_hz": 1.0 / usual,
        "jitter_share": float(high - low) / 2 / usual,
        "gaps": int(np.sum(step > tuning.GAP_SAMPLES * usual)),
        "longest_gap_s": float(step.max()),
        "position_span_rad": np.ptp(log.q, axis=0).tolist(),
        "rms_velocity_rad_s": rms.tolist(),
        "velocity_slope": _known(slopes(log, robot)),
        f"torque_max_{'a' if currents else 'nm'}": top.tolist(),
        "torque_share": _known(top / ratings),
        "least_moving": robot.joint_names[int(np.argmin(rms / robot.limits("velocity", 1.0)))],
    }


def _known(numbers: Floats) -> list[float | None]:
    return [None if np.isnan(x) else x for x in numbers.tolist()]
