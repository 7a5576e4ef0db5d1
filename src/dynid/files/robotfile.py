"""The robot file: YAML to ``Robot`` and back, with every mistake named by file and line.

Reads ``robots/*.yaml``, a path, or the files inside the package. The keys are declared in ``robotkeys``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from contextlib import suppress
from copy import deepcopy
from dataclasses import fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from dynid.errors import (
    DynidError,
    Finding,
    ImplausibleGravity,
    MissingConvention,
    NotYaml,
    RobotNotFound,
    WrongRobotFile,
)
from dynid.files import packaged, tuning
from dynid.files.robotkeys import INERTIA, JOINT, ROBOT, SNAP_STEP, Context, read_found, read_keys
from dynid.files.robotkeys import read_prior as prior_of
from dynid.files.yamlfile import Value, parse_yaml, read_text, read_yaml
from dynid.robot import MOST_JOINTS, Body, Joint, Known, Prior, Robot, TorqueSource, rotation_rpy
from dynid.text import closest, printable, yaml_text
from dynid.units import ANGLE

#: Other usual names of arms, without signs, and the robot file that a person probably means.
USUAL_ROBOTS = {
    "emika": "franka_panda",
    "fer": "franka_panda",
    "franka": "franka_panda",
    "jaco": "kinova_gen2",
    "jaco2": "kinova_gen2",
    "lbr": "iiwa",
    "lbriiwa": "iiwa",
    "lwr": "kuka_lwr4plus",
    "lwr4": "kuka_lwr4plus",
    "kukalwr": "kuka_lwr4plus",
    "lbr4": "kuka_lwr4plus",
    "ufactory": "xarm7",
}
#: Other usual names of keys of the DH table.
USUAL_KEYS = {"alpha": "twist", "theta": "theta_offset", "offset": "theta_offset"}


def known_robots() -> dict[str, Path]:
    """Return the robots in ./robots and inside the package by name; ./robots wins."""
    found: dict[str, Path] = {}
    for folder in (packaged("robots"), Path("robots")):
        for path in sorted(folder.rglob("*.yaml")):
            found[path.relative_to(folder).with_suffix("").as_posix()] = path
    return found


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
    names = ", ".join(sorted(known))
    if name.endswith((".yaml", ".yml", ".urdf")) or "/" in name:
        raise RobotNotFound(
            f"no robot file '{name}'{closest(name, known)}",
            where=name,
            fix=f"known robots: {names}",
        )
    raise RobotNotFound(
        f"no robot '{name}'{suggestion(name, known)}", fix=f"known: {names}; or give a path"
    )


def suggestion(name: str, known: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the robot that a name is likely to mean, or an empty string."""
    word = _letters(name)
    word = _letters(USUAL_ROBOTS.get(word, word))
    inside = [each for each in sorted(known) if len(word) > 1 and word in _letters(each)]
    return f"; did you mean '{min(inside, key=len)}'?" if inside else closest(name, known)


def _letters(name: str) -> str:
    return "".join(character for character in name.lower() if character.isalnum())


def load_robot(name: str | Path) -> Robot:
    """Read a robot by name or path; what was noticed is in ``robot.findings``."""
    path = find_robot(str(name))
    return replace(parse_robot(read_text(path), path), source=str(name))


def parse_robot(text: str, path: Path) -> Robot:
    """Read a robot from the text of its file."""
    # Why a copy: a robot has mappings, which its user may change.
    return deepcopy(_parsed(text, path))


@lru_cache(maxsize=16)
def _parsed(text: str, path: Path) -> Robot:
    """Read a robot once for each text and path."""
    return _robot(parse_yaml(text, path), path)


def read_prior(path: Path, robot: Robot) -> Prior:
    """Read a prior from a file of its own that holds what stands under ``prior:`` of a robot file."""
    return prior_of(read_yaml(path), Context(joints=robot.joints))


def _robot(root: Value, path: Path) -> Robot:
    if not root.is_mapping:
        raise NotYaml(f"{path} has no keys; it is not a robot file", where=str(path))
    found = root.mapping([key.name for key in ROBOT], required=("name", "joints"))
    if "convention" not in found:
        raise MissingConvention(
            f"{path}: say which DH convention: standard or modified; they give different robots",
            where=str(path),
        )
    unit = found["angle_unit"].choice(tuple(ANGLE)) if "angle_unit" in found else "rad"
    findings: list[Finding] = []
    joints = _joints(found["joints"], Context(unit, findings=findings))
    given = read_found(found, ROBOT, Context(unit, joints, findings=findings))
    base, mount = given.pop("base", {}), given.pop("mount", "floor")
    facts = {key: value for key, value in given.items() if key != "angle_unit"}
    rpy = base.get("rpy", (0.0, 0.0, 0.0))
    if "gravity" in found:
        _check_gravity(found["gravity"], given["gravity"], rpy, mount, findings)
    elif mount == "ceiling":
        facts["gravity"] = (0.0, 0.0, 9.81)
    if "xyz" in base:
        facts["base_xyz"] = base["xyz"]
    return Robot(**facts, base_rpy=rpy, path=path, findings=tuple(findings))


def _joints(value: Value, context: Context) -> tuple[Joint, ...]:
    joints: list[Joint] = []
    items = value.items()
    if len(items) > MOST_JOINTS:
        what = f"{value.where}: {len(items)} joints; a robot has at most {MOST_JOINTS}"
        raise WrongRobotFile(what, where=value.where)
    for number, item in enumerate(items, start=1):
        item = _usual_keys(item, context.findings)
        keys = item.mapping([key.name for key in JOINT])
        sliding = "type" in keys and keys["type"].choice(("revolute", "prismatic")) == "prismatic"
        own = Context(context.angle_unit, revolute=not sliding, findings=context.findings)
        joints.append(Joint(**{"name": f"joint_{number}", **read_keys(item, JOINT, own)}))
    if not joints:
        raise WrongRobotFile(f"{value.where}: joints is empty", where=value.where)
    names = [joint.name for joint in joints]
    for name in names:
        if names.count(name) > 1:
            raise WrongRobotFile(
                f"{value.where}: two joints are called '{name}'", where=value.where
            )
    return tuple(joints)


def _usual_keys(value: Value, findings: list[Finding]) -> Value:
    """Return a row of the DH table with dynid's names of its keys; say which others were understood (W203)."""
    import yaml

    if not isinstance(value.node, yaml.MappingNode):
        return value
    pairs = []
    for key, item in value.node.value:
        usual = USUAL_KEYS.get(str(key.value))
        if usual is not None:
            where = f"{value.file}:{key.start_mark.line + 1}"
            text = f"{where}: `{key.value}:` is read as `{usual}:`, its name in dynid"
            findings.append(Finding("W203", "info", text, {"given": str(key.value), "used": usual}))
            key = yaml.ScalarNode(key.tag, usual, key.start_mark, key.end_mark)
        pairs.append((key, item))
    node = yaml.MappingNode(value.node.tag, pairs, value.node.start_mark, value.node.end_mark)
    return replace(value, node=node)


def _check_gravity(
    value: Value,
    gravity: tuple[float, float, float],
    rpy: tuple[float, float, float],
    mount: str,
    findings: list[Finding],
) -> None:
    """Refuse a gravity that no place on Earth has; say so where it points up in the world (W206)."""
    size = math.hypot(*gravity)
    if size and not tuning.GRAVITY[0] <= size <= tuning.GRAVITY[1]:
        hint = "; cm?" if 960 <= size <= 990 else "; in g?" if 0.9 <= size <= 1.1 else ""
        shown = ", ".join(f"{g:g}" for g in gravity)
        raise ImplausibleGravity(
            f"{value.where}: gravity is ({shown}): {size:g} m/s^2{hint}", where=value.where
        )
    world = rotation_rpy(rpy) @ np.array(gravity)
    if size and world[2] > 0.5 * size and mount == "floor":
        text = (
            f"{value.where}: gravity points up in the world frame (base.rpy taken into account): "
            "a ceiling mount? say `mount: ceiling`"
        )
        findings.append(Finding("W206", "warning", text, {"gravity_world": world.tolist()}))


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
            found = parse_robot(text, robot.path)
            if robot in (
                found,
                found if with_prior else replace(found, prior=robot.prior, known=robot.known),
            ):
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
    document |= _beyond_geometry(robot)
    comment = "".join(f"# {printable(line)}\n" for line in head.splitlines())
    return comment + yaml_text(document, width=140)


def _angle(angle: float) -> float | str:
    """Return an angle, in degrees where it is a multiple of 15: 90 deg is exact, 1.5707963267948966 is not."""
    steps = angle / SNAP_STEP
    return (
        f"{round(steps) * 15} deg"
        if round(steps) and abs(steps - round(steps)) < 1e-12
        else angle + 0.0
    )


def _joint_row(joint: Joint) -> dict[str, Any]:
    row: dict[str, Any] = {
        "name": joint.name,
        "type": joint.type,
        "a": joint.a,
        "twist": _angle(joint.twist),
    }
    row |= {"d": joint.d, "theta_offset": _angle(joint.theta_offset)}
    limits = joint.limits
    known: dict[str, Any] = {"position": list(limits.position) if limits.position else None}
    sizes = {
        "velocity": limits.velocity,
        "acceleration": limits.acceleration,
        "torque": limits.torque,
    }
    known |= {
        key: value for key, value in sizes.items() if value is not None and math.isfinite(value)
    }
    row["limits"] = known
    if not joint.motor_inertia:
        row["motor_inertia"] = False
    if joint.friction != Joint("").friction:
        row["friction"] = list(joint.friction)
    return row


def _beyond_geometry(robot: Robot) -> dict[str, Any]:
    """Return the keys after ``joints`` that are not left at their defaults."""
    found: dict[str, Any] = {"links": list(robot.links)} if robot.links else {}
    if robot.torque != TorqueSource():
        found["torque"] = _given(robot.torque)
    if robot.driver is not None:
        spec = _given(robot.driver)
        found["driver"] = {key: value for key, value in spec.items() if key != "map"} | _given(
            robot.driver.map
        )
    if robot.prior is not None:
        bodies, cylinders = robot.prior.links, robot.prior.cylinders
        found["prior"] = (
            {"links": [_body_row(body) for body in bodies]}
            if bodies
            else {"cylinders": _given(cylinders)}
        )
    if robot.tool is not None:
        found["tool"] = _body_row(robot.tool)
    if robot.known != Known():
        found["known"] = {
            key: {str(link): bounds for link, bounds in value} if key != "total_mass" else value
            for key, value in _given(robot.known).items()
        }
    for key in ("simulator", "coupling", "coulomb"):
        if getattr(robot, key) is not None:
            found[key] = _given(getattr(robot, key))
    return found | ({"effects": [_given(spec) for spec in robot.effects]} if robot.effects else {})


def _given(values: Any) -> dict[str, Any]:  # noqa: ANN401
    """Return the attributes of a dataclass that are given, for YAML."""
    every = {each.name: getattr(values, each.name) for each in fields(values)}
    return {key: _plain(value) for key, value in every.items() if value is not None and value != ()}


def _plain(value: Any) -> Any:  # noqa: ANN401
    return [_plain(each) for each in value] if isinstance(value, tuple) else value


def _body_row(body: Body) -> dict[str, Any]:
    tensor = dict(zip(INERTIA, map(_rounded, body.inertia_com), strict=True))
    return {
        "mass": float(body.mass),
        "com": [_rounded(value) for value in body.com],
        "inertia_com": tensor,
    }


def _rounded(value: float) -> float:
    """Take rounding noise off."""
    return round(float(value), 15) + 0.0
