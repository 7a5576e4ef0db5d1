"""Simulated arms: a log without ROS, an arm behind its driver's topics, and exported files driven along a recording."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.answer import Answer, Answered
from dynid.arguments import no_such, public
from dynid.arrays import Floats
from dynid.drivers.ros import connect
from dynid.errors import WrongUsage
from dynid.exporters.driven import drive
from dynid.files.trajectoryfile import read_trajectory
from dynid.loading import (
    LogLike,
    MotionLike,
    ResultLike,
    RobotLike,
    as_log,
    as_motion,
    as_result,
    as_robot,
    checked_log,
    several,
)
from dynid.log import Log
from dynid.model.effects.catalogue import CATALOGUE, DELAY, added_effects
from dynid.model.effects.motion import ArmMotion
from dynid.model.parameters import prior_bodies
from dynid.model.regressor import ModelTorques, build_model, mass_matrices, prior_vector
from dynid.motion import Motion
from dynid.options import LogOptions, numbers
from dynid.progress import Progress, heard_by, stage
from dynid.reports.figures import write_figure
from dynid.reports.gap_figures import simulator_figure
from dynid.robot import Body, EffectSpec, Robot
from dynid.signals.conditioned_log import condition_logs
from dynid.sim.arm import SimulatedArm
from dynid.sim.comparison import SimulatorGap
from dynid.sim.driver_loop import DriverLoop, step_of
from dynid.sim.follow import PointFollower, VelocityFollower
from dynid.sim.options import SimDriverOptions
from dynid.sim.plant import Plant, Sensors, plant_of, read_plant, stepped
from dynid.sim.ros_drivers import simulated_driver
from dynid.workflows.export import identified_arm
from dynid.workflows.options import SimulateOptions, joint_indices

#: What computes the rigid bodies.
PHYSICS = "MuJoCo's inverse dynamics"
LISTED = "dynid explain effects lists them, with their parameters"


@dataclass(frozen=True, repr=False)
class Simulation(Answered):
    """A simulated log.

    Attributes:
        log: what a driver would have recorded, in DH quantities.
        torque: drive torques without sensor errors, (N, n) [N m or N].
    """

    log: Log
    torque: Floats

    def answer(self) -> Answer:
        """Return what ``dynid simulate`` answers."""
        facts = {
            "physics": PHYSICS,
            "samples": len(self.log),
            "duration_s": self.log.duration,
            "torque_max_nm": np.abs(self.torque).max(axis=0),
        }
        return Answer(facts, notes=[("physics", f"{PHYSICS}; the arm follows the motion exactly")])


@public
def simulate(
    robot: RobotLike,
    motion: MotionLike,
    options: SimulateOptions = SimulateOptions(),
    *,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Simulation:
    """Simulate the log of an arm that follows a motion exactly.

    Args:
        robot: the arm, its name, or the path of its file; its prior are the true bodies.
        motion: what it does, evenly sampled; or a plan, or its path.
        options: friction, effects and sensors.
        progress: reports what is computed.
        changes: single options by name, such as ``payload=2.0``; see ``dynid.SimulateOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).

    Example:
        dynid.simulate("kuka_lwr4plus", "out/kuka_lwr4plus/trajectory.npz", payload=2.0)
    """
    robot = as_robot(robot)
    motion = as_motion(motion, robot)
    if options.payload:
        if robot.tool is not None:
            fix = "add the load to `tool:` in the robot file"
            raise WrongUsage("the robot file has a tool already", fix=fix)
        robot = replace(robot, tool=Body(options.payload, (0.0, 0.0, 0.0), (0.0,) * 6))
    for one in options.effects:
        if one.effect not in CATALOGUE:
            raise no_such("--effect: no effect", one.effect, CATALOGUE, fix=LISTED)
    stage("simulate")
    arm = SimulatedArm(robot, prior_bodies(robot))
    rows = zip(motion.q, motion.qd, motion.qdd, strict=True)
    tau = np.array([arm.inverse_dynamics(*row) for row in rows])
    rated = robot.limits("torque", np.maximum(np.abs(tau).max(0), 1e-3))
    speed = robot.limits("velocity", 1.0)
    viscous, coulomb = options.viscous * rated / speed, options.coulomb * rated
    sign = np.tanh(motion.qd / np.array(robot.coulomb_shape.velocity))
    tau = tau + viscous * motion.qd + coulomb * sign
    if specs := (*robot.effects, *options.effects):
        model = build_model(replace(robot, effects=()))
        reference = ModelTorques(model, prior_vector(model))
        tau = tau + _effect_torque(robot, motion, specs, reference)
        if not np.isfinite(tau).all():
            raise WrongUsage("--effect gives no finite torque with these numbers", fix=LISTED)
    moved = motion.t - options.delay
    late = np.stack([np.interp(moved, motion.t, column) for column in tau.T], axis=1)
    rng = np.random.default_rng(options.seed)
    measured = late + rng.normal(0.0, 1.0, late.shape) * options.noise * rated
    q = motion.q
    log = Log(
        motion.t,
        stepped(q, options.resolution),
        measured,
        robot.joint_names,
        tau_unit="Nm",
        dh=True,
        extra={"q_ref": q},
    )
    return Simulation(log, tau)


def _effect_torque(
    robot: Robot, motion: Motion, specs: Sequence[EffectSpec], reference: ModelTorques
) -> Floats:
    """Return the torque of effects along a motion, (N, n) [N m or N].

    Raises:
        WrongUsage: an effect has no amplitude, or a number that it does not take.
        WrongRobotFile: there is no such effect.
    """
    states, rigid = (motion.t, motion.q, motion.qd, motion.qdd), replace(robot, effects=())
    path = ArmMotion(*states, rigid, reference, lambda values: values)
    torque = np.zeros_like(motion.q)
    for spec in specs:
        if spec.effect == DELAY:
            raise WrongUsage(f"{DELAY} is no torque", fix="--delay SECONDS")
        some = joint_indices(robot.joint_names, spec.joints, "--effect")
        named = replace(spec, joints=tuple(robot.joint_names[k] for k in some))
        for one in added_effects(replace(robot, effects=(named,))):
            amplitudes, given = one.effect.amplitudes(one.shape), named.parameters
            known = [*amplitudes, *one.shape]
            if amplitudes.keys().isdisjoint(given) or set(given).difference(known):
                raise WrongUsage(f"--effect: {spec.effect} takes {', '.join(known)}", fix=LISTED)
            sizes = [given.get(name, 0.0) for name in amplitudes]
            columns = one.effect.columns(path, one.joints, one.shape)
            torque[:, list(one.rows)] += np.tensordot(sizes, columns, axes=1).T
    return torque


# ---------------------------------------------------------------- exported files in a simulator
@public
def compare_in_simulator(
    results: ResultLike | Sequence[ResultLike],
    log: LogLike,
    *,
    seconds: float | None = None,
    progress: Progress | None = None,
) -> SimulatorGap:
    """Drive the exported files of results along a recording in a simulator, with one controller for all.

    Measured torques act on the simulated arm; a soft controller of 1 Hz holds it near the recorded motion. The position
    error is how far it strays, the torque error what the controller had to add.

    Args:
        results: results of one arm, such as before and after an effect was added.
        log: a recording, best one that was not fitted.
        seconds: the last so many seconds of the recording are driven; None for all [s].
        progress: reports what is simulated.

    Raises:
        WrongUsage: an argument is something else than what is wanted (E101).
        NotSimulated: a simulation diverges.
        DynidError: the first serious fault of the log.

    Example:
        dynid.compare_in_simulator(["out/before", "out/after"], "run3.bag")
    """
    given = [as_result(each, "results") for each in several(results, "results")]
    first, last = given[0], given[-1]
    robot, options = first.robot, LogOptions(cutoff=first.cutoff or None, delay=first.delay)
    recording = as_log(log, robot, options)
    numbered = tuple(map(str, range(1, len(given) + 1)))
    models = ("before", "after") if len(given) == 2 else numbered
    if any(each.robot.joint_names != robot.joint_names for each in given):
        raise WrongUsage("the results are of different arms", fix="results of one arm")
    with heard_by():
        checked = checked_log(recording, robot, options, identify=False)
        (conditioned,) = condition_logs([checked], first.base.model, options)
    # The end of the longest part without gaps.
    longest = max(conditioned.segments, key=len)
    begin = -np.inf if seconds is None else longest.t[-1] - seconds
    start = int(np.searchsorted(longest.t[:-2], begin))
    t, q, qd, tau = (x[start:] for x in (longest.t, longest.q, longest.qd, longest.tau))
    t, some = t - t[0], q[:: max(1, len(q) // 100)]
    matrices = mass_matrices(lambda *state: last.base.observer.torque(last.theta, *state), some)
    # What each joint moves, on average along the motion, (n,) [kg m^2 or kg].
    inertia = np.abs(np.diagonal(matrices, axis1=1, axis2=2)).mean(axis=0)
    runs = []
    for name, each in zip(models, given, strict=True):
        arm = identified_arm(each, ("mjcf",))
        stage("simulate", f"{name}, {len(t)} samples")
        runs.append(drive(arm, (t, q, qd, tau), inertia))
    simulated, added = (np.array(each) for each in zip(*runs, strict=True))
    return SimulatorGap(
        robot=robot,
        log=str(recording.source or recording.name),
        engine="mujoco",
        models=models,
        t=t,
        q=q,
        simulated=simulated,
        added=added,
    )


def save_figure(gap: SimulatorGap, path: Path) -> Path:
    """Write the picture of the position errors."""
    return write_figure(simulator_figure(gap), path)


# ---------------------------------------------------------------- behind the topics of a driver
def simulate_driver(robot: Robot, options: SimDriverOptions) -> Answer:
    """Simulate an arm behind its driver's topics until the time is over or Ctrl-C is pressed."""
    topic = options.topic or robot.columns.topic or "/joint_states"
    node = connect("dynid_sim_driver", options.master)
    try:
        plant = plant_of(robot) if options.truth is None else read_plant(options.truth)
        arm = plant.arm(robot, step_of(options.rate))
        kind = VelocityFollower if is_kinova(robot) else PointFollower
        follower = kind(start_pose(robot, options.pose), arm.dt)
        rng = np.random.default_rng(options.seed)
        loop = DriverLoop(arm, follower, _sensors(plant, options), options, rng)
        driver = simulated_driver(node, loop, topic)
        stage("stop", "Ctrl-C" if options.duration is None else f"after {options.duration:g} s")
        where = f"master {node.uri}, seed {options.seed}"
        stage("driver", f"{topic} at {options.rate:g} Hz, {where}")
        end = time.monotonic() + (options.duration or float("inf"))
        with suppress(KeyboardInterrupt):
            loop.run(driver.publish, lambda: time.monotonic() < end)
    finally:
        node.close()
    said = f"{loop.published} joint states, {loop.dropped} dropped"
    return Answer({"robot": robot.name, **loop.facts()}, parts=[("published", said)])


def is_kinova(robot: Robot) -> bool:
    """Return whether the arm is a Kinova Gen2, which takes velocities and stands upright at 180 deg."""
    return robot.driver is not None and robot.driver.kind == "kinova_gen2"


def _sensors(plant: Plant, options: SimDriverOptions) -> Sensors:
    """Return the sensors of a truth file, with what is wanted otherwise."""
    sensors, noise, step = plant.sensors, options.torque_noise, options.position_step
    return replace(
        sensors,
        torque_noise=sensors.torque_noise if noise is None else (noise,) * len(plant.bodies),
        position_step=sensors.position_step if step is None else step,
    )


def start_pose(robot: Robot, given: str | None) -> Floats:
    """Return where the arm stands at the beginning, (n,) [rad or m].

    Args:
        robot: the arm.
        given: a file of a trajectory, or positions as text; the middle of all ranges when None.
    """
    if given is None:
        # Why: a Kinova Gen2 points up with all joints at 180 deg, which is also the middle of its ranges.
        endless = (np.pi if is_kinova(robot) else 0.0,) * 2
        return robot.travel(endless, endless).mean(axis=0)
    if Path(given).exists():
        return np.array(read_trajectory(Path(given), robot).motion.q[0])
    try:
        return np.array(numbers(given, robot.n))
    except ValueError as error:
        what = f"--pose {given} is no file, and {error}"
        raise WrongUsage(
            what, fix=f"dynid trajectory {robot.word}, or one per joint [rad]"
        ) from None
