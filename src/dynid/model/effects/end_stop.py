"""One-sided stop or cable that snags: a max(0, side (q - q1))."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class EndStop(Effect):
    """One-sided stop or cable that snags."""

    name = "end_stop"
    title = "one-sided stop or cable that snags"
    equation = "a max(0, side (q - q1))"
    signature = "only at one end of the joint's travel, the same both ways"
    separate = "pass q1 often and from both sides"
    family = "position torque"
    shape_units: ClassVar[dict[str, str]] = {"side": "", "q1": "rad"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"q1": ("plus", 0.1)}

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        points = np.quantile(motion.q[:, place[0]], np.linspace(0.15, 0.85, 9))
        return [{"side": side, "q1": float(q1)} for side in (-1.0, 1.0) for q1 in points]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": "N m/rad"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.maximum(0.0, shape["side"] * (motion.q[:, place[0]] - shape["q1"]))[None, None]
