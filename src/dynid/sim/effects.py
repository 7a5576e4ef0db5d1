"""Effects that a robot file lists, as torques of the simulated arm: the simulation lacks nothing that the model has."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.model.effects.catalogue import Added, added_effects
from dynid.model.effects.interface import ArmMotion
from dynid.model.statics import frames, holding_torque
from dynid.robot import Body, Robot
from dynid.sim.arm import Arm

Floats = NDArray[np.float64]

#: Seconds of path that effects with a memory are given at each step.
MEMORY = 1.0


class BulletPhysics:
    """Torques of the simulated arm itself, for effects that scale with them; satisfies ``ReferenceTorques``.

    Args:
        arm: the arm.
        bodies: its bodies.
    """

    def __init__(self, arm: Arm, bodies: Sequence[Body]) -> None:
        self._arm, self._bodies = arm, bodies

    def rigid(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body torques, (N, n) [N m or N]."""
        return np.array([self._arm.inverse_dynamics(*state) for state in zip(q, qd, qdd, strict=True)])

    def total(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return rigid-body, rotor and friction torques, (N, n) [N m or N]."""
        return self.rigid(q, qd, qdd) + self._arm.friction.torque(qd) + self._arm.rotor_inertia * qdd

    def gravity_tilt(self, q: Floats, axis: int) -> Floats:
        """Return the change of torque by a turn of gravity towards an axis of frame 0, (N, n) [N m/rad]."""
        robot = self._arm.robot
        mass = np.array([body.mass for body in self._bodies])
        moment = mass[:, None] * np.array([body.com for body in self._bodies])
        size = float(np.linalg.norm(robot.gravity))
        return holding_torque(robot, frames(robot, q), mass, moment, size * np.eye(3)[axis])

    def tip_force(self, q: Floats, axis: int) -> Floats:
        """Return the torques that hold a unit force along an axis of frame 0 at the tip, -J^T e, (N, n)."""
        robot = self._arm.robot
        return holding_torque(robot, frames(robot, q), np.eye(robot.n)[-1], np.zeros((robot.n, 3)), np.eye(3)[axis])

    def tip_columns(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Refuse: a body on the last link belongs among the arm's bodies, not among its effects."""
        raise NotImplementedError("put a payload into the bodies of the simulated arm")


def effect_torques(arm: Arm, bodies: Sequence[Body], robot: Robot) -> Callable[[float, Floats, Floats], Floats]:
    """Return the torque of a robot file's effects, to be given to the arm as ``extra``.

    Args:
        arm: the arm.
        bodies: its bodies.
        robot: the robot file with the effects and their amplitudes.
    """
    effects = [added for added in added_effects(robot) if added.effect.name != "payload"]
    reference = BulletPhysics(arm, bodies)
    past: list[tuple[float, Floats]] = []
    keep = max(2, round(MEMORY / arm.dt))

    def torque(t: float, q: Floats, qd: Floats) -> Floats:
        past.append((t, q))
        del past[:-keep]
        tau = np.zeros(robot.n)
        for added in effects:
            tau += _torque(added, _motion(added, t, q, qd, past, robot, reference))
        return tau

    return torque


def _motion(
    added: Added,
    t: float,
    q: Floats,
    qd: Floats,
    past: Sequence[tuple[float, Floats]],
    robot: Robot,
    reference: BulletPhysics,
) -> ArmMotion:
    """Return the path as an effect needs it: the last second of it for one with a memory, otherwise one sample."""
    steps = past if added.effect.name == "presliding_hysteresis" else past[-1:]
    count = len(steps)
    times, path = np.array([step[0] for step in steps]), np.array([step[1] for step in steps])
    speed = np.tile(qd, (count, 1))
    return ArmMotion(times, path, speed, np.zeros((count, robot.n)), robot, reference, lambda x: x)


def _torque(added: Added, motion: ArmMotion) -> Floats:
    """Return the torque at the last sample of a motion, (n,)."""
    columns = added.effect.columns(motion, added.place, added.shape)[:, :, -1]
    amplitudes = np.array([column.value for column in added.columns])
    tau = np.zeros(motion.n)
    tau[list(added.columns[0].rows)] = amplitudes @ columns
    return tau
