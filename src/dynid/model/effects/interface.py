"""What a torque effect gives to the regressor: columns, each with a name, a unit and the joints it acts on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.model.field import FieldState, Residues

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class State:
    """A block of samples.

    Attributes:
        q: positions, (B, n) [rad or m].
        qd: velocities, (B, n) [rad/s or m/s].
        qdd: accelerations, (B, n) [rad/s^2 or m/s^2].
    """

    q: Floats
    qd: Floats
    qdd: Floats


@dataclass(frozen=True)
class Column:
    """One column of the regressor beyond the links' ten parameters and rotor inertia.

    Attributes:
        name: parameter name, such as ``fv3``.
        unit: unit of the parameter.
        rows: indices of the joints it acts on, 0-based.
        evaluate: its entries in those rows for a block, each (B,).
        exact: the same entries in the prime field of ``model/field.py`` for states given there; None for a function
            that is no polynomial of the state, such as a sign: it takes part as an independent function of the motion.
        pull: adds weights @ d entries / d state to a gradient, given the state, a weight (B,) for each row and the
            gradient; None where nobody has written it, and differences are taken.
    """

    name: str
    unit: str
    rows: tuple[int, ...]
    evaluate: Callable[[State], list[Floats]]
    exact: Callable[[FieldState], list[Residues]] | None = None
    pull: Callable[[State, list[Floats], State], None] | None = None
