"""Exported files in MuJoCo, simulated along a recorded motion: the written text is loaded, nothing else.

The measured torques act on the simulated arm, and one soft controller, the same for all arms, holds it near
the recorded motion. Where the model is right the controller has nothing to do.
"""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from dynid.arrays import Floats
from dynid.errors import NotSimulated
from dynid.exporters import effects_file, mjcf
from dynid.exporters.code import imported
from dynid.exporters.engines import quiet
from dynid.exporters.interface import IdentifiedArm
from dynid.sim import tuning

#: What `why` says of an arm that no simulator moves.
FAR = "its parameters are far from those of the real arm"


def drive(
    arm: IdentifiedArm, recorded: tuple[Floats, Floats, Floats, Floats], inertia: Floats
) -> tuple[Floats, Floats]:
    """Drive an exported arm along a recording.

    Args:
        arm: what is exported.
        recorded: times, evenly spaced, (N,) [s], positions, velocities and torques, (N, n).
        inertia: what the controller takes each joint to move, (n,) [kg m^2 or kg].

    Returns:
        Positions, (N, n) [rad or m], and what the controller added to the measured torques, (N, n) [N m or N].

    Raises:
        NotSimulated: MuJoCo refuses the arm, or the simulation diverges.
    """
    import mujoco

    t, q, qd, tau = recorded
    dt = float(t[1] - t[0])
    steps = max(1, round(dt / tuning.PHYSICS_STEP_S / 2))
    omega = 2.0 * np.pi * tuning.SOFT_FREQUENCY_HZ
    stiffness = np.maximum(inertia * omega**2, np.std(tau, axis=0) / tuning.SOFT_DEFLECTION)
    damping = 2.0 * np.sqrt(stiffness * inertia)
    try:
        with quiet():
            model = mujoco.MjModel.from_xml_string(mjcf.text(arm))
    except ValueError as error:
        raise NotSimulated(f"mujoco refuses the arm: {error}", why=FAR) from error
    model.opt.timestep = dt / steps
    # Why no stops: a recording ends before them, and a model that is wrong must not lean on them.
    # Why no restart: a simulation that diverges must show.
    off = mujoco.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_LIMIT | off.mjDSBL_CONTACT | off.mjDSBL_AUTORESET
    model.jnt_actfrclimited[:] = 0
    data, effects = mujoco.MjData(model), imported(effects_file.text(arm)).Mujoco(model)
    places, dofs = effects.places, effects.dofs
    data.qpos[places], data.qvel[dofs] = q[0], qd[0]
    fine = np.minimum(t[0] + dt / steps * np.arange(steps * len(t)), t[-1])
    wanted = make_interp_spline(t, np.hstack([q, qd, tau]), k=1)(fine)
    positions, added = [], []
    mujoco.set_mjcb_passive(effects.passive)
    try:
        for k, row in enumerate(wanted):
            goal, speed, push = np.split(row, 3)
            here = data.qpos[places]
            more = stiffness * (goal - here) + damping * (speed - data.qvel[dofs])
            if k % steps == 0:
                positions.append(here)
                added.append(more)
            data.qfrc_applied[dofs] = push + more
            mujoco.mj_step(model, data)
    finally:
        mujoco.set_mjcb_passive(None)
    if not np.all(np.isfinite(positions)):
        fix = "identify it with --feasible"
        raise NotSimulated("in mujoco the simulation diverges", why=FAR, fix=fix)
    return np.array(positions), np.array(added)
