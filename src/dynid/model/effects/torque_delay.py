"""Delay of the torque behind the position: -T d tau/dt, the logs are then shifted by T."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class TorqueDelay(Effect):
    """Delay of the torque behind the position."""

    name = "torque_delay"
    title = "delay of the torque behind the position"
    equation = "-T d tau/dt, the logs are then shifted by T"
    signature = "in all joints alike, where the torque changes fast: reversals, high frequency"
    separate = "fast reversals; look for a filter in the driver"
    scope = "arm"
    needs_model = True

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"delay": "s"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return -np.gradient(motion.total, motion.t, axis=0).T[None]
