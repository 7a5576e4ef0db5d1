"""The regressor in the prime field: its columns at random states and geometries, and the relations among them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.errors import ReductionsDisagree
from dynid.model.kinematics import geometry as float_geometry
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

#: Samples that the relations are found from and, fresh ones, that they are checked on. Links 1..k have at most 17 k
#: columns (with a coupled motor's) and k rows a sample, so 24 leave room.
_SAMPLES, _FRESH = 24, 4


class FieldRegressor:
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

    def relations(self, geometry: dict[str, Residues]) -> tuple[list[int], Residues]:
        """Find the relations among all columns, checked on fresh states.

        Args:
            geometry: values of the geometric symbols, (G,) each.

        Returns:
            The leftmost independent columns, the same in every geometry, and K, (G, p, c).

        Raises:
            ReductionsDisagree: the relations do not hold at fresh random states.
            ZeroDivisionError: a column is dependent in some of the geometries only.
        """
        columns = self.columns(geometry, samples=_SAMPLES + _FRESH)
        used = _SAMPLES * self.model.robot.n
        base, K = echelon(columns[:, :used])
        for A, k in zip(columns[:, used:], K, strict=True):
            if np.any(product(A[:, base], k) != A):
                raise ReductionsDisagree("relations found at 24 random states do not hold at 4 further ones")
        return base, K

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
