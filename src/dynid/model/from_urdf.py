"""From a chain of a URDF to a DH table: common normals of successive joint axes, bodies moved into the DH frames.

Joint values stay those of the URDF: z points along the joint's axis and ``theta_offset`` takes up the rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from dynid.arrays import Floats
from dynid.errors import Finding
from dynid.files.robotkeys import snapped
from dynid.files.urdffile import MOVING, Urdf, UrdfJoint, wrong_urdf
from dynid.model import tuning
from dynid.model.attached import carried
from dynid.model.kinematics import link_frames, pose_of
from dynid.model.parameters import inertia_of, moved, second_moments
from dynid.robot import MOST_JOINTS, Body, Joint, Prior, Robot, roll_pitch_yaw

_GRAVITY = 9.81
#: What is said of links of a URDF whose bodies are not taken as they are.
IMPOSSIBLE = (
    "the URDF's inertia of link {} is physically impossible (a principal moment exceeds "
    "the sum of the other two): the prior takes the nearest possible one"
)
MASSLESS = (
    "the URDF has no mass for link {}: dynid starts from a light cylinder there; "
    "give the prior a mass if you know one"
)


@dataclass(frozen=True)
class Imported:
    """A robot made from a URDF.

    Attributes:
        robot: the arm.
        base: link that carries the first joint.
        tip: link at the end.
        tip_pose: pose of the tip's frame in the last DH frame, (4, 4).
        largest: largest difference of the tip's pose from the URDF's over random configurations [m and rad]; more than
            rounding where the URDF's angles are rounded, which the table's are not.
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
    link, ahead, count = start, _next_moving(urdf, start), 0
    while len(ahead) == 1:
        link, count = ahead[0].child, count + 1
        ahead = _next_moving(urdf, link)
    # Why: what hangs on an arm is a hand of short fingers; branches longer than the way to them are arms of their own.
    if not count or any(_longest(urdf, joint) > count for joint in ahead):
        moving = (joint.child for joint in urdf.joints if joint.moves)
        tips = ", ".join(end for end in moving if not _next_moving(urdf, end))
        raise wrong_urdf(
            urdf.path,
            f": the joints fork at link '{link}'; the arm may end at {tips or 'no link: no joint moves'}",
            "name the last link of the arm with --tip LINK, and its first with --base LINK (dynid import)",
        )
    while not ahead:
        fixed = [joint for joint in urdf.joints if joint.parent == link and not joint.moves]
        if len(fixed) != 1:
            break
        link = fixed[0].child
    return start, link


def _longest(urdf: Urdf, joint: UrdfJoint) -> int:
    """Return the number of moving joints in the longest chain that begins with one."""
    return 1 + max((_longest(urdf, one) for one in _next_moving(urdf, joint.child)), default=0)


def _next_moving(urdf: Urdf, link: str) -> list[UrdfJoint]:
    """Return the moving joints that hang on a link, directly or behind fixed ones."""
    moving = {joint.name: joint for joint in urdf.joints if joint.moves}
    here = {link, *(joint.child for joint, _ in urdf.behind(link, moving))}
    return [joint for joint in moving.values() if joint.parent in here]


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
    moving = _moving(urdf, urdf.chain(start, end))
    poses = urdf.poses(start, end)
    axes = [
        (poses[joint.child][:3, 3], poses[joint.child][:3, :3] @ joint.axis) for joint in moving
    ]
    frame0, rows = dh_rows(axes, poses[start], poses[end])
    joints = tuple(_joint(joint, rows, i, convention) for i, joint in enumerate(moving))
    R0 = frame0[:3, :3]
    gx, gy, gz = (_clean(value) for value in (R0.T @ [0.0, 0.0, -_GRAVITY]).tolist())
    x, y, z = frame0[:3, 3].tolist()
    robot = Robot(
        name or urdf.name, convention, joints, (gx, gy, gz), (x, y, z), roll_pitch_yaw(R0)
    )
    dh = frame0 @ link_frames(robot, np.zeros(robot.n)).poses
    bodies, findings = _bodies(urdf, moving, dh, poses)
    if any(body.mass for body in bodies):
        robot = replace(robot, prior=Prior(links=bodies))
    tip_pose = np.linalg.inv(dh[-1]) @ poses[end]
    configurations = np.random.default_rng(0).uniform(-3.0, 3.0, (101, robot.n))
    configurations[0] = 0.0
    tips = frame0 @ link_frames(robot, configurations).poses[:, -1] @ tip_pose
    largest = np.abs(tips - [raw.poses(start, end, q)[end] for q in configurations]).max()
    return Imported(robot, start, end, tip_pose, float(largest), tuple(findings))


def _moving(urdf: Urdf, chain: Sequence[UrdfJoint]) -> list[UrdfJoint]:
    """Return the joints of a chain that move.

    Raises:
        WrongUrdf: one is of another kind, none moves, or too many do.
    """
    moving = [joint for joint in chain if joint.moves]
    what = fix = ""
    if other := next((joint for joint in chain if joint.type not in (*MOVING, "fixed")), None):
        what = f"joint '{other.name}' is {other.type}; a DH table has turning and sliding joints"
    elif not moving:
        what = "no joint moves between the ends of the chain"
    # Why here: a robot file with more joints would be written, and be refused by the next command.
    elif len(moving) > MOST_JOINTS:
        what = f"{len(moving)} joints move; a robot has at most {MOST_JOINTS}"
        fix = "choose a part of the chain with --base and --tip"
    if what:
        raise wrong_urdf(urdf.path, f": {what}", fix)
    return moving


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
    x = next(part for part in (_across(base[:3, k], z) for k in (0, 1)) if part is not None)
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
        along, back, _ = np.linalg.solve(np.transpose([z, other, normal]), point - origin)
        foot, next_foot = origin + along * z, point - back * other
    return foot, next_foot, -normal if normal @ x < -tuning.ZERO_LENGTH_M else normal


def _across(direction: Floats, z: Floats) -> Floats | None:
    """Return the part of a direction across z as a unit vector, None when it is along z."""
    rest = direction - z * (z @ direction)
    size = float(np.linalg.norm(rest))
    return None if size < 1e-6 else rest / size


def _frame(x: Floats, z: Floats, origin: Floats) -> Floats:
    # Why plus zero: rounding makes -0 of a small negative number.
    return np.round(pose_of(np.transpose([x, np.cross(z, x), z]), origin), 14) + 0.0


def _angle(a: Floats, b: Floats, axis: Floats) -> float:
    """Return the angle from a to b about an axis; a multiple of 15 degrees where it is one."""
    return snapped(math.atan2(float(np.cross(a, b) @ axis), float(a @ b)), 1e-9)


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
    urdf: Urdf, moving: Sequence[UrdfJoint], dh: Floats, poses: dict[str, Floats]
) -> tuple[tuple[Body, ...], list[Finding]]:
    """Return one body a link in its DH frame: the link's own and all that hangs on it up to the next joint."""
    names, bodies = [joint.name for joint in moving], list[Body]()
    changed, empty = list[str](), list[str]()
    for number, joint in enumerate(moving, start=1):
        pose = np.linalg.inv(dh[number - 1]) @ poses[joint.child]
        body = moved(carried(urdf, joint.child, names), pose)
        bodies.append(possible_body(body))
        changed += [str(number)] * (bodies[-1] != body)
        empty += [str(number)] * (not body.mass)
    said = {
        IMPOSSIBLE.format(", ".join(changed)): changed,
        MASSLESS.format(", ".join(empty)): empty,
    }
    return tuple(bodies), [
        Finding("W210", "warning", text, {"links": links}) for text, links in said.items() if links
    ]


def possible_body(body: Body) -> Body:
    """Return a body with the same mass and centre whose inertia a body can have: itself where it can.

    Second moments of its mass that are negative become small.
    """
    values, axes = np.linalg.eigh(second_moments(body.tensor))
    if values[0] > 0.0 or values[-1] <= 0.0:
        return body
    moments = axes * np.maximum(values, tuning.THINNEST_BODY_SHARE * values[-1]) @ axes.T
    return Body.of(body.mass, np.array(body.com), inertia_of(moments))
