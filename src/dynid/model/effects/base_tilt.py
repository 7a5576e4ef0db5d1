"""Base that is not level: x tau_g(ex) + y tau_g(ey), and c cos(q1) + s sin(q1) on joint 1."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import Course, Effect, Floats, Place, Shape


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

    def columns(self, course: Course, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        columns = np.zeros((4, course.n, len(course)))
        for axis in (0, 1):
            columns[axis] = course.physics.weight(course.q, axis).T
        columns[2, 0], columns[3, 0] = np.cos(course.q[:, 0]), np.sin(course.q[:, 0])
        return columns
