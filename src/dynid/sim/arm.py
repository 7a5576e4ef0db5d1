"""One simulated arm that is stepped by joint torques, with friction and rotors that the physics engine does not know.

The engine is MuJoCo. Nothing here uses dynid's own equations of motion. Damping of the engine is off and
inertias are the given ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.errors import PackageMissing
from dynid.model.parameters import prior_bodies
from dynid.motion import Motion
from dynid.robot import Body, Robot, rotation_rpy
from dynid.sim import tuning
from dynid.sim.urdf import urdf_text, without_stops

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Friction:
    """Friction of all joints: viscous * qd + coulomb * tanh(qd / velocity) + offset.

    Attributes:
        viscous: (n,) [N m s/rad or N s/m].
        coulomb: (n,) [N m or N].
        offset: (n,) [N m or N].
        velocity: where the Coulomb part has reached 76 % of its size, (n,) [rad/s or m/s].
    """

    viscous: tuple[float, ...]
    coulomb: tuple[float, ...]
    offset: tuple[float, ...]
    velocity: tuple[float, ...]

    @classmethod
    def none(cls, n: int) -> Friction:
        """Return no friction at n joints."""
        return cls((0.0,) * n, (0.0,) * n, (0.0,) * n, (0.01,) * n)

    def torque(self, qd: Floats) -> Floats:
        """Return the torque that drives need against friction, (..., n) [N m or N], at velocities [rad/s or m/s]."""
        smooth_sign = np.tanh(qd / np.array(self.velocity))
        return np.asarray(
            np.array(self.viscous) * qd
            + np.array(self.coulomb) * smooth_sign
            + np.array(self.offset)
        )

    def slope(self, qd: Floats) -> Floats:
        """Return the derivative of ``torque`` by the velocity, (..., n) [N m s/rad or N s/m]."""
        steepness = 1 - np.tanh(qd / np.array(self.velocity)) ** 2
        return np.asarray(
            np.array(self.viscous) + np.array(self.coulomb) / np.array(self.velocity) * steepness
        )


class Engine:
    """The rigid bodies of an arm in MuJoCo, without friction, rotors and stops.

    Args:
        robot: geometry and gravity.
        bodies: body of each link in its DH frame.
        dt: step of the physics [s].

    Raises:
        PackageMissing: MuJoCo is not installed, or refuses the bodies.
    """

    name = "MuJoCo"

    def __init__(self, robot: Robot, bodies: Sequence[Body], dt: float) -> None:
        try:
            import mujoco
        except ImportError as error:
            raise PackageMissing("MuJoCo is not installed", fix="pip install mujoco") from error
        try:
            self._arm = mujoco.MjModel.from_xml_string(urdf_text(without_stops(robot), bodies))
        except ValueError as error:
            raise PackageMissing(f"MuJoCo refuses the bodies of the arm: {error}") from error
        self._mujoco, options = mujoco, self._arm.opt
        options.timestep, options.gravity = dt, _world_gravity(robot)
        options.disableflags |= (
            mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
        )
        self._data, self._still = mujoco.MjData(self._arm), np.zeros(robot.n)
        #: Why another: questions about other states must not disturb the motion.
        self._asked = mujoco.MjData(self._arm)

    def reset(self, q: Floats, qd: Floats) -> None:
        """Put the arm at positions (n,) [rad or m] and velocities (n,) [rad/s or m/s]."""
        self._data.qpos, self._data.qvel = q, qd

    def state(self) -> tuple[Floats, Floats]:
        """Return joint positions [rad or m] and velocities [rad/s or m/s], (n,) each."""
        return self._data.qpos.copy(), self._data.qvel.copy()

    def inverse_dynamics(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the torques of a motion, (n,) [N m or N]."""
        asked = self._asked
        asked.qpos, asked.qvel, asked.qacc = q, qd, qdd
        self._mujoco.mj_inverse(self._arm, asked)
        return np.array(asked.qfrc_inverse)

    def mass_matrix(self, q: Floats) -> Floats:
        """Return the mass matrix, (n, n) [kg m^2 or kg], column by column."""
        weight = self.inverse_dynamics(q, self._still, self._still)
        columns = [self.inverse_dynamics(q, self._still, unit) - weight for unit in np.eye(len(q))]
        return np.stack(columns, axis=1)

    def step(self, tau: Floats) -> None:
        """Apply torques, (n,) [N m or N], for one step of the physics."""
        self._data.qfrc_applied = tau
        self._mujoco.mj_step(self._arm, self._data)


class SimulatedArm:
    """A simulated arm; ``step`` moves it, ``state`` reads it.

    Args:
        robot: geometry and gravity.
        bodies: true body of each link in its DH frame; the prior of the robot file when None.
        friction: true friction; none when None.
        rotor_inertia: reflected to the joint side, (n,) [kg m^2 or kg]; none when None.
        dt: step of the physics [s].
        extra: further torque that the drives need, of time, positions and velocities: (float, (n,), (n,)) -> (n,).

    Attributes:
        engine: the rigid bodies.

    Raises:
        PackageMissing: MuJoCo is not installed, or refuses the bodies.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Sequence[Body] | None = None,
        friction: Friction | None = None,
        rotor_inertia: Sequence[float] | None = None,
        dt: float = tuning.PHYSICS_STEP_S,
        extra: Callable[[float, Floats, Floats], Floats] | None = None,
    ) -> None:
        self.robot = robot
        self.friction = friction or Friction.none(robot.n)
        self.rotor_inertia = (
            np.zeros(robot.n) if rotor_inertia is None else np.array(rotor_inertia, dtype=float)
        )
        self.dt, self.time, self.extra = dt, 0.0, extra
        self.engine = Engine(robot, prior_bodies(robot) if bodies is None else bodies, dt)
        self.state, self.inverse_dynamics = self.engine.state, self.engine.inverse_dynamics

    def __enter__(self) -> SimulatedArm:
        """Return itself."""
        return self

    def __exit__(self, *error: object) -> None:
        """Do nothing: MuJoCo holds no process and no window."""

    def reset(self, q: Floats, qd: Floats | None = None) -> None:
        """Put the arm at positions (n,) [rad or m] and velocities (n,) [rad/s or m/s], at rest when None."""
        self.engine.reset(q, np.zeros(self.robot.n) if qd is None else qd)

    def step(self, tau: Floats) -> None:
        """Apply drive torques for one step of the physics.

        MuJoCo knows neither rotors nor our friction, so it gets the torque that is left for the links:
        tau - friction - Im qdd, with qdd from (M + Im + dt dF/dqd) qdd = tau - friction - h. The last term on the left
        takes friction at the end of the step, which keeps the steep Coulomb part stable on light links.

        Args:
            tau: torques of the drives, (n,) [N m or N].
        """
        q, qd = self.state()
        bias = self.inverse_dynamics(q, qd, np.zeros_like(q))
        slope = self.dt * self.friction.slope(qd)
        drive = tau - self.friction.torque(qd)
        if self.extra is not None:
            drive = drive - self.extra(self.time, q, qd)
        self.time += self.dt
        qdd = np.linalg.solve(
            self.engine.mass_matrix(q) + np.diag(self.rotor_inertia + slope), drive - bias
        )
        self.engine.step(drive - (self.rotor_inertia + slope) * qdd)


def _world_gravity(robot: Robot) -> Floats:
    return np.asarray(rotation_rpy(robot.base_rpy) @ np.array(robot.gravity))


# ---------------------------------------------------------------- the closed loop
@dataclass(frozen=True)
class ComputedTorque:
    """Computed torque from the commanded motion with feedback that makes each joint a second-order system.

    Friction is not compensated, as on a real arm, so the arm lags a little where friction turns.

    Attributes:
        frequency: natural frequency of the error [Hz].
        damping: damping ratio of the error.
    """

    frequency: float = tuning.CONTROLLER_FREQUENCY_HZ
    damping: float = 1.0

    def torque(
        self, arm: SimulatedArm, q: Floats, qd: Floats, target: tuple[Floats, Floats, Floats]
    ) -> Floats:
        """Return drive torques, (n,) [N m or N], for a state and a commanded position, velocity and acceleration."""
        omega = 2 * np.pi * self.frequency
        aim = target[2] + 2 * self.damping * omega * (target[1] - qd) + omega**2 * (target[0] - q)
        return arm.inverse_dynamics(q, qd, aim) + arm.rotor_inertia * aim


@dataclass(frozen=True)
class SimulatedRun:
    """What a simulated arm did, without sensor errors.

    Attributes:
        t: (N,) [s].
        q: (N, n) [rad or m].
        qd: (N, n) [rad/s or m/s].
        tau: drive torques, (N, n) [N m or N].
        q_ref: commanded positions, (N, n).
    """

    t: Floats
    q: Floats
    qd: Floats
    tau: Floats
    q_ref: Floats


def track(
    arm: SimulatedArm, motion: Motion, every: int = 1, controller: ComputedTorque | None = None
) -> SimulatedRun:
    """Let an arm follow a motion.

    Args:
        arm: the arm; it is put at the motion's first state.
        motion: sampled at the steps of the arm's physics, ``arm.dt`` apart.
        every: keep every so many steps.
        controller: the feedback; the default one when None.
    """
    controller = controller or ComputedTorque()
    arm.reset(motion.q[0], motion.qd[0])
    kept = len(range(0, len(motion), every))
    q, qd, tau = (np.empty((kept, arm.robot.n)) for _ in range(3))
    for k, target in enumerate(zip(motion.q, motion.qd, motion.qdd, strict=True)):
        state = arm.state()
        torque = controller.torque(arm, *state, target)
        if k % every == 0:
            row = k // every
            (q[row], qd[row]), tau[row] = state, torque
        arm.step(torque)
    return SimulatedRun(motion.t[::every], q, qd, tau, motion.q[::every])
