"""Exported files in their simulators, simulated along a recorded motion: the written text is loaded, nothing else.

The measured torques act on the simulated arm, and one soft controller, the same for all arms, holds it near
the recorded motion. Where the model is right the controller has nothing to do.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
from scipy.interpolate import make_interp_spline

from dynid.arrays import Floats
from dynid.errors import NotSimulated, PackageMissing
from dynid.exporters import effects_file, mjcf, urdf
from dynid.exporters.code import imported
from dynid.exporters.engines import bullet_body, module, quiet
from dynid.exporters.interface import IdentifiedArm
from dynid.sim import tuning

#: What `why` says of an arm that no simulator moves.
FAR = "its parameters are far from those of the real arm"


#: Applies torques of the drives for a step, and returns positions and velocities behind it.
Step = Callable[[Floats], tuple[Floats, Floats]]


def drive(
    arm: IdentifiedArm,
    engine: str,
    recorded: tuple[Floats, Floats, Floats, Floats],
    inertia: Floats,
) -> tuple[Floats, Floats]:
    """Drive an exported arm along a recording.

    Args:
        arm: what is exported.
        engine: ``"mujoco"`` or ``"pybullet"``.
        recorded: times, evenly spaced, (N,) [s], positions, velocities and torques, (N, n).
        inertia: what the controller takes each joint to move, (n,) [kg m^2 or kg].

    Returns:
        Positions, (N, n) [rad or m], and what the controller added to the measured torques, (N, n) [N m or N].

    Raises:
        PackageMissing: the engine is not installed.
        NotSimulated: the engine refuses the arm, or the simulation diverges.
    """
    t, q, qd, tau = recorded
    simulator = module(engine)
    if simulator is None:
        until = ", up to Python 3.11" * (engine == "pybullet")
        raise PackageMissing(f"{engine} is not installed", fix=f"pip install {engine}{until}")
    dt = float(t[1] - t[0])
    steps = max(1, round(dt / tuning.PHYSICS_STEP_S / 2))
    omega = 2.0 * np.pi * tuning.SOFT_FREQUENCY_HZ
    stiffness = np.maximum(inertia * omega**2, np.std(tau, axis=0) / tuning.SOFT_DEFLECTION)
    damping = 2.0 * np.sqrt(stiffness * inertia)
    effects, load = imported(effects_file.text(arm)), {"mujoco": _mujoco, "pybullet": _pybullet}
    try:
        with quiet():
            step, close = load[engine](arm, simulator, effects, dt / steps, q[0], qd[0])
    except ValueError as error:
        raise NotSimulated(f"{engine} refuses the arm: {error}", why=FAR) from error
    fine = np.minimum(t[0] + dt / steps * np.arange(steps * len(t)), t[-1])
    wanted = make_interp_spline(t, np.hstack([q, qd, tau]), k=1)(fine)
    positions, added, here = [], [], (q[0], qd[0])
    try:
        for k, row in enumerate(wanted):
            goal, speed, push = np.split(row, 3)
            more = stiffness * (goal - here[0]) + damping * (speed - here[1])
            if k % steps == 0:
                positions.append(here[0])
                added.append(more)
            here = step(push + more)
    finally:
        close()
    if not np.all(np.isfinite(positions)):
        fix = "identify it with --feasible"
        raise NotSimulated(f"in {engine} the simulation diverges", why=FAR, fix=fix)
    return np.array(positions), np.array(added)


def _mujoco(
    arm: IdentifiedArm,
    engine: Any,  # noqa: ANN401
    effects: ModuleType,
    h: float,
    q: Floats,
    qd: Floats,
) -> tuple[Step, Callable[[], None]]:
    """Put the arm at a state in MuJoCo; return its step of h seconds, and what ends it."""
    model = engine.MjModel.from_xml_string(mjcf.text(arm))
    model.opt.timestep = h
    # Why no stops: a recording ends before them, and a model that is wrong must not lean on them.
    # Why no restart: a simulation that diverges must show.
    off = engine.mjtDisableBit
    model.opt.disableflags |= off.mjDSBL_LIMIT | off.mjDSBL_CONTACT | off.mjDSBL_AUTORESET
    model.jnt_actfrclimited[:] = 0
    data, hook = engine.MjData(model), effects.Mujoco(model)
    places, dofs = hook.places, hook.dofs
    data.qpos[places], data.qvel[dofs] = q, qd
    engine.set_mjcb_passive(hook.passive)

    def step(torque: Floats) -> tuple[Floats, Floats]:
        data.qfrc_applied[dofs] = torque
        engine.mj_step(model, data)
        return data.qpos[places], data.qvel[dofs]

    return step, lambda: engine.set_mjcb_passive(None)


def _pybullet(
    arm: IdentifiedArm,
    engine: Any,  # noqa: ANN401
    effects: ModuleType,
    h: float,
    q: Floats,
    qd: Floats,
) -> tuple[Step, Callable[[], None]]:
    """Do the same in PyBullet."""
    client, body = bullet_body(urdf.text(arm), arm.robot.world_gravity)
    server = {"physicsClientId": client}
    engine.setPhysicsEngineParameter(fixedTimeStep=h, numSubSteps=0, **server)
    for joint in range(-1, engine.getNumJoints(body, **server)):
        engine.changeDynamics(body, joint, linearDamping=0.0, angularDamping=0.0, **server)
    hook = effects.Bullet(body, client)
    for joint, position, speed in zip(hook.joints, q, qd, strict=True):
        engine.resetJointState(body, joint, float(position), float(speed), **server)

    def step(torque: Floats) -> tuple[Floats, Floats]:
        forces = hook.forces(torque, h).tolist()
        engine.setJointMotorControlArray(
            body, hook.joints, engine.TORQUE_CONTROL, forces=forces, **server
        )
        engine.stepSimulation(**server)
        rows = engine.getJointStates(body, hook.joints, **server)
        return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])

    return step, lambda: engine.disconnect(**server)
