"""trajectory.npz and its exports: a planned motion with its coefficients, its samples, and who has reviewed it.

Also CSV with a header, and a ``trajectory_msgs/JointTrajectory`` in YAML for drivers and MoveIt, of ROS 1 and of ROS 2.
"""

from __future__ import annotations

import getpass
import hashlib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.disk import write_text
from dynid.errors import NotAnArtifact
from dynid.files.artifact import read_artifact, reading
from dynid.files.convert import write_columns
from dynid.motion import Motion
from dynid.npz import write_artifact
from dynid.robot import Robot
from dynid.text import yaml_word

SCHEMA = "dynid/trajectory/1"


@dataclass(frozen=True)
class Review:
    """Who accepted a motion after seeing it.

    Attributes:
        by: the person.
        when: date and time, ISO 8601.
        motion: ``motion_hash`` of the motion that was accepted.
        seen: whether there was a picture of it to see.
    """

    by: str
    when: str
    motion: str
    seen: bool = True

    @classmethod
    def now(cls, motion: Motion, *, seen: bool = True) -> Review:
        """Return the mark of the person at this machine, who has just seen a motion, or accepts it unseen."""
        return cls(
            person(),
            datetime.now().astimezone().isoformat(timespec="seconds"),
            motion_hash(motion),
            seen,
        )


def person() -> str:
    """Return the name of the person at this machine."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return "unknown"


@dataclass(frozen=True)
class StoredTrajectory:
    """A planned motion on disk.

    Attributes:
        robot: name of the robot.
        joints: joint names in the order of the columns.
        motion: the motion in DH quantities, sampled evenly from rest to rest.
        alpha: speed factor that the samples already contain.
        basis: family of motions, as ``dynid.trajectory.basis.basis_from`` reads it.
        coefficients: of the family, at full speed, (k, n).
        review: who accepted it; None when it was not accepted.
        facts: further JSON-able facts: limits used, prediction, distances, options, hashes of inputs.
        source: the file it was read from; None for one that was just planned.
    """

    robot: str
    joints: tuple[str, ...]
    motion: Motion
    alpha: float
    basis: Mapping[str, Any]
    coefficients: Floats
    review: Review | None = None
    facts: Mapping[str, Any] = field(default_factory=dict)
    source: Path | None = None

    @property
    def reviewed(self) -> bool:
        """Whether a person accepted exactly this motion."""
        return self.review is not None and self.review.motion == motion_hash(self.motion)

    def accepted(self, *, seen: bool = True, **facts: Any) -> StoredTrajectory:  # noqa: ANN401
        """Return the motion with the mark of the person at this machine, who has seen it or not, and changed facts."""
        return replace(
            self, review=Review.now(self.motion, seen=seen), facts={**self.facts, **facts}
        )


def motion_hash(motion: Motion) -> str:
    """Return the sha256 of a motion's samples: what was seen is what may run."""
    arrays = (np.asarray(x, "<f8").tobytes() for x in vars(motion).values())
    return hashlib.sha256(b"".join(arrays)).hexdigest()


def write_trajectory(path: Path, stored: StoredTrajectory) -> None:
    """Write trajectory.npz."""
    review, motion = stored.review, stored.motion
    header = {
        **stored.facts,
        "robot": stored.robot,
        "joints": list(stored.joints),
        "alpha": stored.alpha,
        "basis": dict(stored.basis),
        "duration_s": float(motion.t[-1]),
        "motion_sha256": motion_hash(motion),
        "reviewed": review is not None,
        "review": review and asdict(review),
    }
    arrays = {**vars(motion), "coefficients": stored.coefficients}
    write_artifact(path, SCHEMA, header, arrays)


def read_trajectory(path: Path, robot: Robot | None = None) -> StoredTrajectory:
    """Read trajectory.npz.

    Args:
        path: the file.
        robot: arm whose joints it must have; any when None.

    Raises:
        NotAnArtifact: not a trajectory, or damaged: the samples are not those that the header names.
        JointCountDiffers: it belongs to another arm.
    """
    artifact = read_artifact(path, SCHEMA)
    header, arrays = dict(artifact.header), artifact.arrays
    with reading(path):
        motion = Motion(*(arrays[key] for key in ("t", "q", "qd", "qdd")))
        review = header.pop("review")
        stored = StoredTrajectory(
            robot=header.pop("robot"),
            joints=tuple(header.pop("joints")),
            motion=motion,
            alpha=float(header.pop("alpha")),
            basis=header.pop("basis"),
            coefficients=arrays["coefficients"],
            review=None if review is None else Review(**review),
            facts=header,
            source=path,
        )
    if len(motion.t) < 2:
        raise NotAnArtifact(f"{path}: {len(motion.t)} samples are too few for a motion", where=path)
    if header["motion_sha256"] != motion_hash(motion):
        raise NotAnArtifact(f"{path}: the samples were changed after planning", where=path)
    if robot is not None:
        robot.require_joints(stored.joints, path)
    return stored


def write_csv(path: Path, joints: tuple[str, ...], motion: Motion) -> None:
    """Write a motion as CSV in DH quantities, with the columns of a CSV log and ``qdd_<name>``."""
    columns = {"t": motion.t}
    for kind in ("q", "qd", "qdd"):
        parts = zip(joints, getattr(motion, kind).T, strict=True)
        columns |= {f"{kind}_{name}": values for name, values in parts}
    write_columns(path, columns)


#: How ROS 1 and ROS 2 spell the head of a message and a duration.
_SPELT = {
    1: ("header: {seq: 0, stamp: {secs: 0, nsecs: 0}, frame_id: ''}", "{secs: %d, nsecs: %d}"),
    2: ("header: {stamp: {sec: 0, nanosec: 0}, frame_id: ''}", "{sec: %d, nanosec: %d}"),
}


def write_joint_trajectory(
    path: Path, robot: Robot, motion: Motion, *, ros: int = 1, goal: bool = False
) -> None:
    """Write a motion as ``trajectory_msgs/JointTrajectory`` in YAML, with the driver's joint names, signs and offsets.

    Every point has velocities and accelerations of the full length: some drivers index them without looking.

    Args:
        path: the file.
        robot: the arm.
        motion: the motion in DH quantities.
        ros: 1 or 2, which spell times differently.
        goal: whether it is the goal of a ``FollowJointTrajectory`` action, with the controller's own tolerances.
    """
    sign, offset = np.array(robot.columns.map.sign), np.array(robot.columns.map.offset)
    names = ", ".join(map(yaml_word, robot.log_names))
    header, duration = _SPELT[ros]
    lines = [header, f"joint_names: [{names}]", "points:"]
    for t, q, qd, qdd in zip(*vars(motion).values(), strict=True):
        lines += [
            f"- positions: {_row((q - offset) * sign)}",
            f"  velocities: {_row(qd * sign)}",
            f"  accelerations: {_row(qdd * sign)}",
            "  effort: []",
            f"  time_from_start: {duration % divmod(round(float(t) * 1e9), 10**9)}",
        ]
    if goal:
        lines = ["trajectory:", *(f"  {line}" for line in lines)]
    write_text(path, "\n".join([*lines, ""]))


def _row(values: Floats) -> str:
    return "[" + ", ".join(f"{value + 0.0:.9f}" for value in values) + "]"
