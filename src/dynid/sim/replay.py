"""Replay an identified model in a physics engine: measured torques in, positions out, in short windows.

The engine carries the state and integrates it; the arm that it carries is the identified one, whose base parameters
need not belong to any set of bodies that an engine would accept. So the engine's own arm gets, at each step, the
torques that make it accelerate as the identified model does.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from dynid.arrays import Floats
from dynid.robot import Robot
from dynid.sim import tuning
from dynid.sim.arm import SimulatedArm


def replay(
    robot: Robot,
    acceleration: Callable[[Floats, Floats, Floats, Floats], Floats],
    t: Floats,
    q: Floats,
    qd: Floats,
    tau: Floats,
    *,
    windows: int = 24,
) -> Floats:
    """Replay measured torques through a model; return the rms error of each position over all windows, (n,) [rad or m].

    Args:
        robot: the arm.
        acceleration: the model: times (B,), positions, velocities and torques (B, n) -> accelerations (B, n).
        t: times, evenly spaced, (N,) [s].
        q: measured positions, (N, n).
        qd: measured velocities, (N, n).
        tau: measured torques, (N, n).
        windows: number of windows, spread evenly.
    """
    dt = float(t[1] - t[0])
    length = max(2, round(tuning.REPLAY_WINDOW_S / dt))
    starts = np.linspace(
        0, len(t) - length - 1, max(1, min(windows, (len(t) - 1) // length))
    ).astype(int)
    x, v = q[starts].copy(), qd[starts].copy()
    errors = np.zeros((len(starts), robot.n))
    # One arm for all windows, put where each of them is.
    arm = SimulatedArm(robot, dt=dt)
    for k in range(length):
        at = starts + k
        a = acceleration(t[at], x, v, 0.5 * (tau[at] + tau[at + 1]))
        for w in range(len(starts)):
            arm.reset(x[w], v[w])
            arm.step(arm.inverse_dynamics(x[w], v[w], a[w]))
            x[w], v[w] = arm.state()
        errors += (x - q[at + 1]) ** 2
    return np.asarray(np.sqrt(np.mean(errors / length, axis=0)))
