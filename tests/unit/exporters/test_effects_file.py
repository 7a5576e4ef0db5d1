"""Effects act in simulators as in dynid: by numbers of a file, or by effects.py."""

import mujoco
import numpy as np
import pytest
from export_cases import (
    bullet_body,
    off_in_pinocchio,
    off_in_pybullet,
    shipped,
    with_effect,
    written,
)

from dynid.exporters import FORMATS
from dynid.exporters.code import imported
from dynid.exporters.effects_file import EFFECTS
from dynid.exporters.simulated import simulated
from dynid.model.effects.catalogue import CATALOGUE

NUMBERS = (
    "viscous",
    "viscous_change",
    "coulomb",
    "coulomb_change",
    "torque_offset",
    "motor_inertia",
    "payload",
)
LEFT = ("joint_elasticity", "backlash", "torque_delay", "offset_step")


@pytest.mark.slow
@pytest.mark.parametrize("name", CATALOGUE)
def test_every_effect_acts_in_mujoco_and_pybullet_as_in_dynid_or_has_a_reason(name, tmp_path):
    """1000 states; the MJCF with effects.py in MuJoCo, the URDF with it in PyBullet."""
    source = with_effect(name)
    (found,) = EFFECTS.check(EFFECTS.text(source), source)
    assert found.engine.startswith("MuJoCo")
    assert found.largest < 1e-8
    assert off_in_pybullet(source, written(source, "urdf", tmp_path)) < 1e-8
    where = simulated(source)
    assert any(name in phrase for phrase in where.numbers) == (name in NUMBERS)
    assert any(name in phrase for phrase in where.left) == (name in LEFT)
    assert any(name in phrase for phrase in where.effects) == (name not in (*NUMBERS, *LEFT))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["viscous", "motor_inertia", "payload"])
def test_elements_of_mujoco_give_dynids_torques_alone(name, tmp_path):
    """Without effects.py; Pinocchio reads bodies and rotors of the same file."""
    source = with_effect(name)
    path = written(source, "mjcf", tmp_path)
    (found,) = FORMATS["mjcf"].check(path.read_text(), source)
    assert found.largest < 1e-8
    assert off_in_pinocchio(source, path) < 1e-8


def test_dry_friction_beyond_the_file_holds_an_arm_at_rest():
    """A push below Coulomb plus Stribeck friction does not move the joint, one above it does."""
    source = with_effect("stribeck")
    model = mujoco.MjModel.from_xml_string(FORMATS["mjcf"].text(source))
    model.opt.gravity[:] = 0.0
    model.opt.timestep = 1e-3
    effects = imported(EFFECTS.text(source)).Mujoco(model)
    dof = model.joint(source.robot.joint_names[2]).dofadr[0]
    most = source.full.drives["fc3"] + 1.1
    moved = []
    try:
        mujoco.set_mjcb_passive(effects.passive)
        for push in (0.9 * most, 1.2 * most):
            data = mujoco.MjData(model)
            for _ in range(200):
                data.qfrc_applied[:] = source.full.of_joints("fo") + push * np.eye(7)[dof]
                mujoco.mj_step(model, data)
            moved.append(abs(data.qpos[dof]))
    finally:
        mujoco.set_mjcb_passive(None)
    assert moved[0] < 2e-3, "more than what MuJoCo's soft constraint creeps"
    assert moved[1] > 10 * moved[0]


def test_pybullet_moves_as_the_model_says():
    """Forward: torques of a slow motion by the model keep the arm on it, with rotors and friction, on a random arm."""
    import pybullet

    source = shipped("kuka_lwr4plus")
    client, body = bullet_body(FORMATS["urdf"].text(source), source.robot.world_gravity)
    effects = imported(EFFECTS.text(source)).Bullet(body, client)
    dt, n = 1e-3, source.robot.n
    pybullet.setPhysicsEngineParameter(fixedTimeStep=dt, numSubSteps=0, physicsClientId=client)
    size = np.linspace(0.1, 0.3, n)
    for j, s in zip(effects.joints, size, strict=True):
        pybullet.resetJointState(body, j, 0.0, 2 * s, physicsClientId=client)
    for k in range(500):
        t = k * dt
        state = size * np.sin(2 * t), 2 * size * np.cos(2 * t), -4 * size * np.sin(2 * t)
        forces = effects.forces(effects.inverse_dynamics(*state), dt)
        pybullet.setJointMotorControlArray(
            body,
            effects.joints,
            pybullet.TORQUE_CONTROL,
            forces=forces.tolist(),
            physicsClientId=client,
        )
        pybullet.stepSimulation(physicsClientId=client)
    q = np.array(
        [row[0] for row in pybullet.getJointStates(body, effects.joints, physicsClientId=client)]
    )
    np.testing.assert_allclose(q, size * np.sin(2 * 500 * dt), atol=5e-3)
