"""Random arms, and the same arms built by hand in Pinocchio: no code of dynid between the DH table and the engine."""

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from dynid import Robot
from dynid.robot import Body, Joint

#: How often an arm has 2, 3, ... 8 joints: deriving a long one takes half a second, so there are fewer of those.
SIZES = (0.28, 0.25, 0.2, 0.13, 0.07, 0.04, 0.03)
RIGHT_ANGLES = np.array([-np.pi / 2, 0.0, np.pi / 2, np.pi])


def random_robot(rng, n=None, convention=None):
    """A robot of 2 to 8 joints; half of its numbers are the special ones of real DH tables."""
    n = n or int(rng.choice(range(2, 9), p=SIZES))
    joints = tuple(
        Joint(
            name=f"joint {i + 1}",
            type="revolute" if rng.random() < 0.7 else "prismatic",
            a=_some_zero(rng),
            twist=_angle(rng),
            d=_some_zero(rng),
            theta_offset=_angle(rng) if rng.random() < 0.5 else 0.0,
        )
        for i in range(n)
    )
    gravity = rng.normal(size=3)
    return Robot(
        name="random",
        convention=convention or str(rng.choice(["standard", "modified"])),
        joints=joints,
        gravity=tuple((9.81 * gravity / np.linalg.norm(gravity)).tolist()),
        base_xyz=tuple(rng.normal(size=3).tolist()),
        base_rpy=tuple(rng.choice([0.0, np.pi / 2, np.pi, 0.3, -1.1], 3).tolist()),
    )


def lumped(masses, points, own=0.0):
    """A body of point masses, and about every axis what the points have of their own [kg m^2]."""
    mass = masses.sum()
    com = masses @ points / mass
    tensor = own * np.eye(3)
    for m, r in zip(masses, points - com, strict=True):
        tensor = tensor + m * (r @ r * np.eye(3) - np.outer(r, r))
    return Body(float(mass), tuple(com), tuple(tensor[np.triu_indices(3)]))


def random_bodies(rng, n):
    """Physically consistent bodies: each a cloud of six point masses."""
    return tuple(lumped(rng.uniform(0.1, 1.0, 6), rng.uniform(-0.2, 0.2, (6, 3))) for _ in range(n))


def cylinder(mass, length, radius=0.06):
    """Return the ten parameters of a cylinder that ends at its frame, along z."""
    across = mass * (3 * radius**2 + length**2) / 12
    tensor = (across, 0, 0, across, 0, mass * radius**2 / 2)
    return Body(mass, (0, 0, -length / 2), tensor).parameters()


def example_robots():
    """Return the folder of URDFs of example-robot-data, which lies beside pinocchio."""
    folder = Path(pin.__file__).parents[4] / "share" / "example-robot-data" / "robots"
    if not folder.is_dir():
        pytest.skip("the package example-robot-data is not installed")
    return folder


def random_states(rng, n, count):
    return tuple(rng.uniform(-size, size, (count, n)) for size in (3.0, 2.0, 5.0))


def tensor_of(body):
    xx, xy, xz, yy, yz, zz = body.inertia_com
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def dh_product(robot, q):
    """Return the poses of the link frames in the world from the textbook matrices."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = pin.rpy.rpyToMatrix(*robot.base_rpy), robot.base_xyz
    poses = []
    for j, v in zip(robot.joints, q, strict=True):
        theta, d = (j.theta_offset + v, j.d) if j.revolute else (j.theta_offset, j.d + v)
        c, s, ca, sa = math.cos(theta), math.sin(theta), math.cos(j.twist), math.sin(j.twist)
        if robot.convention == "standard":
            rows = [[c, -s * ca, s * sa, j.a * c], [s, c * ca, -c * sa, j.a * s], [0, sa, ca, d]]
        else:
            rows = [[c, -s, 0, j.a], [s * ca, c * ca, -sa, -d * sa], [s * sa, c * sa, ca, d * ca]]
        pose = pose @ np.array([*rows, [0, 0, 0, 1]])
        poses.append(pose)
    return poses


def placements(robot):
    """Return for each joint the pose of its axis in the previous moving frame, and of the DH frame in its own."""
    previous, found = pin.SE3.Identity(), []
    for j in robot.joints:
        turn, lift = (j.theta_offset, 0.0) if j.revolute else (j.theta_offset, j.d)
        entry = pin.SE3(pin.utils.rotate("z", turn), np.array([0.0, 0.0, lift]))
        bend = pin.SE3(pin.utils.rotate("x", j.twist), np.array([j.a, 0.0, 0.0]))
        rise = pin.SE3(np.eye(3), np.array([0.0, 0.0, j.d if j.revolute else 0.0]))
        if robot.convention == "standard":
            found.append((previous * entry, rise * bend))
        else:
            found.append((previous * bend * entry, rise))
        previous = found[-1][1]
    return found


def pinocchio_model(robot, bodies, rotor_inertia=None):
    """Return the arm with frame 0 at Pinocchio's origin."""
    model, parent = pin.Model(), 0
    model.gravity.linear = np.array(robot.gravity)
    for joint, body, (place, to_dh) in zip(robot.joints, bodies, placements(robot), strict=True):
        kind = pin.JointModelRZ() if joint.revolute else pin.JointModelPZ()
        parent = model.addJoint(parent, kind, place, joint.name)
        model.appendBodyToJoint(
            parent, pin.Inertia(body.mass, np.array(body.com), tensor_of(body)), to_dh
        )
    if rotor_inertia is not None:
        model.armature = np.array(rotor_inertia)
    return model


def configuration(model, q):
    """Return positions as Pinocchio wants them: cosine and sine where a joint turns without end."""
    pairs = zip(list(model.joints)[1:], q, strict=True)
    return np.concatenate([[x] if joint.nq == 1 else [np.cos(x), np.sin(x)] for joint, x in pairs])


def pinocchio_torques(model, q, qd, qdd):
    data = model.createData()
    states = zip(q, qd, qdd, strict=True)
    return np.array([pin.rnea(model, data, configuration(model, x), v, a) for x, v, a in states])


def simulated_torques(arm, q, qd, qdd):
    """The torques of an arm in a simulator, (N, n)."""
    return np.array([arm.inverse_dynamics(*state) for state in zip(q, qd, qdd, strict=True)])


def relative_error(found, expected):
    return float(np.abs(found - expected).max() / np.abs(expected).max())


def _some_zero(rng):
    return 0.0 if rng.random() < 0.4 else float(rng.uniform(-0.5, 0.5))


def _angle(rng):
    return (
        float(rng.choice(RIGHT_ANGLES)) if rng.random() < 0.5 else float(rng.uniform(-np.pi, np.pi))
    )
