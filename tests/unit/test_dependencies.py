"""What is imported is declared, bounded and explained."""

import ast
import re
import sys
from pathlib import Path

import pytest

import dynid

ROOT = Path(__file__).parents[2]
#: Module where it is called otherwise than its package, and packages that another one brings.
CALLED = {"yaml": "pyyaml", "PIL": "matplotlib", "markupsafe": "jinja2"}
#: What is taken where it is there, from the system or the user's environment.
FOUND = {
    "mujoco",
    "pandas",
    "rospy",
    "rosgraph",
    "pybullet_data",
    "genpy",
    "rosbag",
    "roslib",
    "std_msgs",
    "sensor_msgs",
    "trajectory_msgs",
}


def declared():
    """Return the versions of the packages that dynid needs, or can use, as pyproject.toml gives them."""
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    lists = [
        re.search(rf"(?ms)^{name} = \[(.*?)\]$", text)[1] for name in ("dependencies", "cluster")
    ]
    return dict(re.findall(r'"([A-Za-z0-9_-]+)([^";]*)', " ".join(lists)))


def imported():
    found = set()
    for path in Path(dynid.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += (
                [node.module or ""] if isinstance(node, ast.ImportFrom) and not node.level else []
            )
            found |= {name.partition(".")[0] for name in names}
    return found - set(sys.stdlib_module_names) - {"dynid"}


def test_only_what_is_declared_is_imported():
    assert {CALLED.get(name, name) for name in imported()} - FOUND <= set(declared())


@pytest.mark.parametrize("package", declared())
def test_every_package_has_its_place_on_the_page_of_dependencies(package):
    page = (ROOT / "docs" / "explanation" / "dependencies.md").read_text(encoding="utf-8")
    row = re.search(rf"(?m)^\| {package} \| (\S+) \|", page)
    assert row is None or row[1] == declared()[package]
    assert package in page


@pytest.mark.parametrize(
    "package", ["numpy", "pyyaml", "matplotlib", "click", "rosbags", "jinja2", "sympy", "scipy"]
)
def test_a_package_whose_next_major_version_may_break_is_bounded(package):
    assert re.fullmatch(r">=[0-9.]+,<[0-9.]+", declared()[package])
