"""An arm is found by every word that a person would type for it."""

import shutil

import pytest

from dynid import Robot, load_robot
from dynid.errors import WrongUrdf, WrongUsage
from dynid.files.robotfile import load_robot as read_robot
from dynid.robot import Joint
from dynid.sim.urdf import urdf_text

FORKED = """<robot name="two_arms"><link name="world"/><link name="torso"/>
<joint name="lift" type="prismatic"><parent link="world"/><child link="torso"/><axis xyz="0 0 1"/></joint>
{links}</robot>"""


def _branch(side):
    rows, parent = [], "torso"
    for k in range(2):
        link = f"{side}_{k}"
        rows.append(
            f'<link name="{link}"/><joint name="j_{link}" type="revolute"><parent link="{parent}"/>'
            f'<child link="{link}"/><origin xyz="{k} 0 1"/><axis xyz="0 {k} {1 - k}"/></joint>'
        )
        parent = link
    return "".join(rows)


def test_a_urdf_whose_arms_fork_names_its_tips_and_takes_one(tmp_path):
    path = tmp_path / "two.urdf"
    path.write_text(FORKED.format(links=_branch("left") + _branch("right")))
    with pytest.raises(WrongUrdf, match="may end at left_1, right_1") as caught:
        load_robot(path)
    assert "--tip" in caught.value.fix
    robot = load_robot(f"{path}#right_1")
    assert robot.joint_names == ("lift", "j_right_0", "j_right_1")
    assert robot.word == f"'{path}#right_1'"
    assert load_robot(path, tip="left_1").joint_names[-1] == "j_left_1"


def test_a_urdf_without_a_fork_needs_no_tip(tmp_path):
    arm = read_robot("ur5e")
    (tmp_path / "mine.urdf").write_text(urdf_text(arm))
    robot = load_robot(tmp_path / "mine.urdf")
    assert (robot.n, robot.slug) == (6, "mine")


def test_a_tip_belongs_to_a_urdf_only():
    with pytest.raises(WrongUsage, match="is not a URDF"):
        load_robot("ur5e", tip="link_6")


def test_the_word_of_an_arm_is_what_was_typed(tmp_path):
    own = tmp_path / "my arm.yaml"
    shutil.copy(read_robot("ur5e").path, own)
    assert load_robot("ur5e").word == "ur5e"
    assert load_robot(own).word == f"'{own}'"
    assert Robot("Toy", "standard", (Joint("a"),)).word == "toy"
