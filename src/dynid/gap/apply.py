"""Add what was named: a copy of the robot file with the effects, and the arm identified again on the training rows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.errors import CannotWrite
from dynid.files.artifact import write_text
from dynid.gap.final import Fitted
from dynid.gap.setting import BETWEEN, Setting
from dynid.gap.stretches import Mask
from dynid.identify.effects import ROUNDS, on_time, scaled, with_effects
from dynid.identify.estimate import HoldOut, estimate
from dynid.identify.result import Identification
from dynid.identify.stack import Source, Stack, stack
from dynid.model.reduce import with_added
from dynid.model.reference import reference_of
from dynid.model.regressor import Model
from dynid.model.store import BaseModel
from dynid.robot import EffectSpec, Robot


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


def specs_of(fitted: Sequence[Fitted], robot: Robot) -> list[EffectSpec]:
    """Return the robot file's entries, numbers rounded to what their errors leave."""
    found = []
    for one in fitted:
        spec = one.spec(robot.joint_names)
        parameters = {name: float(f"{value:.6g}") for name, value in spec.parameters.items()}
        errors = {name: float(f"{value:.2g}") for name, value in spec.std_error.items()}
        found.append(replace(spec, parameters=parameters, std_error=errors))
    return found


def identify_again(
    sources: Sequence[Source], setting: Setting, base: BaseModel, specs: Sequence[EffectSpec]
) -> tuple[BaseModel, Identification, list[Source]]:
    """Identify the arm with effects on the training rows alone; the held-out rows judge it.

    Args:
        sources: conditioned logs, as read without the effects.
        setting: which rows are held out.
        base: model without the effects.
        specs: the effects.

    Returns:
        Model, parameters, and the logs with the effects' columns.
    """
    added = with_specs(base, specs)
    delay = sum(spec.parameters.get("delay", 0.0) for spec in specs if spec.effect == "torque_delay")
    late = [replace(s, segments=[on_time(x, delay) for x in s.segments]) for s in sources]
    first = reference_of(base.model, base.reduction, setting.theta)
    made = [with_effects(source, added.model, first) for source in late]
    for _ in range(ROUNDS if any(effect.effect.needs_model for effect in added.model.added) else 0):
        made = scaled(made, added, _fit(made, setting, added).theta)
    return added, _fit(made, setting, added), made


def _fit(sources: Sequence[Source], setting: Setting, base: BaseModel) -> Identification:
    reduction = base.reduction
    stacked = stack(sources, base.model.observer(reduction.base), reduction.base_names, base.robot.joint_names)
    train, held = _blocks(stacked, setting)
    trained = replace(
        stacked,
        factors=stacked.factors[train],
        rows=stacked.rows[train],
        logs=stacked.logs[train],
        start=stacked.start[train],
    )
    holdout = HoldOut(np.ones(int(train.sum()), dtype=bool), stacked, held, setting.held_text)
    return estimate(replace(trained, sources=(), observer=None), base, method="wls", holdout=holdout, drop_weak=True)


def _blocks(stacked: Stack, setting: Setting) -> tuple[Mask, Mask]:
    """Return which blocks of the stack lie in the training and in the held-out rows."""
    train, held = np.zeros(stacked.blocks, dtype=bool), np.zeros(stacked.blocks, dtype=bool)
    for s, t, h in zip(setting.stretches, setting.train, setting.held, strict=True):
        inside = stacked.logs == s.log
        begin = s.source.segments[0].t[0] - s.source.segments[0].since[0]
        since = stacked.start[inside] - begin
        for mask, rows, margin in ((train, t, BETWEEN), (held, h, 0.0)):
            if rows.any():
                first, last = s.t[rows][0], s.t[rows][-1]
                mask[np.flatnonzero(inside)] |= (since >= first - 1e-6) & (since <= last - margin)
    return train, held & ~train


def write_robot(robot: Robot, specs: Sequence[EffectSpec], path: Path) -> str:
    """Write a copy of the robot file with the effects; comments and layout of the file stay.

    Args:
        robot: the arm, read from a file.
        specs: the new entries; those the file already has stay.
        path: the copy.

    Returns:
        Its text.
    """
    import yaml

    if robot.path is None:
        raise CannotWrite("the robot was not read from a file, so there is nothing to copy")
    text = robot.path.read_text(encoding="utf-8").rstrip("\n")
    entries = [
        {"effect": s.effect, "joints": list(s.joints), "parameters": s.parameters, "std_error": s.std_error}
        for s in (*robot.effects, *specs)
    ]
    block = yaml.safe_dump(
        {"effects": entries}, sort_keys=False, default_flow_style=None, width=110, allow_unicode=True
    )
    without = re.sub(r"(?m)^effects:.*\n?(?:^[ \t\-].*\n?|^\s*\n)*", "", text + "\n")
    written = (
        f"{without.rstrip()}\n\n# Added by dynid gap; amplitudes are identified again with everything else.\n{block}"
    )
    write_text(path, written)
    return written


def new_name(robot: Robot, specs: Sequence[EffectSpec]) -> str:
    """Return the name of the copy, such as ``arm+stribeck2``."""
    index = {name: str(k + 1) for k, name in enumerate(robot.joint_names)}
    parts = [s.effect + ("_".join(index[j] for j in s.joints) if len(s.joints) < robot.n else "") for s in specs]
    return "+".join([robot.slug, *parts])
