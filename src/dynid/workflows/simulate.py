"""A log of an arm that follows a motion, without ROS: rigid bodies, friction, effects, and what sensors add."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid import arguments
from dynid.arguments import public
from dynid.errors import PackageMissing, WrongRobotFile, WrongUsage
from dynid.loading import MotionLike, RobotLike, as_base_model, as_motion, as_robot
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE, checked, joints_of
from dynid.model.effects.interface import ArmMotion
from dynid.model.parameters import prior_bodies
from dynid.model.regressor import Model, ModelTorques, prior_vector
from dynid.motion import Motion
from dynid.progress import Progress
from dynid.robot import Body, EffectSpec, Robot
from dynid.sim.arm import SimulatedArm
from dynid.text import whole_number
from dynid.workflows.model import base_model
from dynid.workflows.options import SimulateOptions

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Simulation:
    """A simulated log.

    Attributes:
        log: what a driver would have recorded, in DH quantities.
        torque: drive torques without sensor errors, (N, n) [N m or N].
        source: which physics computed the rigid bodies, in words.
        viscous: viscous friction that was added, (n,) [N m s/rad or N s/m].
        coulomb: Coulomb friction that was added, (n,) [N m or N].
    """

    log: Log
    torque: Floats
    source: str
    viscous: Floats
    coulomb: Floats

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid simulate`` says."""
        return {
            "schema": "dynid/simulate/1",
            "physics": self.source,
            "samples": len(self.log.t),
            "duration_s": float(self.log.t[-1] - self.log.t[0]),
            "torque_max_nm": np.abs(self.torque).max(axis=0).tolist(),
        }


@public
def simulate(
    robot: RobotLike,
    motion: MotionLike,
    options: SimulateOptions | None = None,
    *,
    base: BaseModel | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Simulation:
    """Simulate the log of an arm that follows a motion exactly.

    Args:
        robot: the arm, its name, or the path of its file; its prior are the true bodies.
        motion: what it does, evenly sampled; or a plan, a log, or the path of either.
        options: friction, effects and sensors.
        base: the arm's base model, where it is there already; needed for effects and without a simulator.
        progress: reports what is computed.
        changes: single options by name, such as ``payload=2.0``; see ``dynid.SimulateOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).

    Example:
        dynid.simulate("kuka_lwr4plus", "out/kuka_lwr4plus/trajectory.npz", payload=2.0)
    """
    options, progress = (
        arguments.options(SimulateOptions, options, changes),
        arguments.progress(progress),
    )
    robot, base = as_robot(robot), as_base_model(base)
    motion = as_motion(motion, robot)
    if options.payload:
        if robot.tool is not None:
            raise WrongUsage(
                "the robot file has a tool already", fix="add the load to `tool:` in the robot file"
            )
        robot = replace(robot, tool=Body(options.payload, (0.0, 0.0, 0.0), (0.0,) * 6))
    tau, source = _rigid_torque(robot, motion, base, progress)
    rated = np.array(
        [
            joint.limits.torque or max(float(np.abs(tau[:, j]).max()), 1e-3)
            for j, joint in _joints(robot)
        ]
    )
    speed = np.array([joint.limits.velocity or 1.0 for joint in robot.joints])
    width = np.array(robot.coulomb_shape.velocity)
    viscous, coulomb = options.viscous * rated / speed, options.coulomb * rated
    tau = tau + viscous * motion.qd + coulomb * np.tanh(motion.qd / width)
    specs = (*robot.effects, *options.effects)
    if specs:
        tau = tau + _effect_torque(robot, motion, specs, base, progress)
    late = np.stack(
        [np.interp(motion.t - options.delay, motion.t, column) for column in tau.T], axis=1
    )
    rng = np.random.default_rng(options.seed)
    measured = late + rng.normal(0.0, 1.0, late.shape) * options.noise * rated
    q = (
        np.round(motion.q / options.resolution) * options.resolution
        if options.resolution
        else motion.q
    )
    log = Log(
        motion.t, q, measured, robot.joint_names, tau_unit="Nm", dh=True, extra={"q_ref": motion.q}
    )
    return Simulation(log, tau, source, viscous, coulomb)


def _joints(robot: Robot) -> Sequence[tuple[int, Any]]:
    return list(enumerate(robot.joints))


def _rigid_torque(
    robot: Robot, motion: Motion, base: BaseModel | None, progress: Progress
) -> tuple[Floats, str]:
    """Return the torques of the rigid bodies, (N, n) [N m or N], and which physics computed them."""
    progress.stage("simulate")
    with suppress(PackageMissing), SimulatedArm(robot, prior_bodies(robot)) as arm:
        rows = zip(motion.q, motion.qd, motion.qdd, strict=True)
        return np.array([arm.inverse_dynamics(*row) for row in rows]), "MuJoCo's inverse dynamics"
    return _reference(robot, base, progress)(motion.q, motion.qd, motion.qdd), "dynid's own model"


def _reference(
    robot: Robot, base: BaseModel | None, progress: Progress
) -> Callable[[Floats, Floats, Floats], Floats]:

    base = base or base_model(replace(robot, effects=()), progress=progress)
    model = Model(replace(robot, effects=()), base.model.rigid)
    return ModelTorques(model, prior_vector(model)).rigid


def _effect_torque(
    robot: Robot,
    motion: Motion,
    specs: Sequence[EffectSpec],
    base: BaseModel | None,
    progress: Progress,
) -> Floats:
    """Return the torque of effects along a motion, (N, n) [N m or N].

    Raises:
        WrongUsage: a parameter of an effect is missing.
        WrongRobotFile: there is no such effect.
    """
    plain = replace(robot, effects=())
    base = base or base_model(plain, progress=progress)
    model = Model(plain, base.model.rigid)
    reference = ModelTorques(model, prior_vector(model))
    path = ArmMotion(
        motion.t, motion.q, motion.qd, motion.qdd, plain, reference, lambda values: values
    )
    torque = np.zeros_like(motion.q)
    for spec in specs:
        numbers = ((joint, whole_number(joint)) for joint in spec.joints)
        named = replace(
            spec, joints=tuple(robot.joint_name(name if k < 0 else k) for name, k in numbers)
        )
        try:
            effect = checked(named, robot)
        except WrongRobotFile as error:
            if spec in robot.effects:
                raise
            what = error.what.removeprefix("effects: ")
            raise WrongUsage(
                f"--effect: {what}", fix=_template(spec) or "dynid explain effects lists them"
            ) from error
        if effect.name == "torque_delay":
            raise WrongUsage("torque_delay is no torque", fix="--delay SECONDS")
        shape = {name: named.parameters[name] for name in effect.shape_units}
        names = list(effect.amplitudes(shape))
        missing = [name for name in names if name not in named.parameters]
        if missing:
            raise WrongUsage(
                f"--effect: {effect.name} needs parameters {', '.join(missing)}",
                fix=_template(spec),
            )
        for joints in joints_of(named, effect, robot):
            columns = effect.columns(path, joints, shape)
            rows = list(effect.rows(joints, robot.n))
            torque[:, rows] += np.tensordot(
                [named.parameters[name] for name in names], columns, axes=1
            ).T
        if not np.all(np.isfinite(torque)):
            raise WrongUsage(
                f"--effect: {effect.name} gives no finite torque with these numbers",
                fix=_template(spec),
            )
    return torque


def _template(spec: EffectSpec) -> str:
    """Return an option with all the numbers that an effect of the catalogue needs, "" for one that is not there."""
    effect = CATALOGUE.get(spec.effect)
    if effect is None:
        return ""
    shape = {name: spec.parameters.get(name, 1.0) for name in effect.shape_units}
    values = shape | {name: spec.parameters.get(name, 1.0) for name in effect.amplitudes(shape)}
    joints = "" if effect.scope == "arm" else f"@{','.join(spec.joints) or 'JOINT'}"
    return f"--effect {spec.effect}{joints}:{','.join(f'{name}={value:g}' for name, value in values.items())}"
