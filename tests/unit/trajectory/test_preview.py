"""PyBullet, in a process of its own, measures, draws, and refuses what touches."""

import os
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid import load_robot
from dynid.errors import Collision, NoDisplay, WrongUrdf
from dynid.reports.motion_drawing import draw_motion
from dynid.robot import JointMap
from dynid.sim.urdf import urdf_text
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.feasible import bounds, position_range
from dynid.trajectory.plan import through_waypoints
from dynid.trajectory.preview import (
    FRAMES,
    Drawing,
    measure_poses,
    photographs,
    poses_of,
    require_clear,
    window,
)
from dynid.trajectory.scene import Scene

pytest.importorskip("pybullet")


def towards(robot, *degrees):
    upright = np.radians([0, 180, 0, 180, 0, 180, 0])
    start = 0 * upright if robot.gravity[2] < 0 else upright
    limits = bounds(robot)
    free = replace(limits, lower=limits.lower - 10, upper=limits.upper + 10)
    return through_waypoints(np.array([start, np.radians(degrees)]), free)


@pytest.fixture
def urdf(tmp_path):
    def make(robot):
        (tmp_path / "arm.urdf").write_text(urdf_text(robot))
        return tmp_path / "arm.urdf"

    return make


@pytest.fixture
def measured(urdf):
    """Measures the way to a pose, on the URDF of the arm itself."""

    def measure(robot, *degrees, **scene):
        capsules = Capsules(robot, Scene(**scene))
        return measure_poses(*poses_of(towards(robot, *degrees)), capsules, urdf(robot))

    return measure


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arm", "pose"),
    [
        ("lwr", (0, 119, 0, 0, 0, 0, 0)),
        ("lwr", (0, 120, -20, -120, 100, 0, -130)),
        ("lwr", (0, 0, 0, 165, 0, 0, 0)),
        ("gen2", (0, 300, 0, 180, 0, 180, 0)),
        ("gen2", (60, 170, -130, 310, -180, 290, 170)),
        ("gen2", (0, 270, 0, 100, 0, 180, 0)),
    ],
)
def test_colliding_and_floor_touching_plans_are_refused_with_pair_time_and_depth(
    arm, pose, measured, request
):
    found = measured(request.getfixturevalue(arm).robot, *pose)
    with pytest.raises(Collision, match=r"link_\d and .* at t = \d+\.\d s"):
        require_clear(found)


def test_a_plan_in_free_air_passes_and_its_distance_to_the_floor_is_that_of_geometry(lwr, measured):
    found = measured(lwr.robot, 0, 60, 0, 0, 0, 0, 0, floor=0.1)
    require_clear(found)
    lowest = next(d for d in found if d.pair == "link_7 - floor")
    height = 0.3105 + (0.4 + 0.39 + 0.078) * 0.5 - 0.06 * np.sin(np.radians(60)) - 0.1
    assert lowest.distance == pytest.approx(min(height, 0.3), abs=0.005)


@pytest.mark.slow
def test_picture_and_animation_show_the_arm_and_move(lwr, urdf, tmp_path):
    from PIL import Image

    look = Drawing(tmp_path / "a.png", tmp_path / "a.gif")
    plan = towards(lwr.robot, 40, 60, 0, 60, 0, 0, 0)
    pictures = photographs(plan, Capsules(lwr.robot), urdf(lwr.robot), FRAMES)
    draw_motion(look, plan, Capsules(lwr.robot), pictures)
    still = np.asarray(Image.open(look.picture).convert("RGB")).astype(int)
    assert still.shape[0] > 600
    assert still.shape[1] > 1000
    orange = (still[..., 0] > 150) & (still[..., 2] < 90)
    assert orange.mean() > 0.002
    with Image.open(look.animation) as moving:
        assert moving.n_frames == 60
        first = np.asarray(moving.convert("RGB")).astype(int)
        moving.seek(59)
        last = np.asarray(moving.convert("RGB")).astype(int)
    assert np.abs(first - last).max(axis=2).astype(bool).mean() > 0.01


@pytest.mark.parametrize(
    ("k", "change", "said"),
    [
        (3, {"twist": 1.4}, r"joint 'lwr_4_joint' is not where .* \(off by 0\.\d+ m\)"),
        (0, {"name": "shoulder"}, "has no joint shoulder; it has lwr_0_joint"),
    ],
)
def test_own_urdf_with_other_axes_or_without_a_joint_is_refused(lwr, urdf, k, change, said):
    joints = list(lwr.robot.joints)
    joints[k] = replace(joints[k], **change)
    other = replace(lwr.robot, joints=tuple(joints), driver=None)
    plan = towards(lwr.robot, 0, 10, 0, 0, 0, 0, 0)
    with pytest.raises(WrongUrdf, match=said):
        measure_poses(*poses_of(plan), Capsules(other), urdf(lwr.robot))


def test_urdf_in_the_angles_of_a_simulator_is_seen_through_its_map(lwr, urdf):
    sign, offset = (-1.0, 1.0, 1.0, -1.0, 1.0, 1.0, 1.0), (0.0, 0.5, 0.0, 0.0, 0.0, -0.3, 0.0)
    path = urdf(lwr.robot)
    parts = path.read_text().split("lwr_3_joint", 1)
    axis = 'axis xyz="0 0 %d"'
    path.write_text("lwr_3_joint".join(x.replace(axis % 1, axis % -1, 1) for x in parts))
    joints = list(lwr.robot.joints)
    for k in (1, 5):
        joints[k] = replace(joints[k], theta_offset=-offset[k])
    mapped = replace(lwr.robot, joints=tuple(joints), simulator=JointMap(sign, offset))
    plan = towards(lwr.robot, 0, 10, 0, 0, 0, 0, 0)
    assert measure_poses(*poses_of(plan), Capsules(mapped), path)
    with pytest.raises(WrongUrdf, match="joint 'lwr_0_joint' is not where"):
        measure_poses(*poses_of(plan), Capsules(lwr.robot), path)


def test_window_without_a_display_is_a_named_mistake_and_not_the_end_of_the_process(
    lwr, urdf, monkeypatch
):
    plan = towards(lwr.robot, *[0] * 6, 9)
    for display in ("", ":987"):
        monkeypatch.setenv("DISPLAY", display)
        with pytest.raises(NoDisplay), window(plan, Capsules(lwr.robot), urdf(lwr.robot)):
            pass


@pytest.mark.slow
@pytest.mark.gui
@pytest.mark.skipif(not shutil.which("xvfb-run"), reason="xvfb-run is not installed")
def test_window_opens_on_a_virtual_display_and_closes_after_the_question(tmp_path):
    script = """
from dynid.files.robotfile import load_robot
from dynid.sim.urdf import urdf_text
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.feasible import bounds
from dynid.trajectory.plan import through_waypoints
from dynid.trajectory.preview import window
from pathlib import Path
import numpy as np
robot = load_robot("kuka_lwr4plus")
Path("arm.urdf").write_text(urdf_text(robot))
plan = through_waypoints(np.array([np.zeros(7), np.full(7, 0.3)]), bounds(robot))
with window(plan, Capsules(robot), Path("arm.urdf")):
    print("open")
"""
    words = ["xvfb-run", "-a", "-s", "-screen 0 640x480x24", sys.executable, "-c", script]
    env = {**os.environ, "PYTHONPATH": str(Path(dynid.__file__).parents[1])}
    done = subprocess.run(words, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (0, "open\n"), done.stderr


@pytest.mark.parametrize("name", ["ur5e", "franka_panda"])
def test_capsules_are_no_farther_than_the_cylinders_that_pybullet_measures(name):
    """A capsule holds its cylinder, so a motion that keeps clear in the search does so for PyBullet."""
    robot = load_robot(name)
    lower, upper = position_range(robot)
    q = np.random.default_rng(4).uniform(lower, upper, (40, robot.n))
    t = np.arange(40.0)
    capsules = Capsules(robot)
    near, there = capsules.distances(q, t), measure_poses(t, q, capsules, None)
    for kind in (True, False):
        capsules, cylinders = (
            min(d.distance for d in found if d.pair.endswith("floor") is kind and not d.usual)
            for found in (near, there)
        )
        assert capsules < cylinders + 5e-3
    usual = {d.pair.replace("_", " ") for d in there if d.usual}
    assert usual <= {d.pair for d in near if d.usual}
