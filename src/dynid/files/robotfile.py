"""The robot file: YAML to ``Robot`` and back, with every mistake named by file and line.

Reads ``robots/*.yaml``, a path, or the files inside the package. The keys are declared in ``robotkeys``.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

from dynid.errors import DynidError, ImplausibleGravity, MissingConvention, NotYaml, RobotNotFound
from dynid.files import packaged, tuning
from dynid.files.robotkeys import A_PRIOR, INERTIA, ROBOT, SNAP_STEP, read_joints, unit_of
from dynid.files.yamlfile import Value, parse_yaml, read_text, read_yaml
from dynid.robot import Body, Joint, Known, Prior, Robot, TorqueSource
from dynid.text import closest, printable, yaml_text


def known_robots() -> dict[str, Path]:
    """Return the robots in ./robots and inside the package by name; ./robots wins."""
    return {
        path.relative_to(folder).with_suffix("").as_posix(): path
        for folder in (packaged("robots"), Path("robots"))
        for path in sorted(folder.rglob("*.yaml"))
    }


def find_robot(name: str) -> Path:
    """Return the file of a robot given by name or path.

    Raises:
        RobotNotFound: there is none.
    """
    if Path(name).is_file():
        return Path(name)
    known = known_robots()
    if name in known:
        return known[name]
    inside = [each for each in sorted(known) if name and name.lower() in each]
    meant = f"; did you mean '{min(inside, key=len)}'?" if inside else closest(name, known)
    raise RobotNotFound(
        f"no robot '{name}'{meant}", fix=f"known: {', '.join(sorted(known))}; or give a path"
    )


def load_robot(name: str | Path) -> Robot:
    """Read a robot by name or path; what was noticed is in ``robot.findings``."""
    path = find_robot(str(name))
    return replace(parse_robot(read_text(path), path), source=str(name))


def read_prior(path: Path, robot: Robot) -> Prior:
    """Read a prior from a file of its own that holds what stands under ``prior:`` of a robot file."""
    prior: Prior = A_PRIOR(read_yaml(path).within(joints=robot.joints))
    return prior


def parse_robot(text: str, path: Path) -> Robot:
    """Read a robot from the text of its file."""
    root = parse_yaml(text, path)
    if not root.is_mapping:
        raise NotYaml(f"{path} has no keys; it is not a robot file", where=path)
    values = root.mapping(list(ROBOT), required=("name", "joints"))
    if "convention" not in values:
        raise MissingConvention(
            f"{path}: say which DH convention: standard or modified; they give different robots",
            where=path,
        )
    # Why first: all other keys depend on the number of joints and on which of them are revolute.
    root = root.within(angle_unit=unit_of(values))
    joints = read_joints(replace(values["joints"], context=root.context))
    given = root.within(joints=joints).read(ROBOT)
    base, mount = given.pop("base", {}), given.pop("mount", "floor")
    given.pop("angle_unit", None)
    robot = Robot(**given, **{f"base_{key}": place for key, place in base.items()}, path=path)
    if "gravity" in values:
        _check_gravity(values["gravity"], robot, mount)
    elif mount == "ceiling":
        robot = replace(robot, gravity=(0.0, 0.0, 9.81))
    return replace(robot, findings=tuple(root.context.findings))


def _check_gravity(value: Value, robot: Robot, mount: str) -> None:
    """Refuse a gravity that no place on Earth has; say so where it points up in the world (W206)."""
    size = math.hypot(*robot.gravity)
    if size and not tuning.GRAVITY[0] <= size <= tuning.GRAVITY[1]:
        hint = "; cm?" if 960 <= size <= 990 else ""
        shown = ", ".join(f"{g:g}" for g in robot.gravity)
        raise value.wrong(f" is ({shown}): {size:g} m/s^2{hint}", kind=ImplausibleGravity)
    world = robot.world_gravity
    if size and world[2] > 0.5 * size and mount == "floor":
        text = (
            f"{value.where}: gravity points up in the world frame (base.rpy taken into account): "
            "a ceiling mount? say `mount: ceiling`"
        )
        value.note("W206", text, gravity_world=world.tolist())


# ---------------------------------------------------------------- writing
def text_of(robot: Robot, *, with_prior: bool = True) -> str:
    """Return the robot's file, as its user wrote it where it was read from one and has not been changed since.

    Args:
        robot: the arm.
        with_prior: whether prior and known facts have to be those of the file, too.
    """
    with suppress(DynidError, OSError, UnicodeDecodeError):
        if robot.path is not None:
            text = robot.path.read_text(encoding="utf-8")
            parsed = parse_robot(text, robot.path)
            if not with_prior:
                parsed = replace(parsed, prior=robot.prior, known=robot.known)
            if robot == parsed:
                return text
    return robot_text(robot)


def robot_text(robot: Robot, head: str = "") -> str:
    """Return the robot file of an arm: what ``parse_robot`` reads as the same arm. Defaults are left out.

    Args:
        robot: the arm.
        head: comment lines for the top, without ``#``.
    """
    document: dict[str, Any] = {
        "name": robot.name,
        "convention": robot.convention,
        "angle_unit": "rad",
        "gravity": list(robot.gravity),
        "base": {"xyz": list(robot.base_xyz), "rpy": [_angle(angle) for angle in robot.base_rpy]},
        "joints": [_joint_row(joint) for joint in robot.joints],
    }
    for key in ROBOT:
        value = getattr(robot, key, None)
        if key not in document and value and value not in (TorqueSource(), Known()):
            document[key] = _given(value)
    if robot.driver is not None:
        document["driver"] |= document["driver"].pop("map")
    for key, bounds in document.get("known", {}).items():
        if key != "total_mass":
            document["known"][key] = {str(link): each for link, each in bounds}
    comment = "".join(f"# {printable(line)}\n" for line in head.splitlines())
    return comment + yaml_text(document, width=140)


def _angle(angle: float) -> float | str:
    """Return an angle, in degrees where it is a multiple of 15: 90 deg is exact, 1.5707963267948966 is not."""
    steps = angle / SNAP_STEP
    exact = round(steps) and abs(steps - round(steps)) < 1e-12
    return f"{round(steps) * 15} deg" if exact else angle + 0.0


def _joint_row(joint: Joint) -> dict[str, Any]:
    row: dict[str, Any] = _given(joint)
    row |= {"twist": _angle(joint.twist), "theta_offset": _angle(joint.theta_offset)}
    row["limits"] = {"position": None, **row["limits"]}
    row["friction"] = list(joint.friction)
    for key in ("motor_inertia", "friction"):
        if getattr(joint, key) == getattr(Joint(""), key):
            del row[key]
    return row


def _given(value: Any) -> Any:  # noqa: ANN401
    """Return a value as a robot file has it; of a dataclass the attributes that are given."""
    if isinstance(value, tuple):
        return [_given(each) for each in value]
    if isinstance(value, Body):
        # Rounding noise is taken off.
        mass, *rest = (
            round(float(x), 15) + 0.0 for x in (value.mass, *value.com, *value.inertia_com)
        )
        return {
            "mass": mass,
            "com": rest[:3],
            "inertia_com": dict(zip(INERTIA, rest[3:], strict=True)),
        }
    if not is_dataclass(value):
        return value
    every = {each.name: getattr(value, each.name) for each in fields(value)}
    return {key: _given(x) for key, x in every.items() if x not in (None, (), math.inf)}
