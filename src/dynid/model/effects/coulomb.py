"""Coulomb friction: fc sign(qd), the sign smooth or the paper's (Eq. 7: zero below a velocity limit)."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import ArmMotion, Column, Effect, Floats, Place, Shape, State, sign_of
from dynid.robot import Coulomb


def coulomb_sign(qd: Floats, shape: Coulomb, joint: int) -> Floats:
    """Return the sign of a velocity as the robot file wants it, (B,).

    Source: Paper Eq. 7 with its inequality turned round: friction acts where the speed is at least the limit.
    """
    limit = shape.velocity[joint]
    if shape.shape == "smooth":
        return np.tanh(qd / limit)
    return np.where(np.abs(qd) >= limit, np.sign(qd), 0.0)


def coulomb_slope(qd: Floats, shape: Coulomb, joint: int) -> Floats:
    """Return the derivative of ``coulomb_sign`` by the velocity, (B,); zero for the paper's steps."""
    if shape.shape == "smooth":
        return (1 - np.tanh(qd / shape.velocity[joint]) ** 2) / shape.velocity[joint]
    return np.zeros_like(qd)


def coulomb_column(joint: int, shape: Coulomb, unit: str) -> Column:
    """Return the column of fc for one joint (0-based)."""

    def add_gradient(state: State, weights: list[Floats], gradient: State) -> None:
        gradient.qd[:, joint] += weights[0] * coulomb_slope(state.qd[:, joint], shape, joint)

    return Column(
        f"fc{joint + 1}",
        unit,
        (joint,),
        lambda s: [coulomb_sign(s.qd[:, joint], shape, joint)],
        add_gradient=add_gradient,
    )


class CoulombFriction(Effect):
    """Coulomb friction."""

    name = "coulomb"
    title = "Coulomb friction"
    equation = "fc sign(qd)"
    signature = "a step at each reversal, the same size both ways"
    separate = "several reversals at different speeds"
    family = "friction curve"

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"fc": "N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        return sign_of(motion, place[0])[None, None]
