"""Torque offset: a constant fo, from a sensor that was not zeroed or friction that differs with the direction."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import ArmMotion, Column, Effect, Floats, Place, Shape


def offset_column(joint: int, unit: str) -> Column:
    """Return the column of fo for one joint (0-based)."""
    return Column(
        f"fo{joint + 1}",
        unit,
        (joint,),
        lambda s: [np.ones(len(s.qd))],
        exact=lambda s: [np.ones_like(s.qd[:, 0])],
        add_gradient=lambda *_: None,
    )


class TorqueOffset(Effect):
    """Torque offset, or Coulomb friction that differs with the direction."""

    name = "torque_offset"
    title = "torque offset, or Coulomb friction that differs with the direction"
    equation = "c"
    signature = "constant, whatever the joint does"
    separate = "a wide travel; a rest approached from both sides tells an offset from one-sided friction"
    family = "position torque"

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"c": "N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.ones((1, 1, len(motion)))
