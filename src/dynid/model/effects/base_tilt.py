"""Base that is not level: x tau_g(ex) + y tau_g(ey), and c cos(q1) + s sin(q1) on joint 1."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class BaseTilt(Effect):
    """Base that is not level."""

    name = "base_tilt"
    title = "base that is not level"
    equation = "x tau_g(ex) + y tau_g(ey), and c cos(q1) + s sin(q1) on joint 1"
    signature = "the first joint feels gravity; the others a small turn of it"
    separate = "turn the first joint through its whole travel with the arm stretched out"
    scope = "arm"
    needs_model = True
    family = "statics"

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"x": "rad", "y": "rad", "c": "N m", "s": "N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        columns = np.zeros((4, motion.n, len(motion)))
        for axis in (0, 1):
            columns[axis] = motion.reference.gravity_tilt(motion.q, axis).T
        columns[2, 0], columns[3, 0] = np.cos(motion.q[:, 0]), np.sin(motion.q[:, 0])
        return columns
