"""Rotor inertia: Im qdd."""

from __future__ import annotations

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class MotorInertia(Effect):
    """Rotor inertia."""

    name = "motor_inertia"
    title = "rotor inertia"
    equation = "Im qdd"
    signature = "in proportion to the joint's own acceleration; strongest at reversals of a fast joint"
    separate = "fast reversals; on the first joints it cannot be told from the link's own inertia"
    positive = True

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"Im": "kg m^2"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.qdd[:, place[0]][None, None]
