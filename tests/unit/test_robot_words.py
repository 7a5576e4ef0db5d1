"""Where a person is sent to write a line of a robot file."""

from dataclasses import replace
from pathlib import Path

import pytest

from dynid import load_robot


@pytest.mark.parametrize(
    ("source", "path", "said"),
    [
        ("my arm.urdf", None, "the robot file that `dynid import 'my arm.urdf'` makes"),
        ("arm.urdf#hand", None, "the robot file that `dynid import arm.urdf --tip hand` makes"),
        ("my_arm.yaml", Path("my_arm.yaml"), "my_arm.yaml"),
        ("/lab/my_arm.yaml", Path("/lab/my_arm.yaml"), "/lab/my_arm.yaml"),
        (None, None, "the robot file"),
    ],
)
def test_lines_go_where_they_stay(source, path, said):
    assert replace(load_robot("scara"), source=source, path=path).editable == said


def test_a_robot_file_that_came_with_dynid_is_copied_first(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    robot = load_robot("ur10")
    assert robot.editable == f"a copy of {robot.path}"
