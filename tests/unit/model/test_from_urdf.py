"""DH tables found in URDFs give the URDF's poses and torques, both of Pinocchio."""

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose

from arms import configuration, example_robots, pinocchio_torques, relative_error
from dynid import Log, load_robot
from dynid.diagnose.diagnosis import find_mistake
from dynid.errors import WrongUrdf
from dynid.files.robotfile import parse_robot, robot_text
from dynid.files.urdffile import read_urdf
from dynid.model.from_urdf import import_arm, possible_body
from dynid.model.kinematics import tool_pose
from dynid.model.reduce import random_states
from dynid.model.regressor import build_model, prior_vector
from dynid.robot import Body
from dynid.sim.urdf import urdf_text
from motions import tones

#: Arms of the package example-robot-data: file, first and last link (None: found by itself).
ARMS = {
    "ur5": ("ur_description/urdf/ur5_robot.urdf", None, None),
    "panda": ("panda_description/urdf/panda.urdf", None, None),
    "kinova": ("kinova_description/robots/kinova.urdf", None, None),
    "tiago": ("tiago_description/robots/tiago_no_hand.urdf", "torso_lift_link", "arm_7_link"),
    "talos": ("talos_data/robots/talos_left_arm.urdf", None, None),
    "z1": ("z1_description/urdf/z1.urdf", None, None),
}
#: Two links that carry each other, beside the arm.
RING = "<link name='ring_a'/><link name='ring_b'/>" + "".join(
    f"<joint name='to_{b}' type='revolute'><parent link='ring_{a}'/><child link='ring_{b}'/></joint>"
    for a, b in ("ab", "ba")
)


@pytest.fixture(scope="module")
def iiwa():
    """A URDF of dynid's own, in which nothing is wrong."""
    return urdf_text(load_robot("kuka_iiwa14"))


def random_urdf(rng, n):
    """Return a chain with axes of all kinds: parallel, meeting, the same, skew; fixed links between; any root."""

    def origin():
        turn = (
            rng.choice([-np.pi / 2, 0.0, np.pi / 2, np.pi], 3)
            if rng.random() < 0.6
            else rng.uniform(-3, 3, 3).round(2)
        )
        shift = np.where(rng.random(3) < 0.5, 0.0, rng.uniform(-0.5, 0.5, 3))
        return '<origin xyz="{} {} {}" rpy="{} {} {}"/>'.format(
            *map(float, shift), *map(float, turn)
        )

    def inertial():
        return (
            f'<inertial>{origin()}<mass value="{float(rng.uniform(1, 5))!r}"/>'
            '<inertia ixx="0.2" ixy="0.01" ixz="0" iyy="0.3" iyz="-0.02" izz="0.25"/></inertial>'
        )

    text = '<robot name="random"><link name="root"/>'
    previous = "root"
    for i in range(n):
        kind = rng.choice(["revolute", "continuous", "prismatic"], p=[0.4, 0.3, 0.3])
        axis = (
            np.eye(3)[rng.integers(3)] * rng.choice([-1, 1])
            if rng.random() < 0.7
            else rng.normal(size=3).round(2)
        )
        if rng.random() < 0.4:
            text += f'<joint name="f{i}" type="fixed"><parent link="{previous}"/><child link="g{i}"/>{origin()}</joint>'
            text += f'<link name="g{i}">{inertial() if i else ""}</link>'
            previous = f"g{i}"
        text += f'<joint name="j{i}" type="{kind}"><parent link="{previous}"/><child link="l{i}"/>{origin()}'
        text += '<axis xyz="{} {} {}"/>'.format(*map(float, axis))
        text += '<limit lower="-1" upper="2" effort="10" velocity="3"/></joint>'
        text += f'<link name="l{i}">{inertial()}</link>'
        previous = f"l{i}"
    text += f'<joint name="end" type="fixed"><parent link="{previous}"/><child link="tip"/>{origin()}</joint>'
    return text + f'<link name="tip">{inertial()}</link></robot>'


def imported(path, convention="standard", base=None, tip=None):
    """Return what import finds, its robot read back from the text of its own robot file."""
    found = import_arm(
        read_urdf(path), read_urdf(path, exact=True), convention=convention, base=base, tip=tip
    )
    return found, parse_robot(robot_text(found.robot), Path("again.yaml"))


def in_pinocchio(path, names):
    """Return the arm in Pinocchio with all other joints locked at zero."""
    model = pin.buildModelFromUrdf(str(path))
    others = [i for i, name in enumerate(model.names) if i and name not in names]
    zero = pin.neutral(model)
    return pin.buildReducedModel(model, others, zero) if others else model


def urdf_torques(path, robot, *states):
    return pinocchio_torques(in_pinocchio(path, robot.joint_names), *states)


def pose_difference(path, found, robot, count=100):
    model = in_pinocchio(path, robot.joint_names)
    data, rng, largest = model.createData(), np.random.default_rng(1), 0.0
    for _ in range(count):
        q = rng.uniform(-3, 3, robot.n)
        pin.framesForwardKinematics(model, data, configuration(model, q))
        expected = data.oMf[model.getFrameId(found.tip)].homogeneous
        largest = max(largest, np.abs(tool_pose(robot, q) @ found.tip_pose - expected).max())
    return largest


def torque_difference(path, robot, count=50):
    """Return how far the regressor times the prior is from Pinocchio's torques, over their size."""
    states, model = random_states(robot, count, 2), build_model(robot)
    found = model.observer().torque(prior_vector(model), *states)
    return relative_error(found, urdf_torques(path, robot, *states))


@pytest.fixture(scope="session")
def robots():
    return example_robots()


@pytest.mark.slow
@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("name", ARMS)
def test_arms_that_people_have_get_a_table_with_the_urdfs_kinematics_and_torques(
    name, convention, robots
):
    """UR5, Panda, Kinova, TIAGo, Talos, Z1: poses of the tip to 1e-9, torques of the prior to 1e-9 of their size."""
    file, base, tip = ARMS[name]
    found, robot = imported(robots / file, convention, base, tip)
    assert pose_difference(robots / file, found, robot) < 1e-9
    assert torque_difference(robots / file, robot) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("name", ["ur5", "panda", "z1"])
def test_logs_of_the_urdfs_own_bodies_do_not_accuse_its_table(name, robots):
    """Public URDFs have inertias of bodies as large as the arm: the wrist of the UR5 has 1.2 kg, 0.42 m out."""
    file, base, tip = ARMS[name]
    _, robot = imported(robots / file, base=base, tip=tip)
    rng = np.random.default_rng(3)
    t = np.arange(0, 12.0, 0.005)
    rate, phase = rng.uniform(0.05, 0.4, (2, robot.n)), rng.uniform(0, 2 * np.pi, (2, robot.n))
    q, qd, qdd = tones(t, 1.0, 2 * np.pi * rate, phase)
    tau = urdf_torques(robots / file, robot, q, qd, qdd)
    tau += 0.1 * np.tanh(qd / 0.01) + 0.02 * rng.standard_normal(tau.shape)
    found = find_mistake(Log(t, q, tau), robot)
    assert found is not None
    assert not found.wrong


@pytest.mark.parametrize("convention", ["standard", "modified"])
@pytest.mark.parametrize("seed", range(12))
def test_any_chain_gets_a_table_with_the_urdfs_kinematics_and_torques(seed, convention, tmp_path):
    """Random chains of 2 to 7 joints of all kinds, with fixed links between them that are merged."""
    rng = np.random.default_rng(seed)
    path = tmp_path / "arm.urdf"
    path.write_text(random_urdf(rng, int(rng.integers(2, 8))))
    found, robot = imported(path, convention)
    assert found.tip == "tip"
    assert pose_difference(path, found, robot, 20) < 1e-9
    assert torque_difference(path, robot, 10) < 1e-9


def test_the_iiwas_table_has_the_makers_lengths():
    """0.36, 0.42, 0.4 m between shoulder, elbow and wrist, no offsets: d of joints 1, 3, 5."""
    bullet = Path(pytest.importorskip("pybullet_data").getDataPath())
    _, robot = imported(bullet / "kuka_iiwa" / "model.urdf")
    assert_allclose([abs(j.d) for j in robot.joints[:6]], [0.36, 0, 0.42, 0, 0.4, 0], atol=1e-12)
    assert_allclose([j.a for j in robot.joints], 0.0, atol=1e-12)
    assert {abs(round(np.degrees(j.twist))) for j in robot.joints[:6]} == {90}


def test_limits_and_names_come_along(tmp_path):
    """A continuous joint has no position limits, the others the URDF's."""
    path = tmp_path / "arm.urdf"
    path.write_text(random_urdf(np.random.default_rng(0), 5))
    urdf = read_urdf(path)
    _, robot = imported(path)
    for joint in robot.joints:
        own = next(each for each in urdf.joints if each.name == joint.name)
        assert joint.limits.position == (None if own.type == "continuous" else (-1.0, 2.0))
        assert (joint.limits.torque, joint.limits.velocity) == (10.0, 3.0)


def test_angles_with_few_digits_become_right_angles_and_the_difference_is_said(iiwa, tmp_path):
    """rpy 1.5708 means 90 degrees; the table has it exactly, and it is said by how much the tip moves."""
    path = tmp_path / "arm.urdf"
    path.write_text(iiwa.replace(repr(float(np.pi / 2)), "1.5708"))
    found, robot = imported(path)
    assert 1e-7 < found.largest < 1e-4
    assert {round(np.degrees(j.twist), 12) % 90 for j in robot.joints} == {0.0}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace('type="revolute"', 'type="floating"', 1), "fork|floating|no joint"),
        (lambda t: t.replace("<robot", "<sdf").replace("</robot>", "</sdf>"), "not <robot>"),
        (lambda t: t[:200], "not XML"),
        (
            lambda t: t.replace('<parent link="link_2"', '<parent link="nowhere"'),
            "names link 'nowhere'",
        ),
        (
            lambda t: t.replace('xyz="0 0 1"', 'xyz="0 0 0"', 1),
            "axis of joint iiwa_joint_1 is zero",
        ),
        (lambda t: t.replace('mass value="4', 'mass value="heavy'), "not a number"),
        (lambda t: t.replace("</robot>", RING + "</robot>"), "not one tree"),
        (lambda t: t.replace('"link_7"', '"link_77"'), "no link 'link_7'; did you mean 'link_77'"),
    ],
)
def test_a_urdf_that_is_no_arm_is_refused_with_the_reason(change, message, iiwa, tmp_path):
    """Each fault has its own sentence."""
    path = tmp_path / "arm.urdf"
    path.write_text(change(iiwa))
    with pytest.raises(WrongUrdf, match=message):
        imported(path, tip="link_7" if "link_7" in message or "floating" in message else None)


def test_a_chain_of_hundreds_of_links_is_no_matter_of_recursion(tmp_path):
    """It is refused for its length before a robot file is made of it, which dynid itself would refuse."""
    links = "".join(f'<link name="c{k}"/>' for k in range(900))
    joints = "".join(
        f'<joint name="j{k}" type="{kind}"><parent link="c{k - 1}"/><child link="c{k}"/></joint>'
        for k in range(1, 900)
        for kind in ["fixed" if k % 2 else "revolute"]
    )
    path = tmp_path / "arm.urdf"
    path.write_text(f"<robot name='long'>{links}{joints}</robot>")
    with pytest.raises(WrongUrdf, match="449 joints"):
        import_arm(read_urdf(path), read_urdf(path, exact=True))


def test_an_inertia_of_no_body_becomes_the_nearest_that_one_has():
    """5 exceeds 1 + 2: second moments (-1, 3, 2) become (0.003, 3, 2), whose moments of inertia are 5, 2.003, 3.003."""
    wrong = Body(2.0, (0.1, 0.0, 0.0), (5.0, 0.0, 0.0, 1.0, 0.0, 2.0))
    near = possible_body(wrong)
    assert (near.mass, near.com) == (wrong.mass, wrong.com)
    assert_allclose(near.inertia_com, (5.0, 0.0, 0.0, 2.003, 0.0, 3.003), atol=1e-12)
    assert possible_body(near) == near
