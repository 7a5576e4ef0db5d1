"""The model of one arm: the rigid-body program and the friction columns as one regressor (Paper Eq. 8).

Columns are the 11 parameters of every identified link in the order of Table 5, then the friction columns, then those of
effects that were added to the robot file. The last ones depend on the order of the samples and are made by
``Model.added_entries``.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.model.dynamics import derive
from dynid.model.effects.catalogue import Added, added_effects
from dynid.model.effects.interface import ArmMotion, Column, State
from dynid.model.effects.joint_columns import coupled_motor_columns, joint_columns
from dynid.model.kernels import Kernel
from dynid.model.parameters import Parameter, columns_of, link_parameters
from dynid.model.program import Program
from dynid.robot import Robot
from dynid.units import ampere_unit

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Model:
    """The regressor of one arm.

    Attributes:
        robot: the arm.
        rigid: program of the 11 n rigid-body columns, (n, 11 n).
    """

    robot: Robot
    rigid: Program

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle without what was derived from the two, which cannot be."""
        return Model, (self.robot, self.rigid)

    @cached_property
    def extra(self) -> tuple[Column, ...]:
        """Friction columns and those of coupled motors."""
        return (*joint_columns(self.robot), *coupled_motor_columns(self.robot))

    @cached_property
    def added(self) -> tuple[Added, ...]:
        """Effects that the robot file lists."""
        return added_effects(self.robot)

    @cached_property
    def link_columns(self) -> NDArray[np.intp]:
        """Which of the 11 n rigid-body columns belong to this model: identified links, wanted rotor inertias."""
        kept = [
            11 * (link - 1) + p
            for link in self.robot.identified_links
            for p in range(11)
            if p < 10 or self.robot.joints[link - 1].motor_inertia
        ]
        return np.array(kept, dtype=np.intp)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """What each column stands for, (c)."""
        links = link_parameters(self.robot)
        added = (column.parameter for effect in self.added for column in effect.columns)
        return (*(links[k] for k in self.link_columns), *(column.parameter for column in self.extra), *added)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all columns, (c)."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each parameter by name; in amperes where no gain of a drive is known."""
        if self.robot.torque.relative:
            return {parameter.name: ampere_unit(parameter.unit) for parameter in self.parameters}
        return {parameter.name: parameter.unit for parameter in self.parameters}

    def columns_of(self, *kinds: str) -> NDArray[np.intp]:
        """Return the columns whose parameters are of one of these kinds, such as ``"fc"``, (k,)."""
        return columns_of(self.parameters, *kinds)

    @property
    def size(self) -> int:
        """Number of columns."""
        return len(self.parameters)

    @property
    def plain_size(self) -> int:
        """Number of columns without those of added effects: what one sample is enough for."""
        return len(self.link_columns) + len(self.extra)

    def observer(self, columns: NDArray[np.intp] | None = None) -> Observer:
        """Return an evaluator of the given columns (all when None), in that order."""
        return Observer(self, np.arange(self.size) if columns is None else np.asarray(columns, dtype=np.intp))

    def regressor(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Evaluate the full regressor P on samples (Paper Eq. 8), without added effects.

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].

        Returns:
            P with tau = P gamma, (N, n, c) [N m or N per unit of each parameter].
        """
        return self.observer(np.arange(self.plain_size)).dense(q, qd, qdd)

    def added_entries(self, motion: ArmMotion) -> Floats:
        """Return the entries of the added effects' columns over a whole stretch, (E, N)."""
        parts = [effect.evaluate(motion) for effect in self.added]
        return np.concatenate(parts) if parts else np.zeros((0, len(motion)))


class Observer:
    """Evaluates chosen columns of a model on samples, entry by entry or dense.

    Attributes:
        rows: joint of each non-zero entry, (E,).
        cols: column of each entry among the chosen ones, (E,).
        shape: joints and chosen columns.
        added_entries: which entries of ``Model.added_entries`` follow those of ``blocks``.
    """

    def __init__(self, model: Model, columns: NDArray[np.intp]) -> None:
        links = model.link_columns
        rigid, plain = columns < len(links), columns < model.plain_size
        self._kernel = Kernel(model.rigid.restricted(links[columns[rigid]]), model.robot)
        self._extra = [model.extra[k - len(links)] for k in columns[plain & ~rigid]]
        place = np.flatnonzero(rigid)
        extra = [(column.rows, k) for column, k in zip(self._extra, np.flatnonzero(plain & ~rigid), strict=True)]
        entries, added = self._added_entries(model, columns)
        rows = [self._kernel.rows, *(np.array(rows) for rows, _ in extra), added[0]]
        cols = [place[self._kernel.cols], *(np.full(len(rows), k) for rows, k in extra), added[1]]
        self.rows = np.concatenate(rows).astype(np.intp)
        self.cols = np.concatenate(cols).astype(np.intp)
        self.shape = (model.robot.n, len(columns))
        self.added_entries = entries

    @staticmethod
    def _added_entries(model: Model, columns: NDArray[np.intp]) -> tuple[NDArray[np.intp], tuple[Floats, Floats]]:
        """Return which entries of ``Model.added_entries`` are wanted, with their rows and columns."""
        layout = [column.rows for effect in model.added for column in effect.columns]
        edges = np.cumsum([0, *(len(rows) for rows in layout)])
        wanted = [(k, int(c) - model.plain_size) for k, c in enumerate(columns) if c >= model.plain_size]
        entries = np.concatenate([[], *(np.arange(edges[c], edges[c + 1]) for _, c in wanted)]).astype(np.intp)
        rows = np.concatenate([[], *(np.array(layout[c]) for _, c in wanted)])
        return entries, (rows, np.concatenate([[], *(np.full(len(layout[c]), k) for k, c in wanted)]))

    def blocks(
        self, q: Floats, qd: Floats, qdd: Floats, coulomb_sign: Floats | None = None
    ) -> Iterator[tuple[slice, Floats]]:
        """Yield (samples, entries (E, B)) block by block; entries of added effects are not among them.

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
            coulomb_sign: signs of the velocities where a log carries them, (N, n); those of ``qd`` when None.
        """
        for part, entries in self._kernel.blocks(q, qd, qdd):
            extra = self._extra_entries(
                q[part], qd[part], qdd[part], None if coulomb_sign is None else coulomb_sign[part]
            )
            yield part, np.vstack([entries, *extra]) if extra else entries

    def entries(self, q: Floats, qd: Floats, qdd: Floats, coulomb_sign: Floats | None = None) -> Floats:
        """Return the entries that ``blocks`` yields, in one array, (E, N)."""
        found = np.empty((len(self.rows) - len(self.added_entries), len(q)))
        for part, entries in self._kernel.blocks(q, qd, qdd):
            extra = self._extra_entries(
                q[part], qd[part], qdd[part], None if coulomb_sign is None else coulomb_sign[part]
            )
            found[: len(entries), part] = entries
            for row, entry in zip(found[len(entries) :], extra, strict=True):
                row[part] = entry
        return found

    def _extra_entries(self, q: Floats, qd: Floats, qdd: Floats, coulomb_sign: Floats | None) -> list[Floats]:
        """Return the entries of friction and coupled motors, E arrays (N,)."""
        state, found = State(q, qd, qdd), list[Floats]()
        for column in self._extra:
            if coulomb_sign is not None and column.parameter.kind == "fc":
                found.append(coulomb_sign[:, column.rows[0]])
            else:
                found += column.evaluate(state)
        return found

    def coulomb_sign(self, qd: Floats) -> Floats:
        """Return the Coulomb sign of each joint's velocity, zero where it has no such column, (N, n)."""
        found = np.zeros_like(qd)
        for column in self._extra:
            if column.parameter.kind == "fc":
                found[:, column.rows[0]] = column.evaluate(State(qd, qd, qd))[0]
        return found

    def dense(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the chosen columns as one array, those of added effects zero, (N, n, p)."""
        full = np.zeros((len(q), *self.shape))
        for part, entries in self.blocks(q, qd, qdd):
            full[part, self.rows[: len(entries)], self.cols[: len(entries)]] = entries.T
        return full

    def torque(self, theta: Floats, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the torques of given parameters without storing the regressor, and without added effects.

        Args:
            theta: values of the chosen columns, in their units, (p,).
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].

        Returns:
            tau, (N, n) [N m or N].
        """
        count = len(self.rows) - len(self.added_entries)
        spread = np.zeros((self.shape[0], count))
        spread[self.rows[:count], np.arange(count)] = theta[self.cols[:count]]
        tau = np.empty((len(q), self.shape[0]))
        for part, entries in self.blocks(q, qd, qdd):
            tau[part] = (spread @ entries).T
        return tau


def build_model(robot: Robot) -> Model:
    """Derive the model of an arm from its DH table."""
    return Model(robot, derive(robot)[0])


def parameter_names(robot: Robot) -> tuple[str, ...]:
    """Return the names of all columns of an arm's model, (c), without deriving it."""
    none = np.zeros(0, dtype=np.int32)
    return Model(robot, Program((), (), none, none, none, none, none, none, (robot.n, 11 * robot.n))).parameter_names
