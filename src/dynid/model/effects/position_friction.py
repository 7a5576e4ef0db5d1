"""Friction that varies with the position: (a cos(h q) + b sin(h q)) sign(qd)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape, sign_of


class PositionFriction(Effect):
    """Friction that varies with the position."""

    name = "position_friction"
    title = "friction that varies with the position"
    equation = "(a cos(h q) + b sin(h q)) sign(qd)"
    signature = "friction differs between places of the joint's travel, both ways alike"
    separate = "cross the whole travel both ways at one slow speed"
    family = "position"
    shape_units: ClassVar[dict[str, str]] = {"h": "1/rad"}

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        return [{"h": h} for h in (1.0, 2.0)]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": "N m", "b": "N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        angle, sign = shape["h"] * motion.q[:, place[0]], sign_of(motion, place[0])
        return np.array([np.cos(angle) * sign, np.sin(angle) * sign])[:, None]
