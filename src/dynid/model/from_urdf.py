"""From a chain of a URDF to a DH table: common normals of successive joint axes, bodies moved into the DH frames.

Joint values stay those of the URDF: z points along the joint's axis and ``theta_offset`` takes up the rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, WrongUrdf
from dynid.files.robotkeys import SNAP_STEP
from dynid.files.urdffile import Urdf, UrdfJoint
from dynid.model import tuning
from dynid.model.kinematics import link_frames
from dynid.model.parameters import body_of, inertia_of, moved, second_moments
from dynid.robot import MOST_JOINTS, Body, Joint, Prior, Robot, roll_pitch_yaw

Floats = NDArray[np.float64]

_GRAVITY = 9.81


@dataclass(frozen=True)
class Imported:
    """A robot made from a URDF.

    Attributes:
        robot: the arm.
        base: link that carries the first joint.
        tip: link at the end.
        tip_pose: pose of the tip's frame in the last DH frame, (4, 4).
        largest: largest difference of the tip's pose from the URDF's over random configurations [m and rad].
        findings: what is worth knowing.
    """

    robot: Robot
    base: str
    tip: str
    tip_pose: Floats
    largest: float
    findings: tuple[Finding, ...]


def ends_of(urdf: Urdf, base: str | None, tip: str | None) -> tuple[str, str]:
    """Return the first and last link of the arm; by default from the root to where the chain ends or forks."""
    start = urdf.known_link(base) if base else urdf.root
    if tip:
        return start, urdf.known_link(tip)
    link, count = start, 0
    while True:
        ahead = _next_moving(urdf, link)
        if len(ahead) != 1:
            break
        link, count = ahead[0].child, count + 1
    # Why: what hangs on an arm is a hand of short fingers; branches longer than the way to them are arms of their own.
    if not count or any(_longest(urdf, joint) > count for joint in ahead):
        tips = ", ".join(end for joint in ahead for end in _tips(urdf, joint))
        raise WrongUrdf(
            f"{urdf.path}: the joints fork at link '{link}'; the arm may end at {tips or 'no link: no joint moves'}",
            where=str(urdf.path),
            fix="name the last link of the arm with --tip LINK, and its first with --base LINK (dynid import)",
        )
    while (
        len(fixed := [joint for joint in urdf.joints if joint.parent == link and not joint.moves])
        == 1
        and not ahead
    ):
        link = fixed[0].child
    return start, link


def _tips(urdf: Urdf, joint: UrdfJoint) -> list[str]:
    """Return the last moving link of every chain that begins with a joint."""
    found, waiting = [], [joint]
    while waiting:
        each = waiting.pop()
        ahead = _next_moving(urdf, each.child)
        waiting += reversed(ahead)
        found += [] if ahead else [each.child]
    return found


def _longest(urdf: Urdf, joint: UrdfJoint) -> int:
    """Return the number of moving joints in the longest chain that begins with one."""
    count, layer = 0, [joint]
    while layer:
        count, layer = count + 1, [each for one in layer for each in _next_moving(urdf, one.child)]
    return count


def _next_moving(urdf: Urdf, link: str) -> list[UrdfJoint]:
    """Return the moving joints that hang on a link, directly or behind fixed ones."""
    found, waiting = [], [link]
    while waiting:
        before = waiting.pop()
        ahead = [joint for joint in urdf.joints if joint.parent == before]
        found += [joint for joint in ahead if joint.moves]
        waiting += [joint.child for joint in reversed(ahead) if not joint.moves]
    return found


def import_arm(
    urdf: Urdf,
    raw: Urdf,
    *,
    base: str | None = None,
    tip: str | None = None,
    convention: Literal["standard", "modified"] = "standard",
    name: str | None = None,
) -> Imported:
    """Return the robot that a chain of a URDF describes.

    Args:
        urdf: the file with its rounded angles made exact.
        raw: the same file as it is written, to compare with.
        base: first link; the root when None.
        tip: last link; where the chain ends or forks when None.
        convention: of the DH table.
        name: of the robot.

    Raises:
        WrongUrdf: there is no such chain, or it has joints that a DH table cannot describe, or too many.
    """
    start, end = ends_of(urdf, base, tip)
    chain = urdf.chain(start, end)
    moving = [joint for joint in chain if joint.moves]
    _refuse_others(urdf, chain, moving)
    root = np.eye(4)
    for joint in urdf.chain(urdf.root, start):
        root = root @ joint.origin
    poses = _link_poses(chain, root)
    axes = [
        (poses[joint.child][:3, 3], poses[joint.child][:3, :3] @ joint.axis) for joint in moving
    ]
    frame0, rows = dh_rows(axes, root, poses[end])
    joints = tuple(_joint(joint, rows, i, convention) for i, joint in enumerate(moving))
    R0 = frame0[:3, :3]
    gx, gy, gz = (_clean(value) for value in (R0.T @ [0.0, 0.0, -_GRAVITY]).tolist())
    x, y, z = frame0[:3, 3].tolist()
    robot = Robot(
        name or urdf.name, convention, joints, (gx, gy, gz), (x, y, z), roll_pitch_yaw(R0)
    )
    bodies, findings = _bodies(
        urdf, moving, frame0, link_frames(robot, np.zeros(robot.n)).poses, poses
    )
    robot = (
        replace(robot, prior=Prior(links=bodies)) if any(body.mass for body in bodies) else robot
    )
    tip_pose = np.linalg.inv(frame0 @ link_frames(robot, np.zeros(robot.n)).poses[-1]) @ poses[end]
    own, written = (
        _largest_miss(source, robot, start, end, frame0, tip_pose) for source in (urdf, raw)
    )
    if own > tuning.SAME_POSE:
        raise WrongUrdf(
            f"{urdf.path}: the DH table found misses the URDF's pose by {own:.2g}",
            where=str(urdf.path),
        )
    if written > tuning.SAME_POSE:
        text = f"the URDF's angles are rounded, the DH table's are exact: that moves the tip by {written:.1e} m or rad"
        findings.append(Finding("W202", "warning", text, {"largest": written}))
    return Imported(robot, start, end, tip_pose, written, tuple(findings))


def _refuse_others(urdf: Urdf, chain: Sequence[UrdfJoint], moving: Sequence[UrdfJoint]) -> None:
    where = str(urdf.path)
    for joint in chain:
        if joint.type not in ("revolute", "continuous", "prismatic", "fixed"):
            raise WrongUrdf(
                f"{urdf.path}: joint '{joint.name}' is {joint.type}; a DH table has turning and sliding joints",
                where=where,
            )
    if not moving:
        raise WrongUrdf(f"{urdf.path}: no joint moves between the ends of the chain", where=where)
    # Why here: a robot file with more joints would be written, and be refused by the next command.
    if len(moving) > MOST_JOINTS:
        what = f"{urdf.path}: {len(moving)} joints move; a robot has at most {MOST_JOINTS}"
        raise WrongUrdf(what, where=where, fix="choose a part of the chain with --base and --tip")


def _link_poses(chain: Sequence[UrdfJoint], root: Floats) -> dict[str, Floats]:
    pose, poses = root, {}
    for joint in chain:
        pose = pose @ joint.origin
        poses[joint.child] = pose
    return poses


def dh_rows(
    axes: Sequence[tuple[Floats, Floats]], base: Floats, tip: Floats
) -> tuple[Floats, list[tuple[float, float, float, float]]]:
    """Return frame 0 and theta, d, a, twist of each axis to the next, at q = 0.

    Args:
        axes: a point and the direction of each joint axis, in the world.
        base: pose of the base link: frame 0 lies at the foot of its origin on the first axis.
        tip: pose of the tip link: the last frame lies at the foot of its origin on the last axis.

    Source: Denavit and Hartenberg 1955; parallel axes get d = 0.
    """
    (point, z) = axes[0]
    origin = point + z * (z @ (base[:3, 3] - point))
    x = _across(base[:3, 0], z) if _across(base[:3, 0], z) is not None else _across(base[:3, 1], z)
    assert x is not None
    frame0 = _frame(x, z, origin)
    rows = []
    for next_point, next_z in axes[1:]:
        foot, next_foot, normal = _common_normal(origin, z, next_point, next_z, x)
        turn, rise = _angle(x, normal, z), float((foot - origin) @ z)
        length, twist = float((next_foot - foot) @ normal), _angle(z, next_z, normal)
        rows.append((turn, _clean(rise), _clean(length), twist))
        origin, x, z = next_foot, normal, next_z
    last = _across(tip[:3, 0], z)
    turn = _angle(x, last, z) if last is not None else 0.0
    rows.append((turn, _clean(float((tip[:3, 3] - origin) @ z)), 0.0, 0.0))
    return frame0, rows


def _common_normal(
    origin: Floats, z: Floats, point: Floats, other: Floats, x: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the feet on both axes and the direction of the normal, turned to the side of x."""
    normal = np.cross(z, other)
    size = float(np.linalg.norm(normal))
    if size < tuning.PARALLEL_AXES_RAD:
        foot = origin
        next_foot = point + other * (other @ (foot - point))
        between = next_foot - foot
        between = between - z * (z @ between)
        if np.linalg.norm(between) < tuning.ZERO_LENGTH_M:
            return foot, foot, x
        normal = between / np.linalg.norm(between)
    else:
        normal = normal / size
        gap = point - origin
        foot = origin + z * (np.cross(gap, other) @ np.cross(z, other)) / size**2
        next_foot = point + other * (np.cross(gap, z) @ np.cross(z, other)) / size**2
    return foot, next_foot, -normal if normal @ x < -tuning.ZERO_LENGTH_M else normal


def _across(direction: Floats, z: Floats) -> Floats | None:
    """Return the part of a direction across z as a unit vector, None when it is along z."""
    rest = direction - z * (z @ direction)
    size = float(np.linalg.norm(rest))
    return None if size < 1e-6 else np.asarray(rest / size)


def _frame(x: Floats, z: Floats, origin: Floats) -> Floats:
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, np.cross(z, x), z, origin
    pose[:3] = np.where(np.abs(pose[:3]) < 1e-14, 0.0, pose[:3])
    return pose


def _angle(a: Floats, b: Floats, axis: Floats) -> float:
    """Return the angle from a to b about an axis; a multiple of 15 degrees where it is one."""
    angle = math.atan2(float(np.cross(a, b) @ axis), float(a @ b))
    nearest = round(angle / SNAP_STEP) * SNAP_STEP
    return nearest if abs(angle - nearest) < 1e-9 else angle


def _clean(length: float) -> float:
    return 0.0 if abs(length) < tuning.ZERO_LENGTH_M else round(float(length), 12)


def _joint(
    joint: UrdfJoint, rows: Sequence[tuple[float, float, float, float]], i: int, convention: str
) -> Joint:
    """Return a row of the table; a modified table has the length and twist of the row before."""
    turn, rise, length, twist = rows[i]
    if convention == "modified":
        length, twist = rows[i - 1][2:] if i else (0.0, 0.0)
    kind: Literal["revolute", "prismatic"] = (
        "prismatic" if joint.type == "prismatic" else "revolute"
    )
    return Joint(joint.name, kind, length, twist, rise, turn, joint.limits)


def _bodies(
    urdf: Urdf, moving: Sequence[UrdfJoint], frame0: Floats, dh: Floats, poses: dict[str, Floats]
) -> tuple[tuple[Body, ...], list[Finding]]:
    """Return one body a link in its DH frame: the link's own and all that hangs on it up to the next joint."""
    names = [joint.name for joint in moving]
    bodies, findings = [], []
    for i, joint in enumerate(moving):
        to_dh = np.linalg.inv(frame0 @ dh[i]) @ poses[joint.child]
        parts = [(np.eye(4), joint.child)]
        behind = urdf.behind(joint.child, stop=names)
        parts += [(pose, other.child) for other, pose in behind]
        loose = [other.name for other, _ in behind if other.moves]
        if loose:
            text = f"link {i + 1} carries joints of its own ({', '.join(loose)}): its prior holds with them at zero"
            findings.append(Finding("W210", "info", text, {"link": i + 1, "joints": loose}))
        total = np.zeros(10)
        for pose, link in parts:
            body = urdf.bodies[link]
            if body is not None:
                total += moved(body, to_dh @ pose).parameters()
        bodies.append(body_of(total))
    near = [possible_body(body) if body.mass else body for body in bodies]
    if moved_to := [
        str(i) for i, (a, b) in enumerate(zip(bodies, near, strict=True), start=1) if a != b
    ]:
        text = (
            f"the URDF's inertia of link {', '.join(moved_to)} is physically impossible (a principal moment exceeds "
            "the sum of the other two): the prior takes the nearest possible one"
        )
        findings.append(Finding("W210", "warning", text, {"links": moved_to}))
    bodies = near
    empty = [str(i) for i, body in enumerate(bodies, start=1) if not body.mass]
    if empty:
        text = (
            f"the URDF has no mass for link {', '.join(empty)}: dynid starts from a light cylinder there; "
            "give the prior a mass if you know one"
        )
        findings.append(Finding("W210", "warning", text, {"links": empty}))
    return tuple(bodies), findings


def possible_body(body: Body) -> Body:
    """Return a body with the same mass and centre whose inertia a body can have: itself where it can.

    Second moments of its mass that are negative become small.
    """
    values, axes = np.linalg.eigh(second_moments(body.tensor))
    if values[0] > 0.0 or values[-1] <= 0.0:
        return body
    moments = axes * np.maximum(values, tuning.THINNEST_BODY_SHARE * values[-1]) @ axes.T
    return Body.of(body.mass, np.array(body.com), inertia_of(moments))


def _largest_miss(
    urdf: Urdf, robot: Robot, base: str, tip: str, frame0: Floats, tip_pose: Floats
) -> float:
    """Return the largest difference of the tip's pose between table and URDF at random configurations."""
    rng = np.random.default_rng(0)
    largest = 0.0
    for q in [np.zeros(robot.n), *rng.uniform(-3.0, 3.0, (100, robot.n))]:
        pose = np.eye(4)
        for joint in urdf.chain(urdf.root, base):
            pose = pose @ joint.origin
        values = iter(q.tolist())
        for joint in urdf.chain(base, tip):
            pose = pose @ joint.transform(next(values) if joint.moves else 0.0)
        largest = max(
            largest, float(np.abs(frame0 @ link_frames(robot, q).poses[-1] @ tip_pose - pose).max())
        )
    return largest
