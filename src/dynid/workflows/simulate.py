"""A log of an arm that follows a motion, without ROS: rigid bodies, friction, effects, and what sensors add."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from dynid.answer import Answer, Answered
from dynid.arguments import public
from dynid.arrays import Floats
from dynid.errors import WrongUsage
from dynid.loading import MotionLike, RobotLike, as_motion, as_robot
from dynid.log import Log
from dynid.model.effects.catalogue import CATALOGUE, DELAY, added_effects
from dynid.model.effects.motion import ArmMotion
from dynid.model.parameters import prior_bodies
from dynid.model.regressor import ModelTorques, build_model, prior_vector
from dynid.motion import Motion
from dynid.progress import Progress, stage
from dynid.robot import Body, EffectSpec, Robot
from dynid.sim.arm import SimulatedArm
from dynid.text import closest
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
            "schema": "dynid/simulate/1",
            "physics": PHYSICS,
            "samples": len(self.log),
            "duration_s": self.log.duration,
            "torque_max_nm": np.abs(self.torque).max(axis=0).tolist(),
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
            what = f"--effect: no effect '{one.effect}'{closest(one.effect, CATALOGUE)}"
            raise WrongUsage(what, fix=LISTED)
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
        rigid = replace(robot, effects=())
        model = build_model(rigid)
        reference = ModelTorques(model, prior_vector(model))
        tau = tau + _effect_torque(robot, motion, specs, reference)
        if not np.isfinite(tau).all():
            raise WrongUsage("--effect gives no finite torque with these numbers", fix=LISTED)
    moved = motion.t - options.delay
    late = np.stack([np.interp(moved, motion.t, column) for column in tau.T], axis=1)
    rng = np.random.default_rng(options.seed)
    measured = late + rng.normal(0.0, 1.0, late.shape) * options.noise * rated
    q, step = motion.q, options.resolution
    log = Log(
        motion.t,
        np.round(q / step) * step if step else q,
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
        some = joint_indices(robot.joint_names, ",".join(spec.joints), "--effect")
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
