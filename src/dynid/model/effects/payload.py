"""Payload that the model does not know: ten parameters of the last link, the first `form` of them."""

from __future__ import annotations

from typing import ClassVar

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape
from dynid.robot import LINK_PARAMETERS

UNITS = ("kg", *("kg m",) * 3, *("kg m^2",) * 6)


class Payload(Effect):
    """Payload that the model does not know."""

    name = "payload"
    title = "payload that the model does not know"
    equation = "ten parameters of the last link, the first `form` of them"
    signature = "joint 2 and 4 first, in proportion to gravity"
    separate = "nothing is needed: a payload shows at once"
    scope = "arm"
    uses = ("frozen",)
    shape_units: ClassVar[dict[str, str]] = {"form": ""}
    family = "statics"

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        return [{"form": form} for form in (1.0, 4.0, 10.0)]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return dict(list(zip(LINK_PARAMETERS, UNITS, strict=False))[: round(shape["form"])])

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.reference.tip_columns(motion.q, motion.qd, motion.qdd)[: round(shape["form"])].transpose(0, 2, 1)
