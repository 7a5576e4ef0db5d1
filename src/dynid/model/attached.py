"""The arm of a robot file in a URDF: its joints, their values, and where the DH frames are in its links."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.arrays import Floats
from dynid.errors import WrongUrdf
from dynid.files.urdffile import Urdf, UrdfJoint, read_urdf, wrong_urdf
from dynid.model.kinematics import link_frames
from dynid.model.parameters import body_of, moved
from dynid.robot import Body, JointMap, Prior, Robot

#: The URDF and the DH table count as the same arm when their frames agree to this [m and rad].
SAME_ARM = 1e-4


@dataclass(frozen=True)
class Attached:
    """How a URDF's chain lies relative to the DH frames.

    Attributes:
        urdf: the file.
        joints: its joints, base to tip, in the order of the robot file.
        mapping: q_dh = sign * q_urdf + offset.
        to_dh: pose of each DH frame in the frame of the URDF's link, n of (4, 4).
    """

    urdf: Urdf
    joints: tuple[UrdfJoint, ...]
    mapping: JointMap
    to_dh: tuple[Floats, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the joints."""
        return tuple(joint.name for joint in self.joints)

    def prior(self) -> Prior:
        """Return the file's bodies in the DH frames: each link with all that hangs on it up to the next joint."""
        bodies = []
        for joint, to_dh in zip(self.joints, self.to_dh, strict=True):
            total = carried(self.urdf, joint.child, self.names)
            bodies.append(moved(total, np.asarray(np.linalg.inv(to_dh))))
        return Prior(links=tuple(bodies))


def hanging(urdf: Urdf, link: str, stop: Sequence[str]) -> dict[str, Floats]:
    """Return the parameters, in a link's frame, of the bodies that hang on it up to some joints, by link."""
    return {
        joint.child: moved(body, pose).parameters()
        for joint, pose in urdf.behind(link, stop)
        if (body := urdf.bodies[joint.child])
    }


def carried(urdf: Urdf, link: str, stop: Sequence[str]) -> Body:
    """Return a link with all that hangs on it as one body."""
    own = urdf.bodies[link] or Body(0.0)
    return body_of(sum(hanging(urdf, link, stop).values(), own.parameters()))


def attached(path: Path, robot: Robot, within: float = SAME_ARM) -> Attached:
    """Find the arm of a robot file in a URDF: joints by name, frames by comparing poses.

    Args:
        path: the URDF.
        robot: the arm.
        within: how far frames may be off [m and rad].

    Raises:
        WrongUrdf: joints are missing, or the geometry is another one.
    """
    urdf = read_urdf(path)
    names, known = _names(urdf, robot), {joint.name: joint for joint in urdf.joints}
    chain = urdf.chain(urdf.root, known[names[-1]].child)
    if [joint.name for joint in chain if joint.name in names] != list(names):
        moving = ", ".join(joint.name for joint in chain if joint.moves)
        text = (
            f": the joints up to '{names[-1]}' are {moving}; the robot file has {', '.join(names)}"
        )
        raise wrong_urdf(path, text)
    errors, same = [], JointMap((1.0,) * robot.n, (0.0,) * robot.n)
    maps = (same, robot.simulator, robot.driver.map if robot.driver else None)
    for mapping in filter(None, maps):
        to_dh, miss = _compared(urdf, chain, robot, names, mapping)
        if miss.max() < within:
            return Attached(urdf, tuple(known[name] for name in names), mapping, tuple(to_dh))
        errors.append(miss)
    best = min(errors, key=np.max)
    worst = np.argmax(best > within)
    raise WrongUrdf(
        f"{path}: joint '{names[worst]}' is not where the robot file's DH table has it (off by {best[worst]:.3g} m)",
        where=path,
        why="its links would be put into the wrong places",
        fix="give signs and offsets under `simulator:` and the base's pose under `base:` in the robot file",
    )


def _names(urdf: Urdf, robot: Robot) -> tuple[str, ...]:
    there = {joint.name for joint in urdf.joints if joint.moves}
    for names in (robot.joint_names, robot.log_names):
        if set(names) <= there:
            return names
    missing = ", ".join(name for name in robot.joint_names if name not in there)
    raise wrong_urdf(urdf.path, f" has no joint {missing}; it has {', '.join(sorted(there))}")


def _compared(
    urdf: Urdf,
    chain: tuple[UrdfJoint, ...],
    robot: Robot,
    names: Sequence[str],
    mapping: JointMap,
) -> tuple[Floats, Floats]:
    """Return the DH frames in the links' frames, and by how much each moves there, which it must not, (n,)."""
    q = np.random.default_rng(0).uniform(-1.5, 1.5, (4, robot.n))
    q[0] = 0.0
    ends, links = [joint.child for joint in chain if joint.name in names], []
    for row in q:
        known = dict(zip(names, row, strict=True))
        values = [known.get(joint.name, 0.0) for joint in chain if joint.moves]
        poses = urdf.poses(urdf.root, ends[-1], values)
        links.append([poses[link] for link in ends])
    there = np.array(mapping.sign) * q + np.array(mapping.offset)
    to_dh = np.linalg.inv(links) @ link_frames(robot, there, world=True).poses
    return to_dh[0], np.abs(to_dh - to_dh[0]).max(axis=(0, 2, 3))
