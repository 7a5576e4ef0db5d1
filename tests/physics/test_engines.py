"""The regressor times the parameters against two inverse dynamics that other people wrote."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from arms import (
    configuration,
    dh_product,
    pinocchio_model,
    pinocchio_torques,
    random_bodies,
    random_robot,
    random_states,
    relative_error,
    simulated_torques,
    tensor_of,
)
from dynid import Robot
from dynid.model import build_model, reduce
from dynid.model.kinematics import fixed_poses
from dynid.model.relations import base_parameters
from dynid.robot import LINK_PARAMETERS, Body, Joint, Limits, roll_pitch_yaw, rotation_rpy
from dynid.sim.arm import SimulatedArm
from dynid.sim.urdf import urdf_text

FRICTION = ("fv", "fc", "fo")


def parameters(model, bodies, rotors, friction):
    """Return gamma in the model's own order, taken by name."""
    values = {}
    for i, body in enumerate(bodies, start=1):
        about_origin = tensor_of(body) - body.mass * pin.skew(np.array(body.com)) @ pin.skew(
            np.array(body.com)
        )
        first, second = body.mass * np.array(body.com), about_origin[np.triu_indices(3)]
        numbers = zip(LINK_PARAMETERS, (body.mass, *first, *second, rotors[i - 1]), strict=True)
        values |= {f"{kind}{i}": value for kind, value in numbers}
        values |= {f"{kind}{i}": friction[kind][i - 1] for kind in FRICTION}
    return np.array([values[name] for name in model.parameter_names])


def random_drives(rng, n):
    return rng.uniform(0.01, 0.5, n), {kind: rng.uniform(0.1, 1.0, n) for kind in FRICTION}


@pytest.mark.parametrize("seed", range(80))
def test_any_arm_has_the_torques_of_pinocchio(seed):
    """2 to 8 joints, both conventions, turning and sliding joints mixed, any gravity: 1e-9 relative."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng)
    bodies, (rotors, friction) = random_bodies(rng, robot.n), random_drives(rng, robot.n)
    q, qd, qdd = random_states(rng, robot.n, 5)
    model = build_model(robot)
    tau = model.regressor(q, qd, qdd) @ parameters(model, bodies, rotors, friction)
    expected = pinocchio_torques(pinocchio_model(robot, bodies, rotors), q, qd, qdd)
    smooth_within = np.array([0.01 if joint.revolute else 0.001 for joint in robot.joints])
    expected += friction["fv"] * qd + friction["fc"] * np.tanh(qd / smooth_within) + friction["fo"]
    assert relative_error(tau, expected) < 1e-9


@pytest.mark.parametrize("seed", range(300, 312))
def test_any_arm_has_the_torques_of_mujoco(seed):
    """Through the URDF: geometry, base pose, gravity in the world and inertias in other frames; 1e-6 relative."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng)
    bodies = random_bodies(rng, robot.n)
    q, qd, qdd = random_states(rng, robot.n, 5)
    model = build_model(robot)
    nothing = {kind: np.zeros(robot.n) for kind in FRICTION}
    tau = model.regressor(q, qd, qdd) @ parameters(model, bodies, np.zeros(robot.n), nothing)
    arm = SimulatedArm(robot, bodies)
    expected = simulated_torques(arm, q, qd, qdd)
    assert relative_error(tau, expected) < 1e-6


# ---------------------------------------------------------------- base parameters: span, rank, classes
GRAVITIES = ((0, 0, -9.81), (9.81, 0, 0), (0, 6.9, -6.9), (0, 0, 0), (1.2, -3.4, -9.0))


def random_arm(seed):
    """Return an arm of 3 to 6 joints without rotors and friction; half of its numbers are special ones."""
    robot = random_robot(
        np.random.default_rng(seed), 3 + seed % 4, ("standard", "modified")[seed % 2]
    )
    joints = tuple(replace(joint, motor_inertia=False, friction=()) for joint in robot.joints)
    return replace(robot, joints=joints, gravity=GRAVITIES[seed % 5])


def pinocchio_regressor(robot, *states):
    """Return columns (N n, 10 n): the torques of ten bodies on one link after the other, in their parameters."""
    bodies, columns = random_bodies(np.random.default_rng(0), 10), []
    for k in range(robot.n):
        torques = []
        for body in bodies:
            alone = [body if k == link else Body(0.0) for link in range(robot.n)]
            torques.append(pinocchio_torques(pinocchio_model(robot, alone), *states).ravel())
        columns.append(np.linalg.solve([body.parameters() for body in bodies], torques))
    return np.concatenate(columns).T


def normalised_rank(W):
    size = np.linalg.norm(W, axis=0)
    W = W[:, size > 1e-9] / size[size > 1e-9]
    values = np.linalg.svd(W, compute_uv=False)
    # Why 1e-7: the torques of ten bodies tell columns to 1e-12, which those of hardly any size make larger.
    return int(np.sum(values > 1e-7 * values[0]))


@pytest.mark.parametrize("seed", range(20))
def test_random_arm_has_the_span_rank_and_classes_of_pinocchio(seed):
    robot = random_arm(seed)
    model = build_model(robot)
    states = reduce.random_states(robot, 60, seed)
    ours = model.regressor(*states).reshape(-1, model.size)
    theirs = pinocchio_regressor(robot, *states)
    np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(theirs).max())

    found = base_parameters(model)
    assert found.rank == normalised_rank(theirs) == normalised_rank(np.hstack([ours, theirs]))
    # Dropping a column that stands alone costs a rank; a zero column is zero; any other can be dropped without loss.
    for k, name in enumerate(found.names):
        if name in found.none:
            assert np.linalg.norm(theirs[:, k]) < 1e-9
        else:
            assert (normalised_rank(np.delete(theirs, k, axis=1)) < found.rank) == (
                name in found.alone
            )


# ---------------------------------------------------------------- the URDF against the DH table
@pytest.mark.parametrize("seed", range(40))
def test_links_stand_where_the_dh_product_says(seed):
    """Both conventions, both joint types, any base pose: 1e-9 m and 1e-9 in the rotation."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng)
    model = pin.buildModelFromXML(urdf_text(robot))
    data, q = model.createData(), rng.uniform(-3, 3, robot.n)
    pin.framesForwardKinematics(model, data, configuration(model, q))
    for i, (joint, expected) in enumerate(
        zip(robot.joints, dh_product(robot, q), strict=True), start=1
    ):
        found = (
            data.oMf[model.getFrameId(f"link_{i}")].homogeneous
            @ fixed_poses(joint, robot.convention)[1]
        )
        np.testing.assert_allclose(found, expected, atol=1e-9)


def test_limits_and_types_are_those_of_the_robot_file():
    """A joint without position limits is continuous; the others carry all four limits."""
    joints = (
        Joint("free", limits=Limits(velocity=2.0)),
        Joint("held", limits=Limits((-1.0, 2.0), 3.0, None, 40.0)),
        Joint("slide", "prismatic", limits=Limits((0.0, 0.5))),
    )
    found = ET.fromstring(urdf_text(Robot("r", "standard", joints))).findall("joint")
    assert [joint.get("type") for joint in found] == ["continuous", "revolute", "prismatic"]
    limits = [{key: float(value) for key, value in joint.find("limit").items()} for joint in found]
    assert "lower" not in limits[0]
    assert limits[0]["velocity"] == 2.0
    assert limits[1] == {"lower": -1.0, "upper": 2.0, "velocity": 3.0, "effort": 40.0}
    assert (limits[2]["lower"], limits[2]["upper"]) == (0.0, 0.5)


@pytest.mark.parametrize("pitch", [0.3, np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-9, 2.5])
def test_roll_pitch_yaw_is_exact_where_pitch_is_a_right_angle(pitch):
    """The three angles give the same matrix back, to rounding."""
    R = pin.rpy.rpyToMatrix(0.4, pitch, -1.2)
    np.testing.assert_allclose(rotation_rpy(roll_pitch_yaw(R)), R, atol=1e-15)
