"""A user's URDF keeps every byte except its inertial blocks."""

import re
from dataclasses import replace

import numpy as np
import pytest
from export_cases import made, off_in_pinocchio, off_in_pybullet, written

from arms import random_bodies
from dynid.errors import NotPhysical, WrongUrdf
from dynid.exporters import FORMATS
from dynid.files.urdffile import read_urdf
from dynid.model.from_urdf import import_arm
from dynid.model.parameters import prior_bodies
from dynid.robot import JointMap

#: An arm as people have them: comments, meshes, a world link, a sensor by a fixed joint, a finger, uneven white space.
OWN = """<?xml version="1.0" ?>
<!-- made by hand, 2019 -->
<robot name="own" xmlns:xacro="http://nothing">
  <material name="grey"><color rgba="0.5 0.5 0.5 1"/></material>
  <link name="world"/>
  <link name="base"><inertial>
    <mass value="9"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <joint name="stand" type="fixed"><parent link="world"/><child link="base"/>
    <origin xyz="0.1 0 0.4" rpy="0 0 0.3"/></joint>
  <joint name="a" type="continuous">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 0.2" rpy="0 0 0"/><axis xyz="0 0 1"/>
    <dynamics damping="0.7"/>
  </joint>
  <link name="upper">
    <visual><geometry><mesh filename="package://own/upper.dae"/></geometry></visual>
    <inertial>
      <origin xyz="0 0.1 0" rpy="0.1 0 0"/>   <!-- from CAD -->
      <mass value="4.0"/>
      <inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.05"/>
    </inertial>
  </link>
  <joint name="b" type="revolute">
    <parent link="upper"/><child link="fore"/><origin xyz="0 0.3 0.05" rpy="1.5707963267949 0 0"/><axis xyz="0 0 -1"/>
    <limit lower="-2" upper="2" effort="50" velocity="2"/>
  </joint>
  <link name="fore">   <collision><geometry><box size="1 1 1"/></geometry></collision>
  </link>
  <joint name="c" type="prismatic">
    <parent link="fore"/><child link="hand"/><origin xyz="0.2 0 0" rpy="0 1.5707963267949 0"/><axis xyz="0 0 1"/>
    <limit lower="0" upper="0.3" effort="50" velocity="2"/>
  </joint>
  <link name="hand"/>
  <joint name="camera_mount" type="fixed"><parent link="fore"/><child link="camera"/><origin xyz="0 0 0.1"/></joint>
  <link name="camera"><inertial><mass value="0.2"/>
    <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial></link>
  <joint name="finger" type="revolute"><parent link="hand"/><child link="jaw"/><axis xyz="1 0 0"/>
    <limit lower="0" upper="1" effort="5" velocity="2"/></joint>
  <link name="jaw"><inertial><mass value="0.05"/>
    <inertia ixx="1e-5" ixy="0" ixz="0" iyy="1e-5" iyz="0" izz="1e-5"/></inertial></link>
</robot>
"""


def own(folder, text=OWN, **changes):
    """Return the URDF's path and a source of the same arm with other bodies."""
    path = folder / "own.urdf"
    path.write_text(text, encoding="utf-8")
    robot = import_arm(read_urdf(path), read_urdf(path), tip="hand").robot
    robot = replace(robot, **changes)
    bodies = random_bodies(np.random.default_rng(4), robot.n)
    return path, made(robot, bodies=bodies, urdf=path)


def assert_moves_as_identified(source, folder):
    """In MuJoCo, Pinocchio and PyBullet, 1000 states: 1e-8 N m."""
    path = written(source, "urdf", folder)
    (found,) = FORMATS["urdf"].check(path.read_text(), source)
    assert found.engine.startswith("MuJoCo")
    assert found.largest < 1e-8
    assert off_in_pinocchio(source, path) < 1e-8
    assert off_in_pybullet(source, path) < 1e-8


def without_inertials(text):
    text = re.sub(r"<!-- inertial blocks of .*? -->\n", "", text)
    text = re.sub(r"\s*<inertial>.*?</inertial>", "", text, flags=re.S)
    return re.sub(r'<link name="hand">\s*</link>|<link name="hand"/>', "", text)


def test_only_inertial_blocks_change(tmp_path):
    """Comments, meshes, namespaces, white space and dynamics are the user's; base and camera keep their blocks."""
    _, source = own(tmp_path)
    text = FORMATS["urdf"].text(source)
    assert without_inertials(text) == without_inertials(OWN)
    assert 'filename="package://own/upper.dae"' in text
    assert text.count("<inertial>") == 6
    assert '<mass value="9"/>' in text
    assert '<mass value="0.2"/>' in text


def test_the_changed_file_has_the_identified_torques(tmp_path):
    """Three engines load it; what hangs on a link counts with it, the finger at zero."""
    _path, source = own(tmp_path)
    assert_moves_as_identified(source, tmp_path)


def test_an_empty_frame_weighs_nothing_in_pybullet(tmp_path):
    """Tool frames and flanges have no inertial block; PyBullet's own answer is 1 kg."""
    frames = """  <joint name="flange" type="fixed"><parent link="hand"/><child link="tool0"/></joint>
  <link name="tool0"/>
  <joint name="tip" type="fixed"><parent link="tool0"/><child link="tcp"/><origin xyz="0 0 0.4"/></joint>
  <link name="tcp"></link>
</robot>"""
    _path, source = own(tmp_path, OWN.replace("</robot>", frames))
    assert_moves_as_identified(source, tmp_path)


@pytest.mark.parametrize(
    ("old", "new", "error", "said"),
    [
        ('<mass value="0.05"/>', '<mass value="50"/>', NotPhysical, "jaw"),
        ('<mass value="0.2"/>', '<mass value="50"/>', NotPhysical, "camera"),
        ('xyz="0 0.3 0.05"', 'xyz="0.05 0.3 0.05"', WrongUrdf, "joint 'b' is not where"),
        ('name="b"', 'name="elbow"', WrongUrdf, "no joint b; it has a, c, elbow, finger"),
    ],
)
def test_parts_that_are_too_heavy_and_the_urdf_of_another_arm_are_refused(
    tmp_path, old, new, error, said
):
    """A negative mass of the link that carries them, and bodies in wrong frames."""
    path, source = own(tmp_path)
    path.write_text(OWN.replace(old, new), encoding="utf-8")
    with pytest.raises(error, match=said):
        FORMATS["urdf"].text(source)


def test_signs_and_offsets_of_the_simulator_map_are_used(tmp_path):
    """A DH table that counts joint b the other way from another zero fits with sign -1 and its offset."""
    path, source = own(tmp_path)
    robot = source.full.robot
    turned = replace(robot.joints[1], theta_offset=robot.joints[1].theta_offset + 0.25)
    mapping = JointMap((1.0, 1.0, 1.0), (0.0, -0.25, 0.0))
    other = replace(robot, joints=(robot.joints[0], turned, robot.joints[2]), simulator=mapping)
    changed = made(other, bodies=source.full.bodies, urdf=path)
    assert FORMATS["urdf"].check(FORMATS["urdf"].text(changed), changed)[0].largest < 1e-6


def test_exporting_the_imported_prior_gives_the_same_arm_back(tmp_path):
    """Import, export, import: the bodies are those of the file."""
    path, source = own(tmp_path)
    robot = source.full.robot
    same = made(robot, bodies=prior_bodies(robot), urdf=path)
    path2 = tmp_path / "again.urdf"
    path2.write_text(FORMATS["urdf"].text(same), encoding="utf-8")
    again = import_arm(read_urdf(path2), read_urdf(path2), tip="hand").robot
    for one, other in zip(prior_bodies(robot), prior_bodies(again), strict=True):
        np.testing.assert_allclose(one.parameters(), other.parameters(), atol=1e-12)
