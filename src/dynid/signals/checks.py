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
    in_si,
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
        check_degrees(log, moved, robot)
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
    if robot.coupling is not None:
        # Why: the torque of a motor goes into those of several joints.
        flat = flat @ (np.array(robot.coupling.matrix) != 0.0)
    log = replace(log, checked=True, extra={**log.extra, "clipped": flat})
    return _trusted_velocity(with_findings(log, *findings, *flat_findings), robot)


def _usable_velocity(log: Log, robot: Robot) -> Log:
    """Drop a velocity that was never measured: all zero while positions change, or not a number throughout.

    Why: a velocity that the driver distorts anyway must not fail the log because it is not a number in places.
    """
    if log.qd is None:
        return log
    known = measurable(log.qd)
    usable = known.any() if driver_of(robot).velocity_trusted else known.all()
    never = not np.any(log.qd) and not np.all(same_rows(log.q))
    return log if usable and not never else replace(log, qd=None)


def _trusted_velocity(log: Log, robot: Robot) -> Log:
    """Put aside a velocity that the driver is known to distort, and say so."""
    driver = driver_of(robot)
    if log.qd is None or driver.velocity_trusted:
        return log
    text = f"the reported velocity is not used ({driver.velocity_note})"
    found = Finding("W308", "info", text, {"slope": _known(slopes(log, robot))})
    log = replace(log, qd=None, extra={**log.extra, "qd_reported": log.qd})
    return with_findings(log, found)


def measurable(values: Floats) -> Mask:
    """Return which values are finite and of a size that a sensor can read."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.abs(values) < tuning.LARGEST, dtype=bool)


def check_finite(log: Log, robot: Robot) -> None:
    """Raise when a used column has values that are not numbers, with the --exclude that leaves them out.

    Raises:
        NotFinite: names joint, quantity, count, first time and row.
    """
    columns = {"position": log.q, "torque": log.tau}
    if log.qd is not None:
        columns["velocity"] = log.qd
    wrong = np.array([~measurable(x) for x in columns.values()])
    bad = wrong.any(axis=(0, 2))
    if not bad.any():
        return
    row = int(np.argmax(bad))
    which, j = np.argwhere(wrong[:, row])[0]
    quantity, count = list(columns)[which], wrong[which, :, j].sum()
    value = columns[quantity][row, j]
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


def check_degrees(log: Log, moved: Log, robot: Robot) -> None:
    """Raise when positions [declared rad] break the limits but would keep them as degrees.

    Why: joints without position limits are judged by their speed limit.

    Args:
        log: in SI units, with increasing time.
        moved: the same in DH quantities, without jumps by full turns.
        robot: its robot.

    Raises:
        PositionInDegrees: with the line for the robot file.
    """
    if units(log, robot)["position"] != "rad":
        return
    v = speed(moved)
    for j in np.flatnonzero(robot.turning).tolist():
        joint, limits, fits, text = robot.joints[j], robot.joints[j].limits, False, ""
        if limits.position is not None:
            low, high = limits.position
            if np.ptp(moved.q[:, j]) > tuning.BEYOND_RANGE * (high - low):
                q = to_dh(replace(log, q=np.radians(log.q)), robot).q[:, j]
                fits = beyond(joint, q.min(), q.max()) < 0.05 * (high - low)
            around = f"+-{high:.2f}" if np.isclose(-low, high) else f"{low:.2f} to {high:.2f}"
            text = f"limits are {around} rad"
        if not fits and limits.velocity is not None:
            # Why the percentile: it is a speed that one of twenty samples exceeds.
            fast = np.percentile(np.abs(v[:, j]), 95)
            fits = np.radians(fast) <= limits.velocity < fast / tuning.BEYOND_SPEED
            text = f"the speed limit is {limits.velocity:.2f} rad/s"
        if fits:
            declared = {"position": "deg"}
            if 0.5 < slopes(moved, robot)[j] < 1.5:
                declared["velocity"] = "deg/s"
            raise PositionInDegrees(
                f"{joint.name} position spans {np.ptp(log.q[:, j]):.1f}: degrees? {text}",
                fix=unit_fix(robot, declared),
            )


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
    for j in np.flatnonzero(robot.turning).tolist():
        turns = _full_turns(log.q[:, j])
        where = np.flatnonzero(turns)
        if not len(where):
            continue
        columns[j] = columns[j] - 2 * np.pi * np.cumsum(turns)
        name, times = robot.joint_names[j], log.t[where].tolist()
        more = f" and {len(where) - 1} times more" if len(where) > 1 else ""
        step = np.diff(log.q[:, j])[where[0] - 1]
        text = f"{name} jumps by {step:.2f} rad at {times[0]:.2f} s{more}; unwrapped"
        evidence = {"joint": name, "at_s": times}
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
    if log.tau_unit == "A":
        return
    for j, rating in enumerate(robot.limits("torque")):
        # Why: a lone spike is a bad sample, not another unit.
        high = np.percentile(np.abs(log.tau[:, j]), 99)
        if high <= tuning.BEYOND_RATING * rating:
            continue
        guess, fix = "mNm", unit_fix(robot, {"effort": "mNm"})
        if high / 1000 > tuning.BEYOND_RATING * rating:
            guess = "raw counts"
            fix = "find out what the driver publishes; give the gain under `torque:`"
        joint, top = robot.joints[j], f"{largest[j]:,.0f}".replace(",", " ")
        unit = joint.torque_unit.replace(" ", "")
        text = f"{joint.name} torque reaches {top}: {guess}? rating {rating:g} {unit}"
        raise TorqueScale(text, fix=fix)


def clipped_samples(log: Log, robot: Robot, gone: Mask) -> tuple[Mask, tuple[Finding, ...]]:
    """Return which torques are none, (N, n), and findings W319; in the driver's columns.

    They sit at their largest value, or nobody measured them (``gone``, (n,)).
    """
    mask, alive, findings = np.tile(gone, (len(log), 1)), any_moves(log, robot), []
    if none := ", ".join(compress(robot.joint_names, gone)):
        text = f"the log has no torque for {none}: predicted from the other joints and the prior"
        findings.append(Finding("W319", "warning", text, {"joint": none, "share": 1.0}))
    for j, (joint, x) in enumerate(zip(robot.joints, log.tau.T, strict=True)):
        clipped = _flat_top(x, alive) | _flat_top(-x, alive)
        if not clipped.any():
            continue
        mask[:, j] = clipped
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
    from scipy.ndimage import binary_opening  # here: its import takes longer than most logs

    top = x.max()
    least = top - 1e-9 * abs(top)
    flat = binary_opening((x >= least) & alive & (top > 0), np.ones(tuning.FLAT_RUN))
    below = x[x < least]
    near = np.sum(below > top - 0.01 * np.ptp(x))
    second = np.sum(below == below.max(initial=-np.inf))
    return flat & (flat.sum() >= max(tuning.FLAT_SHARE * second, near))


def check_zero(log: Log, robot: Robot) -> Iterator[Finding]:
    """Yield findings W316 for joints that read a torque at rest although they carry no weight there.

    Why: only for sensors behind the gear; a motor at rest holds any torque up to its friction.
    """
    source, poses = robot.torque.source, rest_slices(log, robot)
    if source.startswith("motor") or log.tau_unit == "A" or not poses:
        return
    q, tau = (np.array([x[part].mean(axis=0) for part in poses]) for x in (log.q, log.tau))
    load = np.abs(expected_torque(q, robot)) if source != "gravity_free" else np.zeros_like(q)
    unloaded = load <= tuning.UNLOADED * max(load.max(), 1e-9)
    most = tuning.ZERO_SHARE * robot.limits("torque")
    for j, joint in enumerate(robot.joints):
        rows = unloaded[:, j]
        if rows.any() and abs(mean := float(np.mean(tau[rows, j]))) > most[j]:
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
    enough = moving(log, robot).sum(axis=0) >= tuning.LEAST_SAMPLES
    joints = np.flatnonzero(enough & log.qd.any(axis=0))
    v, qd = (x[:, joints] / np.linalg.norm(x[:, joints], axis=0) for x in (speed(log), log.qd))
    # Why: a reversed sign is another mistake (E308), so it must not look like a wrong column.
    likeness = np.abs(v.T @ qd)
    if np.all(np.diag(likeness) >= tuning.WRONG_COLUMN):
        return
    from scipy.optimize import linear_sum_assignment

    for i, k in zip(*linear_sum_assignment(-likeness), strict=True):
        labelled, swapped = likeness[i, i], likeness[i, k]
        if i != k and swapped > tuning.WRONG_COLUMN > labelled:
            one, other = (robot.joint_names[joints[x]] for x in (i, k))
            raise JointNamesDiffer(
                f"{one} and {other} look swapped "
                f"(correlation {swapped:.2f} swapped, {labelled:.2f} as labelled)",
                why="the velocity column of one joint follows the position of the other",
                fix="correct the columns of the log; if only the velocities are swapped: --velocity derived",
            )


def check_slopes(log: Log, robot: Robot) -> Iterator[Finding]:
    """Yield finding W308 for velocities that agree only roughly with the change of position.

    Raises:
        VelocityInconsistent: unit or sign is wrong.
    """
    (low, high), derived = tuning.SLOPE_AGREES, ", or use --velocity derived"
    # Of a velocity that is distorted anyway it is said once for all joints that it is not used.
    trusted = driver_of(robot).velocity_trusted
    for joint, slope in zip(robot.joints, slopes(log, robot).tolist(), strict=True):
        if math.isnan(slope) or low <= slope <= high:
            continue
        size, velocity = abs(slope), f"{joint.name} velocity"
        text = f"{velocity} is {slope:.3g} x the change of position"
        if joint.revolute and tuning.SLOPE_DEGREES[0] <= size <= tuning.SLOPE_DEGREES[1]:
            text, fix = f"{text}: deg/s", unit_fix(robot, {"velocity": "deg/s"}) + derived
        elif joint.revolute and tuning.SLOPE_RADIANS[0] <= size <= tuning.SLOPE_RADIANS[1]:
            text = f"{text}: rad/s, while positions are in degrees?"
            fix = "are positions in degrees? declare `units:` under `driver:` in the robot file"
            if units(log, robot)["velocity"] == "deg/s":
                fix = unit_fix(robot, {"velocity": "rad/s"}) + derived
        elif tuning.SLOPE_REVERSED[0] <= slope <= tuning.SLOPE_REVERSED[1]:
            text = f"{velocity} has the opposite sign (slope {slope:.2f} to the change of position)"
            fix = f"correct the sign of the velocity or of the position in the log{derived}"
        else:
            text = (
                f"{velocity} is {slope:.2f} x the change of position; --velocity derived is better"
            )
            if trusted:
                yield Finding("W308", "warning", text, {"joint": joint.name, "slope": slope})
            continue
        raise VelocityInconsistent(text, fix=fix)


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
    step, top = np.diff(log.t), np.abs(log.tau).max(axis=0)
    low, high = np.percentile(step, [2.5, 97.5])
    rms = np.sqrt(np.mean(speed(log) ** 2, axis=0))
    currents = log.tau_unit == "A"
    ratings = np.full(robot.n, np.nan) if currents else robot.limits("torque", np.nan)
    return {
        "samples": len(log),
        "duration_s": log.duration,
        "rate_hz": log.rate,
        "jitter_share": float(high - low) / 2 * log.rate,
        "gaps": int(np.sum(step > tuning.GAP_SAMPLES / log.rate)),
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
