"""URDF files: links with their bodies, joints with their places, and chains from one link to another.

Angles that were typed with few digits (1.5708) are taken for the right angles they mean, as in the robot file.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.arrays import Floats
from dynid.errors import WrongUrdf
from dynid.files import tuning
from dynid.files.robotkeys import INERTIA, snapped
from dynid.options import MOST
from dynid.robot import Body, Limits, rotation_rpy
from dynid.text import closest, shell

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
    """

    name: str
    type: str
    parent: str
    child: str
    origin: Floats
    axis: Floats
    limits: Limits

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
            K = np.cross(np.eye(3), self.axis)
            pose[:3, :3] = np.eye(3) + math.sin(q) * K + (1 - math.cos(q)) * K @ K
        return self.origin @ pose


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
        carrier, joints, link = {joint.child: joint for joint in self.joints}, [], tip
        while link != base:
            if link not in carrier:
                raise wrong_urdf(self.path, f": link '{tip}' is not connected to '{base}'")
            joints.append(carrier[link])
            link = carrier[link].parent
        return tuple(reversed(joints))

    def behind(self, link: str, stop: Container[str] = ()) -> list[tuple[UrdfJoint, Floats]]:
        """Return the joints that hang on a link, with the pose of their child in the link's frame at q = 0.

        Args:
            link: name of a link.
            stop: names of joints that are not followed.
        """
        chain, queue = [], [(link, np.eye(4))]
        while queue:
            name, pose = queue.pop(0)
            for joint in self.joints:
                if joint.parent == name and joint.name not in stop:
                    chain.append((joint, pose @ joint.origin))
                    queue.append((joint.child, pose @ joint.origin))
        return chain

    def poses(self, start: str, end: str, q: Sequence[float] = ()) -> dict[str, Floats]:
        """Return the poses of a link and of all after it up to another, (4, 4) each, at values of joints or 0."""
        pose, values = np.eye(4), iter(q)
        for joint in self.chain(self.root, start):
            pose = pose @ joint.origin
        poses = {start: pose}
        for joint in self.chain(start, end):
            pose = pose @ joint.transform(next(values, 0.0) if joint.moves else 0.0)
            poses[joint.child] = pose
        return poses

    def known_link(self, name: str) -> str:
        """Return the name of a link after checking that it exists."""
        if name not in self.bodies:
            text = f" has no link '{name}'{closest(name, self.bodies)}"
            raise wrong_urdf(self.path, text, f"links: {', '.join(self.bodies)}")
        return name


def wrong_urdf(path: Path, text: str, fix: str = "") -> WrongUrdf:
    """Return the mistake that a URDF is."""
    return WrongUrdf(f"{path}{text}", where=path, fix=fix)


def read_urdf(path: Path, *, exact: bool = False) -> Urdf:
    """Read a URDF.

    Args:
        path: the file; a xacro must be expanded first.
        exact: take angles as they are written, also those that miss a multiple of 15 degrees by less than 1e-4 rad.

    Raises:
        WrongUrdf: it cannot be read or is no tree of links.
    """
    try:
        top = ET.fromstring(path.read_bytes())
    except OSError as error:
        raise WrongUrdf(f"cannot read {path}: {error.strerror}", where=path) from error
    except (ET.ParseError, LookupError, ValueError) as error:
        raise wrong_urdf(path, f" is not XML: {error}") from error
    if top.tag != "robot":
        raise wrong_urdf(path, f" holds <{top.tag}>, not <robot>: it is not a URDF")
    if any("ros.org/wiki/xacro" in element.tag for element in top.iter()):
        raise wrong_urdf(path, " is a xacro", f"{shell('xacro', path)} > arm.urdf")
    try:
        bodies = {link.attrib["name"]: _body(link) for link in top.findall("link")}
        joints = tuple(_joint(joint, exact) for joint in top.findall("joint"))
    except (KeyError, ValueError) as error:
        text = f": a link or joint lacks something or has a value that is not a number: {error}"
        raise wrong_urdf(path, text) from error
    urdf = Urdf(top.get("name", path.stem), bodies, joints, path)
    _check_tree(urdf)
    return urdf


def _check_tree(urdf: Urdf) -> None:
    for joint in urdf.joints:
        for link in {joint.parent, joint.child} - urdf.bodies.keys():
            text = f": joint '{joint.name}' names link '{link}', which is not there"
            raise wrong_urdf(urdf.path, text)
    children = {joint.child for joint in urdf.joints}
    whole = len(children) == len(urdf.joints) == len(urdf.bodies) - 1
    if not whole or len(urdf.behind(urdf.root)) != len(children):
        text = f" is not one tree: {len(urdf.bodies)} links, {len(urdf.joints)} joints"
        raise wrong_urdf(urdf.path, text)


def _numbers(
    element: ET.Element | None, key: str, default: str = "0", *, needed: bool = False
) -> Floats:
    """Return the numbers of an attribute, as many as its default has, which it is where there is no element."""
    given = {key: default} if element is None else element.attrib
    text = given[key] if needed else given.get(key, default)
    values = np.array([float(word) for word in text.split()])
    # Why not only finite: powers and shares of larger numbers are not.
    if len(values) != len(default.split()) or not np.all(np.abs(values) < MOST):
        raise ValueError(
            f"'{text[:80]}' should be {len(default.split())} finite numbers below {MOST:g}"
        )
    return values


def _pose(element: ET.Element | None, exact: bool) -> Floats:
    pose, angles = np.eye(4), _numbers(element, "rpy", "0 0 0").tolist()
    roll, pitch, yaw = angles if exact else map(snapped, angles)
    R = rotation_rpy((roll, pitch, yaw))
    # Why: cos(pi/2) is 6e-17; exact zeros keep axes that are parallel exactly parallel.
    pose[:3, :3] = np.where(np.abs(R - np.round(R)) < 1e-15, np.round(R), R)
    pose[:3, 3] = _numbers(element, "xyz", "0 0 0")
    return pose


def _body(link: ET.Element) -> Body | None:
    inertial = link.find("inertial")
    if inertial is None:
        return None
    pose = _pose(inertial.find("origin"), exact=True)
    mass = _numbers(inertial.find("mass"), "value", needed=True)[0]
    tensor = np.zeros((3, 3))
    for name, i, j in zip(INERTIA, *np.triu_indices(3), strict=True):
        tensor[i, j] = tensor[j, i] = _numbers(inertial.find("inertia"), name)[0]
    turned = pose[:3, :3] @ tensor @ pose[:3, :3].T
    return Body.of(float(mass), pose[:3, 3], turned)


def _joint(joint: ET.Element, exact: bool) -> UrdfJoint:
    name, kind = joint.attrib["name"], joint.attrib["type"]
    axis = _numbers(joint.find("axis"), "xyz", "1 0 0", needed=True)
    if kind in MOVING and not axis.any():
        raise ValueError(f"the axis of joint {name} is zero")
    if not exact:
        # Why: an axis such as (0, 1, 2e-5) would give common normals kilometres away.
        small = tuning.SNAP_RAD * np.linalg.norm(axis)
        axis = np.where(np.abs(axis) < small, 0.0, axis)
    axis = axis / (np.linalg.norm(axis) or 1.0)
    ends = map(joint.find, ("parent", "child"))
    parent, child = ("" if end is None else end.attrib["link"] for end in ends)
    limit = joint.find("limit")
    given = {} if limit is None else limit.attrib
    lower, upper, velocity, effort = (
        float(given.get(key, "0")) for key in ("lower", "upper", "velocity", "effort")
    )
    # Why: some files write an infinite or huge number for a joint without a limit.
    limited = kind != "continuous" and -MOST < lower < upper < MOST
    limits = Limits(
        position=(lower, upper) if limited else None,
        velocity=velocity if 0 < velocity < MOST else None,
        torque=effort if 0 < effort < MOST else None,
    )
    return UrdfJoint(
        name=name,
        type=kind,
        parent=parent,
        child=child,
        origin=_pose(joint.find("origin"), exact),
        axis=axis,
        limits=limits,
    )
