"""Spring or cable torque: k1 q (+ k2 q^2 + k3 q^3) + c."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape


class Spring(Effect):
    """Spring or cable torque."""

    name = "spring"
    title = "spring or cable torque"
    equation = "k1 q (+ k2 q^2 + k3 q^3) + c"
    signature = "rises over the joint's travel: one sign at one end, the other at the other end"
    separate = "dwell at both ends of the travel"
    family = "position torque"
    shape_units: ClassVar[dict[str, str]] = {"order": "", "constant": ""}

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried; the constant only where the joint has no offset of its own."""
        constant = 0.0 if "offset" in motion.robot.joints[place[0]].friction else 1.0
        return [{"order": 1.0, "constant": constant}, {"order": 3.0, "constant": constant}]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        powers = range(1, round(shape["order"]) + 1)
        found = {f"k{i}": f"N m/rad^{i}" if i > 1 else "N m/rad" for i in powers}
        return found | ({"c": "N m"} if shape["constant"] else {})

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        q = motion.q[:, place[0]]
        powers = [q**i for i in range(1, round(shape["order"]) + 1)]
        return np.array([*powers, *([np.ones_like(q)] if shape["constant"] else [])])[:, None]
