"""Added effects in loop 3: their columns over conditioned logs, and the model that some of them scale with.

Effects such as load-dependent friction need the torques of the model that is being identified. Their columns are made
with the last estimate and the fit is repeated until it settles; the stored result is then its own reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.least_squares import weighted
from dynid.estimation.stack import Source, stack_base
from dynid.model.effects.interface import ArmMotion, ReferenceTorques
from dynid.model.reference import model_torques, prior_torques
from dynid.model.regressor import Model
from dynid.model.store import BaseModel
from dynid.signals.conditioning import Filter, Segment
from dynid.signals.filters import decimate

Floats = NDArray[np.float64]

#: Fits until columns that scale with the model have settled; each changes them by the effect's share of the torque.
ROUNDS = 3


def arm_motion(segment: Segment, chosen: Filter, model: Model, reference: ReferenceTorques) -> ArmMotion:
    """Return a conditioned stretch as effects want it."""
    kernel = chosen.second_kernel

    def smooth(x: Floats) -> Floats:
        half = (kernel.shape[1] - 1) // 2
        return np.asarray(decimate(np.pad(x, half, mode="edge")[None], kernel, 1)[0, 0])

    return ArmMotion(
        segment.elapsed, segment.q, segment.qd, segment.qdd, model.robot, reference, smooth, segment.coulomb_sign
    )


def with_effects(source: Source, model: Model, reference: ReferenceTorques | None = None) -> Source:
    """Return a log with the columns of the effects that the robot file lists.

    Args:
        source: the conditioned log.
        model: the model.
        reference: torques that effects scale with; those of the prior when None.
    """
    if not model.added:
        return source
    reference = reference or prior_torques(model)
    motions = [arm_motion(segment, source.chosen, model, reference) for segment in source.segments]
    segments = [replace(s, effects=model.added_entries(c).T) for s, c in zip(source.segments, motions, strict=True)]
    return replace(source, segments=segments)


def on_time(segment: Segment, delay: float) -> Segment:
    """Return a stretch whose torques, which came late, belong to its positions again; the end counts no more.

    Args:
        segment: the stretch.
        delay: how late the torques are [s].
    """
    if not delay:
        return segment
    from scipy.interpolate import CubicSpline

    t = segment.t + delay
    inside = (t >= segment.t[0]) & (t <= segment.t[-1])
    wanted = np.clip(t, segment.t[0], segment.t[-1])
    tau = np.asarray(CubicSpline(segment.t, segment.tau, axis=0)(wanted))
    return replace(segment, tau=tau, usable=segment.usable & inside[:, None])


def settled(sources: Sequence[Source], base: BaseModel, first: Floats | None = None) -> list[Source]:
    """Return logs whose model-based columns fit the parameters that are identified from them.

    Args:
        sources: conditioned logs.
        base: model and base parameters.
        first: base parameters to begin with, (p,); those of a first fit when None.
    """
    found = list(sources)
    if not scale_with_model(base):
        return found
    theta = first
    for _ in range(ROUNDS):
        theta = fitted(found, base) if theta is None else theta
        found = scaled(found, base, theta)
        theta = None
    return found


def scale_with_model(base: BaseModel) -> bool:
    """Return whether columns of the model's effects depend on the parameters that are identified."""
    return any(added.effect.needs_model for added in base.model.added)


def scaled(sources: Sequence[Source], base: BaseModel, theta: Floats) -> list[Source]:
    """Return logs whose model-based columns scale with given base parameters, (p,)."""
    reference = model_torques(base.model, base.reduction, theta)
    return [with_effects(source, base.model, reference) for source in sources]


def fitted(sources: Sequence[Source], base: BaseModel) -> Floats:
    """Return base parameters of conditioned logs by weighted least squares, (p,)."""
    return weighted(*stack_base(sources, base).whole).theta
