"""Add what was named: a copy of the robot file with the effects, and the arm identified again on the training rows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.estimation.effect_columns import scaled, settled
from dynid.estimation.estimate import HoldOut, estimate
from dynid.estimation.least_squares import weighted
from dynid.estimation.result import Identification
from dynid.estimation.stack import stack_base
from dynid.files.artifact import write_text
from dynid.files.robotfile import robot_text
from dynid.gap.problem import GapProblem
from dynid.gap.record import GapEffect
from dynid.gap.segments import Mask
from dynid.gap.selected_effects import SelectedEffect
from dynid.model.base_model import BaseModel
from dynid.model.reduce import with_added
from dynid.model.reference import model_torques
from dynid.model.regressor import Model
from dynid.robot import EffectSpec, Robot
from dynid.signals.conditioned_log import ConditionedLog, with_effects
from dynid.signals.conditioning import Segment
from dynid.signals.delay import segment_without_delay


def with_specs(base: BaseModel, specs: Sequence[EffectSpec]) -> BaseModel:
    """Return a model with effects added; the rigid body and its base parameters stay as they are."""
    robot = replace(base.robot, effects=(*base.robot.effects, *specs))
    model = Model(robot, base.model.rigid)
    kept = Model(replace(robot, effects=()), base.model.rigid).size
    plain = replace(
        base.reduction,
        names=base.reduction.names[:kept],
        base=base.reduction.base[base.reduction.base < kept],
        K=base.reduction.K[base.reduction.base < kept, :kept],
        alone=tuple(name for name in base.reduction.alone if name in base.reduction.names[:kept]),
    )
    return BaseModel(model, with_added(plain, model))


def specs_of(effects: Sequence[SelectedEffect], robot: Robot) -> list[EffectSpec]:
    """Return the robot file's entries, numbers rounded to what their errors leave."""
    return [
        EffectSpec(
            one.name,
            tuple(robot.joint_names[j] for j in one.joints or range(robot.n)),
            {name: float(f"{value:.6g}") for name, value in one.values.items()},
            {name: float(f"{value:.2g}") for name, value in one.std_errors.items()},
        )
        for one in effects
    ]


def identify_again(
    logs: Sequence[ConditionedLog], problem: GapProblem, base: BaseModel, specs: Sequence[EffectSpec]
) -> Identification:
    """Identify the arm with effects on the training rows alone; the held-out rows judge it.

    Args:
        logs: conditioned logs, as read without the effects.
        problem: which rows are held out.
        base: model without the effects.
        specs: the effects.
    """
    added = with_specs(base, specs)
    delay = sum(spec.parameters.get("delay", 0.0) for spec in specs if spec.effect == "torque_delay")
    late = [replace(s, segments=[segment_without_delay(x, delay) for x in s.segments]) for s in logs]
    first = model_torques(base.model, base.reduction, problem.theta)
    made = settled(only([with_effects(s, added.model, first) for s in late], problem, problem.train), added)
    train = stack_base(made, added)
    held = stack_base(scaled(only(late, problem, problem.held), added, weighted(*train.whole).theta), added)
    holdout = HoldOut(train, held.select(held.counts.sum(axis=1) > 0), problem.held_text)
    return estimate(train, added, method="wls", holdout=holdout, drop_weak=True)


def only(logs: Sequence[ConditionedLog], problem: GapProblem, chosen: Sequence[Mask]) -> list[ConditionedLog]:
    """Return logs of which only the chosen rows count, one mask per segment."""
    spans = {
        (s.number, float(s.motion.t[0])): (s.t[rows][0], s.t[rows][-1])
        for s, rows in zip(problem.segments, chosen, strict=True)
        if rows.any()
    }
    return [
        replace(log, segments=[_within(x, spans.get((k, float(x.elapsed[0])))) for x in log.segments])
        for k, log in enumerate(logs)
    ]


def _within(segment: Segment, span: tuple[float, float] | None) -> Segment:
    inside = (
        np.zeros(len(segment), dtype=bool)
        if span is None
        else (segment.elapsed >= span[0]) & (segment.elapsed <= span[1])
    )
    return replace(segment, usable=segment.usable & inside[:, None])


def write_robot(robot: Robot, specs: Sequence[EffectSpec], path: Path) -> None:
    """Write a copy of the robot file with the effects; comments and layout of the file stay.

    Args:
        robot: the arm, read from a file.
        specs: the new entries; those the file already has stay.
        path: the copy.
    """
    import yaml

    text = (robot_text(robot) if robot.path is None else robot.path.read_text(encoding="utf-8")).rstrip("\n")
    entries = [
        {"effect": s.effect, "joints": list(s.joints), "parameters": s.parameters, "std_error": s.std_error}
        for s in (*robot.effects, *specs)
    ]
    block = yaml.safe_dump(
        {"effects": entries}, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True
    )
    without = re.sub(r"(?m)^effects:.*\n?(?:^[ \t\-].*\n?|^\s*\n)*", "", text + "\n")
    note = "# Added by dynid gap; amplitudes are identified again with everything else."
    write_text(path, f"{without.rstrip()}\n\n{note}\n{block}")


def new_name(robot: Robot, effects: Sequence[EffectSpec | GapEffect]) -> str:
    """Return the name of the copy, such as ``arm+stribeck2``."""
    index = {name: str(k + 1) for k, name in enumerate(robot.joint_names)}
    parts = [s.effect + ("_".join(index[j] for j in s.joints) if len(s.joints) < robot.n else "") for s in effects]
    return "+".join([robot.slug, *parts])
