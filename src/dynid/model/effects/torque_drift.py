"""Drift of the torque sensor: a tc (1 - exp(-t / tc)); a t for a long tc."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class TorqueDrift(Effect):
    """Drift of the torque sensor."""

    name = "torque_drift"
    title = "drift of the torque sensor"
    equation = "a tc (1 - exp(-t / tc)); a t for a long tc"
    signature = "the mean of the residual moves with time and with nothing else"
    separate = "repeat the same motion minutes apart"
    family = "time"
    shape_units: ClassVar[dict[str, str]] = {"tc": "s"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"tc": ("times", 1.4)}

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        return [{"tc": tc} for tc in (1e6, 10.0, 25.0, 60.0, 150.0)]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": "N m/s"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return (shape["tc"] * -np.expm1(-motion.t / shape["tc"]))[None, None]
