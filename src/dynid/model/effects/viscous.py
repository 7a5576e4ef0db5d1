"""Viscous friction: fv qd."""

from __future__ import annotations

from dynid.model.effects.interface import Column, Floats, State


def viscous_column(joint: int, unit: str) -> Column:
    """Return the column of fv for one joint (0-based). Source: Paper Eq. 7."""

    def pull(state: State, weights: list[Floats], gradient: State) -> None:
        gradient.qd[:, joint] += weights[0]

    return Column(
        f"fv{joint + 1}", unit, (joint,), lambda s: [s.qd[:, joint]], exact=lambda s: [s.qd[:, joint]], pull=pull
    )
