"""The closed loop: a simulated arm follows a motion, and what it did is sampled at the log's rate."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.motion import Motion
from dynid.sim.arm import SimulatedArm

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class ComputedTorque:
    """Computed torque from the commanded motion with feedback that makes each joint a second-order system.

    Friction is not compensated, as on a real arm, so the arm lags a little where friction turns.

    Attributes:
        frequency: natural frequency of the error [Hz].
        damping: damping ratio of the error.
    """

    frequency: float = 15.0
    damping: float = 1.0

    def torque(self, arm: SimulatedArm, q: Floats, qd: Floats, target: tuple[Floats, Floats, Floats]) -> Floats:
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


def track(arm: SimulatedArm, motion: Motion, every: int = 1, controller: ComputedTorque | None = None) -> SimulatedRun:
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
