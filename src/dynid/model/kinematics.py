"""DH transforms and the motion of the link frames (Paper Eqs. 1-3 and 10-12 in their right form).

The symbolic part names every intermediate expression (``Recorder``), so that expressions never grow along the chain.
The numeric part gives frame poses for checks and pictures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.robot import Joint, Robot, rotation_rpy

if TYPE_CHECKING:
    from sympy import Expr, Symbol

    Vector = list[Expr]
    Matrix = list[list[Expr]]

Floats = NDArray[np.float64]


class Recorder:
    """Gives a name to each intermediate SymPy expression and the same name to equal ones."""

    def __init__(self) -> None:
        self.assignments: list[tuple[Symbol, Expr]] = []
        self._known: dict[Expr, Symbol] = {}

    def let(self, expression: Expr) -> Expr:
        """Return a symbol, or its negative, that stands for the expression."""
        from sympy import Symbol

        if expression.is_Atom or (-expression).is_Atom:
            return expression
        if expression in self._known:
            return self._known[expression]
        opposite = -expression
        if opposite in self._known:
            return -self._known[opposite]
        # Why: the side with fewer minus signs is kept, since a sum of negative terms would cost one more operation.
        terms = expression.args if expression.is_Add else (expression,)
        flipped = 2 * sum(bool(term.as_coeff_Mul()[0].is_negative) for term in terms) > len(terms)
        symbol, kept = Symbol(f"t{len(self.assignments)}"), opposite if flipped else expression
        self._known[kept] = symbol
        self.assignments.append((symbol, kept))
        return -symbol if flipped else symbol

    def vector(self, entries: Vector) -> Vector:
        """Name the entries of a vector."""
        return [self.let(entry) for entry in entries]


def dot(a: Vector, b: Vector) -> Expr:
    """Return a . b; most entries are zero, and leaving them out is most of the speed of the derivation."""
    from sympy import Integer

    return sum((x * y for x, y in zip(a, b, strict=True) if x and y), Integer(0))


def cross(a: Vector, b: Vector) -> Vector:
    """Return a x b."""
    pairs = ((1, 2), (2, 0), (0, 1))
    return [dot([a[i], -a[j]], [b[j], b[i]]) for i, j in pairs]


def add(a: Vector, b: Vector) -> Vector:
    """Return a + b."""
    return [x + y if x and y else x or y for x, y in zip(a, b, strict=True)]


def rotate(R: Matrix, v: Vector) -> Vector:
    """Return R v."""
    return [dot(row, v) for row in R]


def transposed(R: Matrix) -> Matrix:
    """Return the transpose, which is the inverse of a rotation."""
    return [list(column) for column in zip(*R, strict=True)]


@dataclass(frozen=True)
class Step:
    """The symbolic transform of one joint.

    Attributes:
        R: rotation from the link's frame to the previous one (Paper Eq. 12: R_j^{j-1}), 3 x 3.
        r: from the previous frame's origin to the link's origin, in the link's frame (standard) or the previous
            frame (modified), 3.
        z: joint axis in the link's frame, 3.
    """

    R: Matrix
    r: Vector
    z: Vector


def _right_angle(angle: float) -> tuple[int, int] | None:
    """Return exact cosine and sine of a multiple of 90 degrees."""
    quarter = angle / (math.pi / 2)
    if abs(quarter - round(quarter)) > 1e-12:
        return None
    return ((1, 0), (0, 1), (-1, 0), (0, -1))[round(quarter) % 4]


def symbolic_step(joint: Joint, number: int, convention: str) -> Step:
    """Return the transform of joint ``number`` (1-based) in SymPy; geometry that is zero by design stays zero.

    Source: Paper Eqs. 10-12; the 1 in the first row of the printed Eq. 11 must be a 0.
    """
    from sympy import Integer, Symbol

    zero, one = Integer(0), Integer(1)

    def cos_sin(angle: float, prefix: str) -> tuple[Expr, Expr]:
        exact = _right_angle(angle)
        if exact is not None:
            return Integer(exact[0]), Integer(exact[1])
        return Symbol(f"c{prefix}{number}"), Symbol(f"s{prefix}{number}")

    ca, sa = cos_sin(joint.twist, "a")
    ct, st = (Symbol(f"c{number}"), Symbol(f"s{number}")) if joint.revolute else cos_sin(joint.theta_offset, "")
    a = Symbol(f"a{number}") if joint.a else zero
    d = Symbol(f"d{number}") if joint.d else zero
    if not joint.revolute:
        d = d + Symbol(f"q{number}")
    if convention == "standard":
        R = [[ct, -ca * st, sa * st], [st, ca * ct, -sa * ct], [zero, sa, ca]]
        return Step(R, [a, d * sa, d * ca], [zero, sa, ca])
    R = [[ct, -st, zero], [ca * st, ca * ct, -sa], [sa * st, sa * ct, ca]]
    return Step(R, [a, -d * sa, d * ca], [zero, zero, one])


def numeric_step(joint: Joint, q: float, convention: str) -> Floats:
    """Return the homogeneous transform of one joint at ``q``, (4, 4)."""
    theta = joint.theta_offset + (q if joint.revolute else 0.0)
    d = joint.d + (0.0 if joint.revolute else q)
    (ct, st), (ca, sa) = ((math.cos(x), math.sin(x)) for x in (theta, joint.twist))
    if convention == "standard":
        rows = [[ct, -ca * st, sa * st, joint.a * ct], [st, ca * ct, -sa * ct, joint.a * st], [0, sa, ca, d]]
    else:
        rows = [[ct, -st, 0, joint.a], [ca * st, ca * ct, -sa, -d * sa], [sa * st, sa * ct, ca, d * ca]]
    return np.array([*rows, [0, 0, 0, 1]], dtype=float)


def frames(robot: Robot, q: Floats) -> Floats:
    """Return the poses of all link frames in frame 0 at one configuration, (n, 4, 4).

    Args:
        robot: the arm.
        q: joint positions, (n,) [rad or m].
    """
    pose = np.eye(4)
    poses = np.empty((robot.n, 4, 4))
    for i, joint in enumerate(robot.joints):
        pose = pose @ numeric_step(joint, float(q[i]), robot.convention)
        poses[i] = pose
    return poses


def tool_pose(robot: Robot, q: Floats) -> Floats:
    """Return the pose of the last frame in the world at one configuration, (4, 4)."""
    base = np.eye(4)
    base[:3, :3] = rotation_rpy(robot.base_rpy)
    base[:3, 3] = robot.base_xyz
    pose: Floats = base @ frames(robot, q)[-1]
    return pose
