"""The user's own URDF with new inertial blocks: every other byte stays as it is.

What hangs on a moving link by fixed joints, or by joints of its own such as fingers, keeps its block; the link itself
gets the rest of the identified body. Where no such rest exists, fixed parts are emptied and the link carries all.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NotPhysical, WrongUrdf
from dynid.estimation.possible_set import smallest_eigenvalues
from dynid.exporters.code import rendered
from dynid.exporters.full_model import FullModel
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
    """How a URDF's chain lies relative to the DH frames.

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

    def hanging(self, link: str) -> dict[str, Floats]:
        """Return the parameters, in a link's frame, of the bodies that hang on it up to the next joint, by link."""
        return {
            joint.child: moved(body, pose).parameters()
            for joint, pose in self.urdf.behind(link, self.names)
            if (body := self.urdf.bodies[joint.child])
        }

    def prior(self) -> Prior:
        """Return the file's bodies in the DH frames: each link with all that hangs on it up to the next joint."""
        bodies = []
        for joint, to_dh in zip(self.joints, self.to_dh, strict=True):
            own = self.urdf.bodies[joint.child] or Body(0.0)
            total = body_of(sum(self.hanging(joint.child).values(), own.parameters()))
            bodies.append(moved(total, np.asarray(np.linalg.inv(to_dh))))
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
    errors = []
    same = JointMap((1.0,) * robot.n, (0.0,) * robot.n)
    maps = (same, robot.simulator, robot.driver.map if robot.driver else None)
    for mapping in filter(None, maps):
        to_dh, miss = _compared(urdf, chain, robot, mapping)
        if miss.max() < SAME_ARM:
            return Attached(urdf, names, mapping, tuple(to_dh))
        errors.append(miss)
    best = min(errors, key=lambda miss: float(miss.max()))
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


def _compared(
    urdf: Urdf, chain: tuple[UrdfJoint, ...], robot: Robot, mapping: JointMap
) -> tuple[Floats, Floats]:
    """Return the DH frames in the links' frames, and by how much each moves there, which it must not, (n,)."""
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (4, robot.n))
    q[0] = 0.0
    ends = [joint.child for joint in chain if joint.moves]
    poses = (urdf.poses(urdf.root, ends[-1], row) for row in q)
    links = np.array([[each[link] for link in ends] for each in poses])
    there = np.array(mapping.sign) * q + np.array(mapping.offset)
    to_dh = np.linalg.inv(links) @ link_frames(robot, there, world=True).poses
    return np.asarray(to_dh[0]), np.asarray(np.abs(to_dh - to_dh[0]).max(axis=(0, 2, 3)))


def rewritten(path: Path, arm: IdentifiedArm, full: FullModel) -> str:
    """Return the text of a URDF with the inertial blocks of the identified links replaced.

    Args:
        path: the URDF.
        arm: what is written.
        full: its bodies.
    """
    place = attached(path, arm.robot)
    moving = [joint.name for joint in place.urdf.joints if joint.moves]
    new: dict[str, tuple[Body, str]] = {}
    for i, (joint, body) in enumerate(zip(place.joints, full.bodies, strict=True), start=1):
        own, emptied = _own_share(place, joint.child, moved(body, place.to_dh[i - 1]))
        new[joint.child] = (own, full.origin_of_link(i))
        note = f"its mass is in {joint.child}: link {i} was identified as one body"
        new |= dict.fromkeys(emptied, (Body(0.0), note))
        for fixed, _ in place.urdf.behind(joint.child, moving):
            if place.urdf.bodies[fixed.child] is None:
                note = "an empty frame: without this block PyBullet gives it 1 kg"
                new[fixed.child] = (Body(0.0), note)
    return _replaced(path, new, arm.head(str))


def _own_share(place: Attached, link: str, body: Body) -> tuple[Body, list[str]]:
    """Return a link's body without what hangs on it, and the links that had to be emptied."""
    behind, parts = place.urdf.behind(link, place.names), place.hanging(link)
    total = body.parameters()
    rest = total - sum(parts.values())
    if not parts or smallest_eigenvalues(rest) > -NOTHING or smallest_eigenvalues(total) <= 0:
        return body_of(rest), []
    own_joint = {joint.child for joint, _ in behind if joint.moves}
    free = {joint.child for joint, _ in behind if joint.parent in own_joint} | own_joint
    rest = total - sum(part for name, part in parts.items() if name in free)
    if smallest_eigenvalues(rest) <= -NOTHING:
        raise NotPhysical(
            f"what moves on link '{link}' by itself ({', '.join(sorted(free))}) is heavier than the identified body"
        )
    return body_of(rest), [name for name in parts if name not in free]


def _replaced(path: Path, new: dict[str, tuple[Body, str]], head: str) -> str:
    """Splice new inertial blocks into the text, so that nothing else is touched."""
    text = path.read_bytes().decode("utf-8")
    # What is commented out is no element.
    seen = re.sub("<!--.*?-->", lambda found: " " * len(found[0]), text, flags=re.DOTALL)
    comment = xml_comment(f"inertial blocks of {', '.join(new)} by dynid: {head}")
    pieces = [(seen.index("<robot"), seen.index("<robot"), f"<!--{comment}-->\n")]
    for link, (body, note) in new.items():
        name = rf"""<link\s(?:[^>]*?\s)?name\s*=\s*["']{re.escape(escape(link))}["'][^>]*?"""
        element = re.search(rf"{name}(?:/>|>.*?</link\s*>)", seen, re.DOTALL)
        assert element is not None
        own = re.compile(r"<inertial\b.*?</inertial\s*>", re.DOTALL).search(seen, *element.span())
        at = (own or element).start()
        before = text[text.rfind("\n", 0, at) + 1 : at]
        indent, around = before if not before.strip() else "    ", "{}"
        if own:
            start, end = own.span()
        else:
            end = seen.index(">", at) + 1
            start = end - 2 * (closed := seen[end - 2] == "/")
            around = f"\n{indent}  {{}}"
            around = f">{around}\n{indent}</link>" if closed else around
            indent += "  "
        block = rendered("inertial.xml", body=body, note=note).strip().replace("\n", f"\n{indent}")
        pieces.append((start, end, around.format(block)))
    for start, end, piece in sorted(pieces, reverse=True):
        text = text[:start] + piece + text[end:]
    return text
