"""Viscous friction that differs with the direction: a |qd|."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class AsymmetricViscous(Effect):
    """Viscous friction that differs with the direction."""

    name = "asymmetric_viscous"
    title = "viscous friction that differs with the direction"
    equation = "a |qd|"
    signature = (
        "grows with speed, with the same sign both ways: largest where the joint is fast, small where it is slow"
    )
    separate = "drive the same path forwards and backwards"
    family = "viscous"

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": "N m s/rad"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.abs(motion.qd[:, place[0]])[None, None]
