"""The robot file is read by the declarations of its keys, and what the reference says of a key is what holds."""

from pathlib import Path

import pytest

from dynid.errors import NotANumber, UnknownKey, WrongRobotFile
from dynid.files import robotkeys
from dynid.files.robotfile import parse_robot
from dynid.robot import Joint

ROOT = Path(__file__).parents[3]
LEAST = (
    "name: arm\nconvention: standard\njoints:\n  - {name: one}\n  - {name: two, type: prismatic}\n"
)


def read(text=""):
    return parse_robot(LEAST + text, Path("arm.yaml"))


#: The tables of the reference by what stands in front of their keys; a body stands in two places.
TABLES = {
    "": robotkeys.ROBOT,
    "base": robotkeys.BASE,
    "joints": robotkeys.JOINT,
    "joints.limits": robotkeys.LIMITS,
    "torque": robotkeys.TORQUE,
    "driver": robotkeys.DRIVER,
    "driver.units": robotkeys.UNITS,
    "driver.columns": robotkeys.COLUMNS,
    "simulator": robotkeys.SIMULATOR,
    "prior": robotkeys.PRIOR,
    "prior.cylinders": robotkeys.CYLINDERS,
    "prior.links, tool": robotkeys.BODY,
    "known": robotkeys.KNOWN,
    "coupling": robotkeys.COUPLING,
    "coulomb": robotkeys.COULOMB,
    "effects": robotkeys.EFFECT,
}


def reference():
    """Return the rows of the page by table and key: type, unit, default, meaning."""
    tables, title = {"": {}}, ""
    for line in (ROOT / "docs" / "reference" / "robot-file.md").read_text().splitlines():
        if line.startswith("## `"):
            title = line.removeprefix("## ").replace("`", "")
            tables[title] = {}
        elif line.startswith("| `"):
            key, *cells = line.strip("| ").split(" | ")
            tables[title][key.strip("`")] = cells
    return tables


def test_the_reference_has_a_row_for_every_key_and_no_other():
    assert {title: set(rows) for title, rows in reference().items()} == {
        title: set(keys) for title, keys in TABLES.items()
    }


def test_the_defaults_of_the_reference_are_those_of_a_file_that_leaves_the_keys_out():
    shown = {key: cells[2].strip("` ") for key, cells in reference()["joints"].items()}
    plain = Joint("joint_1")
    assert (shown["a"], shown["d"], shown["twist"], shown["theta_offset"]) == ("0", "0", "0", "0")
    assert shown["friction"] == f"[{', '.join(plain.friction)}]"
    assert (shown["type"], shown["motor_inertia"]) == (plain.type, str(plain.motor_inertia).lower())
    robot, top = read(), {key: cells[2].strip("` ") for key, cells in reference()[""].items()}
    assert top["gravity"] == str([*map(float, robot.gravity)]).replace(".0", "")
    assert top["torque"] == robot.torque.source
    assert top["coulomb"].startswith(
        f"{robot.coulomb_shape.shape}`, {robot.coulomb_shape.velocity[0]} rad/s"
    )


@pytest.mark.parametrize("name", ["''", '"a\\0b"', '"\\ud800"', 101 * "x"])
def test_a_name_that_no_page_or_simulator_can_hold_is_refused(name):
    for text in (LEAST.replace("one", name), LEAST.replace("arm", name)):
        with pytest.raises(WrongRobotFile, match="printable"):
            parse_robot(text, Path("arm.yaml"))


@pytest.mark.parametrize(
    ("text", "error", "says"),
    [
        (
            "driver: {kind: generic, units: {position: gon}}\n",
            WrongRobotFile,
            r"'gon' is none of rad, deg, m, mm",
        ),
        (
            "driver: {kind: generic, sign: [1, 2]}\n",
            WrongRobotFile,
            r"driver\.sign\[1\] = 2 must be 1 or -1",
        ),
        ("driver: {topic: /x}\n", WrongRobotFile, "driver lacks the key 'kind'"),
        ("torque: {gain: [1, 0]}\n", WrongRobotFile, r"torque\.gain\[1\] = 0 must be positive"),
        (
            "torque: {noise: [1, null]}\n",
            NotANumber,
            r"torque\.noise\[1\] = 'null' is not a number",
        ),
        ("torque: {noise: -0.1}\n", WrongRobotFile, r"torque\.noise"),
        ("torque: {noise: [0.1, 0.1, 0.1]}\n", WrongRobotFile, r"torque\.noise"),
        ("tool: {mass: -1}\n", WrongRobotFile, r"tool\.mass = -1 kg is negative"),
        ("prior: {}\n", WrongRobotFile, "prior needs one of cylinders, links"),
        ("known: {link_mass: {3: [0, 1]}}\n", UnknownKey, "unknown key '3'"),
        ("known: {total_mass: [2, 1]}\n", WrongRobotFile, "2, 1 is not a range of masses"),
        (
            "simulator: {offset: [1, x]}\n",
            NotANumber,
            r"simulator\.offset\[1\] = 'x' is not a number",
        ),
        ("base: {rpy: [0, 0, pi/0]}\n", NotANumber, r"base\.rpy\[2\] = 'pi/0' is not finite"),
        ("links: [3]\n", WrongRobotFile, "there is no link 3, the arm has 2"),
        ("coupling: {matrix: [[1, 1], [1, 1]]}\n", WrongRobotFile, "cannot be inverted"),
    ],
)
def test_what_is_wrong_is_named_with_file_line_and_place(text, error, says):
    with pytest.raises(error, match=says) as caught:
        read(text)
    assert caught.value.where == "arm.yaml:6"


def test_plain_angles_are_in_the_unit_of_the_file_and_only_those_of_turning_joints():
    robot = read("angle_unit: deg\ncoulomb: {velocity: 90}\nsimulator: {offset: [180, 0.5]}\n")
    assert robot.coulomb is not None
    assert robot.coulomb.velocity == pytest.approx((3.14159265 / 2, 90))
    assert robot.simulator is not None
    assert robot.simulator.offset == pytest.approx((3.14159265, 0.5))


def test_one_value_may_stand_for_all_joints_where_the_reference_says_so():
    assert read("torque: gravity_free\n").torque.source == "gravity_free"
    robot = read("torque: {source: motor_current, gain: 2}\n")
    assert robot.torque.gain == (2.0, 2.0)


def test_null_leaves_a_key_out_where_that_has_a_meaning():
    robot = read(
        "tool: null\ncoupling: null\ntorque: {gain: null}\ndriver: {kind: generic, topic: null}\n"
    )
    assert (robot.tool, robot.coupling, robot.torque.gain) == (None, None, None)
    assert robot.driver is not None
    assert robot.driver.topic is None
