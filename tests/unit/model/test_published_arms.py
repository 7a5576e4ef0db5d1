"""The DH tables in robots/ put the flange where public descriptions of the same arms put it."""

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from arms import example_robots
from dynid import load_robot
from dynid.files.urdffile import UrdfJoint, read_urdf
from dynid.model.kinematics import tool_pose
from dynid.robot import Limits, rotation_rpy

PI, HALF, Z = np.pi, np.pi / 2, (0, 0, 1)


def _bullet(*inside):
    return Path(pytest.importorskip("pybullet_data").getDataPath(), *inside)


def _public(*inside):
    return Path(example_robots(), *inside)


def _largest_wobble(robot, chain, base=np.eye(4)):  # noqa: B008
    """Return how much the pose of the last DH frame in the URDF's last link changes over random configurations.

    ``base`` is the pose of the URDF's first link in the world of the robot file.
    """
    q = np.random.default_rng(0).uniform(-PI, PI, (50, robot.n))
    dh = tool_pose(robot, q)
    fixed = []
    for k in range(len(q)):
        pose, moving = base, iter(q[k])
        for joint in chain:
            pose = pose @ joint.transform(next(moving) if joint.moves else 0.0)
        fixed.append(np.linalg.inv(pose) @ dh[k])
    return np.abs(np.array(fixed) - fixed[0]).max(), fixed[0]


def _chain(*rows):
    """Return joints about z from their origins (x, y, z, roll, pitch, yaw) [m, rad]."""
    joints = []
    for k, (x, y, z, *rpy) in enumerate(rows):
        origin = np.eye(4)
        origin[:3, :3], origin[:3, 3] = rotation_rpy(tuple(rpy)), (x, y, z)
        joints.append(
            UrdfJoint(
                f"j{k}", "revolute", str(k), str(k + 1), origin, np.array([0.0, 0.0, 1.0]), Limits()
            )
        )
    return joints


def _turned(shifts, axes):
    """Return joints that are shifted against each other, each about an axis of the first frame."""
    rows = ((*shift, 0, 0, 0) for shift in shifts)
    joints = zip(_chain(*rows), axes, strict=True)
    return [replace(joint, axis=np.array(axis, dtype=float)) for joint, axis in joints]


def _ur(d1, a2, a3, d4, d5, d6):
    """Return the chain of Universal Robots' ur_description, the numbers those of its default_kinematics.yaml."""
    return _chain(
        (0, 0, d1, 0, 0, 0),
        (0, 0, 0, HALF, 0, 0),
        (a2, 0, 0, 0, 0, 0),
        (a3, 0, d4, 0, 0, 0),
        (0, -d5, 0, HALF, 0, 0),
        (0, d6, 0, HALF, PI, PI),
    )


#: Chains of makers' descriptions, and where the last link lies in their last frame.
CHAINS = {
    "ur3e": (_ur(0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921), (0, 0, 0)),
    "ur5e": (_ur(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996), (0, 0, 0)),
    "ur10e": (_ur(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655), (0, 0, 0)),
    "kuka_iiwa7": (
        _chain(
            (0, 0, 0.15, 0, 0, 0),
            (0, 0, 0.19, HALF, 0, PI),
            (0, 0.21, 0, HALF, 0, PI),
            (0, 0, 0.19, HALF, 0, 0),
            (0, 0.21, 0, -HALF, PI, 0),
            (0, 0.06070, 0.19, HALF, 0, 0),
            (0, 0.081, 0.06070, -HALF, PI, 0),
        ),
        (0, 0, 0.045),
    ),
    "kuka_lwr4plus": (
        _turned(
            [(0, 0, z) for z in (0.11, 0.2005, 0.2, 0.2, 0.2, 0.19, 0.078)],
            (Z, (0, -1, 0), Z, (0, 1, 0), Z, (0, -1, 0), Z),
        ),
        (0, 0, 0),
    ),
    # Axes of the maker's URDF at zero, and points on them.
    "kinova_gen3": (
        _turned(
            np.diff(
                [
                    (0, 0, 0),
                    (0, 0, 0.1564),
                    (0, -0.0054, 0.2848),
                    (0, -0.0118, 0.4952),
                    (0, -0.0182, 0.7056),
                    (0, -0.0246, 0.9140),
                    (0, -0.0246, 1.0199),
                    (0, -0.0246, 1.1258),
                ],
                axis=0,
            ),
            ((0, 0, -1), (0, 1, 0)) * 3 + ((0, 0, -1),),
        ),
        (0, 0, 0.0615),
    ),
}


@pytest.mark.parametrize("name", CHAINS)
def test_table_follows_the_chain_of_the_makers_description(name):
    chain, last = CHAINS[name]
    wobble, fixed = _largest_wobble(load_robot(name), chain)
    assert wobble < 1e-12
    assert_allclose(fixed[:3, 3], last, atol=1e-12)


#: Public URDFs: where the file is, the arm, its last link, and where that lies in the last frame of the table.
URDFS = [
    (partial(_bullet, "kuka_iiwa/model.urdf"), "kuka_iiwa14", "lbr_iiwa_link_7", (0, 0, 0.045)),
    (partial(_public, "xarm_description/urdf/xarm7.urdf"), "xarm7", "link7", (0, 0, 0)),
    (
        partial(_public, "panda_description/urdf/panda.urdf"),
        "franka_panda",
        "panda_link7",
        (0, 0, 0),
    ),
    (partial(_public, "ur_description/urdf/ur10_robot.urdf"), "ur10", "tool0", (0, 0, 0)),
]


@pytest.mark.parametrize(("file", "name", "link", "last"), URDFS)
def test_table_follows_the_public_urdf(file, name, link, last):
    urdf = read_urdf(file())
    # Why turned: the base link of ur_description looks backwards.
    base = np.diag([-1.0, -1.0, 1.0, 1.0]) if name == "ur10" else np.eye(4)
    wobble, fixed = _largest_wobble(load_robot(name), urdf.chain(urdf.root, link), base)
    assert wobble < 1e-9
    assert_allclose(fixed[:3, 3], last, atol=1e-9)
    if name in ("xarm7", "franka_panda"):
        assert_allclose(fixed, np.eye(4), atol=1e-9)


def test_gen2_has_the_axes_of_kinova_description_and_its_tool_within_the_urdfs_own_offsets():
    chain = _chain(
        (0, 0, 0.15675, 0, PI, 0),
        (0, 0.0016, -0.11875, -HALF, 0, PI),
        (0, -0.205, 0, -HALF, 0, 0),
        (0, 0, -0.205, HALF, 0, PI),
        (0, 0.2073, -0.0114, -HALF, 0, PI),
        (0, 0, -0.10375, HALF, 0, PI),
        (0, 0.10375, 0, -HALF, 0, PI),
    )
    wobble, fixed = _largest_wobble(load_robot("kinova_gen2"), chain)
    assert_allclose(np.abs(fixed[:3, :3]), np.eye(3), atol=1e-9)
    assert wobble < 0.006


@pytest.mark.parametrize("name", [*CHAINS, *(name for _, name, *_ in URDFS), "kinova_gen2"])
def test_every_published_arm_says_its_source_and_has_limits_of_speed_and_torque(name):
    robot = load_robot(name)
    assert "Source" in robot.path.read_text(encoding="utf-8")
    assert all(joint.limits.velocity and joint.limits.torque for joint in robot.joints)
    assert not robot.findings
