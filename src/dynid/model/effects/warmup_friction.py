"""Friction that falls while the drive warms up: exp(-t / tw) (a1 sign(qd) + a2 qd)."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape, sign_of


class WarmupFriction(Effect):
    """Friction that falls while the drive warms up."""

    name = "warmup_friction"
    title = "friction that falls while the drive warms up"
    equation = "exp(-t / tw) (a1 sign(qd) + a2 qd)"
    signature = "friction is larger in the first minutes than later"
    separate = "repeat the same motion cold and warm"
    family = "time"
    shape_units: ClassVar[dict[str, str]] = {"tw": "s"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"tw": ("times", 1.4)}

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        return [{"tw": tw} for tw in (12.0, 25.0, 50.0, 100.0, 250.0)]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a1": "N m", "a2": "N m s/rad"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        cold = np.exp(-motion.t / shape["tw"])
        return np.array([cold * sign_of(motion, place[0]), cold * motion.qd[:, place[0]]])[:, None]
