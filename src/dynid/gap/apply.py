"""Add what was named: a copy of the robot file with the effects, and the logs stacked for a model that has them."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from dynid.arrays import Floats
from dynid.disk import write_text
from dynid.estimation.stack import Stack, stack_logs, stack_with_settled_effects
from dynid.files.robotfile import text_of
from dynid.judgement.gap import GapEffect
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE, delay_of
from dynid.model.reduce import with_added
from dynid.model.regressor import Model
from dynid.robot import EffectSpec, Robot
from dynid.signals.conditioned_log import ConditionedLog, torques_moved_back, with_effects
from dynid.text import yaml_text


def with_specs(base: BaseModel, specs: Sequence[EffectSpec]) -> BaseModel:
    """Return a model with effects added; the rigid body and its base parameters stay as they are."""
    robot = replace(base.robot, effects=(*base.robot.effects, *specs))
    model = Model(robot, base.model.rigid)
    return BaseModel(model, with_added(base.reduction, model))


def specs_of(effects: Sequence[GapEffect], clock: float) -> list[EffectSpec]:
    """Return the robot file's entries, numbers rounded to what their errors leave.

    Args:
        effects: what was found.
        clock: the stamp that those which change with time count from [s].
    """
    return [
        EffectSpec(
            one.effect,
            one.joints,
            {name: float(f"{value:.6g}") for name, value in one.values.items()}
            | ({"clock": clock} if "s" in CATALOGUE[one.effect].shape_units.values() else {}),
            {name: float(f"{error:.2g}") for name, error in one.std_errors.items()},
        )
        for one in effects
    ]


def stacked_with(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    specs: Sequence[EffectSpec],
    theta: Floats,
    earlier: Sequence[ConditionedLog] = (),
) -> tuple[BaseModel, Stack]:
    """Return the model with effects, and the logs stacked for it.

    Args:
        logs: conditioned logs, as read without the effects.
        base: model without the effects.
        specs: the effects.
        theta: base parameters without the effects, which effects scale with first, (p,).
        earlier: conditioned logs of a time when the effects were not there yet.
    """
    added = with_specs(base, specs)
    delay = delay_of(specs)
    late = [replace(torques_moved_back(s, base.model, delay), delay=s.delay) for s in logs]
    first = base.torques(theta)
    made = stack_with_settled_effects([with_effects(s, added.model, first) for s in late], added)
    return added, stack_logs([*(_before(s, base, added) for s in earlier), *made.logs], added)


def _before(log: ConditionedLog, base: BaseModel, added: BaseModel) -> ConditionedLog:
    """Return a log of a time when the effects that were added were not there: their columns are zero."""
    known = sum(len(one.rows) * len(one.parameters) for one in base.model.added)
    log = with_effects(log, added.model)
    for segment in log.segments:
        segment.effects[:, known:] = 0.0
    return log


def write_robot(robot: Robot, specs: Sequence[EffectSpec], path: Path) -> None:
    """Write a copy of the robot file with the effects; comments and layout of the file stay.

    Args:
        robot: the arm, read from a file.
        specs: the new entries; those the file already has stay.
        path: the copy.
    """
    text = text_of(robot, with_prior=False).rstrip("\n")
    entries = [{**s.facts(), "joints": list(s.joints)} for s in (*robot.effects, *specs)]
    block = yaml_text({"effects": entries}, width=110)
    without = re.sub(r"(?m)^effects:.*\n?(?:^[ \t\-].*\n?|^\s*\n)*", "", text + "\n")
    note = "# Added by dynid gap; amplitudes are identified again with everything else."
    write_text(path, f"{without.rstrip()}\n\n{note}\n{block}")
