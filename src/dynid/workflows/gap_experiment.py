"""From a gap search to the question of the next experiment: what was not told apart, and what stayed unexplained."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dynid.arrays import Floats
from dynid.errors import WrongUsage
from dynid.gap.record import GapRecord
from dynid.loading import load_run
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.separation import GapQuestion, Rivalry, run_of, separation

#: A joint whose residual is so many times the noise's power has something unexplained, as in the verdict.
LOUD = 1.25
#: Lead in evidence from which one explanation is better beyond doubt, and how many times as much a plan should promise.
CLEAR, SAFETY = 12.0, 3.0


def question_of(record: GapRecord, base: BaseModel, theta: Floats) -> GapQuestion:
    """Return what a gap search left open.

    Args:
        record: the search.
        base: model and base parameters of the arm.
        theta: base parameters by the prior, where the searched result is not at hand, (p,).

    Raises:
        WrongUsage: it was another arm, or nothing is open.
    """
    if record.joint_names != base.robot.joint_names:
        what = f"the search was made for {record.robot}, whose joints differ from those of {base.robot.name}"
        raise WrongUsage(f"--for-gap: {what}", fix="give the robot file that was searched")
    rivalries = tuple(_rivalries(record))
    above = sorted(one.joint for one in record.joints if one.chi > LOUD)
    unexplained = tuple(above) if record.verdict == "unexplained" else ()
    if not rivalries and not unexplained:
        verdict = record.verdict.replace("_", " ")
        raise WrongUsage(
            "--for-gap: the search left no question that a motion could answer",
            why=f"its verdict is {verdict}, and no two explanations fitted equally well",
            fix="plan without --for-gap; to test the model on a new log: dynid validate",
        )
    if record.made_from and Path(record.made_from).is_file():
        result = load_run(Path(record.made_from))
        if tuple(result.names) == base.reduction.base_names:
            theta = result.theta
    return GapQuestion(rivalries, unexplained, np.asarray(record.improvement.floor), theta)


def _rivalries(record: GapRecord) -> Iterator[Rivalry]:
    """Yield each named effect beside each of its rivals."""
    for one in record.named:
        effect = CATALOGUE[one.effect]
        shape = {name: one.values[name] for name in effect.shape_units}
        for (rival, joints), text in zip(one.rival_keys, one.rivals, strict=True):
            yield Rivalry(
                effect=effect,
                joints=one.indices,
                shape=shape,
                amplitudes=np.array([one.values[name] for name in effect.amplitudes(shape)]),
                rival=CATALOGUE[rival],
                rival_joints=joints,
                text=f"{one.effect} on {one.where} and {text}",
            )


def outlook(base: BaseModel, question: GapQuestion, trajectory: Trajectory) -> Iterator[str]:
    """Yield what the next search will tell with a log of a motion, a sentence for each open question."""
    after = separation(base, question, run_of(trajectory))
    for pair, lead in zip(question.rivalries, after.leads, strict=True):
        sure = "will be separated" if lead > SAFETY * CLEAR else "may still fit equally well"
        yield f"{pair.text} {sure}: expected lead {lead:.2g}; {CLEAR:g} is clear"
    if after.spread is not None:
        where = ", ".join(base.robot.joint_names[j] for j in question.unexplained)
        size = f"{100 * np.exp(-after.spread / 2):.2g} % of the noise"
        yield f"the unexplained torque on {where} will be known to {size}"
