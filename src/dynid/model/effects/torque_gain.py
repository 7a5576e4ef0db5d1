"""Gain error of one joint's torque sensor: g tau."""

from __future__ import annotations

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class TorqueGain(Effect):
    """Gain error of one joint's torque sensor."""

    name = "torque_gain"
    title = "gain error of one joint's torque sensor"
    equation = "g tau"
    signature = "in proportion to the joint's own torque, and in the joints whose model shares its parameters"
    separate = "a known payload, or a second sensor; a gain common to all joints cannot be seen without one"
    needs_model = True

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"g": ""}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.total[:, place[0]][None, None]
