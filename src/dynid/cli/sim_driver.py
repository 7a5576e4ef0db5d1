"""``dynid sim-driver ROBOT``: a simulated arm behind the very topics of its driver, to rehearse a recording with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus, WrongUsage

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.robot import Robot
    from dynid.sim.driver_loop import DriverLoop, Imperfections
    from dynid.sim.plant import Plant

    Floats = NDArray[np.float64]

#: Rate of the joint states when none is given [Hz]: Kinova's arm has no more, ros_control's example publishes so.
RATE = 100.0
#: The physics has at least this many steps between two samples, and a step is no longer than this [s].
LONGEST_STEP = 1e-3
#: A pose that any arm can be simulated from, when none is given: every joint at this share of its range.
MIDDLE = 0.5


def _fault(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[str, float]:
    from dynid.sim.driver_loop import FAULTS

    if value is None:
        return "", 0.0
    name, _, seconds = value.partition("@")
    if name not in FAULTS:
        raise WrongUsage(f"no fault '{name}'", why=f"faults are {', '.join(FAULTS)}", fix="--fault silent@3")
    try:
        return name, float(seconds or 0)
    except ValueError:
        raise WrongUsage(f"'{seconds}' is no time", fix=f"--fault {name}@3") from None


@dynid_command(
    "sim-driver",
    examples=(
        "rosmaster --core &                       a ROS master, if none runs",
        "dynid sim-driver kinova_gen2 --pose out/kinova_gen2/trajectory.npz",
        "dynid sim-driver kuka_lwr4plus --rate 200 --torque-noise 0.1 --latency 0.005",
        "dynid sim-driver kinova_gen2 --fault silent@3      what happens when joint states stop?",
    ),
)
@click.argument("robot")
@click.option(
    "--rate", type=click.FloatRange(1, 1000), default=RATE, show_default=True, help="Rate of the joint states [Hz]."
)
@click.option("--topic", help="Topic of the joint states (default: the robot file's).")
@click.option("--master", metavar="URI", help="ROS master (default: ROS_MASTER_URI).")
@click.option(
    "--pose", metavar="TRAJECTORY|Q1,Q2,...", help="Where the arm stands: a trajectory's start, or DH angles [rad]."
)
@click.option(
    "--truth", type=click.Path(exists=True, dir_okay=False, path_type=Path), help="Truth file of the simulated arm."
)
@click.option(
    "--torque-noise", type=click.FloatRange(0), metavar="NM", help="Of all joints (default: the truth file's)."
)
@click.option("--torque-step", type=click.FloatRange(0), default=0.0, metavar="NM", help="Resolution of the torques.")
@click.option(
    "--torque-offset", type=float, default=0.0, metavar="NM", help="Offset of all torque sensors until zeroed."
)
@click.option("--position-step", type=click.FloatRange(0), metavar="RAD", help="Resolution of the encoders.")
@click.option("--latency", type=click.FloatRange(0, 1), default=0.0, metavar="S", help="From sampling to publishing.")
@click.option("--jitter", type=click.FloatRange(0, 1), default=0.0, metavar="S", help="Standard deviation added to it.")
@click.option(
    "--drop", type=click.FloatRange(0, 1), default=0.0, metavar="SHARE", help="Share of messages that are lost."
)
@click.option(
    "--skew",
    type=click.FloatRange(0, 1),
    default=0.0,
    metavar="S",
    help="Torque and velocity are polled so much later than the position (Kinova).",
)
@click.option(
    "--fault", metavar="KIND[@S]", callback=_fault, help="Make something go wrong, S seconds after the first command."
)
@click.option(
    "--duration", type=click.FloatRange(0, min_open=True), metavar="S", help="End by itself (default: Ctrl-C)."
)
@click.option(
    "--sent", type=click.Path(dir_okay=False, path_type=Path), metavar="CSV", help="Write all commands that came."
)
def command(common: Common, robot: str, **options: Any) -> ExitStatus:  # noqa: ANN401
    """Simulate an arm behind its driver's topics, in real time."""
    import signal
    import time

    from dynid.drivers.ros import connect, raise_priority
    from dynid.files.robotfile import load_robot
    from dynid.sim.ros_drivers import simulated_driver

    arm = load_robot(robot)
    topic = options["topic"] or (arm.driver.topic if arm.driver else None) or "/joint_states"
    raise_priority()
    node = connect("dynid_sim_driver", options["master"])
    try:
        with _rig(common, arm, options) as loop:
            driver = simulated_driver(node, loop, topic)
            common.terminal.stage("driver", f"{topic} at {loop.rate:g} Hz, master {node.uri}, seed {common.seed}")
            common.terminal.stage(
                "stop", "Ctrl-C" if options["duration"] is None else f"after {options['duration']:g} s"
            )
            end = time.monotonic() + (options["duration"] or float("inf"))
            # Why: a shell that started this in the background has it ignore Ctrl-C; it is ended with kill then.
            signal.signal(signal.SIGTERM, signal.default_int_handler)
            try:
                loop.run(driver.publish, lambda: time.monotonic() < end)
            except KeyboardInterrupt:
                common.terminal.detail("stop", "interrupted")
            facts = driver.commands.facts() | _played(loop) | {
                "published": loop.published, "dropped": loop.dropped, "largest_delay_s": loop.largest_delay,
                "longest_queue": loop.follower.longest,
            }  # fmt: skip
            if options["sent"] is not None:
                driver.commands.write(options["sent"])
                common.terminal.wrote(options["sent"])
    finally:
        node.close()
    return _told(common, arm, facts)


def _played(loop: DriverLoop) -> dict[str, float]:
    """Return what the arm's own reference used of the limits: along commands, and while braking after a stop."""
    import numpy as np

    velocity, acceleration = (
        np.array([getattr(joint.limits, key) or np.inf for joint in loop.robot.joints])
        for key in ("velocity", "acceleration")
    )
    follower = loop.follower
    return {
        "reference_velocity_share": float(np.max(follower.fastest / velocity)),
        "reference_acceleration_share": float(np.max(follower.hardest / acceleration)),
        "stop_acceleration_share": float(np.max(follower.hardest_stop / acceleration)),
    }


def _told(common: Common, arm: Robot, facts: dict[str, Any]) -> ExitStatus:
    """Say what was received and whether it kept the limits."""
    terminal = common.terminal
    terminal.emit_json({"schema": "dynid/sim-driver/1", "robot": arm.name, **facts})
    terminal.fact("published", f"{facts['published']} joint states, {facts['dropped']} dropped")
    if facts["commands"]:
        shares = {name: facts[f"{name}_share"] for name in ("velocity", "acceleration")}
        used = [f"{name} {100 * share:.0f} % of the limits" for name, share in shares.items() if share is not None]
        terminal.fact("received", f"{facts['commands']} commands; {', '.join(used) or 'the robot file has no limits'}")
    if facts["stop_acceleration_share"]:
        share = 100 * facts["stop_acceleration_share"]
        terminal.fact("stops", f"braking took {share:.0f} % of the acceleration limits; this driver brakes as it can")
    for broken in facts["violations"]:
        terminal.fact("broken", broken)
    return ExitStatus.LIMIT_NOT_MET if facts["violations"] else ExitStatus.DONE


def _rig(common: Common, robot: Robot, options: dict[str, Any]) -> Any:  # noqa: ANN401 - a context manager of a DriverLoop
    """Return the simulation as a context that closes the physics."""
    from contextlib import contextmanager

    import numpy as np

    from dynid.sim.driver_loop import DriverLoop
    from dynid.sim.follow import PointFollower, VelocityFollower

    @contextmanager
    def made() -> Any:  # noqa: ANN401
        dt = _step(options["rate"])
        plant = _plant(robot, options["truth"])
        with _arm(robot, plant, dt) as arm:
            velocity = robot.driver is not None and robot.driver.kind == "kinova_gen2"
            follower = (VelocityFollower if velocity else PointFollower)(_pose(robot, options["pose"]), dt)
            wrong = _imperfections(robot, plant, options)
            loop: DriverLoop = DriverLoop(arm, follower, options["rate"], wrong, np.random.default_rng(common.seed))
            yield loop

    return made()


def _step(rate: float) -> float:
    """Return a step of the physics that divides the time between two samples."""
    import math

    return 1 / rate / math.ceil(1 / rate / LONGEST_STEP - 1e-9)


def _plant(robot: Robot, given: Path | None) -> Plant | None:
    """Return the truth of the simulated arm: the given file's, the one that ships for this robot, or None."""
    from dynid.files.robotfile import packaged
    from dynid.sim.plant import read_plant

    if given is not None:
        return read_plant(given)
    for path in sorted(packaged("trajectories").glob("*_truth.yaml")):
        plant = read_plant(path)
        if plant.robot == robot.slug:
            return plant
    return None


def _arm(robot: Robot, plant: Plant | None, dt: float) -> Any:  # noqa: ANN401
    from dynid.sim.arm import SimulatedArm

    if plant is None:
        return SimulatedArm(robot, dt=dt)
    return SimulatedArm(robot, plant.bodies, plant.friction, plant.rotor_inertia, dt=dt)


def _imperfections(robot: Robot, plant: Plant | None, options: dict[str, Any]) -> Imperfections:
    from dynid.sim.driver_loop import Imperfections

    noise = plant.sensors.torque_noise if plant else (0.0,) * robot.n
    found = Imperfections(
        torque_noise=noise,
        position_step=plant.sensors.position_step if plant else 0.0,
        velocity_noise=(plant.sensors.velocity_noise or 0.0) if plant else 0.0,
        torque_step=options["torque_step"],
        torque_offset=(options["torque_offset"],) * robot.n,
        latency=options["latency"],
        jitter=options["jitter"],
        drop=options["drop"],
        skew=options["skew"],
        fault=options["fault"][0],
        fault_time=options["fault"][1],
    )
    if options["torque_noise"] is not None:
        found = replace(found, torque_noise=(options["torque_noise"],) * robot.n)
    return found if options["position_step"] is None else replace(found, position_step=options["position_step"])


def _pose(robot: Robot, given: str | None) -> Floats:
    """Return where the arm stands at the beginning, (n,) [rad or m]."""
    import numpy as np

    from dynid.files.trajectoryfile import read_trajectory

    if given is None:
        # Why: a Kinova Gen2 points up with all joints at 180 deg, which is also the middle of its ranges.
        endless = np.pi if robot.driver is not None and robot.driver.kind == "kinova_gen2" else 0.0
        ranges = [joint.limits.position or (endless, endless) for joint in robot.joints]
        return np.array([(1 - MIDDLE) * lower + MIDDLE * upper for lower, upper in ranges])
    if Path(given).exists():
        return np.array(read_trajectory(Path(given), robot).motion.q[0])
    try:
        pose = np.array([float(word) for word in given.split(",")])
    except ValueError:
        plan = given.endswith(".npz")
        raise WrongUsage(
            f"--pose {given} is neither a file nor numbers",
            fix=f"plan it first: dynid trajectory {robot.slug}" if plan else "--pose 0,0.5,0,1,0,0.5,0",
        ) from None
    if len(pose) != robot.n:
        raise WrongUsage(
            f"--pose has {len(pose)} numbers, {robot.name} has {robot.n} joints", fix="give one a joint [rad]"
        )
    return pose
