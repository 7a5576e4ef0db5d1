"""What a motion will do, before the arm does it: limits, clearance and torques of the very samples that are played.

The checks are those of the planner; here they include the approach, at the speed and as often as it will be played.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynid.errors import LimitBroken, PackageMissing
from dynid.motion import Motion
from dynid.progress import stage
from dynid.record import tuning
from dynid.record.playing import PlayedMotion
from dynid.robot import Robot
from dynid.trajectory.clearance import Capsules, tool_speed
from dynid.trajectory.feasible import bounds
from dynid.trajectory.limits import (
    Torque,
    fitting_alpha,
    floor2,
    joint_violations,
    raise_worst,
)
from dynid.trajectory.preview import measure_poses, require_clear
from dynid.trajectory.scene import Distance, Scene

APPROACH_FIX = (
    "drive the arm nearer to the start by hand or joystick: the approach moves all joints at once"
)


@dataclass(frozen=True)
class Forecast:
    """What a motion will do, as checked before the arm moved.

    Attributes:
        seconds: length of all that is played [s].
        approach_seconds: length of the slow approach at its beginning [s].
        fastest_joint: name of the joint that moves fastest.
        speed_rad_s: its speed [rad/s or m/s].
        tool_speed_m_s: largest speed of the last frame [m/s].
        closest_m: least distance to anything [m]; None where nothing is measured.
        torque_share: largest predicted share of a torque rating; None where nothing can be said.
        torque_by: what predicts the torques: a file of parameters, or ``"prior"``.
    """

    seconds: float
    approach_seconds: float
    fastest_joint: str
    speed_rad_s: float
    tool_speed_m_s: float
    closest_m: float | None
    torque_share: float | None
    torque_by: str


@dataclass(frozen=True)
class TorqueForecaster:
    """What predicts torques before a motion.

    Attributes:
        torque: predicted torques of a motion, (N, n) [N m or N]; None where nothing can be said.
        words: what predicts them, or why nothing does.
        source: for the manifest: a file of parameters, or ``"prior"``.
    """

    torque: Torque | None
    words: str
    source: str


def forecast(
    robot: Robot,
    played: PlayedMotion,
    scene: Scene,
    forecaster: TorqueForecaster,
    urdf: Path | None = None,
) -> Forecast:
    """Judge limits, clearance and torques of what will be played.

    Args:
        robot: the arm.
        played: approach, motion, repetitions.
        scene: what surrounds the arm.
        forecaster: predicts the torques.
        urdf: shapes that the motion was planned with; cylinders along the DH table when None.

    Raises:
        LimitBroken: a joint limit or a torque (E501).
        Collision: links, floor or obstacles come too near (E502).
    """
    joint, speed = check_limits(robot, played)
    text = "position, velocity and acceleration of every sample are inside the limits"
    stage("limits", text)
    near = check_clearance(robot, played, scene, urdf)
    tool = float(tool_speed(robot, played.motion.q, played.motion.qd).max())
    text = f"tool up to {tool:.2f} m/s"
    if near:
        where = f"{near[0].pair}, {1e3 * near[0].distance:.0f} mm at t = {near[0].time:.1f} s"
        text = f"closest {where}; {text}"
    stage("clearance", text)
    return Forecast(
        seconds=float(played.motion.t[-1]),
        approach_seconds=played.approach,
        fastest_joint=joint,
        speed_rad_s=speed,
        tool_speed_m_s=tool,
        closest_m=near[0].distance if near else None,
        torque_share=check_torque(robot, played, forecaster),
        torque_by=forecaster.source,
    )


def check_limits(robot: Robot, played: PlayedMotion) -> tuple[str, float]:
    """Check the samples against the joints' limits; return the fastest joint and its speed.

    Raises:
        LimitBroken: a limit is broken, the motion does not begin and end at rest, or its rates are not its derivatives.
    """
    motion = played.motion
    _check_consistent(motion)
    # A joint without end may have been turned further than a plan would turn it.
    endless = (-np.inf, np.inf)
    lower, upper = robot.travel(endless, endless)
    moved = {"position": motion.q, "velocity": motion.qd, "acceleration": motion.qdd}
    series = {key: [(motion.t, own) for own in values.T] for key, values in moved.items()}
    limits = replace(bounds(robot), lower=lower, upper=upper)
    raise_worst(joint_violations(robot, limits, series, played.speed), 0.0, _speed)
    peaks = np.abs(motion.qd).max(axis=0)
    return robot.joint_names[int(peaks.argmax())], float(peaks.max())


def _speed(alpha: float) -> str:
    """Return the option that plays a motion at a share of its speed."""
    return f"--speed {floor2(100 * alpha):g}%"


def _check_consistent(motion: Motion) -> None:
    step, wrong = np.diff(motion.t), ""
    if not all(np.isfinite(part).all() for part in vars(motion).values()):
        wrong = "the motion has values that are not a number"
    elif len(step) == 0 or step.min() <= 0:
        wrong = "the motion's time does not increase"
    elif np.abs(motion.qd[[0, -1]]).max() > 1e-3:
        wrong = "the motion does not begin and end at rest"
    else:
        # Why: positions and velocities are sent to different drivers; they must be the same motion on all of them.
        moved = np.diff(motion.q, axis=0) - 0.5 * (motion.qd[1:] + motion.qd[:-1]) * step[:, None]
        if np.abs(moved).max() > 1e-4 + np.abs(motion.qdd).max() * step.max() ** 2:
            wrong = "the motion's velocities are not the change of its positions"
    if wrong:
        raise LimitBroken(wrong, fix="plan it again")


def check_clearance(
    robot: Robot, played: PlayedMotion, scene: Scene, urdf: Path | None = None
) -> tuple[Distance, ...]:
    """Refuse a motion that comes too near to the arm itself, the floor or an obstacle, as the planner would.

    Args:
        robot: the arm.
        played: what will be played.
        scene: what surrounds the arm.
        urdf: shapes that the motion was planned with; cylinders along the DH table when None.

    Returns:
        The least distances, the closest first; those of capsules where PyBullet is missing.

    Raises:
        Collision: with the pair, the time, the distance and what would pass.
    """
    motion = played.motion
    few = np.unique(np.linspace(0, len(motion) - 1, tuning.CLEARANCE_POSES).astype(int))
    t, q, capsules = motion.t[few], motion.q[few], Capsules(robot, scene)
    try:
        distances = measure_poses(t, q, capsules, urdf)
    except PackageMissing:
        distances = capsules.distances(q, t)
    require_clear(
        (d for d in distances if d.time < played.approach),
        fix=APPROACH_FIX,
        slack=tuning.CLEARANCE_SLACK_M,
    )
    require_clear(distances, slack=tuning.CLEARANCE_SLACK_M)
    return tuple(d for d in distances if not d.usual)


def check_torque(robot: Robot, played: PlayedMotion, forecaster: TorqueForecaster) -> float | None:
    """Refuse a motion whose predicted torques come near the ratings; return the largest share of a rating.

    Args:
        robot: the arm.
        played: what will be played.
        forecaster: predicts the torques.

    Returns:
        None where nothing predicts torques, or no joint has a rating.

    Raises:
        LimitBroken: with joint, torque, time, and the speed that would pass.
    """
    rating = robot.limits("torque")
    if forecaster.torque is None or not np.isfinite(rating).any():
        unrated = "the robot file has no ratings"
        stage("forecast", f"no torques: {unrated if forecaster.torque else forecaster.words}")
        return None
    some = slice(None, None, 1 + len(played.motion) // tuning.TORQUE_POSES)
    motion = Motion(*(x[some] for x in vars(played.motion).values()))
    tau, limit = forecaster.torque(motion), tuning.PREDICTED_TORQUE_SHARE * rating
    if np.any(np.abs(tau) > limit):
        alpha = fitting_alpha(motion, limit, forecaster.torque)
        slower = None if alpha is None else alpha * played.speed
        drives = {"torque": [(motion.t, own) for own in tau.T]}
        violations = joint_violations(robot, replace(bounds(robot), torque=limit), drives, slower)
        raise_worst(violations, 1 - tuning.PREDICTED_TORQUE_SHARE, _speed)
    share = np.abs(tau) / rating
    k, j = np.unravel_index(share.argmax(), share.shape)
    largest = float(share[k, j])
    where = f"{robot.joint_names[j]} at t = {motion.t[k]:.1f} s"
    stage(
        "forecast",
        f"torques up to {100 * largest:.0f} % of the rating ({where}), by {forecaster.words}",
    )
    return largest
