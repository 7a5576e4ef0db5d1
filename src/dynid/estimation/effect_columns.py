"""Columns of effects that scale with the model that is being identified, such as load-dependent friction.

They are made with the last estimate and the fit is repeated until it settles; the result is then its own reference.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.stack import stack_base
from dynid.model.base_model import BaseModel
from dynid.model.reference import model_torques
from dynid.signals.conditioned_log import ConditionedLog, with_effects

Floats = NDArray[np.float64]

#: Fits until columns that scale with the model have settled; each changes them by the effect's share of the torque.
ROUNDS = 3


def settled(logs: Sequence[ConditionedLog], base: BaseModel, first: Floats | None = None) -> list[ConditionedLog]:
    """Return logs whose model-based columns fit the parameters that are identified from them.

    Args:
        logs: conditioned logs.
        base: model and base parameters.
        first: base parameters to begin with, (p,), each in its unit; those of a first fit when None.
    """
    found = list(logs)
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


def scaled(logs: Sequence[ConditionedLog], base: BaseModel, theta: Floats) -> list[ConditionedLog]:
    """Return logs whose model-based columns scale with given base parameters, (p,), each in its unit."""
    reference = model_torques(base.model, base.reduction, theta)
    return [with_effects(log, base.model, reference) for log in logs]


def fitted(logs: Sequence[ConditionedLog], base: BaseModel) -> Floats:
    """Return base parameters of conditioned logs by weighted least squares, (p,), each in its unit."""
    return stack_base(logs, base).first_fit.theta
