"""The catalogue: every effect by its identifier, and the columns of those that a robot file lists."""

from __future__ import annotations

import difflib
from dataclasses import dataclass

import numpy as np

from dynid.errors import WrongRobotFile
from dynid.model.effects.asymmetric_viscous import AsymmetricViscous
from dynid.model.effects.base_tilt import BaseTilt
from dynid.model.effects.coulomb import CoulombFriction
from dynid.model.effects.coulomb_change import CoulombChange
from dynid.model.effects.encoder_offset import EncoderOffset
from dynid.model.effects.end_stop import EndStop
from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place
from dynid.model.effects.joint_coupling import JointCoupling
from dynid.model.effects.joint_elasticity import JointElasticity
from dynid.model.effects.load_friction import LoadFriction
from dynid.model.effects.motor_inertia import MotorInertia
from dynid.model.effects.nonlinear_viscous import NonlinearViscous
from dynid.model.effects.offset import TorqueOffset
from dynid.model.effects.payload import Payload
from dynid.model.effects.position_friction import PositionFriction
from dynid.model.effects.presliding_hysteresis import PreslidingHysteresis
from dynid.model.effects.spring import Spring
from dynid.model.effects.stribeck import Stribeck
from dynid.model.effects.tool_force import ToolForce
from dynid.model.effects.torque_crosstalk import TorqueCrosstalk
from dynid.model.effects.torque_delay import TorqueDelay
from dynid.model.effects.torque_drift import TorqueDrift
from dynid.model.effects.torque_gain import TorqueGain
from dynid.model.effects.torque_ripple import TorqueRipple
from dynid.model.effects.viscous import ViscousFriction
from dynid.model.effects.viscous_change import ViscousChange
from dynid.model.effects.warmup_friction import WarmupFriction
from dynid.robot import EffectSpec, Robot

_ALL: tuple[Effect, ...] = (
    TorqueOffset(), ViscousFriction(), CoulombFriction(), AsymmetricViscous(), Stribeck(), NonlinearViscous(),
    LoadFriction(), TorqueGain(), WarmupFriction(), TorqueDrift(), PositionFriction(), TorqueRipple(), Spring(),
    EndStop(), MotorInertia(), JointCoupling(), TorqueCrosstalk(), JointElasticity(), EncoderOffset(),
    PreslidingHysteresis(), BaseTilt(), TorqueDelay(), ToolForce(), Payload(), CoulombChange(), ViscousChange(),
)  # fmt: skip
CATALOGUE: dict[str, Effect] = {effect.name: effect for effect in _ALL}


@dataclass(frozen=True)
class AddedColumn:
    """One column of an effect that the robot file lists.

    Attributes:
        name: parameter name, such as ``stribeck4_a``.
        unit: unit of the parameter.
        rows: joints it acts on, 0-based.
        value: its value in the robot file; 0 where the file has none.
    """

    name: str
    unit: str
    rows: tuple[int, ...]
    value: float


@dataclass(frozen=True)
class Added:
    """One effect of a robot file at one place.

    Attributes:
        effect: the effect.
        place: where it sits.
        shape: its non-linear parameters.
        columns: its linear ones.
    """

    effect: Effect
    place: Place
    shape: dict[str, float]
    columns: tuple[AddedColumn, ...]

    def evaluate(self, motion: ArmMotion) -> Floats:
        """Return the entries of its columns, column by column, row by row, (E, N)."""
        return self.effect.columns(motion, self.place, self.shape).reshape(-1, len(motion))


def added_effects(robot: Robot) -> tuple[Added, ...]:
    """Return the effects of a robot file, place by place; a torque delay has no column (``delay_of``)."""
    found = []
    for spec in robot.effects:
        effect = checked(spec, robot)
        if effect.name == "torque_delay":
            continue
        shape = {name: spec.parameters[name] for name in effect.shape_units}
        for place in places_of(spec, robot):
            rows = effect.rows(place, robot.n)
            label = f"{effect.name}{'_'.join(str(j + 1) for j in place)}"
            columns = tuple(
                AddedColumn(f"{label}_{name}", unit, rows, spec.parameters.get(name, 0.0))
                for name, unit in effect.amplitudes(shape).items()
            )
            found.append(Added(effect, place, shape, columns))
    return tuple(found)


def checked(spec: EffectSpec, robot: Robot) -> Effect:
    """Return the effect that an entry of the robot file names.

    Raises:
        WrongRobotFile: there is no such effect, or a number that gives it its shape is missing.
    """
    where = str(robot.path or robot.name)
    effect = CATALOGUE.get(spec.effect)
    if effect is None:
        near = difflib.get_close_matches(spec.effect, CATALOGUE, 1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        raise WrongRobotFile(
            f"effects: no effect '{spec.effect}'{hint}", where=where, fix=f"one of {', '.join(CATALOGUE)}"
        )
    needed = [*effect.shape_units, *(["delay"] if effect.name == "torque_delay" else [])]
    missing = [name for name in needed if name not in spec.parameters]
    if missing:
        raise WrongRobotFile(f"effects: {spec.effect} needs parameters {', '.join(missing)}", where=where)
    if effect.scope == "pair" and len(spec.joints) != 2:
        raise WrongRobotFile(f"effects: {spec.effect} needs two joints: the one it acts on and the other", where=where)
    return effect


def places_of(spec: EffectSpec, robot: Robot) -> list[Place]:
    """Return where a listed effect sits: one place a joint, the pair, or the whole arm."""
    index = [robot.joint_names.index(name) for name in spec.joints]
    scope = CATALOGUE[spec.effect].scope
    return [(j,) for j in index] if scope == "joint" else [tuple(index)] if scope == "pair" else [()]


def delay_of(robot: Robot) -> float:
    """Return how late the torques of a robot's logs are [s]."""
    return float(sum(spec.parameters["delay"] for spec in robot.effects if checked(spec, robot).name == "torque_delay"))


def joined_motion(motions: list[ArmMotion]) -> ArmMotion:
    """Return several stretches as one, for grids that depend on where the arm went."""
    if len(motions) == 1:
        return motions[0]
    signals = ("t", "q", "qd", "qdd", "coulomb_sign")
    parts = {key: np.concatenate([getattr(motion, key) for motion in motions]) for key in signals}
    return ArmMotion(**parts, robot=motions[0].robot, reference=motions[0].reference, smooth=motions[0].smooth)
