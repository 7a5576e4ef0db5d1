"""A log of an arm that follows a motion, without ROS: rigid bodies, friction, effects, and what sensors add."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import PackageMissing, WrongRobotFile, WrongUsage
from dynid.log import Log
from dynid.motion import Motion
from dynid.options import MOST, Options, option
from dynid.progress import Progress
from dynid.robot import Body, EffectSpec, Robot
from dynid.text import whole_number
from dynid.workflows import arguments
from dynid.workflows.arguments import public

if TYPE_CHECKING:
    from dynid.model.base_model import BaseModel
    from dynid.workflows.arguments import MotionLike, RobotLike

Floats = NDArray[np.float64]


def _effects(value: Any, name: str) -> tuple[EffectSpec, ...]:  # noqa: ANN401
    """Return effects from NAME@JOINT,...:PARAMETER=NUMBER,... or from entries of a robot file."""
    found = []
    for item in (value,) if isinstance(value, (str, EffectSpec)) else value:
        if isinstance(item, EffectSpec):
            found.append(item)
            continue
        if not isinstance(item, str):
            raise TypeError("it must be a list of words")
        head, _, numbers = str(item).partition(":")
        effect, _, joints = head.partition("@")
        try:
            pairs = [part.split("=") for part in numbers.split(",") if part]
            parameters = {key.strip(): float(number) for key, number in pairs}
        except ValueError:
            raise WrongUsage(
                f"{name} '{item}' is not understood", fix=f"{name} viscous@joint_2:fv=4.5"
            ) from None
        if not all(abs(number) <= MOST for number in parameters.values()):
            raise WrongUsage(f"{name} '{item}' has a number beyond what can be measured")
        found.append(
            EffectSpec(effect, tuple(joint for joint in joints.split(",") if joint), parameters)
        )
    return tuple(found)


@dataclass(frozen=True)
class SimulateOptions(Options):
    """What is simulated beyond the rigid bodies of the robot file."""

    viscous: float = option(
        0.02, "Viscous friction of each joint as a share of its rated torque at its rated speed."
    )
    coulomb: float = option(0.03, "Coulomb friction of each joint as a share of its rated torque.")
    noise: float = option(
        0.003, "Standard deviation of the torques as a share of the rated torque.", kind="float"
    )
    resolution: float = option(
        1e-5, "Resolution of the position sensors [rad or m]; 0 for none.", kind="float"
    )
    delay: float = option(0.0, "How late the torques are in the log [s].")
    payload: float = option(
        0.0, "Mass of a point load at the origin of the last frame [kg].", kind="float"
    )
    effects: tuple[EffectSpec, ...] = option(
        (),
        "Effect of the catalogue, NAME@JOINT:PARAMETER=NUMBER,...; may be repeated.",
        metavar="EFFECT",
        repeatable=True,
        flag="--effect",
        read=_effects,
    )
    seed: int = option(0, "Seed of the noise.")


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
    robot, base = arguments.robot(robot), arguments.base_model(base)
    motion = arguments.motion(motion, robot)
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
    from dynid.model.parameters import prior_bodies
    from dynid.sim.arm import SimulatedArm

    progress.stage("simulate")
    with suppress(PackageMissing), SimulatedArm(robot, prior_bodies(robot)) as arm:
        rows = zip(motion.q, motion.qd, motion.qdd, strict=True)
        return np.array(
            [arm.inverse_dynamics(*row) for row in rows]
        ), f"{arm.engine.name}'s inverse dynamics"
    return _reference(robot, base, progress)(motion.q, motion.qd, motion.qdd), "dynid's own model"


def _reference(
    robot: Robot, base: BaseModel | None, progress: Progress
) -> Callable[[Floats, Floats, Floats], Floats]:
    from dynid.model.parameters import prior_vector
    from dynid.model.regressor import Model, ModelTorques
    from dynid.workflows.model import base_model

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
    from dynid.model.effects.catalogue import checked, joints_of
    from dynid.model.effects.interface import ArmMotion
    from dynid.model.parameters import prior_vector
    from dynid.model.regressor import Model, ModelTorques
    from dynid.workflows.model import base_model

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
    from dynid.model.effects.catalogue import CATALOGUE

    effect = CATALOGUE.get(spec.effect)
    if effect is None:
        return ""
    shape = {name: spec.parameters.get(name, 1.0) for name in effect.shape_units}
    values = shape | {name: spec.parameters.get(name, 1.0) for name in effect.amplitudes(shape)}
    joints = "" if effect.scope == "arm" else f"@{','.join(spec.joints) or 'JOINT'}"
    return f"--effect {spec.effect}{joints}:{','.join(f'{name}={value:g}' for name, value in values.items())}"


def motion_of(path: Path, robot: Robot) -> Motion:
    """Return the motion of a trajectory.npz, or the one that a log went through.

    Args:
        path: trajectory.npz, or a log.
        robot: the arm.
    """
    from dynid.errors import NotAnArtifact
    from dynid.files.trajectoryfile import read_trajectory

    try:
        return read_trajectory(path, robot).motion
    except (NotAnArtifact, KeyError):
        return motion_of_log(path, robot)


def motion_of_log(recording: Log | Path, robot: Robot) -> Motion:
    """Return the motion that a log went through, evenly sampled."""
    from dynid.workflows.logs import load_log

    log = load_log(recording, robot)
    t = log.t - log.t[0]
    even = np.linspace(0.0, float(t[-1]), len(t))
    step, orders = float(even[1]), []
    signal = np.stack([np.interp(even, t, column) for column in log.q.T], axis=1)
    from scipy.signal import savgol_filter

    # Why at most: of a fast and short log, the window would take more samples than there are.
    window = min(max(7, 2 * round(0.05 / step) + 1), (len(even) - 1) // 2 * 2 + 1)
    for order in range(3):
        orders.append(savgol_filter(signal, window, 5, deriv=order, delta=step, axis=0))
    return Motion(even, *orders)
