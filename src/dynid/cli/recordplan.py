"""From a stored trajectory to what ``dynid record`` plays: approach, speed, repetitions, and the judges of all that."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common
from dynid.errors import StartPoseOff, WrongUsage

if TYPE_CHECKING:
    from dynid.cli.record import Options
    from dynid.cli.terminal import Terminal
    from dynid.files.trajectoryfile import StoredTrajectory
    from dynid.record.motion_checks import PlayedMotion
    from dynid.record.preflight import ObservedState
    from dynid.robot import Robot
    from dynid.trajectory.limits import Torque


def motion_to_play(
    terminal: Terminal, arm: Robot, stored: StoredTrajectory, seen: ObservedState, given: Options
) -> PlayedMotion:
    """Return the motion at its speed, as often as asked for, led in from where the arm stands.

    Raises:
        StartPoseOff: the arm moves, or is elsewhere and no approach was asked for.
    """
    from dynid.record import playing, preflight
    from dynid.record.motion_checks import PlayedMotion

    motion = playing.repeated(arm, playing.at_speed(stored.motion, given.speed), given.repeat)
    motion = playing.nearest_turn(arm, motion, seen.q)
    try:
        preflight.check_start(seen, arm, motion)
    except StartPoseOff:
        if not given.go_to_start or seen.moved > preflight.STILL:
            raise
    else:
        return PlayedMotion(motion, speed=given.speed)
    way = playing.approach(arm, seen.q, motion.q[0])
    share = 100 * playing.APPROACH_SHARE
    terminal.stage("approach", f"{way.t[-1]:.0f} s to the start, at {share:.0f} % of the limits")
    return PlayedMotion(playing.joined([way, motion]), float(way.t[-1]), given.speed)


def foresee(
    common: Common, arm: Robot, played: PlayedMotion, stored: StoredTrajectory, parameters: Path | None
) -> dict[str, Any]:
    """Judge limits, clearance and torques of what will be played; return what is foreseen, for the manifest.

    Raises:
        LimitBroken: a joint limit or a torque.
        Collision: links, floor or obstacles come too near.
    """
    from dynid.record import motion_checks as motion_checks
    from dynid.trajectory.clearance import Scene, scene_from

    terminal = common.terminal
    joint, speed = motion_checks.check_limits(arm, played)
    terminal.stage("limits", "position, velocity and acceleration of every sample are inside")
    facts = stored.facts.get("scene")
    shapes = Path(facts["urdf"]) if facts and facts["urdf"] else None
    if shapes is not None and not shapes.is_file():
        terminal.say(f"note       {shapes} is gone: distances are those of cylinders along the links")
        shapes = None
    near = motion_checks.check_clearance(arm, played, scene_from(facts) if facts else Scene(), shapes)
    tool = motion_checks.fastest_tool(arm, played.motion)
    closest = f"closest {near[0].pair}, {1e3 * near[0].distance:.0f} mm at t = {near[0].time:.1f} s; " if near else ""
    terminal.stage("clearance", f"{closest}tool up to {tool:.2f} m/s")
    return {
        "seconds": float(played.motion.t[-1]),
        "approach_seconds": played.approach,
        "fastest_joint": joint,
        "speed_rad_s": speed,
        "tool_speed_m_s": tool,
        "closest_m": near[0].distance if near else None,
        "torque_share": _foresee_torque(common, arm, played, parameters),
        "torque_by": str(parameters) if parameters else "prior",
    }


def _foresee_torque(common: Common, arm: Robot, played: PlayedMotion, parameters: Path | None) -> float | None:
    """Judge the torques; return the largest share of a rating, None where nothing can be said."""
    from dynid.record.motion_checks import check_torque

    if arm.torque.source == "gravity_free" or arm.torque.relative:
        reason = "are counted in amperes" if arm.torque.relative else "lack gravity, and so does its model"
        common.terminal.stage("forecast", f"no torques: those of this arm {reason}")
        return None
    torque, words = _torque_of(common, arm, parameters)
    load = check_torque(arm, played, torque)
    common.terminal.stage(
        "forecast",
        f"torques up to {100 * load.share:.0f} % of the rating ({load.joint} at t = {load.time:.1f} s), by {words}"
        if load is not None
        else "no torques: the robot file has no ratings",
    )
    return load.share if load is not None else None


def _torque_of(common: Common, arm: Robot, parameters: Path | None) -> tuple[Torque, str]:
    """Return what predicts torques, and its name."""
    from dynid.model.prior import prior_base_parameters
    from dynid.workflows.model import base_model

    if parameters is None:
        base = base_model(arm, common.folder(arm.slug))
        theta = prior_base_parameters(base.model, base.reduction, unknown=0.0)
        words = "the robot file's prior, without friction"
    else:
        from dynid.estimation import result
        from dynid.workflows.validate import base_model_of

        stored = result.load(parameters)
        if stored.robot.joint_names != arm.joint_names:
            raise WrongUsage(f"{parameters} belongs to {stored.robot.name}", fix="give a model of this arm")
        if stored.robot.torque.relative:
            raise WrongUsage(f"{parameters} predicts currents", fix="leave out --parameters")
        base = base_model_of(stored, stored.path.parent)
        theta, words = stored.theta, str(parameters)
    observer = base.model.observer(base.reduction.base)
    return lambda motion: observer.torque(theta, motion.q, motion.qd, motion.qdd), words
