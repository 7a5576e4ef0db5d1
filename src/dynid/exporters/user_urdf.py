"""The user's own URDF with new inertial blocks: every other byte stays as it is.

What hangs on a moving link by fixed joints, or by joints of its own such as fingers, keeps its block; the link itself
gets the rest of the identified body. Where no such rest exists, fixed parts are emptied and the link carries all.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.parsers import expat

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NotPhysical, WrongUrdf
from dynid.exporters.full_model import FullModel, numbers, smallest_eigenvalue
from dynid.files.urdffile import Urdf, UrdfJoint, read_urdf
from dynid.model.kinematics import link_frames
from dynid.model.parameters import body_of, moved
from dynid.robot import Body, JointMap, Prior, Robot
from dynid.text import xml_comment

if TYPE_CHECKING:
    from dynid.exporters.interface import IdentifiedArm

Floats = NDArray[np.float64]

#: The URDF and the DH table count as the same arm when their frames agree to this [m and rad].
SAME_ARM = 1e-4
#: What is left of a link when all its mass hangs on it, up to rounding.
NOTHING = 1e-12


@dataclass(frozen=True)
class Attached:
    """How a URDF's chain lies beside the DH frames.

    Attributes:
        urdf: the file.
        names: its joints, base to tip, in the order of the robot file.
        mapping: q_dh = sign * q_urdf + offset.
        to_dh: pose of each DH frame in the frame of the URDF's link, n of (4, 4).
    """

    urdf: Urdf
    names: tuple[str, ...]
    mapping: JointMap
    to_dh: tuple[Floats, ...]

    @property
    def joints(self) -> tuple[UrdfJoint, ...]:
        """The moving joints, base to tip."""
        known = {joint.name: joint for joint in self.urdf.joints}
        return tuple(known[name] for name in self.names)

    def prior(self) -> Prior:
        """Return the file's bodies in the DH frames: each link with all that hangs on it up to the next joint."""
        bodies = []
        for joint, to_dh in zip(self.joints, self.to_dh, strict=True):
            parts = [
                (joint.child, np.eye(4)),
                *((o.child, p) for o, p in self.urdf.behind(joint.child, self.names)),
            ]
            there = [moved(body, pose) for link, pose in parts if (body := self.urdf.bodies[link])]
            whole = body_of(sum((body.parameters() for body in there), np.zeros(10)))
            bodies.append(moved(whole, np.linalg.inv(to_dh).astype(np.float64)))
        return Prior(links=tuple(bodies))


def attached(path: Path, robot: Robot) -> Attached:
    """Find the arm of a robot file in a URDF: joints by name, frames by comparing poses.

    Raises:
        WrongUrdf: joints are missing, or the geometry is another one.
    """
    urdf = read_urdf(path)
    names = _names(urdf, robot)
    known = {joint.name: joint for joint in urdf.joints}
    chain = urdf.chain(urdf.root, known[names[-1]].child)
    if [joint.name for joint in chain if joint.moves] != list(names):
        moving = ", ".join(joint.name for joint in chain if joint.moves)
        raise WrongUrdf(
            f"{path}: the joints up to '{names[-1]}' are {moving}; the robot file has {', '.join(names)}",
            where=str(path),
        )
    misses = []
    for mapping in _maps(robot):
        to_dh, miss = _compared(chain, robot, mapping)
        if miss.max() < SAME_ARM:
            return Attached(urdf, names, mapping, to_dh)
        misses.append(miss)
    best = min(misses, key=lambda miss: float(miss.max()))
    worst = int(np.argmax(best > SAME_ARM))
    raise WrongUrdf(
        f"{path}: joint '{names[worst]}' is not where the robot file's DH table has it (off by {best[worst]:.3g} m)",
        where=str(path),
        why="bodies would be put into the wrong frames",
        fix="give signs and offsets under `simulator:` and the base's pose under `base:` in the robot file",
    )


def _names(urdf: Urdf, robot: Robot) -> tuple[str, ...]:
    there = {joint.name for joint in urdf.joints if joint.moves}
    for names in (robot.joint_names, robot.log_names):
        if set(names) <= there:
            return names
    missing = ", ".join(name for name in robot.joint_names if name not in there)
    raise WrongUrdf(
        f"{urdf.path} has no joint {missing}; it has {', '.join(sorted(there))}",
        where=str(urdf.path),
    )


def _maps(robot: Robot) -> list[JointMap]:
    same = JointMap((1.0,) * robot.n, (0.0,) * robot.n)
    return [same, *(each for each in (robot.simulator, robot.driver and robot.driver.map) if each)]


def _compared(
    chain: tuple[UrdfJoint, ...], robot: Robot, mapping: JointMap
) -> tuple[tuple[Floats, ...], Floats]:
    """Return the DH frames in the links' frames, and by how much each moves there, which it must not, (n,)."""
    rng = np.random.default_rng(0)
    seen: list[list[Floats]] = [[] for _ in range(robot.n)]
    for q in [np.zeros(robot.n), *rng.uniform(-1.5, 1.5, (3, robot.n))]:
        dh = link_frames(
            robot, np.array(mapping.sign) * q + np.array(mapping.offset), world=True
        ).poses
        pose, j = np.eye(4), 0
        for joint in chain:
            pose = pose @ joint.transform(float(q[j]) if joint.moves else 0.0)
            if joint.moves:
                seen[j].append(np.linalg.inv(pose) @ dh[j])
                j += 1
    miss = np.array([max(float(np.abs(other - own[0]).max()) for other in own[1:]) for own in seen])
    return tuple(own[0] for own in seen), miss


def rewritten(path: Path, arm: IdentifiedArm, full: FullModel) -> str:
    """Return the text of a URDF with the inertial blocks of the identified links replaced.

    Args:
        path: the URDF.
        arm: what is written.
        full: its bodies.
    """
    place = attached(path, arm.robot)
    new: dict[str, tuple[Body, str]] = {}
    for i, (joint, body) in enumerate(zip(place.joints, full.bodies, strict=True), start=1):
        own, emptied = _own_share(place, joint.child, moved(body, place.to_dh[i - 1]))
        new[joint.child] = (own, full.origin_of_link(i))
        for link in emptied:
            new[link] = (
                Body(0.0),
                f"its mass is in {joint.child}: link {i} was identified as one body",
            )
        for link in _empty_frames(place, joint.child):
            new[link] = (Body(0.0), "an empty frame: without this block PyBullet gives it 1 kg")
    return _replaced(path, new, arm.head(str))


def _empty_frames(place: Attached, link: str) -> list[str]:
    """Return the links without a body that are fixed to a link."""
    urdf, stop = place.urdf, [joint.name for joint in place.urdf.joints if joint.moves]
    return [joint.child for joint, _ in urdf.behind(link, stop) if urdf.bodies[joint.child] is None]


def _own_share(place: Attached, link: str, body: Body) -> tuple[Body, list[str]]:
    """Return a link's body without what hangs on it, and the links that had to be emptied."""
    urdf = place.urdf
    behind = urdf.behind(link, stop=place.names)
    parts = [
        (joint.child, moved(part, pose), joint)
        for joint, pose in behind
        if (part := urdf.bodies[joint.child])
    ]
    rest = body_of(
        body.parameters() - sum((part.parameters() for _, part, _ in parts), np.zeros(10))
    )
    if not parts or smallest_eigenvalue(rest) > -NOTHING or smallest_eigenvalue(body) <= 0:
        return rest, []
    own_joint = {joint.child for joint, _ in behind if joint.moves}
    free = {joint.child for joint, _ in behind if joint.parent in own_joint} | own_joint
    kept = [part for name, part, _ in parts if name in free]
    rest = body_of(body.parameters() - sum((part.parameters() for part in kept), np.zeros(10)))
    if smallest_eigenvalue(rest) <= -NOTHING:
        raise NotPhysical(
            f"what moves on link '{link}' by itself ({', '.join(sorted(free))}) is heavier than the identified body"
        )
    return rest, [name for name, _, _ in parts if name not in free]


def _replaced(path: Path, new: dict[str, tuple[Body, str]], head: str) -> str:
    """Splice new inertial blocks into the text; offsets come from the XML parser, so that nothing else is touched."""
    raw = path.read_bytes()
    cuts = _places(raw)
    pieces: list[tuple[int, int, bytes]] = []
    for link, (body, note) in new.items():
        start, end, indent = cuts[link]
        text = _inertial(body, note, indent)
        if start == end:
            opening = raw[:start]
            if opening.endswith(b"/>"):
                start, text = start - 2, f">{text}\n{indent[:-2]}</link>"
            pieces.append((start, end, text.encode()))
        else:
            pieces.append((start, end, text.strip().encode()))
    first = re.search(rb"<robot\b", raw)
    assert first is not None
    names = ", ".join(new)
    comment = f"<!--{xml_comment(f'inertial blocks of {names} by dynid: {head}')}-->\n"
    pieces.append((first.start(), first.start(), comment.encode()))
    for start, end, text_bytes in sorted(pieces, reverse=True):
        raw = raw[:start] + text_bytes + raw[end:]
    return raw.decode("utf-8")


def _places(raw: bytes) -> dict[str, tuple[int, int, str]]:
    """Return for each link the bytes of its inertial block, or the place for one, and its indentation."""
    parser = expat.ParserCreate()
    stack: list[str] = []
    found: dict[str, tuple[int, int, str]] = {}
    open_link, start = "", 0

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal open_link, start
        stack.append(tag)
        if stack == ["robot", "link"]:
            open_link = attributes["name"]
            end = raw.index(b">", parser.CurrentByteIndex) + 1
            found[open_link] = (end, end, _indent(raw, parser.CurrentByteIndex) + "  ")
        elif stack == ["robot", "link", "inertial"]:
            start = parser.CurrentByteIndex

    def finish(tag: str) -> None:
        if stack == ["robot", "link", "inertial"]:
            end = raw.index(b">", parser.CurrentByteIndex) + 1
            found[open_link] = (start, end, _indent(raw, start))
        stack.pop()

    parser.StartElementHandler, parser.EndElementHandler = begin, finish
    parser.Parse(raw, True)
    return found


def _indent(raw: bytes, at: int) -> str:
    line = raw[raw.rfind(b"\n", 0, at) + 1 : at]
    return line.decode() if not line.strip() else "    "


def _inertial(body: Body, note: str, indent: str) -> str:
    names = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    tensor = " ".join(
        f'{name}="{value!r}"'
        for name, value in zip(names, map(float, body.inertia_com), strict=True)
    )
    lines = (
        "<inertial>",
        f"  <!--{xml_comment(note)}-->",
        f'  <origin xyz="{numbers(body.com)}" rpy="0 0 0"/>',
        f'  <mass value="{float(body.mass)!r}"/>',
        f"  <inertia {tensor}/>",
        "</inertial>",
    )
    return "\n" + "\n".join(indent + line for line in lines)
