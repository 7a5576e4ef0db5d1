"""Friction that is not linear in speed: a sign(qd) |qd|^p."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class NonlinearViscous(Effect):
    """Friction that is not linear in speed."""

    name = "nonlinear_viscous"
    title = "friction that is not linear in speed"
    equation = "a sign(qd) |qd|^p"
    signature = "the residual bends with speed: one sign at middle speeds, the other at the highest"
    separate = "move the joint at least five times faster than the bend"
    family = "friction curve"
    shape_units: ClassVar[dict[str, str]] = {"p": ""}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"p": ("times", 1.1)}

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        return [{"p": p} for p in (1.3, 1.6, 2.0, 2.5, 3.0)]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": "N m (s/rad)^p"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        speed = motion.qd[:, place[0]]
        return (np.sign(speed) * np.abs(speed) ** shape["p"])[None, None]
