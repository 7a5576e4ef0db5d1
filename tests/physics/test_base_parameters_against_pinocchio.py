"""The base parameters of random arms against Pinocchio's regressor: same span, same rank, same classes."""

import math

import numpy as np
import pinocchio as pin
import pytest

from dynid.model import build_model
from dynid.model.reduce import random_states
from dynid.model.relations import base_parameters
from dynid.robot import Joint, Robot

TWISTS = (0, 30, 45, 60, 90, -90, 180)
GRAVITIES = ((0, 0, -9.81), (9.81, 0, 0), (0, 6.9, -6.9), (0, 0, 0), (1.2, -3.4, -9.0))


def random_arm(seed):
    """Return an arm of 3 to 6 joints, either convention, one joint in five sliding, special and arbitrary twists."""
    rng = np.random.default_rng(seed)
    joints = []
    for i in range(int(rng.integers(3, 7))):
        twist = rng.choice(TWISTS) if rng.random() < 0.7 else rng.uniform(-170, 170)
        a, d = (round(rng.uniform(0.1, 0.5), 3) * int(rng.integers(0, 2)) for _ in range(2))
        kind = "prismatic" if rng.random() < 0.2 else "revolute"
        offset = float(rng.choice([0, math.pi / 2, 0.3]))
        joints.append(
            Joint(
                f"j{i + 1}",
                kind,
                a,
                math.radians(twist),
                d,
                offset,
                motor_inertia=False,
                friction=(),
            )
        )
    gravity = GRAVITIES[int(rng.integers(len(GRAVITIES)))]
    return Robot("arm", ("standard", "modified")[seed % 2], tuple(joints), gravity=gravity)


def pose(axis, angle=0.0, shift=0.0):
    rotation = pin.utils.rotate(axis, angle)
    return pin.SE3(rotation, shift * np.eye(3)["xyz".index(axis)])


def pinocchio_arm(robot):
    """Return Pinocchio's model and, for each joint, the pose of the DH link frame in the joint's frame."""
    model, frame, frames = pin.Model(), pin.SE3.Identity(), []
    model.gravity.linear = np.array(robot.gravity, dtype=float)
    for i, j in enumerate(robot.joints):
        across = pose("x", 0, j.a) * pose("x", j.twist)
        before = frame * (
            pose("z", j.theta_offset)
            if robot.convention == "standard"
            else across * pose("z", j.theta_offset)
        )
        joint = pin.JointModelRZ() if j.revolute else pin.JointModelPZ()
        model.addJoint(i, joint, before, j.name)
        frame = pose("z", 0, j.d) * (
            across if robot.convention == "standard" else pin.SE3.Identity()
        )
        frames.append(frame)
    return model, frames


def pseudo(parameters):
    """Return the pseudo-inertia of m, mc, Ixx, Ixy, Ixz, Iyy, Iyz, Izz, (4, 4)."""
    m, *rest = parameters
    h, (xx, xy, xz, yy, yz, zz) = np.array(rest[:3]), rest[3:]
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    J = np.zeros((4, 4))
    J[:3, :3], J[:3, 3], J[3, :3], J[3, 3] = np.trace(tensor) / 2 * np.eye(3) - tensor, h, h, m
    return J


def pinocchio_parameters(J):
    """Return Pinocchio's ten parameters of a pseudo-inertia: m, mc, Ixx, Ixy, Iyy, Ixz, Iyz, Izz."""
    tensor = np.trace(J[:3, :3]) * np.eye(3) - J[:3, :3]
    return np.array(
        [
            J[3, 3],
            *J[:3, 3],
            *(tensor[i, k] for i, k in ((0, 0), (0, 1), (1, 1), (0, 2), (1, 2), (2, 2))),
        ]
    )


def pinocchio_regressor(robot, q, qd, qdd):
    """Return Pinocchio's regressor for the parameters in the DH link frames, (N, n, 10 n)."""
    model, frames = pinocchio_arm(robot)
    data = model.createData()
    change = np.zeros((10 * robot.n, 10 * robot.n))
    for k, frame in enumerate(frames):
        T = frame.homogeneous
        block = np.column_stack(
            [pinocchio_parameters(T @ pseudo(unit) @ T.T) for unit in np.eye(10)]
        )
        change[10 * k : 10 * k + 10, 10 * k : 10 * k + 10] = block
    rows = [
        pin.computeJointTorqueRegressor(model, data, *state).copy()
        for state in zip(q, qd, qdd, strict=True)
    ]
    return np.array(rows) @ change


def normalised_rank(W):
    size = np.linalg.norm(W, axis=0)
    W = W[:, size > 1e-9] / size[size > 1e-9]
    values = np.linalg.svd(W, compute_uv=False)
    return int(np.sum(values > 1e-9 * values[0]))


@pytest.mark.parametrize("seed", range(30))
def test_random_arm_has_the_span_rank_and_classes_of_pinocchio(seed):
    robot = random_arm(seed)
    model = build_model(robot)
    states = random_states(robot, 60, seed)
    ours = model.regressor(*states).reshape(-1, model.size)
    theirs = pinocchio_regressor(robot, *states).reshape(-1, model.size)
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
    # The relations themselves hold for Pinocchio's columns.
    np.testing.assert_allclose(
        theirs[:, found.base] @ found.K, theirs, atol=1e-8 * np.abs(theirs).max()
    )
