"""Find where model and measurement disagree and name what is missing: which question is asked, in which order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.answer import picked
from dynid.arguments import public
from dynid.disk import sha256
from dynid.errors import DynidError
from dynid.estimation.evidence import evidence_of, fingerprint, found_log
from dynid.estimation.payload import find_payload
from dynid.estimation.result import Identification
from dynid.gap.analysis import (
    CUTOFF,
    GapAnalysis,
    analyse_gap,
    relative_error,
    with_counterbalances,
)
from dynid.gap.candidates import SelectionOptions
from dynid.gap.counterbalance import Suspicion, suspicions
from dynid.gap.loads import named_load, with_reestimated_payload
from dynid.gap.possible_arm import COUNTERBALANCE
from dynid.gap.problem import kept_model
from dynid.gap.record import GapEffect, record_of
from dynid.loading import (
    LogsLike,
    ResultLike,
    as_logs,
    as_result,
    check_weight,
    checked_log,
    condition_logs,
    load_log,
)
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE
from dynid.progress import Progress, heard_by, stage
from dynid.signals.conditioned_log import ConditionedLog, stretches
from dynid.workflows.gap_result import Gap, selection_options
from dynid.workflows.identify import identify
from dynid.workflows.model import base_model_of
from dynid.workflows.options import GapOptions
from dynid.workflows.validate import Validation, validate

#: What each question asks, as the answer says it.
ASKED = {
    "numbers": "which effects remain after refitting all parameters?",
    "arm": "which effects remain when the links have to be plausible?",
    "changed": "what has changed since the model was identified?",
}
#: A kept model that misses so many times more of new torques than of its own, although nothing has changed, is told.
EXTRAPOLATES = 1.5
#: Longer recordings are searched in stretches that are so long together [s]: whitened columns of a hundred candidates
#: of eight minutes take half a gigabyte.
LONGEST = 480.0


@public
def find_gap(
    result: ResultLike,
    logs: LogsLike,
    options: GapOptions = GapOptions(),
    *,
    earlier: LogsLike = (),
    base: BaseModel | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Gap:
    """Find where a model and recordings disagree, which effect is missing, and how much smaller the gap is with it.

    Args:
        result: identified parameters, their folder or their file.
        logs: one or several recordings, or their paths; each motion twice, so that the noise is known.
        options: what is searched and how.
        earlier: logs that the model was identified from (``earlier_logs``), to find what has changed since.
        base: the result's base model, where it is there already.
        progress: reports how far the work is.
        changes: single options by name, such as ``joints="2-4"``; see ``dynid.GapOptions``.

    Raises:
        WrongUsage: there is no effect or no joint of a name that was given, or an argument is something else than what
            is wanted (E101).
        DynidError: the first serious fault of a log.

    Example:
        dynid.find_gap("out/kuka_lwr4plus", ["run3.bag", "run4.bag"])
    """
    result = as_result(result)
    recordings = as_logs(logs, result.robot, options)
    known = as_logs(earlier, result.robot, options, "earlier", empty=True)
    base = base or base_model_of(result)
    search = _Search(result, base, selection_options(base.robot, options), options)
    new, question = search.checked(recordings), options.question
    before = search.checked(known) if question in ("auto", "changed") else []
    if question == "auto":
        return search.judged(_answered(search, new, before), new)
    return search.judged(search.ask(question, new, before, ASKED[question]), new)


def _answered(search: _Search, new: Sequence[Log], before: Sequence[Log]) -> Gap:
    """Return the answer to the question that the logs allow."""
    if any(log.sha256 and log.sha256 in search.result.log_sha256 for log in new):
        return search.of_the_arm(new, "the model was identified from these logs")
    if not before:
        why = "the logs that the model was identified from were not found"
        found = search.of_the_arm(new, why)
        named = not found.verdict.startswith("nothing")
        if named or search.judged(found, new).verdict == found.verdict:
            return found
        # Why: new numbers for all parameters take in a load, and the model as it is does not.
        why += ", and the error of the model is larger than expected."
        changed = search.ask("changed", new, (), why)
        return changed if changed.named else found
    changed = search.ask("changed", new, before, ASKED["changed"])
    if changed.named:
        return changed
    unchanged = changed.verdict == "nothing_changed"
    told = "Nothing has changed" if unchanged else "No change could be named"
    why = f"{changed.asked} {told}, so all {len(before) + len(new)} logs were searched"
    return search.of_the_arm([*before, *new], why)


@dataclass(frozen=True)
class _Search:
    """Questions to one model.

    Attributes:
        result: the result.
        base: its base model.
        wanted: what is searched.
        options: how recordings are read.
    """

    result: Identification
    base: BaseModel
    wanted: SelectionOptions
    options: GapOptions

    def checked(self, logs: Sequence[Log]) -> list[Log]:
        """Return checked recordings."""
        found = [checked_log(log, self.base.robot, self.options, identify=False) for log in logs]
        for log in found:
            check_weight(log, self.base.robot)
        return found

    def ask(
        self,
        question: str,
        logs: Sequence[Log],
        earlier: Sequence[Log],
        why: str,
    ) -> Gap:
        """Ask one question of checked logs.

        Args:
            question: one of ``QUESTIONS``.
            logs: the recordings.
            earlier: those that the model was identified from, to find what has changed since.
            why: why this is asked, in words.
        """
        base, wanted = self.base, self.wanted
        options = signals_of(self.result, self.options, question)
        conditioned = self._conditioned(logs, options)
        before = self._conditioned(earlier, options) if earlier else []
        stage("search")
        analysis = analyse_gap(
            conditioned,
            base,
            kept_model(self.result) if question == "changed" else None,
            wanted,
            earlier=before,
            possible=self.result.in_force == "physical",
        )
        if question == "arm":
            analysis = with_counterbalances(analysis, wanted, wanted.joints or range(base.robot.n))
        if question == "changed":
            now = relative_error(conditioned, base, self.result.theta)
            then = relative_error(before, base, self.result.theta) if before else 0.0
            why += _kept_error(now, then, analysis.verdict.word == "nothing_changed")
            analysis = self._with_reestimated_payload(analysis, logs) if earlier else analysis
        found = self._recorded(analysis, question, why)
        return replace(found, recordings=tuple(logs), before=tuple(earlier), signals=options)

    @heard_by()
    def _replays(
        self, logs: Sequence[Log], result: Identification, cutoff: float | None = None
    ) -> list[Validation]:
        """Return replays of logs by a result, read as they were for the search."""
        read = picked(self.options, "exclude", "velocity")
        base = self.base if result is self.result else None
        return [validate(result, log, base=base, cutoff=cutoff, **read) for log in logs]

    def judged(self, gap: Gap, new: Sequence[Log]) -> Gap:
        """Return an answer beside how the model as it is does on the new logs: "nothing" only where that agrees."""
        fitted = [sha for sha in self.result.log_sha256 if sha]
        replays = self._replays([log for log in new if log.sha256 not in fitted], self.result)
        if replays:
            # The worst of them.
            kept = max(
                replays, key=lambda one: one.relative_error_percent / (one.expected_percent or 1.0)
            )
            gap = replace(
                gap,
                kept=kept.relative_error_percent,
                expected=kept.expected_percent,
                kept_rms=tuple(joint.rms for joint in kept.joints),
            )
        if evidence_of(self.result).of_another_arm:
            gap = self._unproved(gap)
        if gap.named and gap.unseen_logs:
            gap = self._proved(gap)
        if gap.verdict.startswith("nothing") and gap.judgement.light("complete").state != "good":
            gap = replace(gap, verdict="unexplained", advice="")
        return gap

    def _proved(self, gap: Gap) -> Gap:
        """Return an answer with the errors that ``apply`` and then ``validate`` reach on the recordings held out."""
        after = self._errors(gap.apply(), gap)
        before, at = self._before(gap), gap.joint_names.index
        named = tuple(
            replace(
                one,
                rms_before=float(before[at(one.joint)]),
                rms_after=float(after[at(one.joint)]),
            )
            for one in gap.named
        )
        improvement = replace(gap.improvement, before=before, after=after)
        return replace(gap, named=named, improvement=improvement)

    def _unproved(self, gap: Gap) -> Gap:
        """Return an answer that names nothing: what links of another arm leave over is no effect of this one."""
        why, before = "the robot file does not describe the arm of these logs", self._before(gap)
        ratio = np.ones_like(gap.improvement.ratio)
        given_up = (
            replace(one, why_not=why, rms_after=None, share=None, probability=None)
            for one in gap.named
        )
        return replace(
            gap,
            verdict="unexplained" if gap.named else gap.verdict,
            named=(),
            closest=(*given_up, *gap.closest),
            alternatives=(),
            advice="",
            curves=(),
            improvement=replace(gap.improvement, before=before, after=before, ratio=ratio),
            simulation=gap.simulation[[0, 0]] if len(gap.simulation) else gap.simulation,
        )

    def _before(self, gap: Gap) -> NDArray[np.float64]:
        """Return the error of each joint without what is named, of the model as it is where it is tried, (n,)."""
        known = any(log.sha256 in self.result.log_sha256 for log in gap.unseen_logs)
        if known or not gap.unseen_logs:
            return gap.improvement.before
        return self._errors(self.result, gap)

    def _errors(self, result: Identification, gap: Gap) -> NDArray[np.float64]:
        """Return the error of each joint on what was held out, with the filter of the search, (n,) [N m or N]."""
        replays = self._replays(gap.unseen_logs, result, gap.signals.cutoff)
        counts = np.array([each.motion.usable.sum(axis=0) for each in replays])
        squares = np.array([[joint.rms**2 for joint in each.joints] for each in replays])
        return np.asarray(
            np.sqrt(np.sum(counts * squares, axis=0) / np.maximum(1, counts.sum(axis=0)))
        )

    def _recorded(self, analysis: GapAnalysis, question: str, why: str) -> Gap:
        """Return an analysis as the answer to a question, without logs and signals."""
        made_from = str(self.result.path) if self.result.path.name else ""
        record = record_of(analysis, self.base.robot, question, why, made_from)
        facts = {**vars(record), "of": fingerprint(self.result)}
        return Gap(**facts, analysis=analysis, searched=self.result)

    @heard_by()
    def _with_reestimated_payload(self, analysis: GapAnalysis, logs: Sequence[Log]) -> GapAnalysis:
        """Return an analysis whose load, if it names one, is as heavy as ``dynid identify --payload-from`` says."""
        load, result = named_load(analysis), self.result
        if load is None or result.robot.torque.relative:
            return analysis
        try:
            now = identify(
                self.base.robot,
                logs,
                base=self.base,
                holdout=None,
                drop_weak=True,
                cutoff=result.cutoff or None,
                delay=result.delay,
                exclude=self.options.exclude,
            )
            # Why the other way round: what was taken off hung there when the model was identified.
            loaded, bare = (now, result) if load.values["m"] >= 0.0 else (result, now)
            return with_reestimated_payload(analysis, load, find_payload(loaded, bare))
        except DynidError:
            # Why nothing is said: the load is there, and the search has numbers of its own.
            return analysis

    def _conditioned(self, logs: Sequence[Log], options: GapOptions) -> list[ConditionedLog]:
        """Return conditioned logs, of long ones stretches: minutes say what hours do, and all candidates fit."""
        whole = condition_logs(logs, self.base.model, options)
        found, parts = stretches(whole, LONGEST)
        if parts:
            text = f"{LONGEST:.0f} s are searched, in {parts} stretches spread evenly over the logs"
            stage("stretches", text)
        return found

    def of_the_arm(self, logs: Sequence[Log], why: str) -> Gap:
        """Ask which effects remain after refitting all parameters, and which only implausible links imitate."""
        found = self.ask("numbers", logs, (), f"{why}: {ASKED['numbers']}")
        assert found.analysis is not None
        search, effects, joints = found.analysis.search, self.wanted.effects, self.wanted.joints
        suspected = [
            one
            for one in suspicions(search.problem, search.selected)
            if not effects or COUNTERBALANCE in effects
            if not joints or one.joint in joints
        ]
        names = self.base.robot.joint_names
        sought = [one for one in suspected if one.searched]
        if not sought:
            return _with_likely(found, suspected, names)
        why = f"{found.asked} {_suspected(sought, names)}: {ASKED['arm']}"
        analysis = with_counterbalances(found.analysis, self.wanted, [one.joint for one in sought])
        if any(one.name == COUNTERBALANCE for one in analysis.verdict.named):
            return replace(
                self._recorded(analysis, "arm", why),
                recordings=found.recordings,
                signals=found.signals,
            )
        found = replace(found, asked=f"{why} {_not_told(sought, analysis)}")
        return _with_likely(found, sought, names)


def _suspected(suspected: Sequence[Suspicion], names: Sequence[str]) -> str:
    """Return why effects are searched that only implausible links could imitate."""
    said = []
    for one in suspected:
        shown = f" (without it, there is {one.instead_of})" if one.instead_of else ""
        said.append(f"A counterbalance on {names[one.joint]} makes the links more plausible{shown}")
    return " and ".join(said)


def _with_likely(gap: Gap, suspected: Sequence[Suspicion], names: Sequence[str]) -> Gap:
    """Return an answer with the counterbalances that an arm of other links would do for: what is odd is not nothing."""
    told = [one for one in suspected if one.instead_of]
    if not told or not gap.verdict.startswith("nothing"):
        return gap
    effect = CATALOGUE[COUNTERBALANCE]
    likely = tuple(
        GapEffect(
            effect=COUNTERBALANCE,
            indices=(one.joint,),
            joints=(names[one.joint],),
            where=names[one.joint],
            values=dict(zip(effect.units, one.sizes[0].tolist(), strict=True)),
            std_errors=dict(zip(effect.units, one.sizes[1].tolist(), strict=True)),
            units=dict(effect.units),
            p_value=one.chance,
            joint=names[one.joint],
            rms_before=float(gap.improvement.before[one.joint]),
            rms_after=None,
            unit=gap.torque_units[one.joint],
            why_not=f"torques alone cannot tell it from {one.instead_of}",
            probability=one.probability,
        )
        for one in told
    )
    advice = (
        f"Give the mass {_links(told)} from the data sheet with --link-mass and identify again."
    )
    verdict = "unexplained" if any(one.odd for one in told) else gap.verdict
    return replace(gap, closest=(*likely, *gap.closest), verdict=verdict, advice=advice)


def _not_told(suspected: Sequence[Suspicion], analysis: GapAnalysis) -> str:
    """Return why no counterbalance is named, and what would tell."""
    joints = [(one.joint,) for one in suspected]
    reasons = [text for one, text in analysis.verdict.closest if one.joints[:1] in joints]
    what = "Torques alone cannot tell it from heavier links"
    if all(one.sure for one in suspected):
        what = "Without it, the logs fit as well only with implausible links"
    return (
        f"{what}{f' ({reasons[0]})' if reasons else ''}. Give the mass {_links(suspected)} from the data sheet "
        "(known: link_mass in the robot file) and identify again."
    )


def _links(suspected: Sequence[Suspicion]) -> str:
    return " and ".join(dict.fromkeys(f"of link {one.link}" for one in suspected))


def _kept_error(now: float, then: float, unchanged: bool) -> str:
    """Return how well the kept model does on new and on its own logs [%], in words."""
    if not then:
        return f" (error of the model on these logs {now:.3g} %)"
    text = f" (error of the model {now:.3g} % on these logs, {then:.3g} % on the logs it was identified from"
    if unchanged and now > EXTRAPOLATES * then:
        return f"{text}; this motion differs from the one used to identify)"
    return f"{text})"


def signals_of(result: Identification, options: GapOptions, question: str) -> GapOptions:
    """Return options with cut-off and delay of the search where nothing else was asked for."""
    # Why no delay otherwise: there it is one of the effects that are looked for.
    delay = result.delay if question == "changed" else 0.0
    cutoff = max(CUTOFF, result.cutoff) if options.cutoff is None else options.cutoff
    return replace(options, cutoff=cutoff, delay=delay if options.delay is None else options.delay)


@public
def earlier_logs(
    result: ResultLike,
    logs: LogsLike,
    options: GapOptions = GapOptions(),
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> list[Log]:
    """Return the recordings that a result was identified from, where their files are still what they were.

    Why: what the model left unexplained in them it leaves unexplained in new ones, and that is no change. A new log
    that is one of them cannot be compared with itself.

    Args:
        result: the result, its folder or its file.
        logs: the new recordings, or their paths.
        options: how recordings are read.
        progress: reports which logs are missing.
        changes: single options by name; see ``dynid.GapOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).

    Example:
        dynid.earlier_logs("out/kuka_lwr4plus", ["run3.bag", "run4.bag"])
    """
    result = as_result(result)
    new = {log.sha256 for log in as_logs(logs, result.robot, options, empty=True) if log.sha256}
    before = [(found_log(result, k), sha) for k, sha in enumerate(result.log_sha256)]
    own = new & {sha for _, sha in before}
    if own and options.question == "auto":
        return []
    if own and options.question == "changed":
        text = "the model was identified from a log given here, so that log shows no change"
        stage("earlier", text)
    there = [
        path for path, sha in before if sha not in new and path.exists() and sha256(path) == sha
    ]
    missing = [str(path) for path, sha in before if sha not in own and path not in there]
    if missing:
        text = f"missing, or changed since then: {', '.join(missing)}"
        stage("earlier", f"logs that the model was identified from are {text}")
    return [load_log(path, result.robot, options, identify=False) for path in there]
