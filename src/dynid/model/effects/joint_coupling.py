"""Friction that a neighbouring joint drags along: a qd_k + b sign(qd_k), k the neighbour."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape, sign_of


class JointCoupling(Effect):
    """Friction that a neighbouring joint drags along."""

    name = "joint_coupling"
    title = "friction that a neighbouring joint drags along"
    equation = "a qd_k + b sign(qd_k), k the neighbour"
    signature = "the residual of one joint follows the speed of the next one"
    separate = "move the two joints one after the other"
    scope = "pair"
    family = "cross"

    def places(self, n: int) -> list[Place]:
        """Return every joint with each of its neighbours."""
        return [(j, k) for j in range(n) for k in (j - 1, j + 1) if 0 <= k < n]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": "N m s/rad", "b": "N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return np.array([motion.qd[:, place[1]], sign_of(motion, place[1])])[:, None]
