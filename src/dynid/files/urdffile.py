"""URDF files: links with their bodies, joints with their places, and chains from one link to another.

Angles that were typed with few digits (1.5708) are taken for the right angles they mean, as in the robot file.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.errors import WrongUrdf
from dynid.files import tuning
from dynid.files.robotkeys import SNAP_STEP
from dynid.files.yamlfile import LARGEST
from dynid.robot import Body, Limits, rotation_rpy
from dynid.text import closest, shell

Floats = NDArray[np.float64]

MOVING = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class UrdfJoint:
    """One joint.

    Attributes:
        name: its name.
        type: as in the file.
        parent: link before it.
        child: link after it.
        origin: pose of the child's frame in the parent's at q = 0, (4, 4).
        axis: unit vector in the child's frame, (3,).
        limits: limits that the file gives.
        damping: viscous friction of ``<dynamics>``.
        friction: Coulomb friction of ``<dynamics>``.
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Floats
    axis: Floats
    limits: Limits
    damping: float = 0.0
    friction: float = 0.0

    @property
    def moves(self) -> bool:
        """Whether it is a revolute or prismatic joint."""
        return self.type in MOVING

    def transform(self, q: float) -> Floats:
        """Return the pose of the child's frame in the parent's at q, (4, 4)."""
        pose = np.eye(4)
        if self.type == "prismatic":
            pose[:3, 3] = q * self.axis
        elif self.moves:
            x, y, z = self.axis
            K = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
            pose[:3, :3] = np.eye(3) + math.sin(q) * K + (1 - math.cos(q)) * K @ K
        return np.asarray(self.origin @ pose)


@dataclass(frozen=True)
class Urdf:
    """A tree of links.

    Attributes:
        name: the robot's name.
        bodies: body of each link in the link's frame, None where the file gives none.
        joints: all joints.
        path: the file.
    """

    name: str
    bodies: Mapping[str, Body | None]
    joints: tuple[UrdfJoint, ...]
    path: Path

    @property
    def root(self) -> str:
        """Name of the link that no joint carries."""
        children = {joint.child for joint in self.joints}
        return next(link for link in self.bodies if link not in children)

    def chain(self, base: str, tip: str) -> tuple[UrdfJoint, ...]:
        """Return the joints from one link to another further out."""
        carrier = {joint.child: joint for joint in self.joints}
        joints: list[UrdfJoint] = []
        link = tip
        while link != base:
            if link not in carrier:
                raise WrongUrdf(
                    f"{self.path}: link '{tip}' is not connected to '{base}'", where=str(self.path)
                )
            joints.append(carrier[link])
            link = carrier[link].parent
        return tuple(reversed(joints))

    def behind(self, link: str, stop: Sequence[str] = ()) -> list[tuple[UrdfJoint, Floats]]:
        """Return the joints that hang on a link, with the pose of their child in the link's frame at q = 0.

        Args:
            link: name of a link.
            stop: names of joints that are not followed.
        """
        found: list[tuple[UrdfJoint, Floats]] = []
        queue = [(link, np.eye(4))]
        while queue:
            name, pose = queue.pop(0)
            for joint in self.joints:
                if joint.parent == name and joint.name not in stop:
                    found.append((joint, pose @ joint.origin))
                    queue.append((joint.child, pose @ joint.origin))
        return found

    def known_link(self, name: str) -> str:
        """Return the name of a link after checking that it exists."""
        if name not in self.bodies:
            hint = closest(name, self.bodies)
            raise WrongUrdf(
                f"{self.path} has no link '{name}'{hint}",
                where=str(self.path),
                fix=f"links: {', '.join(self.bodies)}",
            )
        return name


def read_urdf(path: Path, *, exact: bool = False) -> Urdf:
    """Read a URDF.

    Args:
        path: the file; a xacro must be expanded first.
        exact: take angles as they are written, also those that miss a multiple of 15 degrees by less than 1e-4 rad.

    Raises:
        WrongUrdf: it cannot be read or is no tree of links.
    """
    where = str(path)
    try:
        top = ET.fromstring(path.read_bytes())
    except OSError as error:
        raise WrongUrdf(f"cannot read {path}: {error.strerror}", where=where) from error
    except ET.ParseError as error:
        raise WrongUrdf(
            f"{path} is not XML: {error}", where=f"{path}:{error.position[0]}"
        ) from error
    except (LookupError, ValueError) as error:
        raise WrongUrdf(f"{path} is not XML in a known encoding: {error}", where=where) from error
    if top.tag != "robot":
        raise WrongUrdf(f"{path} holds <{top.tag}>, not <robot>: it is not a URDF", where=where)
    if any("ros.org/wiki/xacro" in element.tag for element in top.iter()):
        raise WrongUrdf(f"{path} is a xacro", where=where, fix=f"{shell('xacro', path)} > arm.urdf")
    try:
        bodies = {link.attrib["name"]: _body(link) for link in top.findall("link")}
        joints = tuple(_joint(joint, exact) for joint in top.findall("joint"))
    except (KeyError, ValueError, AttributeError) as error:
        raise WrongUrdf(
            f"{path}: a link or joint lacks something or has a value that is not a number: {error}",
            where=where,
        ) from error
    _check_tree(path, bodies, joints)
    return Urdf(top.get("name", path.stem), bodies, joints, path)


def _check_tree(path: Path, bodies: Mapping[str, Body | None], joints: Sequence[UrdfJoint]) -> None:
    children = [joint.child for joint in joints]
    for joint in joints:
        for link in (joint.parent, joint.child):
            if link not in bodies:
                raise WrongUrdf(
                    f"{path}: joint '{joint.name}' names link '{link}', which is not there",
                    where=str(path),
                )
    if len(set(children)) != len(children) or len(children) != len(bodies) - 1:
        raise WrongUrdf(
            f"{path} is not one tree: {len(bodies)} links, {len(children)} joints", where=str(path)
        )
    parents = {joint.child: joint.parent for joint in joints}
    reached = {link for link in bodies if link not in parents}
    for link in bodies:
        before = [link]
        while before[-1] not in reached:
            before.append(parents[before[-1]])
            if len(before) > len(bodies):
                raise WrongUrdf(
                    f"{path} is not one tree: link '{link}' is its own parent", where=str(path)
                )
        reached.update(before)


def _numbers(text: str, count: int) -> Floats:
    values = np.array([float(word) for word in text.split()])
    # Why not only finite: powers and shares of larger numbers are not.
    if values.shape != (count,) or not np.all(np.abs(values) < LARGEST):
        raise ValueError(f"'{text[:80]}' should be {count} finite numbers below {LARGEST:g}")
    return values


def _number(element: ET.Element | None, key: str) -> float:
    """Return a number of an element, 0 where there is none."""
    return float(_numbers(element.get(key, "0"), 1)[0]) if element is not None else 0.0


def _pose(element: ET.Element | None, clean: Callable[[float], float]) -> Floats:
    pose = np.eye(4)
    if element is not None:
        roll, pitch, yaw = (
            clean(angle) for angle in _numbers(element.get("rpy", "0 0 0"), 3).tolist()
        )
        R = rotation_rpy((roll, pitch, yaw))
        # Why: cos(pi/2) is 6e-17; exact zeros keep axes that are parallel exactly parallel.
        pose[:3, :3] = np.where(np.abs(R - np.round(R)) < 1e-15, np.round(R), R)
        pose[:3, 3] = _numbers(element.get("xyz", "0 0 0"), 3)
    return pose


def _snapped(angle: float) -> float:
    nearest = round(angle / SNAP_STEP) * SNAP_STEP
    return nearest if abs(angle - nearest) < tuning.SNAP_RAD else angle


def _body(link: ET.Element) -> Body | None:
    inertial = link.find("inertial")
    if inertial is None:
        return None
    pose = _pose(inertial.find("origin"), lambda angle: angle)
    mass = inertial.find("mass")
    entries = inertial.find("inertia")
    m = float(_numbers(mass.attrib["value"], 1)[0]) if mass is not None else 0.0
    tensor = np.zeros((3, 3))
    if entries is not None:
        for name in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
            i, j = "xyz".index(name[1]), "xyz".index(name[2])
            tensor[i, j] = tensor[j, i] = _number(entries, name)
    return Body.of(m, pose[:3, 3], pose[:3, :3] @ tensor @ pose[:3, :3].T)


def _joint(joint: ET.Element, exact: bool) -> UrdfJoint:
    kind = joint.attrib["type"]
    axis_element = joint.find("axis")
    axis = (
        _numbers(axis_element.attrib["xyz"], 3)
        if axis_element is not None
        else np.array([1.0, 0.0, 0.0])
    )
    if kind in MOVING and not np.linalg.norm(axis):
        raise ValueError(f"the axis of joint {joint.attrib['name']} is zero")
    axis = axis / (np.linalg.norm(axis) or 1.0)
    if not exact:
        # Why: an axis such as (0, 1, 2e-5) would give common normals kilometres away.
        axis = np.where(np.abs(axis) < tuning.SNAP_RAD, 0.0, axis)
        axis = axis / (np.linalg.norm(axis) or 1.0)
    dynamics = joint.find("dynamics")
    parent, child = joint.find("parent"), joint.find("child")
    if parent is None or child is None:
        raise ValueError(f"joint {joint.attrib['name']} has no parent or child")
    return UrdfJoint(
        name=joint.attrib["name"],
        type=kind,
        parent=parent.attrib["link"],
        child=child.attrib["link"],
        origin=_pose(joint.find("origin"), (lambda angle: angle) if exact else _snapped),
        axis=axis,
        limits=_limits(joint.find("limit"), kind),
        damping=_number(dynamics, "damping"),
        friction=_number(dynamics, "friction"),
    )


def _limits(element: ET.Element | None, kind: str) -> Limits:
    if element is None:
        return Limits()
    lower, upper = (float(element.get(key, "0")) for key in ("lower", "upper"))
    velocity, effort = (float(element.get(key, "0")) for key in ("velocity", "effort"))
    # Why: some files write an infinite or huge number for a joint without a limit.
    position = (
        (lower, upper) if kind != "continuous" and -LARGEST < lower < upper < LARGEST else None
    )
    most = (value if 0 < value < LARGEST else None for value in (velocity, effort))
    return Limits(position, next(most), None, next(most))
