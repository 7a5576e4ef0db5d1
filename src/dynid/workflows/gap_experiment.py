"""From a gap search to the question of the next experiment: what was not told apart, and what stayed unexplained."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.arrays import Floats
from dynid.errors import DynidError, WrongUsage
from dynid.gap.record import GapEffect, GapRecord
from dynid.loading import checked_log, condition_logs, load_run, read_log
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE
from dynid.motion import Motion
from dynid.options import LogOptions
from dynid.trajectory import tuning
from dynid.trajectory.optimise import SearchOutcome
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.planning import PlanningContext, plan_problem
from dynid.trajectory.separation import (
    GapQuestion,
    Rivalry,
    Separation,
    run_of,
    separate,
    separation,
)

#: A joint whose residual is so many times the noise's power has something unexplained, as in the verdict.
LOUD = 1.25


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
    rivalries = tuple(
        _rivalry(one, key, text)
        for one in record.named
        for key, text in zip(one.rival_keys, one.rivals, strict=True)
    )
    above = sorted(one.joint for one in record.joints if one.chi > LOUD)
    unexplained = tuple(above) if record.verdict == "unexplained" else ()
    if not rivalries and not unexplained:
        verdict = record.verdict.replace("_", " ")
        raise WrongUsage(
            "--for-gap: the search left no question that a motion could answer",
            why=f"its verdict is {verdict}, and no two explanations fitted equally well",
            fix="plan without --for-gap; to test the model on a new log: dynid validate",
        )
    path = Path(record.made_from)
    if record.made_from and path.is_file():
        result = load_run(path)
        if tuple(result.names) == base.reduction.base_names:
            theta = result.theta
    return GapQuestion(rivalries, unexplained, np.asarray(record.improvement.floor), theta)


def _rivalry(one: GapEffect, key: tuple[str, tuple[int, ...]], text: str) -> Rivalry:
    """Return an effect beside one of its rivals, by identifier and joints, and in words."""
    effect, (rival, joints) = CATALOGUE[one.effect], key
    shape = {name: one.values[name] for name in effect.shape_units}
    return Rivalry(
        effect=effect,
        joints=one.indices,
        shape=shape,
        amplitudes=np.array([one.values[name] for name in effect.amplitudes(shape)]),
        rival=CATALOGUE[rival],
        rival_joints=joints,
        text=f"{one.effect} on {one.where} and {text}",
    )


def _of_logs(record: GapRecord, base: BaseModel, question: GapQuestion) -> Separation | None:
    """Return what the searched logs tell themselves; None where they are not at hand."""
    paths, options = [Path(name) for name in record.logs], LogOptions(delay=0.0)
    if not paths or not all(path.is_file() for path in paths):
        return None
    try:
        logs = [checked_log(read_log(path, base.robot), base.robot, options) for path in paths]
        conditioned = condition_logs(logs, base.model, options)
    except DynidError:
        return None
    segments = [segment for log in conditioned for segment in log.segments]
    step = max(1, sum(len(segment) for segment in segments) // (tuning.RUN_SAMPLES * len(paths)))
    q, qd, qdd = (
        np.concatenate([getattr(s, key)[::step] for s in segments]) for key in ("q", "qd", "qdd")
    )
    rate = conditioned[0].filter.rate / step
    return separation(base, question, Motion(np.arange(len(q)) / rate, q, qd, qdd))


@dataclass(frozen=True)
class GapExperiment:
    """The next experiment after a gap search.

    Attributes:
        base: model and base parameters.
        question: what the search left open.
        before: what the searched logs tell; None where they are not at hand.
    """

    base: BaseModel
    question: GapQuestion
    before: Separation | None

    @classmethod
    def of(cls, record: GapRecord, context: PlanningContext) -> GapExperiment:
        """Return the experiment that a search asks for on a prepared arm."""
        base = context.base
        question = question_of(record, base, context.theta)
        return cls(base, question, _of_logs(record, base, question))

    def search(self, context: PlanningContext, limit: float) -> SearchOutcome:
        """Search for the motion that answers best, for so many seconds at most."""
        problem = plan_problem(context)
        return separate(problem, self.base, self.question, context.options, limit)

    def outlook(self, trajectory: Trajectory) -> tuple[str, ...]:
        """Return how much better the second search will be, a sentence for each open question."""
        after, before = separation(self.base, self.question, run_of(trajectory)), self.before
        sentences, in_logs = [], "in the logs that were searched"
        for k, pair in enumerate(self.question.rivalries):
            then = "" if before is None else f", {before.leads[k]:.2g} {in_logs}"
            separated = after.leads[k] > SAFETY * CLEAR
            sure = "will be separated" if separated else "may still fit equally well"
            lead = f"expected lead {after.leads[k]:.2g}{then}; {CLEAR:g} is clear"
            sentences.append(f"{pair.text} {sure}: {lead}")
        if after.spread is not None:
            then = ""
            if before is not None and before.spread is not None:
                then = f", {100 * np.exp(-before.spread / 2):.2g} % {in_logs}"
            where = ", ".join(self.base.robot.joint_names[j] for j in self.question.unexplained)
            size = f"will be known to {100 * np.exp(-after.spread / 2):.2g} % of the noise"
            sentences.append(f"the unexplained torque on {where} {size}{then}")
        return tuple(sentences)


#: Lead in evidence from which one explanation is better beyond doubt, and how many times as much a plan should promise.
CLEAR, SAFETY = 12.0, 3.0
