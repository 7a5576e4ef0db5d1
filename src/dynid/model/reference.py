"""The current model as a source of torques, for effects that scale with the arm's own torques.

Reads a model and values of all its columns; writes nothing.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.model.kinematics import LinkFrames, link_frames
from dynid.model.prior import prior_vector
from dynid.model.reduce import Reduction
from dynid.model.regressor import Model, Observer
from dynid.robot import Robot

Floats = NDArray[np.float64]


class ModelTorques:
    """Torques of a model with given parameters; satisfies ``ReferenceTorques``.

    Args:
        model: the model.
        values: of all its columns, in their units; those of effects are left out, (c,).
    """

    def __init__(self, model: Model, values: Floats) -> None:
        self._model, self._values = model, values
        self._rigid = np.flatnonzero(values[: len(model.link_columns)])
        self._total = np.flatnonzero(values[: model.plain_size])

    # Why later: many are made whose torques nobody asks for.
    @cached_property
    def _rigid_observer(self) -> Observer:
        return self._model.observer(self._rigid)

    @cached_property
    def _total_observer(self) -> Observer:
        return self._model.observer(self._total)

    def rigid(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body torques, (N, n) [N m or N]."""
        return self._rigid_observer.torque(self._values[self._rigid], q, qd, qdd)

    def total(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body and friction torques, (N, n) [N m or N]."""
        return self._total_observer.torque(self._values[self._total], q, qd, qdd)

    def gravity_tilt(self, q: Floats, axis: int) -> Floats:
        """Return the change of torque by a turn of gravity towards an axis of frame 0, (N, n) [N m/rad]."""
        robot, values = self._model.robot, np.zeros(11 * self._model.robot.n)
        values[self._model.link_columns] = self._values[: len(self._model.link_columns)]
        links = values.reshape(robot.n, 11)
        size = float(np.linalg.norm(robot.gravity))
        return holding_torque(robot, link_frames(robot, q), links[:, 0], links[:, 1:4], size * np.eye(3)[axis])

    def tip_force(self, q: Floats, axis: int) -> Floats:
        """Return the torques that hold a unit force along an axis of frame 0 at the tip, -J^T e, (N, n) [m or 1]."""
        # Why: a unit mass at the tip under a gravity of 1 m/s^2 along the axis is a unit force.
        robot = self._model.robot
        mass = np.eye(robot.n)[-1]
        return holding_torque(robot, link_frames(robot, q), mass, np.zeros((robot.n, 3)), np.eye(3)[axis])

    def tip_columns(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the columns of the ten parameters of the last link, (10, N, n) [N m or N per unit of each]."""
        last = 11 * (self._model.robot.n - 1)
        chosen = np.searchsorted(self._model.link_columns, np.arange(last, last + 10))
        return np.ascontiguousarray(self._model.observer(chosen).dense(q, qd, qdd).transpose(2, 0, 1))


def model_torques(model: Model, reduction: Reduction, theta: Floats) -> ModelTorques:
    """Return the torques of base parameters: their representatives carry them, all other parameters are zero."""
    values = np.zeros(model.size)
    values[reduction.base] = theta
    return ModelTorques(model, values)


def prior_torques(model: Model) -> ModelTorques:
    """Return the torques of the prior, without friction."""
    return ModelTorques(model, prior_vector(model))


def holding_torque(robot: Robot, where: LinkFrames, mass: Floats, moment: Floats, gravity: Floats) -> Floats:
    """Return the torques that hold the links under a gravity, (N, n) [N m or N].

    The regressor's program leaves out components of gravity that are zero, so a tilted base or a force on the tool is
    computed here from the frames.

    Args:
        robot: the arm.
        where: its poses over a motion of N samples.
        mass: of each link, (n,) [kg].
        moment: first moment of each link in its DH frame, (n, 3) [kg m].
        gravity: in frame 0, (3,) [m/s^2].
    """
    centres = mass[:, None] * where.p + np.einsum("mkij,kj->mki", where.R, moment)
    # What a joint carries is everything from its own link outwards.
    carried, weight = np.cumsum(centres[:, ::-1], axis=1)[:, ::-1], np.cumsum(mass[::-1])[::-1]
    tau = np.empty(where.p.shape[:2])
    for j, joint in enumerate(robot.joints):
        if joint.revolute:
            lever = carried[:, j] - weight[j] * where.point[:, j]
            tau[:, j] = -np.einsum("mi,mi->m", where.axis[:, j], np.cross(lever, gravity))
        else:
            tau[:, j] = -weight[j] * where.axis[:, j] @ gravity
    return tau
