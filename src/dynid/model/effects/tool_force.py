"""Constant force on the tool (a hose, a cable): -J^T f, f constant in the world."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class ToolForce(Effect):
    """Constant force on the tool (a hose, a cable)."""

    name = "tool_force"
    title = "constant force on the tool (a hose, a cable)"
    equation = "-J^T f, f constant in the world"
    signature = "wrist and elbow together, with the pattern of a force at the tip"
    separate = "turn the wrist in many directions at each pose"
    scope = "arm"
    family = "statics"

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"x": "N", "y": "N", "z": "N"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.array([motion.reference.tip_force(motion.q, axis).T for axis in range(3)])
