"""A robot as the text of its file."""

from __future__ import annotations

import math
from typing import Any

from dynid.files.robotfile import SNAP_STEP
from dynid.robot import Body, Joint, Robot


def robot_text(robot: Robot, head: str = "") -> str:
    """Return the robot file of an arm that has geometry, limits and a prior of explicit bodies.

    Args:
        robot: the arm; other keys of the robot file keep their defaults.
        head: comment lines for the top, without ``#``.
    """
    import yaml

    document: dict[str, Any] = {
        "name": robot.name,
        "convention": robot.convention,
        "angle_unit": "rad",
        "gravity": list(robot.gravity),
        "base": {"xyz": list(robot.base_xyz), "rpy": [_angle(angle) for angle in robot.base_rpy]},
        "joints": [_joint(joint) for joint in robot.joints],
    }
    if robot.prior and robot.prior.links:
        document["prior"] = {"links": [_body(body) for body in robot.prior.links]}
    comment = "".join(f"# {line}\n" for line in head.splitlines())
    return (
        f"{comment}{yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=140, default_flow_style=None)}"
    )


def _angle(angle: float) -> float | str:
    """Return an angle, in degrees where it is a multiple of 15: 90 deg is exact, 1.5707963267948966 is not."""
    steps = angle / SNAP_STEP
    return f"{round(steps) * 15} deg" if round(steps) and abs(steps - round(steps)) < 1e-12 else angle + 0.0


def _joint(joint: Joint) -> dict[str, Any]:
    row: dict[str, Any] = {"name": joint.name, "type": joint.type, "a": joint.a, "twist": _angle(joint.twist)}
    row |= {"d": joint.d, "theta_offset": _angle(joint.theta_offset)}
    limits = joint.limits
    known: dict[str, Any] = {"position": list(limits.position) if limits.position else None}
    sizes = {"velocity": limits.velocity, "acceleration": limits.acceleration, "torque": limits.torque}
    known |= {key: value for key, value in sizes.items() if value is not None and math.isfinite(value)}
    return {**row, "limits": known}


def _body(body: Body) -> dict[str, Any]:
    tensor = dict(zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), map(_tidy, body.inertia_com), strict=True))
    return {"mass": float(body.mass), "com": [_tidy(value) for value in body.com], "inertia_com": tensor}


def _tidy(value: float) -> float:
    """Take rounding noise off."""
    return round(float(value), 15) + 0.0
