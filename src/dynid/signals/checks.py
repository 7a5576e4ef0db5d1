"""From a raw log to a clean one in DH quantities, with every check in its order.

Reads a ``Log`` as it came from disk or from arrays; gives back a ``Log`` that is ``checked``, with names and columns of
the robot, findings, and ``extra["clipped"]``, (N, n) bool. Cutting at gaps and filtering come later, in ``condition``.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.drivers.registry import driver_of
from dynid.errors import Finding
from dynid.log import Log
from dynid.longarrays import spans
from dynid.robot import Robot
from dynid.signals.columns import in_si, joint_of_motor, matching_columns, robot_columns, to_dh
from dynid.signals.cutoff import check_position_noise
from dynid.signals.motion import check_amount
from dynid.signals.pieces import changed
from dynid.signals.ranges import check_ranges
from dynid.signals.repeats import without_stale
from dynid.signals.stamps import (
    check_gaps,
    check_rate,
    same_rows,
    with_even_clock,
    with_findings,
    with_rising_time,
    without_intervals,
)
from dynid.signals.values import (
    check_degrees,
    check_finite,
    check_repeats,
    check_torque_scale,
    check_zero,
    clipped_samples,
    measurable,
    unwrapped,
)
from dynid.signals.velocity import check_order, check_slopes, slopes


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
        columns before the driver's map was applied, () where they had none.

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
    log = with_rising_time(log, sort_time=sort_time)
    check_finite(log, robot)
    findings = list(check_gaps(log, exclude))
    log = without_stale(changed(log, lambda part: in_si(part, robot)), robot)
    check_degrees(log, robot)
    flat, flat_findings = clipped_samples(log, robot)
    log = with_even_clock(unwrapped(changed(log, lambda part: to_dh(part, robot)), robot))
    check_order(log, robot)
    findings += check_slopes(log, robot)
    findings += check_ranges(log, robot)
    check_torque_scale(log, robot)
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
    whole = [measurable(log.qd[part]) for part in spans(len(log))] if len(log) else [np.zeros(0, dtype=bool)]
    usable = any(part.any() for part in whole) if driver_of(robot).velocity_trusted else all(p.all() for p in whole)
    still = usable and not any(np.any(log.qd[part]) for part in spans(len(log)))
    return replace(log, qd=None) if not usable or (still and not np.all(same_rows(log.q))) else log


def _trusted_velocity(log: Log, robot: Robot) -> Log:
    """Put aside a velocity that the driver is known to distort, and say so."""
    driver = driver_of(robot)
    if log.qd is None or driver.velocity_trusted:
        return log
    ratio = slopes(log, robot)
    shown = ", ".join("-" if np.isnan(value) else f"{value:.2f}" for value in ratio)
    text = f"the reported velocity is not used ({driver.velocity_note}); its slope to dq/dt is {shown}"
    evidence = {"slope": [None if np.isnan(value) else float(value) for value in ratio]}
    kept = [finding for finding in log.findings if finding.code != "W308"]
    log = replace(log, qd=None, extra={**log.extra, "qd_reported": log.qd}, findings=tuple(kept))
    return with_findings(log, Finding("W308", "info", text, evidence))
