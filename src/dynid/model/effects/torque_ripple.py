"""Torque ripple (cogging, gear, sensor): a cos(k q) + b sin(k q)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape

#: Radians of phase over the travel of the slowest wave that counts as one: below, it is a spring.
WAVES = 10.0
#: Radians of phase over the travel between neighbouring waves that are tried.
SPACING = 1.6
#: Fastest wave: harmonic drives have up to some 200 teeth [1/rad].
HIGHEST = 230.0
#: More shapes than this come from the grid, whose waves are evenly spaced.
MANY = 8
#: A joint that travels less does not move [rad].
STILL = 0.1


class TorqueRipple(Effect):
    """Torque ripple (cogging, gear, sensor)."""

    name = "torque_ripple"
    title = "torque ripple (cogging, gear, sensor)"
    equation = "a cos(k q) + b sin(k q)"
    signature = "a wave over the joint's position, faster in time when the joint is faster"
    separate = "a slow, even motion over several waves"
    shape_units: ClassVar[dict[str, str]] = {"k": "1/rad"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"k": ("plus", 0.1)}

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        travel = float(np.ptp(motion.q[:, place[0]]))
        if travel < STILL:
            return []
        return [{"k": float(k)} for k in np.arange(WAVES / travel, HIGHEST, SPACING / travel)]

    def tried(self, motion: ArmMotion, place: Place, shapes: Sequence[Shape]) -> list[Floats]:
        """Return the columns of several shapes; of evenly spaced waves each turns the one before by the same angles."""
        k = np.array([shape["k"] for shape in shapes])
        if len(k) < MANY:
            return super().tried(motion, place, shapes)
        q = motion.q[:, place[0]]
        wave, turn = np.exp(1j * k[0] * q), np.exp(1j * (k[1] - k[0]) * q)
        found = []
        for _ in k:
            found.append(np.stack([wave.real, wave.imag])[:, None])
            wave = wave * turn
        return found

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": "N m", "b": "N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        angle = shape["k"] * motion.q[:, place[0]]
        return np.array([np.cos(angle), np.sin(angle)])[:, None]
