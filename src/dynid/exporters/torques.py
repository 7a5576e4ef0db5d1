"""dynid's own torques of a full set, part by part, to compare other engines with."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.exporters.full_model import WholeArm
from dynid.model.regressor import Model

Floats = NDArray[np.float64]
Torques = Callable[[Floats, Floats, Floats], Floats]

#: Parts of the torque by the prefix of their parameters.
RIGID = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
ROTORS = ("Im",)
VISCOUS = ("fv",)


def part(model: Model, full: WholeArm, kinds: Sequence[str]) -> Torques:
    """Return the torques that only the parameters of these kinds make."""
    whole = Model(replace(model.robot, links=()), model.rigid)
    names = whole.parameter_names
    wanted = np.array([name.rstrip("0123456789") in kinds for name in names])
    gamma = np.where(wanted, full.values(names), 0.0)
    observer = whole.observer(np.flatnonzero(wanted))
    chosen = gamma[wanted]
    return lambda q, qd, qdd: observer.torque(chosen, q, qd, qdd)
