"""The mean of the residual model as source code: numbers per column, joint and parameter, and the columns' shapes.

    tau_j = sum_k a_jk shape_k(q_j, qd_j) + a_j |Y_j reference| sign_j - Y_j shift_j

Y is the base regressor that the file has already. Shapes are those of ``dynid.estimation.residual_model``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.residual_model import ModelError

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Spelling:
    """How a language spells what the shapes are made of.

    Attributes:
        position: of a joint.
        speed: of a joint.
        sign: Coulomb sign of a joint.
        load: torque that friction of the load scales with, of a joint.
        store: a statement that stores the torque of a joint.
        call: a function of one number, by its name.
        absolute: name of the absolute value.
    """

    position: Callable[[int], str]
    speed: Callable[[int], str]
    sign: Callable[[int], str]
    load: Callable[[int], str]
    store: Callable[[int, str], str]
    call: Callable[[str, str], str]
    absolute: str


def statements(error: ModelError, language: Spelling) -> list[str]:
    """Return one statement per joint that stores what the columns of its own motion and of its load add."""
    lines = []
    for joint, (mean, scale) in enumerate(zip(error.mean, error.scale, strict=True)):
        shapes = _shapes(joint, float(error.speed[joint]), language)
        terms = zip((mean / scale).tolist(), shapes, strict=True)
        lines.append(
            language.store(joint, " ".join(f"{value:+.17g} * {shape}" for value, shape in terms))
        )
    return lines


def shift(error: ModelError) -> Floats:
    """Return by how much the parameters are smaller in the row of each joint, (n, p)."""
    return -error.mean_by_rows[1]


def _shapes(joint: int, speed: float, language: Spelling) -> list[str]:
    """Return the columns of a joint, in the order of ``shapes_of``."""
    q, sign, call = language.position(joint), language.sign(joint), language.call
    waves = [
        call(f, f"{k} * {q}")
        for k in range(1, tuning.POSITION_HARMONICS + 1)
        for f in ("sin", "cos")
    ]
    friction = [f"{sign} * {wave}" for wave in waves[: 2 * tuning.FRICTION_HARMONICS]]
    share = call(language.absolute, language.speed(joint))
    friction += [
        f"{sign} * {call('exp', f'-{share} / {least * speed!r}')}"
        for least in tuning.FRICTION_SPEEDS
    ]
    return [*waves, *friction, f"{sign} * {call(language.absolute, language.load(joint))}"]
