"""Changed Coulomb friction: c sign(qd)."""

from __future__ import annotations

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape, sign_of


class CoulombChange(Effect):
    """Changed Coulomb friction."""

    name = "coulomb_change"
    title = "changed Coulomb friction"
    equation = "c sign(qd)"
    signature = "a step at each reversal, on one joint"
    separate = "nothing is needed: it shows at every reversal"
    uses = ("frozen",)
    family = "friction curve"

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"c": "N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return sign_of(motion, place[0])[None, None]
