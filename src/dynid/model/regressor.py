"""The model of one arm: the rigid-body program and the friction columns as one regressor (Paper Eq. 8).

Columns are the 11 parameters of every identified link in the order of Table 5, then the friction columns, then those of
effects that were added to the robot file. The last ones depend on the order of the samples and are made by
``Model.added_entries``. With values of the parameters the model is a source of torques (``ModelTorques``), whose mass
matrix tells whether an arm can have them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats, Ints
from dynid.model import tuning
from dynid.model.dynamics import derive
from dynid.model.effects.catalogue import Added, added_effects
from dynid.model.effects.friction import friction_entries, friction_parameters, friction_rows
from dynid.model.effects.motion import ArmMotion
from dynid.model.parameters import (
    BODY_PARAMETERS,
    Parameter,
    body_columns,
    columns_of,
    link_parameters,
    prior_parameters,
)
from dynid.model.program import Evaluator, Program
from dynid.robot import Joint, Robot
from dynid.units import ampere_unit

#: Coulomb signs that nobody gave.
MADE_HERE = np.zeros((0, 0))


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
    def friction(self) -> tuple[Parameter, ...]:
        """Friction of the robot file, and what coupled motors add."""
        return friction_parameters(self.robot)

    @cached_property
    def added(self) -> tuple[Added, ...]:
        """Effects that the robot file lists."""
        return added_effects(self.robot)

    @cached_property
    def link_columns(self) -> Ints:
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
        added = (parameter for effect in self.added for parameter in effect.parameters)
        return (*(links[k] for k in self.link_columns), *self.friction, *added)

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of all columns, (c)."""
        return tuple(parameter.name for parameter in self.parameters)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each parameter by name; in amperes where no gain of a drive is known."""
        relative = self.robot.torque.relative
        return {p.name: ampere_unit(p.unit) if relative else p.unit for p in self.parameters}

    @property
    def size(self) -> int:
        """Number of columns."""
        return len(self.parameters)

    @property
    def size_without_effects(self) -> int:
        """Number of columns without those of added effects: what one sample is enough for."""
        return len(self.link_columns) + len(self.friction)

    def observer(self, columns: Ints | None = None) -> Observer:
        """Return an evaluator of the given columns (all when None), in that order."""
        return Observer(self, np.arange(self.size) if columns is None else columns)

    def regressor(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Evaluate the full regressor P on samples (Paper Eq. 8), without added effects.

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].

        Returns:
            P with tau = P gamma, (N, n, c) [N m or N per unit of each parameter].
        """
        return self.observer(np.arange(self.size_without_effects)).dense(q, qd, qdd)

    def added_entries(self, motion: ArmMotion) -> Floats:
        """Return the entries of the added effects' columns over an interval, (E, N)."""
        none = np.zeros((0, len(motion)))
        return np.concatenate([none, *(effect.evaluate(motion) for effect in self.added)])


class Observer:
    """Evaluates chosen columns of a model on samples, entry by entry or dense.

    Args:
        model: the model.
        columns: indices of the columns, in the order wanted.
        samples: of a block.
        evaluator: what evaluates the rigid-body columns.

    Attributes:
        rows: joint of each non-zero entry of P, (E,); entries of added effects come last.
        cols: column of each entry, among the chosen ones, (E,).
        shape: joints and chosen columns.
        added_entries: which entries of ``Model.added_entries`` follow those of ``blocks``.
    """

    def __init__(
        self,
        model: Model,
        columns: Ints,
        samples: int = tuning.BLOCK_SAMPLES,
        evaluator: type[Evaluator] = Evaluator,
    ) -> None:
        self._made_of = model, columns
        links, robot = model.link_columns, model.robot
        rigid, own_column = columns < len(links), columns < model.size_without_effects
        program = model.rigid.restricted(links[columns[rigid]])
        self._robot, self._samples = robot, samples
        self._rigid = evaluator(program, robot, samples)
        own, last = np.flatnonzero(own_column & ~rigid), np.flatnonzero(~own_column)
        self._friction = [model.friction[k - len(links)] for k in columns[own]]
        added = [effect.rows for effect in model.added for _ in effect.parameters]
        edges = np.cumsum([0, *map(len, added)])
        wanted = columns[last] - model.size_without_effects
        self.added_entries = _joined([np.arange(edges[c], edges[c + 1]) for c in wanted])
        rows = [*map(friction_rows, self._friction), *(added[c] for c in wanted)]
        places = (np.full(len(at), k) for k, at in zip((*own, *last), rows, strict=True))
        self.rows = _joined([program.rows, *rows])
        self.cols = _joined([np.flatnonzero(rigid)[program.cols], *places])
        self.shape = (robot.n, len(columns))
        self._own_entries = len(self.rows) - len(self.added_entries)

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle without the bound program, which cannot be."""
        return Observer, self._made_of

    def blocks(
        self, q: Floats, qd: Floats, qdd: Floats, coulomb_sign: Floats = MADE_HERE
    ) -> Iterator[tuple[slice, Floats]]:
        """Yield (samples, entries (E, B)) block by block; entries of added effects are not among them.

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
            coulomb_sign: signs of the velocities where a log carries them, (N, n); empty for those of ``qd``.
        """
        for start in range(0, len(q), self._samples):
            part = slice(start, min(start + self._samples, len(q)))
            rigid = self._rigid.run(q[part], qd[part], qdd[part])
            friction = self._friction_entries(qd[part], qdd[part], coulomb_sign[part])
            yield part, np.vstack([rigid, *friction]) if friction else rigid

    def entries(
        self, q: Floats, qd: Floats, qdd: Floats, coulomb_sign: Floats = MADE_HERE
    ) -> Floats:
        """Return the entries that ``blocks`` yields, in one array, (E, N)."""
        values = np.empty((self._own_entries, len(q)))
        for part, entries in self.blocks(q, qd, qdd, coulomb_sign):
            values[:, part] = entries
        return values

    def _friction_entries(self, qd: Floats, qdd: Floats, coulomb_sign: Floats) -> list[Floats]:
        columns = []
        for parameter in self._friction:
            if coulomb_sign.size and parameter.kind == "fc":
                columns.append(coulomb_sign[:, parameter.number - 1])
            else:
                columns += friction_entries(parameter, self._robot, qd, qdd)
        return columns

    def coulomb_sign(self, qd: Floats) -> Floats:
        """Return the Coulomb sign of each joint's velocity, zero where it has no such column, (N, n)."""
        sign = np.zeros_like(qd)
        for parameter in self._friction:
            if parameter.kind == "fc":
                sign[:, parameter.number - 1] = friction_entries(parameter, self._robot, qd, qd)[0]
        return sign

    def dense(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the chosen columns as one array, those of added effects zero, (N, n, p)."""
        full, own = np.zeros((len(q), *self.shape)), self._own_entries
        for part, entries in self.blocks(q, qd, qdd):
            full[part, self.rows[:own], self.cols[:own]] = entries.T
        return full

    def along(self, motion: ArmMotion) -> Floats:
        """Return the chosen columns along a motion, those of added effects too, (N, n, p)."""
        full, own = self.dense(motion.q, motion.qd, motion.qdd), self._own_entries
        if len(self.added_entries):
            entries = self._made_of[0].added_entries(motion)[self.added_entries]
            full[:, self.rows[own:], self.cols[own:]] = entries.T
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
        n, own = self.shape[0], self._own_entries
        spread, tau = np.zeros((n, own)), np.empty((len(q), n))
        spread[self.rows[:own], range(own)] = theta[self.cols[:own]]
        for part, entries in self.blocks(q, qd, qdd):
            tau[part] = (spread @ entries).T
        return tau


def _joined(parts: Sequence[Sequence[int] | NDArray[Any]]) -> Ints:
    return np.concatenate([np.asarray(part, dtype=np.intp) for part in (*parts, [])])


def build_model(robot: Robot) -> Model:
    """Derive the model of an arm from its DH table."""
    return Model(robot, derive(robot))


@lru_cache(maxsize=64)
def _bare_model(
    convention: Literal["standard", "modified"],
    joints: tuple[Joint, ...],
    gravity: tuple[float, float, float],
) -> Model:
    """Return the model of a DH table under a gravity: questions of many tables ask for the same ones again."""
    return build_model(Robot("", convention, joints, gravity))


def body_regressor(robot: Robot, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return the columns of the bodies of all links; only geometry and gravity of the arm matter.

    Args:
        robot: the arm.
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n) [rad/s or m/s].
        qdd: accelerations, (N, n) [rad/s^2 or m/s^2].

    Returns:
        Torques per unit of m, mcx, mcy, mcz, Ixx, Ixy, Ixz, Iyy, Iyz, Izz of each link, (N, n, 10 n) [N m or N].
    """
    model = _bare_model(robot.convention, robot.joints, robot.gravity)
    return model.observer(columns_of(model.parameters, *BODY_PARAMETERS)).dense(q, qd, qdd)


def body_torques(robot: Robot, bodies: Floats, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return the torques of links with ten parameters each, (10 n,), without rotors and friction, (N, n) [N m or N]."""
    model = _bare_model(robot.convention, robot.joints, robot.gravity)
    values = np.zeros(model.size)
    values[columns_of(model.parameters, *BODY_PARAMETERS)] = bodies
    return ModelTorques(model, values).rigid(q, qd, qdd)


def expected_torque(q: Floats, robot: Robot, *motion: Floats) -> Floats:
    """Return the torques of the prior bodies without friction, (N, n) [N m or N].

    Of bodies about which the robot file says nothing only the pattern over the poses means something.

    Args:
        q: positions, (N, n) [rad or m].
        robot: the arm.
        motion: velocities and accelerations, (N, n) each [rad/s or m/s, rad/s^2 or m/s^2]; none at rest.
    """
    bodies = prior_parameters(robot)
    if not (robot.prior and (robot.prior.links or robot.prior.cylinders)):
        bodies *= tuning.UNKNOWN_LINK_MASS_KG * robot.n / bodies[::10].sum()
    return body_torques(robot, bodies, q, *(motion or np.zeros((2, *q.shape))))


# ---------------------------------------------------------------- the model with numbers
class ModelTorques:
    """Torques of a model with given parameters; satisfies ``ReferenceTorques``.

    Args:
        model: the model.
        values: of all its columns, in their units; those of effects are left out, (c,).
    """

    def __init__(self, model: Model, values: Floats) -> None:
        self._model, self._values = model, values
        # Made when they are needed: many are made whose torques nobody asks for.
        self._observers: dict[int, Observer] = {}

    def rigid(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body torques, (N, n) [N m or N]."""
        return self._of_first(len(self._model.link_columns), q, qd, qdd)

    def total(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body and friction torques, (N, n) [N m or N]."""
        return self._of_first(self._model.size_without_effects, q, qd, qdd)

    def _of_first(self, size: int, *motion: Floats) -> Floats:
        """Return the torques of the first parameters, (N, n) [N m or N]."""
        columns = np.flatnonzero(self._values[:size])
        if size not in self._observers:
            self._observers[size] = self._model.observer(columns)
        return self._observers[size].torque(self._values[columns], *motion)

    def gravity_tilt(self, q: Floats, towards: Floats) -> Floats:
        """Return the change of torque by a turn of gravity towards a level axis, (3,), (N, n) [N m/rad]."""
        links = np.zeros((self._model.robot.n, 11))
        rigid = self._model.link_columns
        links.flat[rigid] = self._values[: len(rigid)]
        gravity = np.linalg.norm(self._model.robot.gravity) * towards
        there, still = replace(self._model.robot, gravity=tuple(gravity.tolist())), np.zeros_like(q)
        return body_torques(there, links[:, :10].ravel(), q, still, still)

    def tip_columns(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the columns of the ten parameters of the last link, (10, N, n) [N m or N per unit of each]."""
        last = 11 * (self._model.robot.n - 1)
        chosen = np.searchsorted(self._model.link_columns, np.arange(last, last + 10))
        return self._model.observer(chosen).dense(q, qd, qdd).transpose(2, 0, 1)


def prior_vector(model: Model) -> Floats:
    """Return the prior gamma of all parameters of a model in the order of its columns, (c,), in their units.

    Nothing is known beforehand about rotor inertias, friction and added effects; they count as zero.
    """
    bodies = prior_parameters(model.robot).reshape(-1, len(BODY_PARAMETERS))
    gamma = np.zeros(model.size)
    for link, columns in body_columns(model.parameters).items():
        gamma[columns] = bodies[link - 1]
    return gamma


# ---------------------------------------------------------------- mass matrix
#: Inverse dynamics (q, qd, qdd) -> tau, all (N, n); linear in qdd.
Torque = Callable[[Floats, Floats, Floats], Floats]


def mass_matrices(torque: Torque, q: Floats) -> Floats:
    """Return the mass matrix of each pose, column by column: tau(q, 0, e_j) - tau(q, 0, 0).

    Args:
        torque: inverse dynamics.
        q: poses, (N, n) [rad or m].

    Returns:
        (N, n, n), not made symmetric.
    """
    still = np.zeros_like(q)
    gravity = torque(q, still, still)
    columns = [
        torque(q, still, np.broadcast_to(unit, q.shape).copy()) - gravity
        for unit in np.eye(q.shape[1])
    ]
    return np.stack(columns, axis=2)


def random_poses(robot: Robot, poses: int) -> Floats:
    """Return poses within the limits, one turn where there are none, (poses, n) [rad or m]."""
    low, high = robot.travel((-np.pi, np.pi), (-0.5, 0.5))
    return np.random.default_rng(0).uniform(low, high, (poses, robot.n))


def indefinite_share(torque: Torque, q: Floats) -> float:
    """Return the share of poses in which the mass matrix of identified parameters is not positive definite.

    Above 0 the parameters belong to no arm: it would accelerate against a push. A wrong sign in the driver's map does
    that, and can hide in a small residual.

    Args:
        torque: inverse dynamics of the identified parameters.
        q: poses to test, (N, n) [rad or m]; 1000 random ones take milliseconds.
    """
    M = mass_matrices(torque, q)
    return float(np.mean(np.linalg.eigvalsh(M + M.swapaxes(1, 2))[:, 0] <= 0.0))
