"""Cross-talk from another joint's torque: a tau_rb,k, k another joint."""

from __future__ import annotations

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class TorqueCrosstalk(Effect):
    """Cross-talk from another joint's torque."""

    name = "torque_crosstalk"
    title = "cross-talk from another joint's torque"
    equation = "a tau_rb,k, k another joint"
    signature = "the residual of one joint follows the load of another"
    separate = "load one joint while the other rests"
    scope = "pair"
    family = "cross"
    needs_model = True

    def places(self, n: int) -> list[Place]:
        """Return every ordered pair of joints."""
        return [(j, k) for j in range(n) for k in range(n) if j != k]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": ""}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.rigid[:, place[1]][None, None]
