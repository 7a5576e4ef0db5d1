"""Friction that grows with the load: a |tau_rb| sign(qd), a > 0."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape, sign_of


class LoadFriction(Effect):
    """Friction that grows with the load."""

    name = "load_friction"
    title = "friction that grows with the load"
    equation = "a |tau_rb| sign(qd), a > 0"
    signature = "Coulomb-like, but larger where the joint carries more: high at high load, low at low load"
    separate = "the same motion with and without a payload"
    family = "load"
    positive = True
    needs_model = True

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": ""}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return (np.abs(motion.rigid[:, place[0]]) * sign_of(motion, place[0]))[None, None]
