"""A conditioned log: motion and torques after the filters, from which the rows of the observation matrix are made.

A prepared log (checked, in DH quantities) is freed of spikes, corrected for a known delay of its torques, filtered and
differentiated (``dynid.signals.conditioning``). The torques of links that keep their prior values are subtracted, and
the columns of the robot file's effects are evaluated: they depend on the order of the samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import DynidError, Finding
from dynid.log import Log
from dynid.longarrays import release
from dynid.model.effects.catalogue import delay_of
from dynid.model.effects.interface import ArmMotion, ReferenceTorques
from dynid.model.parameters import prior_vector
from dynid.model.regressor import Model, prior_torques
from dynid.progress import SILENT, Progress
from dynid.signals.conditioning import Filter, Segment, choose_filter, condition
from dynid.signals.cutoff import choose_cutoff
from dynid.signals.delay import segment_without_delay, without_delay
from dynid.signals.filters import decimate, despiked, lowpass_kernel

Floats = NDArray[np.float64]

#: Parts that are kept of each interval of a long log: long ones, so that a motion that repeats in it is still found.
STRETCHES = 4
#: Samples of all logs together that are kept however long they take.
FEW = 20_000
#: Torques that are differentiated twice are smoothed beyond this [Hz]: they follow accelerations already, and above it
#: the fourth derivative of the positions is their noise, which makes what is fitted to it too small.
SMOOTH = 4.0


@dataclass(frozen=True)
class ConditionedLog:
    """One log after the filters.

    Attributes:
        segments: intervals without gaps, in order of time.
        filter: the filters that they went through.
        name: name of the log for people, such as that of its file; "" where it has none.
        path: where the log was read from; "" for arrays.
        sha256: hash of that file; "" for arrays.
        delay: by how much the torques were moved back [s].
        findings: what was noticed while the log was read, checked and conditioned.
    """

    segments: Sequence[Segment]
    filter: Filter
    name: str
    path: str = ""
    sha256: str = ""
    delay: float = 0.0
    findings: tuple[Finding, ...] = ()


def condition_log(
    log: Log,
    model: Model,
    *,
    cutoff: float | None = None,
    delay: float = 0.0,
    measured_velocity: bool = False,
) -> ConditionedLog:
    """Condition one log for the rows of a model.

    Args:
        log: a prepared log, in DH quantities.
        model: the model whose rows are wanted.
        cutoff: cut-off frequency of the filter over torques and columns [Hz]; from the band of the motion when None.
        delay: how much later than the positions the torques are stamped; they are moved back by it [s].
        measured_velocity: use the velocities of the driver where there are any, and differentiate only those.

    Returns:
        The conditioned log; spikes that were removed are among its findings.

    Raises:
        LogTooShort: no interval without gaps is longer than the filters.
    """
    robot = model.robot
    try:
        chosen = choose_filter(log, robot, cutoff)
        clean, spikes = despiked(log, chosen.cutoff)
        coulomb = robot.coulomb_shape
        speeds = zip(coulomb.velocity, robot.joints, strict=True)
        rest = np.array([v if "coulomb" in joint.friction else 0.0 for v, joint in speeds])
        segments = condition(
            without_delay(clean, delay), chosen, measured_velocity=measured_velocity, coulomb=coulomb, rest_speed=rest
        )
    except DynidError as error:
        error.where = error.where or str(log.source or "")
        raise
    late = delay_of(robot)
    conditioned = ConditionedLog(
        segments=[segment_without_delay(segment, late) for segment in without_known(segments, model)],
        filter=chosen,
        name=log.source.name if log.source else "",
        path=str(log.source or ""),
        sha256=log.sha256,
        delay=delay,
        findings=(*log.findings, *spikes),
    )
    return with_effects(conditioned, model)


def condition_logs(
    logs: Sequence[Log],
    model: Model,
    *,
    cutoff: float | None = None,
    delay: float = 0.0,
    measured_velocity: bool = False,
    progress: Progress = SILENT,
) -> list[ConditionedLog]:
    """Condition several logs with one filter, which has to serve all that are stacked.

    Args:
        logs: prepared logs.
        model: the model whose rows are wanted.
        cutoff: as for ``condition_log``; ``choose_cutoff`` when None [Hz].
        delay: as for ``condition_log`` [s].
        measured_velocity: as for ``condition_log``.
        progress: told what was noticed in the logs and how they are filtered.
    """
    shared = choose_cutoff(logs, model.robot) if cutoff is None else cutoff
    found = []
    for k, log in enumerate(logs, start=1):
        each = condition_log(log, model, cutoff=shared, delay=delay, measured_velocity=measured_velocity)
        found.append(replace(each, name=each.name or f"log {k}"))
        where = found[-1].path or found[-1].name
        progress.stage("log", f"{where}: {len(log)} samples, {log.duration:.1f} s, {log.rate:.1f} Hz")
        progress.findings(each.findings)
    if any(segment.command is None for log in found for segment in log.segments):
        # Why: instruments serve all rows or none, and columns of a command in some of them fit into no array.
        found = [without_command(log) for log in found]
    how = "from the motion's band" if cutoff is None else "as given"
    chosen = found[0].filter
    progress.stage(
        "filter",
        f"zero-phase low-pass at {chosen.cutoff:.3g} Hz over torque and columns ({how}; positions at "
        f"{chosen.position_cutoff:.3g} Hz), {chosen.kept_rate:.3g} Hz kept",
    )
    return found


def without_command(log: ConditionedLog) -> ConditionedLog:
    """Return a log without its commanded motion."""

    def bare(segment: Segment) -> Segment:
        none = np.zeros((len(segment), 0))
        return replace(segment, command_q=none, command_qd=none, command_qdd=none, command_coulomb_sign=none)

    return replace(log, segments=[bare(segment) for segment in log.segments])


def stretches(logs: Sequence[ConditionedLog], seconds: float) -> tuple[list[ConditionedLog], int]:
    """Return logs of which only some stretches are left, spread evenly over each, where they are longer together.

    Args:
        logs: conditioned logs.
        seconds: how long they may be together; a log of them keeps its share in ``STRETCHES`` parts.

    Returns:
        The logs, and in how many parts they are; 0 where they are whole.
    """
    rows = [sum(len(s) for s in log.segments) for log in logs]
    long = sum(n / log.filter.rate * log.filter.first_step for n, log in zip(rows, logs, strict=True))
    # Why rows too: a recording at a low rate is long in time alone.
    share = max(seconds / max(long, 1e-9), FEW / max(sum(rows), 1))
    if share >= 1.0:
        return list(logs), 0
    found, parts = [], 0
    for log, total in zip(logs, rows, strict=True):
        length, kept = round(total * share / STRETCHES), []
        for start in np.linspace(0, total - length, STRETCHES).astype(int).tolist():
            first = 0
            for segment in log.segments:
                part = slice(max(0, start - first), max(0, start + length - first))
                first += len(segment)
                if part.stop > 0 and part.start < len(segment):
                    # Why a copy: what is left shall not keep the whole log in memory.
                    kept.append(Segment(**{name: value[part].copy() for name, value in vars(segment).items()}))
        found.append(replace(log, segments=kept))
        parts += len(kept)
        release()
    return found, parts


def torques_moved_back(log: ConditionedLog, model: Model, delay: float) -> ConditionedLog:
    """Return a conditioned log whose measured torque at t is that at t + delay; the ends are not usable any more.

    Args:
        log: the conditioned log, its torques as they were recorded.
        model: the model that it was conditioned for.
        delay: by how much the torques are late [s].
    """

    def moved(segment: Segment) -> Segment:
        # Why: what the links with prior values take was subtracted at the time of the positions.
        known = known_torque(model, segment.q, segment.qd, segment.qdd)
        back = segment_without_delay(replace(segment, tau=segment.tau + known), delay)
        return replace(back, tau=back.tau - known)

    return replace(log, segments=[moved(segment) for segment in log.segments], delay=delay)


def without_known(segments: Sequence[Segment], model: Model) -> list[Segment]:
    """Subtract the torques of links that keep their prior values, so that the rest fits the identified columns."""
    if len(model.robot.identified_links) == model.robot.n:
        return list(segments)
    return [replace(s, tau=s.tau - known_torque(model, s.q, s.qd, s.qdd)) for s in segments]


def known_torque(model: Model, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return the torques of the links that keep their prior values, zero where all are identified.

    Args:
        model: the model.
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        qdd: accelerations, (N, n) [rad/s^2 or m/s^2].

    Returns:
        tau, (N, n) [N m or N].
    """
    others = tuple(k for k in range(1, model.robot.n + 1) if k not in model.robot.identified_links)
    if not others:
        return np.zeros_like(q)
    frozen = tuple(replace(joint, friction=(), motor_inertia=False) for joint in model.robot.joints)
    rest = Model(replace(model.robot, links=others, joints=frozen, coupling=None), model.rigid)
    return rest.observer().torque(prior_vector(rest), q, qd, qdd)


# ---------------------------------------------------------------- effects of the robot file
def with_effects(log: ConditionedLog, model: Model, reference: ReferenceTorques | None = None) -> ConditionedLog:
    """Return a log with the columns of the effects that the robot file lists.

    Args:
        log: the conditioned log.
        model: the model.
        reference: torques that effects scale with; those of the prior when None.
    """
    if not model.added:
        return log
    reference = reference or prior_torques(model)
    motions = [arm_motion(segment, log.filter, model, reference) for segment in log.segments]
    segments = [replace(s, effects=model.added_entries(c).T) for s, c in zip(log.segments, motions, strict=True)]
    return replace(log, segments=segments)


def arm_motion(segment: Segment, chosen: Filter, model: Model, reference: ReferenceTorques) -> ArmMotion:
    """Return a segment as effects want it.

    Args:
        segment: conditioned motion without gaps.
        chosen: the filters that it went through.
        model: the model.
        reference: torques that effects scale with.
    """
    kernel = lowpass_kernel(min(SMOOTH, chosen.cutoff), chosen.rate / chosen.first_step)[None]

    def smooth(x: Floats) -> Floats:
        half = (kernel.shape[1] - 1) // 2
        return np.asarray(decimate(np.pad(x, half, mode="reflect", reflect_type="odd")[None], kernel, 1)[0, 0])

    return ArmMotion(
        segment.elapsed, segment.q, segment.qd, segment.qdd, model.robot, reference, smooth, segment.coulomb_sign
    )
