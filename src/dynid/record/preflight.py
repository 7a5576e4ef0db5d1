"""Everything that is checked before a joint moves, in a fixed order; the first failure ends it. Nothing is sent."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats
from dynid.drivers.command_port import CommandPort
from dynid.drivers.interface import driver_of
from dynid.drivers.joint_state import Columns, Sample
from dynid.drivers.ros import Node
from dynid.errors import (
    Finding,
    GravityRemoved,
    JointNamesDiffer,
    NotFinite,
    PositionInDegrees,
    RateTooLow,
    ServiceMissing,
    StartPoseOff,
    StateStale,
    TopicSilent,
    TorqueScale,
)
from dynid.model.regressor import expected_torque
from dynid.motion import Motion
from dynid.progress import stage
from dynid.record import tuning
from dynid.record.playing import PlayedMotion, approach, joined, nearest_turn, repeated
from dynid.record.recorder import Listener
from dynid.robot import Robot

#: The small state topics that drivers have next to their joint states.
STATE_TOPICS = ("joint_angles", "joint_torques", "joint_command", "FRI_data", "j_ext_ft")


@dataclass(frozen=True)
class ObservedState:
    """What two seconds of listening showed.

    Attributes:
        q: mean positions in DH quantities, (n,).
        tau: mean torques, (n,).
        rate: rate of arrival [Hz].
        moved: largest change of any joint [rad or m].
    """

    q: Floats
    tau: Floats
    rate: float
    moved: float


def find_topic(node: Node, robot: Robot, asked: str | None) -> str:
    """Return the topic of the joint states.

    Raises:
        TopicSilent: nobody publishes joint states.
        TopicMissing: the topic that was asked for is not there.
    """
    published = node.ask("getPublishedTopics", "")
    topics = {name: kind for name, kind in published if not name.startswith("/rosout")}
    if not topics:
        text = f"no node publishes anything at {node.uri}"
        raise TopicSilent(text, where=node.uri, fix="start the arm's driver")
    return driver_of(robot).choose_topic(topics, asked, robot, f"the ROS graph at {node.uri}")


def listen(listener: Listener, robot: Robot, patience: float) -> ObservedState:
    """Wait for the first joint state and measure for two seconds.

    Raises:
        TopicSilent: none comes.
        JointNamesDiffer: it has other joints.
        RateTooLow: they come too rarely.
        NotFinite: a number is none.
    """
    end = time.monotonic() + patience
    while listener.latest is None:
        if time.monotonic() > end:
            raise _nothing(listener, robot, patience)
        time.sleep(0.005)
    begin, count = time.monotonic(), listener.tally.messages
    samples = [listener.latest]
    while time.monotonic() < begin + tuning.LISTENING_S:
        if listener.latest is not samples[-1]:
            samples.append(listener.latest)
        time.sleep(0.005)
    rate = (listener.tally.messages - count) / (time.monotonic() - begin)
    q, tau = (np.array([getattr(sample, key) for sample in samples]) for key in ("q", "tau"))
    if not (np.isfinite(q).all() and np.isfinite(tau).all()):
        raise NotFinite(
            f"{listener.topic} has positions or torques that are not a number",
            where=listener.topic,
            fix="restart the driver",
        )
    if rate < tuning.LEAST_RATE_HZ:
        raise RateTooLow(
            f"joint states arrive at {rate:.1f} Hz; at least {tuning.LEAST_RATE_HZ:.0f} Hz is needed for accelerations",
            where=listener.topic,
            fix=driver_of(robot).rate_fix,
        )
    moved = float(np.ptp(q, axis=0).max())
    return ObservedState(q.mean(axis=0), tau.mean(axis=0), rate, moved)


def _nothing(listener: Listener, robot: Robot, patience: float) -> Exception:
    if listener.names:
        expected = ", ".join(robot.log_names)
        return JointNamesDiffer(
            f"{listener.topic} names {', '.join(listener.names)}, or lacks torques; the robot file expects {expected}",
            where=listener.topic,
            fix="list the driver's names in chain order under `driver: joint_names:`",
        )
    return TopicSilent(
        f"{listener.topic} is advertised but silent for {patience:g} s", where=listener.topic
    )


def check_units(seen: ObservedState, robot: Robot) -> None:
    """Refuse numbers that cannot be in the units the robot file says.

    Raises:
        PositionInDegrees: positions beyond anything an arm can reach.
        TorqueScale: torques beyond anything its drives can give.
    """
    for joint, q, tau in zip(robot.joints, seen.q, seen.tau, strict=True):
        lower, upper = joint.limits.position or (-tuning.MOST_TURNS_RAD, tuning.MOST_TURNS_RAD)
        if joint.revolute and not lower - np.pi <= q <= upper + np.pi:
            raise PositionInDegrees(
                f"{joint.name} stands at {q:.4g} rad; its limits are {lower:.3g} to {upper:.3g}"
            )
        if joint.limits.torque and abs(tau) > tuning.MOST_RATINGS * joint.limits.torque:
            raise TorqueScale(
                f"{joint.name} reads {tau:.4g} N m; its rating is {joint.limits.torque:g}"
            )


def check_zero(seen: ObservedState, robot: Robot) -> tuple[Finding, ...]:
    """Return a warning when the torque sensors should be zeroed, or nobody can tell."""
    if driver_of(robot).kind != "kinova_gen2":
        return ()
    if not at_candle(seen):
        text = (
            "torque sensors are zeroed at the candle pose (all joints 180 deg), where the arm is "
            "not: offsets stay in"
        )
        return (Finding("W501", "warning", text),)
    worst = int(np.abs(seen.tau).argmax())
    if abs(seen.tau[worst]) < tuning.ZEROED_TORQUE_NM:
        return ()
    text = f"{robot.joint_names[worst]} reads {seen.tau[worst]:+.2f} N m at the candle pose: run with --zero-torques"
    return (Finding("W316", "warning", text, {"torque": seen.tau.tolist()}),)


def at_candle(seen: ObservedState) -> bool:
    """Return whether a Kinova Gen2 points straight up."""
    away = np.angle(np.exp(1j * (seen.q - tuning.CANDLE_POSE_RAD)))
    return bool(np.abs(away).max() < tuning.CANDLE_TOLERANCE_RAD)


def check_gravity(seen: ObservedState, robot: Robot, port: CommandPort) -> bool | None:
    """Refuse a driver that publishes torques without gravity; return what its parameter says.

    Raises:
        GravityRemoved: by its parameter, or by the torques themselves.
    """
    removed = port.gravity_removed()
    if robot.torque.source == "gravity_free":
        return removed
    weight = np.abs(expected_torque(seen.q[None], robot)[0])
    heavy, largest = int(weight.argmax()), np.abs(seen.tau).max()
    unloaded = weight[heavy] > max(tuning.LEAST_WEIGHT_NM, largest / tuning.NO_WEIGHT_SHARE)
    what = (
        f"no joint reads more than {largest:.2f} N m, but {robot.joint_names[heavy]} must carry about "
        f"{weight[heavy]:.0f} N m here"
    )
    if removed:
        what = "the driver says that it publishes torques without gravity"
    if removed or (unloaded and robot.torque.source != "motor_current"):
        raise GravityRemoved(what, fix=driver_of(robot).gravity_fix)
    return removed


def check_start(seen: ObservedState, robot: Robot, motion: Motion) -> None:
    """Refuse to begin anywhere else than at the first pose, or while the arm moves.

    Raises:
        StartPoseOff: it is elsewhere, or moving.
    """
    if seen.moved > tuning.STILL_WHILE_LISTENING:
        what = f"the arm is moving ({seen.moved:.2f} rad in {tuning.LISTENING_S:g} s)"
        raise StartPoseOff(what, fix="stop what moves it first")
    _check_place(seen.q, robot, motion, "")


def check_place(sample: Sample, robot: Robot, motion: Motion) -> None:
    """Check again just before the first command: while a person was asked, the arm may have been moved or gone silent.

    Raises:
        StateStale: its joint states have ended.
        StartPoseOff: it is elsewhere by now.
    """
    age = time.monotonic() - sample.arrival
    if age > tuning.STOP_STALE_S:
        raise StateStale(
            f"no joint state for {age:.1f} s: the arm was not moved",
            fix="is the driver still there?",
        )
    _check_place(sample.q, robot, motion, " by now; it was moved after it was checked")


def _check_place(q: Floats, robot: Robot, motion: Motion, when: str) -> None:
    away = np.abs(q - motion.q[0])
    worst = int(np.nan_to_num(away, nan=np.inf).argmax())
    if not away[worst] <= tuning.START_TOLERANCE:
        unit = "rad" if robot.joints[worst].revolute else "m"
        raise StartPoseOff(
            f"the arm is {away[worst]:.2f} {unit} from the start on {robot.joint_names[worst]}{when}"
        )


def motion_to_play(
    robot: Robot,
    planned: Motion,
    seen: ObservedState,
    *,
    speed: float = 1.0,
    repeat: int = 1,
    go_to_start: bool = False,
) -> PlayedMotion:
    """Return a planned motion at its speed, as often as asked for, led in from where the arm stands.

    Args:
        robot: the arm.
        planned: the motion.
        seen: where the arm stands.
        speed: share of the planned speed.
        repeat: how often it is played.
        go_to_start: approach the first pose slowly where the arm is elsewhere.

    Raises:
        StartPoseOff: the arm moves, or is elsewhere and no approach was asked for.
    """
    motion = nearest_turn(robot, repeated(robot, planned.at_speed(speed), repeat), seen.q)
    try:
        check_start(seen, robot, motion)
    except StartPoseOff:
        if not go_to_start or seen.moved > tuning.STILL_WHILE_LISTENING:
            raise
    else:
        return PlayedMotion(motion, speed=speed)
    way_in = approach(robot, seen.q, motion.q[0])
    share = 100 * tuning.APPROACH_SHARE
    stage("approach", f"{way_in.t[-1]:.0f} s to the start, at {share:.0f} % of the limits")
    return PlayedMotion(joined([way_in, motion]), float(way_in.t[-1]), speed)


def check_endpoints(port: CommandPort) -> None:
    """Refuse a driver that cannot be commanded or stopped.

    Raises:
        ServiceMissing: a topic or service is not there.
    """
    if missing := port.missing():
        raise ServiceMissing(
            f"the driver has no {', no '.join(missing)}",
            where=port.namespace,
            fix="start the driver completely",
        )


def listener_of(node: Node, robot: Robot, topic: str) -> Listener:
    """Return a listener on the joint states and on the driver's other topics that belong to the record."""
    published = {name for name, _ in node.ask("getPublishedTopics", "")}
    neighbours = [f"{topic.rsplit('/', 1)[0]}/{name}" for name in STATE_TOPICS]
    extra = [name for name in neighbours if name in published and name != topic]
    return Listener(node, Columns(robot), topic, extra)
