"""The columns of the effects that a robot file lists."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np

from dynid.arrays import Floats
from dynid.errors import WrongRobotFile
from dynid.model.effects.expression import formula_terms
from dynid.model.effects.interface import Effect
from dynid.model.effects.motion import ArmMotion, Joints
from dynid.model.effects.table import CATALOGUE as CATALOGUE
from dynid.model.parameters import Parameter
from dynid.robot import EffectSpec, Robot

#: The effect that has no column.
DELAY = "torque_delay"


@dataclass(frozen=True)
class Added:
    """One effect of a robot file on one joint, one pair of joints or the whole arm.

    Attributes:
        effect: the effect.
        joints: the joints that it belongs to.
        shape: its non-linear parameters.
        rows: joints it acts on, 0-based.
        parameters: what its columns stand for, such as ``stribeck4_a``.
    """

    effect: Effect
    joints: Joints
    shape: dict[str, float]
    rows: tuple[int, ...]
    parameters: tuple[Parameter, ...]

    @property
    def names(self) -> list[str]:
        """Names of its columns."""
        return [parameter.name for parameter in self.parameters]

    def evaluate(self, motion: ArmMotion) -> Floats:
        """Return the entries of its columns, column by column, row by row, (E, N).

        Raises:
            WrongRobotFile: with these numbers it has no torque, such as a time constant of zero.
        """
        columns = self.effect.columns(motion, self.joints, self.shape).reshape(-1, len(motion))
        if not np.all(np.isfinite(columns)):
            shown = (
                ", ".join(f"{name} = {value:g}" for name, value in self.shape.items())
                or "its formula"
            )
            place = _place(self.joints, motion.robot)
            _refuse(motion.robot, f"{self.effect.name} {place}: {shown} gives no finite torque")
        return columns


def added_effects(robot: Robot) -> tuple[Added, ...]:
    """Return the effects of a robot file, joint by joint; a torque delay has no column (``delay_of``)."""
    added: list[Added] = []
    for spec in robot.effects:
        effect = checked(spec, robot)
        if effect.name == DELAY:
            continue
        shape = {name: spec.parameters[name] for name in effect.shape_units}
        for joints in joints_of(spec, effect, robot):
            alike = [one for one in added if (one.effect.name, one.joints) == (effect.name, joints)]
            if any(one.shape == shape for one in alike):
                _refuse(robot, f"{effect.name} is given twice {_place(joints, robot)}")
            rows = effect.rows(joints, robot.n)
            label = f"{effect.name}{'_'.join(str(j + 1) for j in joints)}"
            # Why: two waves on one joint are two effects, and every column needs a name of its own.
            more = f"_{len(alike) + 1}" if alike else ""
            parameters = tuple(
                Parameter(effect.name, rows[0] + 1, unit, f"{label}_{name}{more}")
                for name, unit in effect.amplitudes(shape).items()
            )
            added.append(Added(effect, joints, shape, rows, parameters))
    return tuple(added)


def _place(joints: Joints, robot: Robot) -> str:
    return f"on {' and '.join(robot.joint_names[j] for j in joints)}" if joints else "on the arm"


def checked(spec: EffectSpec, robot: Robot) -> Effect:
    """Return the effect that an entry of the robot file names.

    Raises:
        WrongRobotFile: there is no such effect, or a number that gives it its shape is missing.
    """
    if spec.effect == "formula":
        return _formula(spec, robot)
    effect = CATALOGUE.get(spec.effect)
    if effect is None:
        near = difflib.get_close_matches(spec.effect, CATALOGUE, 1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        fix = f"formula, or one of {', '.join(CATALOGUE)}"
        _refuse(robot, f"no effect '{spec.effect}'{hint}", fix)
    missing = [name for name in effect.shape_units if name not in spec.parameters]
    if missing:
        _refuse(robot, f"{spec.effect} needs parameters {', '.join(missing)}")
    if effect.scope == "joint" and not spec.joints:
        _refuse(robot, f"{spec.effect} acts on no joint", "joints: [NAME]")
    if effect.scope == "pair" and len(set(spec.joints)) != 2:
        _refuse(robot, f"{spec.effect} needs two joints: the one it acts on and the other")
    return effect.at_size({name: spec.parameters.get(name, 0.0) for name in effect.units})


def _refuse(robot: Robot, what: str, fix: str = "") -> NoReturn:
    raise WrongRobotFile(f"effects: {what}", where=robot.path or robot.name, fix=fix)


def _formula(spec: EffectSpec, robot: Robot) -> Effect:
    """Return the effect of a formula of the robot file."""
    if not spec.formula:
        _refuse(robot, "formula needs the key formula", "formula: a cos(2 q4) |qd4|")
    if not spec.joints:
        _refuse(robot, "formula acts on no joint", "joints: [NAME]")
    text = " ".join(spec.formula.split())
    terms = formula_terms(text, robot.n)
    unknown = [name for name in spec.parameters if name not in terms]
    if unknown:
        what = f"formula '{text}' has no amplitude '{unknown[0]}'"
        _refuse(robot, what, f"{', '.join(terms)}")
    torque = robot.joints[robot.joint_names.index(spec.joints[0])].torque_unit
    units = dict.fromkeys(terms, f"{torque} per unit of its factor")
    return Effect(name=spec.effect, terms=tuple(terms.values()), units=units, needs_model=True)


def joints_of(spec: EffectSpec, effect: Effect, robot: Robot) -> list[Joints]:
    """Return the joints that a listed effect belongs to: each joint alone, the pair, or () for the whole arm."""
    index = [robot.joint_names.index(name) for name in spec.joints]
    if effect.scope == "joint":
        return [(j,) for j in index]
    return [tuple(index) if effect.scope == "pair" else ()]


def delay_of(effects: Iterable[EffectSpec]) -> float:
    """Return how late effects of a robot file make the torques of its logs [s]."""
    delays = (one.parameters.get("delay", 0.0) for one in effects if one.effect == DELAY)
    return float(sum(delays))


def joined_motion(motions: list[ArmMotion]) -> ArmMotion:
    """Return several intervals as one, for grids that depend on where the arm went."""
    signals = ("t", "q", "qd", "qdd", "coulomb_sign")
    parts: dict[str, Any] = {
        key: np.concatenate([getattr(motion, key) for motion in motions]) for key in signals
    }
    return replace(motions[0], **parts)
