"""Stribeck friction: a exp(-(|qd| / vs)^d) sign(qd), a > 0."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape, sign_of


class Stribeck(Effect):
    """Stribeck friction."""

    name = "stribeck"
    title = "Stribeck friction"
    equation = "a exp(-(|qd| / vs)^d) sign(qd), a > 0"
    signature = "a hump at low speed on both sides of each reversal that is gone at high speed"
    separate = "sweeps at constant speed over two decades, down to a tenth of vs"
    family = "friction curve"
    positive = True
    shape_units: ClassVar[dict[str, str]] = {"vs": "rad/s", "d": ""}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"vs": ("times", 1.25), "d": ("times", 1.3)}

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        return [{"vs": vs, "d": d} for vs in (0.014, 0.022, 0.036, 0.06, 0.1, 0.16) for d in (0.7, 1.0, 2.0)]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": "N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        speed = np.abs(motion.qd[:, place[0]])
        return (np.exp(-((speed / shape["vs"]) ** shape["d"])) * sign_of(motion, place[0]))[None, None]
