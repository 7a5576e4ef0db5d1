"""Encoder zero that is off: tau_rb(q - D e_j) - tau_rb(q), to first order in D."""

from __future__ import annotations

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape

#: Step of the derivative [rad].
STEP = 1e-5


class EncoderOffset(Effect):
    """Encoder zero that is off."""

    name = "encoder_offset"
    title = "encoder zero that is off"
    equation = "tau_rb(q - D e_j) - tau_rb(q), to first order in D"
    signature = "in several joints at once, with the pattern of gravity turned by a small angle"
    separate = "static poses over the whole workspace"
    needs_model = True
    family = "statics"

    def rows(self, place: Place, n: int) -> tuple[int, ...]:
        """Return all joints: the whole arm's torque changes."""
        return tuple(range(n))

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"offset": "rad"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        moved = motion.q.copy()
        moved[:, place[0]] -= STEP
        return ((motion.reference.rigid(moved, motion.qd, motion.qdd) - motion.rigid) / STEP).T[None]
