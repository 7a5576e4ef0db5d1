"""Elastic joint with the encoder on the motor's side: tau_rb(q - tau_j / K e_j) - tau_rb(q), to first order."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape

#: Step of the directional derivative [rad/N m]: a hundredth of the softest gear.
STEP = 1e-6


class JointElasticity(Effect):
    """Elastic joint with the encoder on the motor's side."""

    name = "joint_elasticity"
    title = "elastic joint with the encoder on the motor's side"
    equation = "tau_rb(q - tau_j / K e_j) - tau_rb(q), to first order in 1/K > 0"
    signature = "at high frequency and where the torque changes fast; in several joints at once"
    separate = "fast reversals under load"
    positive = True
    needs_model = True

    def rows(self, place: Place, n: int) -> tuple[int, ...]:
        """Return all joints: the whole arm's torque changes."""
        return tuple(range(n))

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"compliance": "rad/N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        j = place[0]
        bend = motion.smooth(motion.rigid[:, j])
        speed = np.gradient(bend, motion.t)
        moved = []
        for x, shift in ((motion.q, bend), (motion.qd, speed), (motion.qdd, np.gradient(speed, motion.t))):
            y = x.copy()
            y[:, j] -= STEP * shift
            moved.append(y)
        return ((motion.reference.rigid(*moved) - motion.rigid) / STEP).T[None]
