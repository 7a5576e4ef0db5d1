"""One simulated arm that is stepped by joint torques, with friction and rotors that the physics engine does not know.

The engine is MuJoCo. Nothing here uses dynid's own equations of motion. Damping of the engine is off and
inertias are the given ones.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats
from dynid.errors import PackageMissing
from dynid.motion import Motion
from dynid.robot import Body, Robot
from dynid.sim import tuning
from dynid.sim.urdf import urdf_text, without_stops


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
        return self.viscous * qd + self.coulomb * smooth_sign + self.offset

    def slope(self, qd: Floats) -> Floats:
        """Return the derivative of ``torque`` by the velocity, (..., n) [N m s/rad or N s/m]."""
        velocity = np.array(self.velocity)
        return self.viscous + self.coulomb / velocity * (1 - np.tanh(qd / velocity) ** 2)


class SimulatedArm:
    """A simulated arm; ``step`` moves it, ``state`` reads it.

    Args:
        robot: geometry and gravity.
        bodies: true body of each link in its DH frame; the prior of the robot file when None.
        friction: true friction; none when None.
        rotor_inertia: reflected to the joint side, (n,) [kg m^2 or kg].
        dt: step of the physics [s].

    Attributes:
        extra: further torque that the drives need, of time, positions and velocities: (float, (n,), (n,)) -> (n,).

    Raises:
        PackageMissing: MuJoCo is not installed, or refuses the bodies.
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Sequence[Body] | None = None,
        friction: Friction | None = None,
        rotor_inertia: Sequence[float] | float = 0.0,
        dt: float = tuning.PHYSICS_STEP_S,
    ) -> None:
        try:
            import mujoco
        except ImportError as error:
            raise PackageMissing("MuJoCo is not installed", fix="pip install mujoco") from error
        try:
            self._arm = mujoco.MjModel.from_xml_string(urdf_text(without_stops(robot), bodies))
        except ValueError as error:
            raise PackageMissing(f"MuJoCo refuses the bodies of the arm: {error}") from error
        off, options = mujoco.mjtDisableBit, self._arm.opt
        options.timestep = dt
        options.gravity = robot.world_gravity
        options.disableflags |= off.mjDSBL_CONTACT | off.mjDSBL_CONSTRAINT
        self._mujoco, self._data = mujoco, mujoco.MjData(self._arm)
        # Why another: questions about other states must not disturb the motion.
        self._asked = mujoco.MjData(self._arm)
        self._inertia = self._arm.dof_M0.copy()
        self.robot, self.dt, self.time = robot, dt, 0.0
        self.extra: Callable[[float, Floats, Floats], Floats] = lambda t, q, qd: np.zeros_like(q)
        self.friction = friction or Friction.none(robot.n)
        self.rotor_inertia = np.zeros(robot.n) + rotor_inertia

    def reset(self, q: Floats, qd: Floats | float = 0.0) -> None:
        """Put the arm at positions (n,) [rad or m] and velocities (n,) [rad/s or m/s]."""
        self._data.qpos, self._data.qvel = q, qd

    def state(self) -> tuple[Floats, Floats]:
        """Return joint positions [rad or m] and velocities [rad/s or m/s], (n,) each."""
        return self._data.qpos.copy(), self._data.qvel.copy()

    def inverse_dynamics(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the torques of a motion of the bodies, without rotors and friction, (n,) [N m or N]."""
        asked = self._asked
        asked.qpos, asked.qvel, asked.qacc = q, qd, qdd
        self._mujoco.mj_inverse(self._arm, asked)
        return np.array(asked.qfrc_inverse)

    def step(self, tau: Floats) -> None:
        """Apply drive torques, (n,) [N m or N], for one step of the physics.

        MuJoCo does not know our friction. It gets what friction leaves, and as armature the rotors and friction's
        slope: (M + Im + dt dF/dqd) qdd = tau - friction - h. The slope takes friction at the end of the step, which
        keeps the steep Coulomb part stable on light links.
        """
        q, qd = self.state()
        more = self.rotor_inertia + self.dt * self.friction.slope(qd)
        self._data.qfrc_applied = tau - self.friction.torque(qd) - self.extra(self.time, q, qd)
        # Why both: MuJoCo takes dof_M0 of joints whose inertia never changes.
        self._arm.dof_armature, self._arm.dof_M0 = more, self._inertia + more
        self._mujoco.mj_step(self._arm, self._data)
        self._arm.dof_armature, self._arm.dof_M0 = 0.0, self._inertia
        self.time += self.dt

    def computed_torque(self, target: tuple[Floats, Floats, Floats]) -> Floats:
        """Return drive torques, (n,) [N m or N], towards a commanded position, velocity and acceleration.

        Feedback makes each joint a critically damped second-order system. Friction is not compensated, as on a real
        arm, so the arm lags a little where friction turns.
        """
        (q, qd), omega = self.state(), 2 * np.pi * tuning.CONTROLLER_FREQUENCY_HZ
        aim = target[2] + 2 * omega * (target[1] - qd) + omega**2 * (target[0] - q)
        return self.inverse_dynamics(q, qd, aim) + self.rotor_inertia * aim


# ---------------------------------------------------------------- the closed loop
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


def track(arm: SimulatedArm, motion: Motion) -> SimulatedRun:
    """Let an arm follow a motion.

    Args:
        arm: the arm; it is put at the motion's first state.
        motion: sampled at the steps of the arm's physics, ``arm.dt`` apart.
    """
    arm.reset(motion.q[0], motion.qd[0])
    rows = []
    for target in zip(motion.q, motion.qd, motion.qdd, strict=True):
        rows.append((*arm.state(), arm.computed_torque(target)))
        arm.step(rows[-1][2])
    q, qd, tau = (np.array(part) for part in zip(*rows, strict=True))
    return SimulatedRun(motion.t, q, qd, tau, motion.q)
