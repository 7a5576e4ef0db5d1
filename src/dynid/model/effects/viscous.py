"""Viscous friction: fv qd."""

from __future__ import annotations

from dynid.model.effects.interface import ArmMotion, Column, Effect, Floats, Place, Shape, State


def viscous_column(joint: int, unit: str) -> Column:
    """Return the column of fv for one joint (0-based). Source: Paper Eq. 7."""

    def add_gradient(state: State, weights: list[Floats], gradient: State) -> None:
        gradient.qd[:, joint] += weights[0]

    return Column(
        f"fv{joint + 1}",
        unit,
        (joint,),
        lambda s: [s.qd[:, joint]],
        exact=lambda s: [s.qd[:, joint]],
        add_gradient=add_gradient,
    )


class ViscousFriction(Effect):
    """Viscous friction."""

    name = "viscous"
    title = "viscous friction"
    equation = "fv qd"
    signature = "in proportion to the joint's own speed"
    separate = "several speeds, both ways"
    family = "viscous"

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"fv": "N m s/rad"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return motion.qd[:, place[0]][None, None]
