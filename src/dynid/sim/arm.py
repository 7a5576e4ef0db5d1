"""One arm in PyBullet that is stepped by joint torques, with friction and rotor inertia that Bullet does not know.

Nothing here uses dynid's own equations of motion. Bullet's damping is off and its inertias are the given ones.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import PackageMissing
from dynid.model.parameters import prior_bodies
from dynid.robot import Body, Robot, rotation_rpy
from dynid.scratch import scratch_folder
from dynid.sim.urdf import without_stops, write_urdf

Floats = NDArray[np.float64]

#: How PyBullet is installed: it has wheels up to Python 3.11.
GET_BULLET = "pip install pybullet (Python 3.12 and later: built from source in about 8 minutes, with a C++ compiler)"
#: Largest moment of inertia that Bullet is given [kg m^2].
LARGEST = 0.5
#: Step of the physics where none is given [s].
STEP = 5e-4


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
        return np.asarray(np.array(self.viscous) * qd + np.array(self.coulomb) * smooth_sign + np.array(self.offset))

    def slope(self, qd: Floats) -> Floats:
        """Return the derivative of ``torque`` by the velocity, (..., n) [N m s/rad or N s/m]."""
        steepness = 1 - np.tanh(qd / np.array(self.velocity)) ** 2
        return np.asarray(np.array(self.viscous) + np.array(self.coulomb) / np.array(self.velocity) * steepness)


class SimulatedArm:
    """A simulated arm; ``step`` moves it, ``state`` reads it.

    Args:
        robot: geometry and gravity.
        bodies: true body of each link in its DH frame; the prior of the robot file when None.
        friction: true friction; none when None.
        rotor_inertia: reflected to the joint side, (n,) [kg m^2 or kg]; none when None.
        dt: step of the physics [s].
        extra: further torque that the drives need, of time, positions and velocities: (float, (n,), (n,)) -> (n,).
    """

    def __init__(
        self,
        robot: Robot,
        bodies: Sequence[Body] | None = None,
        friction: Friction | None = None,
        rotor_inertia: Sequence[float] | None = None,
        dt: float = STEP,
        extra: Callable[[float, Floats, Floats], Floats] | None = None,
    ) -> None:
        self.robot = robot
        self.friction = friction or Friction.none(robot.n)
        self.rotor_inertia = np.zeros(robot.n) if rotor_inertia is None else np.array(rotor_inertia, dtype=float)
        self.dt, self.time, self.extra = dt, 0.0, extra
        self._bullet = _bullet()
        self._client = self._bullet.connect(self._bullet.DIRECT)
        bodies = prior_bodies(robot) if bodies is None else bodies
        self._scale = _scale(bodies)
        self._body, self._joints = self._load([_lighter(body, self._scale) for body in bodies])

    def __enter__(self) -> SimulatedArm:
        """Return itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close the physics server."""
        self.close()

    def close(self) -> None:
        """Close the physics server."""
        self._bullet.disconnect(self._client)

    def _load(self, bodies: Sequence[Body]) -> tuple[int, list[int]]:
        bullet, client = self._bullet, self._client
        # Why: without this flag Bullet replaces the inertias by those of the shapes, 0.4 N m on this kind of arm.
        flags = bullet.URDF_USE_INERTIA_FROM_FILE
        with scratch_folder() as folder:
            path = Path(folder) / "arm.urdf"
            write_urdf(without_stops(self.robot), bodies, path)
            body = bullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=client)
        gravity = rotation_rpy(self.robot.base_rpy) @ np.array(self.robot.gravity)
        bullet.setGravity(*gravity.tolist(), physicsClientId=client)
        bullet.setPhysicsEngineParameter(fixedTimeStep=self.dt, numSubSteps=0, physicsClientId=client)
        joints = list(range(self.robot.n))
        for link in (-1, *joints):
            free = {"linearDamping": 0.0, "angularDamping": 0.0, "jointDamping": 0.0}
            bullet.changeDynamics(body, link, **free, physicsClientId=client)
        # Why: Bullet holds every joint with a motor of its own until told otherwise.
        idle = {"controlMode": bullet.VELOCITY_CONTROL, "forces": [0.0] * len(joints)}
        bullet.setJointMotorControlArray(body, joints, **idle, physicsClientId=client)
        return body, joints

    def reset(self, q: Floats, qd: Floats | None = None) -> None:
        """Put the arm at positions (n,) [rad or m] and velocities (n,) [rad/s or m/s], at rest when None."""
        speeds = np.zeros(self.robot.n) if qd is None else qd
        for joint, position, speed in zip(self._joints, q, speeds, strict=True):
            self._bullet.resetJointState(self._body, joint, float(position), float(speed), physicsClientId=self._client)

    def state(self) -> tuple[Floats, Floats]:
        """Return joint positions [rad or m] and velocities [rad/s or m/s], (n,) each."""
        rows = self._bullet.getJointStates(self._body, self._joints, physicsClientId=self._client)
        return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])

    def inverse_dynamics(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return Bullet's rigid-body torques without friction and rotors, (n,) [N m or N]."""
        inputs = (q.tolist(), qd.tolist(), qdd.tolist())
        torques = self._bullet.calculateInverseDynamics(self._body, *inputs, physicsClientId=self._client)
        return self._scale * np.array(torques)

    def mass_matrix(self, q: Floats) -> Floats:
        """Return Bullet's mass matrix without rotors, (n, n) [kg m^2 or kg]."""
        found = self._bullet.calculateMassMatrix(self._body, q.tolist(), physicsClientId=self._client)
        return self._scale * np.array(found)

    def step(self, tau: Floats) -> None:
        """Apply drive torques for one step of the physics.

        Bullet knows neither rotors nor our friction, so it gets the torque that is left for the links:
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
        qdd = np.linalg.solve(self.mass_matrix(q) + np.diag(self.rotor_inertia + slope), drive - bias)
        left = drive - (self.rotor_inertia + slope) * qdd
        bullet = self._bullet
        forces = {"controlMode": bullet.TORQUE_CONTROL, "forces": (left / self._scale).tolist()}
        bullet.setJointMotorControlArray(self._body, self._joints, **forces, physicsClientId=self._client)
        bullet.stepSimulation(physicsClientId=self._client)


def _scale(bodies: Sequence[Body]) -> float:
    """Return by how much bodies are too heavy for Bullet, a power of two.

    It refuses inertias that are not symmetric to 1e-15 kg m^2, which those of an industrial arm are not after their
    rounding. An arm whose masses and torques are all a power of two smaller moves alike, to the last digit.
    """
    largest = max((float(np.abs(body.tensor).max()) for body in bodies), default=0.0)
    return 2.0 ** max(0, int(np.ceil(np.log2(largest / LARGEST)))) if largest > LARGEST else 1.0


def _lighter(body: Body, scale: float) -> Body:
    xx, xy, xz, yy, yz, zz = (value / scale for value in body.inertia_com)
    return Body(body.mass / scale, body.com, (xx, xy, xz, yy, yz, zz))


def _bullet() -> Any:  # noqa: ANN401 - the module has no types
    if "pybullet" in sys.modules:
        return sys.modules["pybullet"]
    # Why: the module prints its build time when it is loaded, on streams where answers and messages go.
    kept, nowhere = [os.dup(k) for k in (1, 2)], os.open(os.devnull, os.O_WRONLY)
    for k in (1, 2):
        os.dup2(nowhere, k)
    try:
        import pybullet
    except ImportError as error:
        raise PackageMissing("pybullet is not installed", fix=GET_BULLET) from error
    finally:
        for k, stream in zip((1, 2), kept, strict=True):
            os.dup2(stream, k)
            os.close(stream)
        os.close(nowhere)
    return pybullet
