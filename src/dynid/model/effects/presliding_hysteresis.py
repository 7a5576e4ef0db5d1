"""Hysteresis before sliding (Dahl): a (z - sign(qd)), dz/dq = (1 - z sign(qd)) / delta, a > 0."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place, Shape, sign_of


class PreslidingHysteresis(Effect):
    """Hysteresis before sliding (Dahl)."""

    name = "presliding_hysteresis"
    title = "hysteresis before sliding (Dahl)"
    equation = "a (z - sign(qd)), dz/dq = (1 - z sign(qd)) / delta, a > 0"
    signature = "friction builds up over the first millirads after each reversal instead of jumping"
    separate = "many small reversals, each a few delta long"
    positive = True
    shape_units: ClassVar[dict[str, str]] = {"delta": "rad"}
    steps: ClassVar[dict[str, tuple[str, float]]] = {"delta": ("times", 1.4)}
    family = "friction curve"

    def grid(self, motion: ArmMotion, place: Place) -> list[dict[str, float]]:
        """Return the shapes that are tried."""
        return [{"delta": float(delta)} for delta in np.geomspace(0.002, 0.2, 9)]

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return {"a": "N m"}

    def columns(self, motion: ArmMotion, place: Place, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        z = presliding(motion.q[:, place[0]], shape["delta"])
        return (z - sign_of(motion, place[0]))[None, None]


def presliding(q: Floats, delta: float) -> Floats:
    """Return the bristle's state over a motion, exact in the position, (N,).

    Between reversals z = sigma + (z0 - sigma) exp(-|q - q0| / delta); it starts slack at 0.
    """
    step = np.diff(q, prepend=q[:1])
    direction = np.sign(step)
    turns = np.flatnonzero(np.diff(direction) != 0) + 1
    z = np.zeros_like(q)
    last, origin = 0.0, q[0]
    for run in np.split(np.arange(len(q)), turns):
        sigma = direction[run[0]]
        z[run] = sigma + (last - sigma) * np.exp(-np.abs(q[run] - origin) / delta) if sigma else last
        last, origin = z[run[-1]], q[run[-1]]
    return z
