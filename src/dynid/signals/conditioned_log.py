"""A conditioned log: motion and torques after the filters, from which the rows of the observation matrix are made.

A prepared log (checked, in DH quantities) is freed of spikes, corrected for a known delay of its torques, filtered and
differentiated. The torques of links that keep their prior values are subtracted, and
the columns of the robot file's effects are evaluated: they depend on the order of the samples.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats, Mask
from dynid.errors import Finding, LogTooShort, located
from dynid.log import Log
from dynid.model.effects.catalogue import delay_of
from dynid.model.effects.friction import coulomb_sign
from dynid.model.effects.motion import ArmMotion, ReferenceTorques
from dynid.model.regressor import Model, ModelTorques, prior_vector
from dynid.options import LogOptions
from dynid.progress import notice, stage
from dynid.robot import Coulomb
from dynid.signals import tuning
from dynid.signals.columns import take_samples
from dynid.signals.filters import (
    Filter,
    choose_cutoff,
    choose_filter,
    choose_sign_cutoffs,
    decimate,
    despiked,
    lowpass_kernel,
    under,
    velocity_kernel,
)
from dynid.signals.motion import speed


@dataclass(frozen=True)
class Segment:
    """Part of a log without gaps, after the position filter; N samples of n joints.

    Attributes:
        t: time in the log's clock, (N,) [s].
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
        tau: torques under the same filter, (N, n) [N m, N or A].
        usable: False where a sample under the filter was clipped, or the joint rests, (N, n).
        raw_q: unfiltered position at the same times, (N, n) [rad or m].
        raw_qd: unfiltered velocity: the driver's where there is one, otherwise differences, (N, n) [rad/s or m/s].
        command_q: commanded positions under the same filter, (N, n) [rad or m]; (N, 0) where the log has none.
        effects: entries of the columns of added effects, (N, E) [N m or N per unit of the parameter].
        elapsed: time since the log began, (N,) [s].
        coulomb_sign: sign of the velocity as Coulomb friction has it, under the same filter, (N, n); (N, 0) where it is
            to be taken of ``qd``.
    """

    t: Floats
    q: Floats
    qd: Floats
    qdd: Floats
    tau: Floats
    usable: Mask
    raw_q: Floats
    raw_qd: Floats
    command_q: Floats
    effects: Floats
    elapsed: Floats
    coulomb_sign: Floats

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)

    def __getitem__(self, part: slice) -> Segment:
        """Return some of the samples, as views."""
        return Segment(**{name: values[part] for name, values in vars(self).items()})


def condition(log: Log, chosen: Filter) -> list[Segment]:
    """Resample, filter and differentiate a log: one segment for each part without gaps.

    Args:
        log: a prepared log, in DH quantities of one robot.
        chosen: the filters.

    Raises:
        LogTooShort: no part is longer than the filters.
    """
    kernels, step, found = chosen.first_kernels, chosen.first_step, []
    half = kernels.shape[1] // 2

    def filtered(x: NDArray[Any], weights: Floats) -> Floats:
        """Return a signal under kernels, (K, M, n)."""
        return decimate(x.T, weights, step).transpose(0, 2, 1)

    for part in _parts(log, chosen):
        q, qd, qdd = filtered(part.q, kernels)
        if chosen.measured_velocity and part.qd is not None:
            qd, qdd = filtered(part.qd, kernels[:2])
        clipped = part.extra.get("clipped", np.zeros(part.q.shape))
        command = part.extra.get("q_ref")
        centres, none = half + step * np.arange(len(q)), np.empty((len(q), 0))
        raw_qd = 0.5 * chosen.rate * (part.q[centres + 1] - part.q[centres - 1])
        found.append(
            Segment(
                t=part.t[centres],
                q=q,
                qd=qd,
                qdd=qdd,
                tau=filtered(part.tau, kernels[:1])[0],
                usable=filtered(clipped, np.ones_like(kernels[:1]))[0] < 0.5,
                raw_q=part.q[centres],
                raw_qd=raw_qd if part.qd is None else part.qd[centres],
                command_q=none if command is None else filtered(command, kernels[:1])[0],
                effects=none,
                elapsed=part.t[centres] - log.t[0],
                coulomb_sign=none,
            )
        )
    return found


def _parts(log: Log, chosen: Filter) -> list[Log]:
    """Return the parts between gaps that are longer than the filters, on even grids.

    Raises:
        LogTooShort: there are none.
    """
    step, parts = 1.0 / chosen.rate, []
    cuts = np.flatnonzero(np.diff(log.t) > (tuning.GAP_SAMPLES + 0.5) * step) + 1
    needed = chosen.first_kernels.shape[1] + chosen.first_step * (
        chosen.second_kernel.shape[1] + chosen.second_step
    )
    every = [take_samples(log, slice(*ends)) for ends in pairwise([0, *cuts.tolist(), len(log)])]
    for part in every:
        if len(part) <= needed:
            continue
        times = part.t[0] + np.arange(round(part.duration * chosen.rate) + 1) * step
        columns = part.columns
        if len(times) != len(part) or np.abs(part.t - times).max() >= tuning.EVEN_STEP * step:
            columns = {key: resampled(part.t, x, times) for key, x in columns.items()}
        parts.append(part.with_columns(columns, t=times))
    if not parts:
        longest = max(map(len, every)) * step
        raise LogTooShort(
            f"the longest part without a gap has {longest:.2f} s; "
            f"the filters at {chosen.cutoff:.3g} Hz need {needed * step:.2f} s",
            where=str(log.source or ""),
            fix="record a longer motion, or raise --cutoff",
        )
    return parts


def _without_rests(segment: Segment, rest_speed: Floats) -> Segment:
    """Mark samples of joints at rest: static friction holds any torque up to its limit, which no column describes.

    Args:
        segment: conditioned motion.
        rest_speed: speed below which the friction of a joint is undetermined, 0 where that does not matter, (n,)
            [rad/s or m/s]; samples of a joint that stays slower for ``tuning.FRICTION_REST_S``, or than a share of it
            for that share of the time, are not usable.
    """
    from scipy.ndimage import binary_opening  # here: its import takes longer than most logs

    # Why not qd: positions pass far more than torques do, and what the encoder scatters seems to move.
    speeds = np.abs(speed(Log(segment.t, segment.q, segment.tau)))
    usable, step = segment.usable, segment.t[1] - segment.t[0]
    for share in tuning.REST_SHARES:
        least = max(1, round(share * tuning.FRICTION_REST_S / step))
        usable = usable & ~binary_opening(speeds < share * rest_speed, np.ones((least, 1)))
    return replace(segment, usable=usable)


def signs_of_shapes(
    log: Log,
    chosen: Filter,
    sharp: Coulomb,
    shapes: Sequence[Coulomb],
    most: int = sys.maxsize,
    then: Callable[[Floats], Floats] = np.asarray,
) -> list[Floats]:
    """Return the Coulomb signs of several shapes under the filter of the torques, (N, n, shapes) for each segment.

    Args:
        log: a prepared log.
        chosen: the filters.
        sharp: shape whose width is large against the noise of the velocity whose sign is taken.
        shapes: of the sign.
        most: samples of the beginning of each segment that are wanted.
        then: what is wanted of each sign, (1, N) -> (1, M).
    """
    kernels, step, found = chosen.first_kernels[:1], chosen.first_step, []
    count = (most - 1) * step + kernels.shape[1]
    for part in _parts(log, chosen):
        x = part.qd if chosen.measured_velocity and part.qd is not None else part.q
        measured = x is part.qd
        cutoffs = choose_sign_cutoffs(x, sharp, chosen.rate, chosen.cutoff, measured=measured)
        signs = []
        for j, cutoff in enumerate(cutoffs):
            kernel = velocity_kernel(cutoff, chosen.rate, measured=measured)
            v = under(kernel, x[: count + len(kernel), j])[:count]
            # Why one by one: the signs of all shapes take many times the memory of the log.
            each = (coulomb_sign(v, shape, j, 1.0 / chosen.rate) for shape in shapes)
            signs.append([then(decimate(sign[None], kernels, step)[0])[0] for sign in each])
        found.append(np.array(signs).transpose(2, 0, 1))
    return found


def resampled(t: Floats, x: Floats, grid: Floats) -> Floats:
    """Interpolate by time stamp with the cubic through the two samples before and the two after (Lagrange).

    Args:
        t: increasing time stamps, (N,) with N >= 4 [s].
        x: signals of any unit, (N, C).
        grid: times inside those of ``t``, (M,) [s].

    Returns:
        The signals at the times of the grid, (M, C).

    Why not a spline: a cubic through four samples looks no further than they do, so a log gives the same values whether
    it is read whole or in parts.
    """
    right = np.clip(np.searchsorted(t, grid), 2, len(t) - 2)
    nodes = right + np.arange(-2, 2)[:, None]
    found = np.zeros((len(grid), x.shape[1]))
    for k, own in enumerate(nodes):
        others = t[np.delete(nodes, k, axis=0)]
        weight = np.prod((grid - others) / (t[own] - others), axis=0)
        found += weight[:, None] * x[own]
    return found


def segment_without_delay(segment: Segment, delay: float, known: Floats | float = 0.0) -> Segment:
    """Return a segment whose torque at t is the filtered one at t + delay; the end is not usable any more.

    Why a spline here: filtered torques are thinned, so that four samples no longer carry them, and a search over delays
    needs a torque that is smooth in the delay.

    Args:
        segment: the segment.
        delay: by how much the torques are late [s].
        known: what was subtracted from them at the time of the positions, (N, n) [N m or N].
    """
    if not delay:
        return segment
    from scipy.interpolate import CubicSpline

    t = segment.t + delay
    inside = (t >= segment.t[0]) & (t <= segment.t[-1])
    wanted = np.clip(t, segment.t[0], segment.t[-1])
    tau = CubicSpline(segment.t, segment.tau + known, axis=0)(wanted) - known
    return replace(segment, tau=tau, usable=segment.usable & inside[:, None])


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
        torque_step: steps in which torques were recorded, 0 where they are finer than can be told, (n,) [N m, N or A];
            none where it is not known.
    """

    segments: Sequence[Segment]
    filter: Filter
    name: str
    path: str = ""
    sha256: str = ""
    delay: float = 0.0
    findings: tuple[Finding, ...] = ()
    torque_step: Floats = field(default_factory=lambda: np.zeros(0))


def coarse_steps(tau: Floats) -> Floats:
    """Return the steps in which torques, (N, n), were recorded, 0 where nearly every value is another one, (n,)."""
    found = np.zeros(tau.shape[1])
    for j, x in enumerate(tau[: tuning.ENOUGH_SAMPLES].T):
        steps = np.diff(np.sort(x))
        steps = steps[steps > 0.0]
        if 0 < len(steps) < len(x) / tuning.VALUES_OF_STEPS - 1:
            found[j] = np.median(steps)
    return found


def condition_log(
    log: Log, model: Model, cutoff: float, options: LogOptions = LogOptions()
) -> ConditionedLog:
    """Condition one log for the rows of a model.

    Args:
        log: a prepared log, in DH quantities.
        model: the model whose rows are wanted.
        cutoff: cut-off frequency of the filter over torques and columns [Hz].
        options: velocity and delay, where None counts as zero: torques are moved back by it.

    Returns:
        The conditioned log; spikes that were removed are among its findings.

    Raises:
        LogTooShort: no interval without gaps is longer than the filters.
    """
    robot, delay = model.robot, options.delay or 0.0
    with located(str(log.source or "")):
        chosen = choose_filter(log, cutoff, measured_velocity=options.velocity == "measured")
        clean, spikes = despiked(log, chosen.cutoff)
        sharp = robot.coulomb or robot.usual_coulomb
        speeds = zip(sharp.velocity, robot.joints, strict=True)
        rest = np.array([v if "coulomb" in joint.friction else 0.0 for v, joint in speeds])
        segments = condition(clean, chosen)
        signs = signs_of_shapes(clean, chosen, sharp, [robot.coulomb_shape])
    late = delay + delay_of(robot.effects)
    segments = [
        segment_without_delay(_without_rests(replace(s, coulomb_sign=sign[..., 0]), rest), late)
        for s, sign in zip(segments, signs, strict=True)
    ]
    conditioned = ConditionedLog(
        segments=without_known(segments, model),
        filter=chosen,
        name=log.source.name if log.source else "",
        path=str(log.source or ""),
        sha256=log.sha256,
        delay=delay,
        findings=(*log.findings, *spikes),
        torque_step=coarse_steps(log.tau),
    )
    return with_effects(conditioned, model)


def condition_logs(
    logs: Sequence[Log], model: Model, options: LogOptions = LogOptions()
) -> list[ConditionedLog]:
    """Condition several logs with one filter, which has to serve all that are stacked.

    Args:
        logs: prepared logs.
        model: the model whose rows are wanted.
        options: cut-off, velocity, and the delay, where None counts as zero.
    """
    cutoff = choose_cutoff(logs, model.robot) if options.cutoff is None else options.cutoff
    found = []
    for k, log in enumerate(logs, start=1):
        each = condition_log(log, model, cutoff, options)
        found.append(replace(each, name=each.name or f"log {k}"))
        where = each.path or found[-1].name
        stage("log", f"{where}: {len(log)} samples, {log.duration:.1f} s, {log.rate:.1f} Hz")
        notice(each.findings)
    how = "from motion and encoder noise; " if options.cutoff is None else ""
    chosen = found[0].filter
    stage(
        "filter",
        f"zero-phase low-pass at {chosen.cutoff:.3g} Hz over torque and columns ({how}positions at "
        f"{chosen.position_cutoff:.3g} Hz), {chosen.kept_rate:.3g} Hz kept",
    )
    return found


def stretches(logs: Sequence[ConditionedLog], seconds: float) -> tuple[list[ConditionedLog], int]:
    """Return logs of which only some stretches are left, spread evenly over each, where they are longer together.

    Args:
        logs: conditioned logs.
        seconds: how long they may be together; each segment keeps its share in ``tuning.KEPT_STRETCHES`` parts.

    Returns:
        The logs, and in how many parts they are; 0 where they are whole.
    """
    every = [segment for log in logs for segment in log.segments]
    long = sum(segment.t[-1] - segment.t[0] for segment in every)
    # Why rows too: a recording at a low rate is long in time alone.
    share = max(seconds / long, tuning.KEPT_SAMPLES / sum(map(len, every)))
    if share >= 1.0:
        return list(logs), 0
    found = []
    for log in logs:
        kept = []
        for segment in log.segments:
            length = round(len(segment) * share / tuning.KEPT_STRETCHES)
            starts = np.linspace(0, len(segment) - length, tuning.KEPT_STRETCHES).astype(int)
            # Why a copy: what is left shall not keep the whole log in memory.
            kept += [deepcopy(segment[start : start + length]) for start in starts.tolist()]
        found.append(replace(log, segments=kept))
    return found, sum(len(log.segments) for log in found)


def torques_moved_back(log: ConditionedLog, model: Model, delay: float) -> ConditionedLog:
    """Return a conditioned log whose measured torque at t is that at t + delay; the ends are not usable any more.

    Args:
        log: the conditioned log, its torques as they were recorded.
        model: the model that it was conditioned for.
        delay: by how much the torques are late [s].
    """
    segments = []
    for s in log.segments:
        known = known_torque(model, s.q, s.qd, s.qdd)
        segments.append(segment_without_delay(s, delay, known))
    return replace(log, segments=segments, delay=delay)


def without_known(segments: Sequence[Segment], model: Model) -> list[Segment]:
    """Subtract the torques of links that keep their prior values, so that the rest fits the identified columns."""
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
def with_effects(
    log: ConditionedLog, model: Model, reference: ReferenceTorques | None = None
) -> ConditionedLog:
    """Return a log with the columns of the effects that the robot file lists.

    Args:
        log: the conditioned log.
        model: the model.
        reference: torques that effects scale with; those of the prior when None.
    """
    if not model.added:
        return log
    reference = reference or ModelTorques(model, prior_vector(model))
    segments = []
    for segment in log.segments:
        motion = arm_motion(segment, log.filter, model, reference)
        segments.append(replace(segment, effects=model.added_entries(motion).T))
    return replace(log, segments=segments)


def arm_motion(
    segment: Segment, chosen: Filter, model: Model, reference: ReferenceTorques
) -> ArmMotion:
    """Return a segment as effects want it.

    Args:
        segment: conditioned motion without gaps.
        chosen: the filters that it went through.
        model: the model.
        reference: torques that effects scale with.
    """
    rate = chosen.rate / chosen.first_step
    kernel = lowpass_kernel(min(tuning.EFFECT_SMOOTHING_HZ, chosen.cutoff), rate)
    since = segment.t - next(
        (x.parameters["clock"] for x in model.robot.effects if "clock" in x.parameters), np.inf
    )
    return ArmMotion(
        since if 0.0 <= since[0] < tuning.SESSION_S else segment.elapsed,
        segment.q,
        segment.qd,
        segment.qdd,
        model.robot,
        reference,
        partial(under, kernel),
        segment.coulomb_sign,
    )
