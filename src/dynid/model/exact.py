"""Base parameters without thresholds: exact rank, classes and relations over a prime field (Paper Eq. 13).

Reads a Model, gives an ExactReduction: the leftmost independent columns in textbook order, and every other column as an
exact combination of them, with a formula in the DH symbols for each coefficient.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.errors import ReductionsDisagree
from dynid.model.formula import ONE, Formula
from dynid.model.kernels import geometry as float_geometry
from dynid.model.prime_field import (
    PRIME,
    FieldState,
    Residues,
    circle_point,
    echelon,
    product,
    rational_circle,
    residue,
    run_program,
)
from dynid.model.regressor import Model

Floats = NDArray[np.float64]

#: Samples that the relations are found from and, fresh ones, that they are checked on. Links 1..k have at most 17 k
#: columns (with a coupled motor's) and k rows a sample, so 24 leave room.
_SAMPLES, _FRESH = 24, 4


@dataclass(frozen=True)
class Term:
    """A share of one parameter in a base parameter.

    Attributes:
        name: the parameter.
        formula: its coefficient in the DH symbols; None where no name was found.
        value: its coefficient as a number.
    """

    name: str
    formula: Formula | None
    value: float


@dataclass(frozen=True)
class ExactReduction:
    """The base parameters of an arm, found without thresholds.

    Attributes:
        names: all columns, (c,).
        base: indices of the representatives, the leftmost independent columns, (p,).
        groups: of each base parameter, the shares of all parameters in it, its own first.
        none: names of the columns that are zero.
        geometry: value of each DH symbol [m, -].
        generic: whether the classes are those of any arm of this shape; False where special values of the DH table
            (an oblique mounting along a joint axis, for example) make more parameters dependent.
    """

    names: tuple[str, ...]
    base: NDArray[np.intp]
    groups: tuple[tuple[Term, ...], ...]
    none: tuple[str, ...]
    geometry: dict[str, float]
    generic: bool

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return len(self.base)

    @cached_property
    def alone(self) -> tuple[str, ...]:
        """Names of the parameters that are identifiable by themselves."""
        return tuple(group[0].name for group in self.groups if len(group) == 1)

    @cached_property
    def combined(self) -> tuple[str, ...]:
        """Names of the parameters that are identifiable only in combination."""
        apart = {*self.alone, *self.none}
        return tuple(name for name in self.names if name not in apart)

    @property
    def unnamed(self) -> int:
        """Number of coefficients that have no formula."""
        return sum(term.formula is None for group in self.groups for term in group)

    @cached_property
    def K(self) -> Floats:
        """The matrix of theta = K gamma, (p, c)."""
        index = {name: k for k, name in enumerate(self.names)}
        K = np.zeros((self.rank, len(self.names)))
        for row, group in enumerate(self.groups):
            for term in group:
                K[row, index[term.name]] = term.value
        return K


class Draws:
    """The regressor's columns in the prime field: random joint states, several values of the geometry.

    Args:
        model: the model.
        still: whether the joint states are at rest: gravity and offsets only.
        seed: of the random states and geometries.
    """

    def __init__(self, model: Model, *, still: bool = False, seed: int = 0) -> None:
        self.model, self.moving = model, not still
        self._rng = np.random.default_rng(seed)
        self._program = model.rigid.restricted(model.link_columns)
        values = float_geometry(model.robot)
        self.symbols = tuple(name for name in model.rigid.inputs if name in values)
        self._angles = {
            f"{kind}a{i}": joint.twist for i, joint in enumerate(model.robot.joints, 1) for kind in "cs"
        } | {f"{kind}{i}": joint.theta_offset for i, joint in enumerate(model.robot.joints, 1) for kind in "cs"}
        self.values = {name: values[name] for name in self.symbols}

    def actual(self) -> dict[str, Residues]:
        """Return the arm's own geometry."""
        return {name: self._own(name) for name in self.symbols}

    def free(self, count: int, turned: bool) -> dict[str, Residues]:
        """Return ``count`` random geometries with the arm's gravity; twists are random too when ``turned``."""
        drawn: dict[str, Residues] = {}
        for name in self.symbols:
            if name.startswith("g") or (name in self._angles and not turned):
                drawn[name] = self._own(name)
            elif name in self._angles:
                partner = name[1:]
                if "c" + partner not in drawn:
                    drawn["c" + partner], drawn["s" + partner] = rational_circle(self.random(count))
            else:
                drawn[name] = self.random(count)
        return drawn

    def columns(
        self, geometry: dict[str, Residues], chosen: NDArray[np.intp] | None = None, *, samples: int
    ) -> Residues:
        """Return columns of the regressor stacked over new random states.

        Args:
            geometry: values of the geometric symbols, (1,) or (G,).
            chosen: rigid-body columns (all columns with the friction ones when None).
            samples: number of joint states.

        Returns:
            Stacked columns, (G, samples * n, c).
        """
        program = self._program if chosen is None else self._program.restricted(chosen)
        n = self.model.robot.n
        q, qd, qdd = (self.random((samples, n)) for _ in range(3))
        state = FieldState(q, qd * self.moving, qdd * self.moving)
        P = run_program(program, self._inputs(geometry, state))
        count = max((len(value) for value in geometry.values()), default=1)
        P = np.broadcast_to(P, (count, samples, *P.shape[2:]))
        if chosen is None and self.model.extra:
            friction = self._friction(state)
            P = np.concatenate([P, np.broadcast_to(friction, (count, *friction.shape))], axis=-1)
        return P.reshape(count, samples * n, -1)

    def _inputs(self, geometry: dict[str, Residues], state: FieldState) -> dict[str, Residues]:
        """Return the program's inputs: geometry (G, 1) and motion (1, samples)."""
        inputs: dict[str, Residues] = {name: value[:, None] for name, value in geometry.items()}
        for j, joint in enumerate(self.model.robot.joints):
            inputs |= {f"q{j + 1}": state.q[None, :, j], f"qd{j + 1}": state.qd[None, :, j]}
            inputs[f"qdd{j + 1}"] = state.qdd[None, :, j]
            if joint.revolute:
                inputs[f"c{j + 1}"], inputs[f"s{j + 1}"] = rational_circle(self.random((1, len(state.q))))
        return inputs

    def _friction(self, state: FieldState) -> Residues:
        """Return the friction columns; a function that is no polynomial takes part as random numbers."""
        block = np.zeros((*state.q.shape, len(self.model.extra)), dtype=np.uint64)
        for k, column in enumerate(self.model.extra):
            other = self.random if self.moving else np.zeros
            entries = column.exact(state) if column.exact else other((len(column.rows), len(state.q)))
            for row, entry in zip(column.rows, entries, strict=True):
                block[:, row, k] = entry
        return block

    def random(self, shape: int | tuple[int, ...]) -> Residues:
        """Return random elements of the field."""
        return self._rng.integers(1, PRIME, shape, dtype=np.uint64)

    def _own(self, name: str) -> Residues:
        if name in self._angles:
            number = circle_point(self._angles[name])[name[0] == "s"]
        else:
            number = residue(self.values[name])
        return np.array([number], dtype=np.uint64)


def reduce_exactly(model: Model, *, still: bool = False) -> ExactReduction:
    """Find the base parameters of a model without thresholds.

    Args:
        model: the model; friction and coupled motors take part like any other column, added effects do not.
        still: whether to reduce the torques at rest instead: the gravity parameters that vendors publish.

    Returns:
        Rank, classes and relations with a formula for each coefficient where one was found.

    Raises:
        ReductionsDisagree: when the relations do not hold at fresh random states.

    Source: Paper Eq. 13 and section II-B; docs/explanation/base-parameters.md.
    """
    from dynid.model.symbolic_relations import name_coefficients

    draws = Draws(model, still=still)
    own = draws.actual()
    base, K = relations(draws, own)
    found = name_coefficients(draws, base, K[0])
    numbers = _numbers(model, base, K[0], found.formulas, draws)
    names = model.parameter_names[: model.plain_size]
    groups = []
    for row, b in enumerate(base):
        shares = [int(b), *(int(j) for j in np.flatnonzero(K[0, row]) if j != b)]
        groups.append(
            tuple(Term(names[j], ONE if j == b else found.formulas.get((row, j)), numbers[row, j]) for j in shares)
        )
    none = tuple(name for j, name in enumerate(names) if not K[0, :, j].any())
    return ExactReduction(names, np.array(base, dtype=np.intp), tuple(groups), none, draws.values, found.generic)


def relations(draws: Draws, geometry: dict[str, Residues]) -> tuple[list[int], Residues]:
    """Return the leftmost independent columns, the same in every geometry, and K (G, p, c), checked on fresh states."""
    columns = draws.columns(geometry, samples=_SAMPLES + _FRESH)
    used = _SAMPLES * draws.model.robot.n
    base, K = echelon(columns[:, :used])
    for A, k in zip(columns[:, used:], K, strict=True):
        if np.any(product(A[:, base], k) != A):
            raise ReductionsDisagree("relations found at 24 random states do not hold at 4 further ones")
    return base, K


def _numbers(
    model: Model, base: Sequence[int], K: Residues, formulas: dict[tuple[int, int], Formula], draws: Draws
) -> Floats:
    """Return K as numbers: from the formulas, and by least squares on random states where there is none."""
    numbers = np.zeros(K.shape)
    numbers[np.arange(len(base)), base] = 1.0
    for (row, col), formula in formulas.items():
        numbers[row, col] = formula.value(draws.values)
    open_columns = sorted({int(j) for i, j in np.argwhere(K) if (int(i), int(j)) not in formulas and base[i] != j})
    if open_columns:
        q, qd, qdd = np.random.default_rng(0).uniform(-2, 2, (3, 200, model.robot.n))
        P = model.regressor(q, qd * draws.moving, qdd * draws.moving).reshape(-1, model.plain_size)
        scale = np.linalg.norm(P[:, base], axis=0)
        solved = np.linalg.lstsq(P[:, base] / scale, P[:, open_columns], rcond=None)[0] / scale[:, None]
        for k, j in enumerate(open_columns):
            for row in np.flatnonzero(K[:, j]).tolist():
                if (row, j) not in formulas:
                    numbers[row, j] = solved[row, k]
    return numbers
