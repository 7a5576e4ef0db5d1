"""Rigid-body torques of an arm from MuJoCo, where it is installed; it shares no equation with the model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.errors import PackageMissing
from dynid.robot import Body, Robot, rotation_rpy
from dynid.sim.urdf import urdf_text, without_stops

Floats = NDArray[np.float64]


def mujoco_torques(robot: Robot, bodies: Sequence[Body] | None, q: Floats, qd: Floats, qdd: Floats) -> Floats:
    """Return the torques along a motion without friction and rotors, (N, n) [N m or N].

    Args:
        robot: geometry and gravity.
        bodies: body of each link in its DH frame; the prior of the robot file when None.
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n).
        qdd: accelerations, (N, n).

    Raises:
        PackageMissing: MuJoCo is not installed, or refuses the arm's bodies.
    """
    try:
        import mujoco
    except ImportError as error:
        raise PackageMissing("mujoco is not installed", fix="pip install mujoco") from error
    try:
        arm = mujoco.MjModel.from_xml_string(urdf_text(without_stops(robot), bodies))
    except ValueError as error:
        raise PackageMissing(f"MuJoCo refuses the arm: {error}") from error
    arm.opt.gravity = rotation_rpy(robot.base_rpy) @ np.array(robot.gravity)
    arm.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    state, tau = mujoco.MjData(arm), np.zeros_like(q)
    for k in range(len(q)):
        state.qpos, state.qvel, state.qacc = q[k], qd[k], qdd[k]
        mujoco.mj_inverse(arm, state)
        tau[k] = state.qfrc_inverse
    return tau
