"""Changed viscous friction: v qd."""

from __future__ import annotations

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class ViscousChange(Effect):
    """Changed viscous friction."""

    name = "viscous_change"
    title = "changed viscous friction"
    equation = "v qd"
    signature = "in proportion to the speed of one joint"
    separate = "several speeds, both ways"
    uses = ("frozen",)
    family = "friction curve"

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"v": "N m s/rad"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.qd[:, place[0]][None, None]
