"""Plans and waypoints are read by name and in their units; every mistake is named with its place."""

from pathlib import Path

import numpy as np
import pytest

from dynid import load_robot
from dynid.errors import DynidError
from dynid.files.planfile import read_plan, read_waypoints
from dynid.trajectory.options import IN_PLAN_FILE

ROBOT = load_robot(Path(__file__).parents[3] / "robots" / "kuka_lwr4plus.yaml")
ROW = "0, 10, 20, 30, 40, 50, 60"


def given(path, text):
    path.write_text(text)
    return path


def test_plan_gives_waypoints_and_boxes(tmp_path):
    text = f"""
alpha: 0.5
margin: 5%
angle_unit: deg
waypoints: [[{ROW}], [0, 0, 0, 0, 0, 0, 0]]
times: [0, 4]
obstacles: [{{lower: [0.5, 0.2, 0], upper: [0.3, 0.4, 1]}}]
workspace: {{lower: [-1, -1, 0], upper: [1, 1, 2]}}
"""
    plan = read_plan(given(tmp_path / "p.yaml", text), ROBOT, IN_PLAN_FILE)
    assert np.allclose(plan.waypoints.q[0], np.radians([0, 10, 20, 30, 40, 50, 60]))
    assert np.array_equal(plan.waypoints.times, [0, 4])
    assert plan.obstacles == (((0.3, 0.2, 0.0), (0.5, 0.4, 1.0)),)
    assert plan.workspace == ((-1, -1, 0), (1, 1, 2))


def test_columns_of_a_csv_are_taken_by_joint_name(tmp_path):
    names = [*reversed(ROBOT.joint_names)]
    text = "t," + ",".join(f"q_{name}" for name in names) + "\n0,7,6,5,4,3,2,1\n2,0,0,0,0,0,0,0\n"
    found = read_waypoints(given(tmp_path / "w.csv", text), ROBOT)
    assert np.array_equal(found.q[0], [1, 2, 3, 4, 5, 6, 7])
    assert np.array_equal(found.times, [0, 2])


def test_a_csv_without_header_has_the_joints_in_order(tmp_path):
    path = given(tmp_path / "w.csv", "# mine\n1,2,3,4,5,6,7\n0,0,0,0,0,0,0\n")
    found = read_waypoints(path, ROBOT)
    assert found.times is None
    assert np.array_equal(found.q, [[1, 2, 3, 4, 5, 6, 7], [0] * 7])


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("1,2,3\n4,5,6\n", "E310", "3 columns"),
        ("1,2,3,4,5,6,7\n", "E322", "1 waypoints"),
        (
            "1,2,3,4,5,6,x\n1,2,3,4,5,6,7\n1,2,3,4,5,6,y\n",
            "E322",
            "w.csv:1: 'x' is not a number",
        ),
        ("1,2,3,4,5,6,7\n1,2,3,4,5,6,nan\n", "E322", "row 2"),
        ("t," + ",".join(ROBOT.joint_names) + 2 * "\n1,1,2,3,4,5,6,7", "E311", "waypoint 2"),
        ("t,a,b,c,d,e,f,g\n1,1,2,3,4,5,6,7\n2,0,0,0,0,0,0,0\n", "E322", "no column lwr_0_joint"),
    ],
)
def test_broken_waypoints_are_named(tmp_path, text, code, words):
    with pytest.raises(DynidError, match=words) as caught:
        read_waypoints(given(tmp_path / "w.csv", text), ROBOT)
    assert caught.value.code == code


def test_unknown_key_of_a_plan_is_named_with_its_line(tmp_path):
    with pytest.raises(DynidError, match=r"p.yaml:2: unknown key 'aplha'; did you mean 'alpha'"):
        read_plan(given(tmp_path / "p.yaml", "segments: 4\naplha: 0.2\n"), ROBOT, IN_PLAN_FILE)
