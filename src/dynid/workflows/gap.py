"""Find where model and measurement disagree and name what is missing: which question is asked, in which order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeVar, overload

import numpy as np

from dynid.answer import Answer, Facts, Judged, picked
from dynid.arguments import instance, no_such, public
from dynid.arrays import Floats
from dynid.disk import sha256
from dynid.errors import DynidError, NotAnArtifact, WrongUsage
from dynid.estimation.evidence import evidence_of, found_path, with_paths
from dynid.estimation.payload import find_payload
from dynid.estimation.result import Identification
from dynid.files import packaged
from dynid.files.artifact import kind_of, read_artifact
from dynid.files.gapfile import read_record, write_record
from dynid.files.trajectoryfile import StoredTrajectory, read_trajectory
from dynid.gap.analysis import (
    CUTOFF,
    GapAnalysis,
    analyse_gap,
    effect_of,
    new_name,
    on_one_clock,
    record_of,
    with_counterbalances,
    with_reestimated_payload,
)
from dynid.gap.apply import specs_of, stacked_with, write_robot
from dynid.gap.candidates import SelectionOptions
from dynid.gap.counterbalance import COUNTERBALANCE, Suspicion, suspicions
from dynid.gap.localisation import NEGLIGIBLE
from dynid.gap.tuning import REST_SURE
from dynid.judgement.evidence import Evidence, of_search
from dynid.judgement.gap import GapEffect, GapRecord
from dynid.loading import (
    LogsLike,
    ResultLike,
    as_logs,
    as_result,
    check_weight,
    checked_log,
    load_log,
    load_run,
    parameters_of,
)
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE
from dynid.progress import Progress, heard_by, stage
from dynid.reports.figures import write_figure
from dynid.reports.gap_figures import effect_figure, improvement_figure, residual_figure
from dynid.robot import EffectSpec, Robot
from dynid.signals.conditioned_log import ConditionedLog, condition_logs, stretches
from dynid.table import Table
from dynid.workflows.identify import identify
from dynid.workflows.options import GapOptions, IdentifyOptions, joint_indices
from dynid.workflows.parameters import Observations, observe
from dynid.workflows.validate import Validation, validate

T = TypeVar("T")

#: A joint with a larger share of the disagreement of all joints is told.
TOLD_SHARE = 0.1
#: What each question asks, as the answer says it.
ASKED = {
    "numbers": "which effects remain after refitting all parameters?",
    "arm": "which effects remain when the links have to be plausible?",
    "changed": "what has changed since the model was identified?",
}
#: Longer recordings are searched in stretches that are so long together [s]: whitened columns of a hundred candidates
#: of eight minutes take half a gigabyte.
LONGEST = 480.0


@dataclass(frozen=True, repr=False, eq=False)
class Gap(Judged, GapRecord):
    """What ``find_gap`` found; equal to another one by what is in its file.

    Attributes:
        analysis: the rows and the search; None when it was read from a file.
        searched: the result that was searched; None when it was read from a file.
        recordings: the recordings, checked; none when it was read from a file.
        before: those that the result was identified from, where what has changed since was named.
        signals: how they were read.
    """

    analysis: GapAnalysis | None = None
    searched: Identification | None = None
    recordings: tuple[Log, ...] = ()
    before: tuple[Log, ...] = ()
    signals: GapOptions = GapOptions()

    @property
    def unseen_logs(self) -> tuple[Log, ...]:
        """The recordings that were held out as a whole; none where parts of recordings were."""
        names = self.heldout.split(", ")
        logs = tuple(log for log in self.recordings if log.name in names)
        return logs if 0 < len(logs) == len(names) < len(self.recordings) else ()

    @property
    def evidence(self) -> Evidence:
        """What is known of the searched model with what was found."""
        result = self.searched
        known = Evidence(result=self.made_from) if result is None else evidence_of(result)
        name = known.result or self.made_from
        return replace(known, asked="gap", gap=with_paths(self), result=name)

    def table(self) -> Table:
        """Return one row per candidate: size, held-out rms of its joint before and, if it is named, after, p-value."""
        return Table(
            [
                {
                    **picked(one, "effect", "where"),
                    "size": ", ".join(one.texts()),
                    "rms before": one.rms_before,
                    "rms after": one.rms_after,
                    "unit": one.unit,
                    "p-value": one.p_value,
                    "result": one.message,
                }
                for one in (*self.named, *self.closest)
            ]
        )

    def joint_table(self) -> Table:
        """Return one row per joint: held-out rms before and after, noise [N m or N]."""
        errors = self.improvement
        columns = errors.before.tolist(), errors.after.tolist(), errors.floor.tolist()
        heads = ("joint", "rms before", "rms after", "noise", "unit")
        rows = zip(self.joint_names, *columns, self.torque_units, strict=True)
        return Table([dict(zip(heads, row, strict=True)) for row in rows])

    def answer(self) -> Answer:
        """Return what ``dynid gap`` answers."""
        where = "; ".join(
            f"{self.joint_names[one.joint]} ({100 * one.share:.0f} % of the residual above the noise) {one.text}"
            for one in sorted(self.joints, key=lambda one: -one.share)
            if one.share > TOLD_SHARE and one.chi > 1 + NEGLIGIBLE
        )
        hidden = ", ".join(
            f"{name} ({','.join(str(j + 1) for j in joints) or 'arm'})"
            for name, joints in self.cannot_judge.items()
        )
        lines = {
            "where": where or "no joint is above its noise level",
            "asked": self.asked,
            "not shown": f"these logs cannot show: {hidden}" if hidden else "",
        }
        return Answer(
            self.facts(),
            parts=(self.judgement, self.joint_table()),
            details=(
                "",
                *filter(all, lines.items()),
                *(("rest", clue) for clue in self.clues),
                *filter(None, (self.advice,)),
                self.table(),
            ),
            notes=(("noise", f"from {self.noise_from}; held out: {self.heldout}"),),
            next=self.judgement.steps,
        )

    def facts(self) -> Facts:
        """Return what the JSON answer of ``dynid gap`` says."""
        names = self.joint_names
        return {
            **picked(self, "robot", "mode", "question", "asked", "verdict", "advice"),
            **picked(self, "clues", "alternatives", "not_repeatable"),
            "kept_relative_error_percent": self.kept,
            "expected_relative_error_percent": self.expected,
            "where": [
                {"joint": names[one.joint], **picked(one, "share", "chi", region="text")}
                for one in self.joints
            ],
            "named": [one.facts() for one in self.named],
            "closest": [one.facts() for one in self.closest],
            "formulas": [],
            "gap": {
                "joints": names,
                **picked(
                    self.improvement,
                    heldout_before_nm="before",
                    heldout_after_nm="after",
                    noise_floor_nm="floor",
                    ratio_interval="ratio",
                    simulation_before="simulated_before",
                    simulation_after="simulated_after",
                ),
                **picked(self, "heldout", "noise_from"),
            },
            "cannot_judge": {
                name: [names[j] for j in joints] for name, joints in self.cannot_judge.items()
            },
            "judgement": self.judgement.facts(),
        }

    def save(self, path: Path | str) -> Path:
        """Write gap.npz."""
        write_record(Path(path), self)
        return Path(path)

    @classmethod
    def load(cls, path: Path | str) -> Gap:
        """Read gap.npz; what is read prints as it did, and cannot be applied."""
        return cls(**vars(read_record(Path(path))))

    def write_figures(self, folder: Path) -> list[Path]:
        """Write the figures as PNG: where.png, shrink.png, and one of each named effect."""
        title = f"{self.robot}: the gap on held-out data ({self.heldout})"
        figures = {
            "where": residual_figure(self.joints, self.joint_names, self.robot),
            "shrink": improvement_figure(
                self.improvement, self.joint_names, self.torque_units, title
            ),
        }
        for k, (one, curve) in enumerate(self.drawn(), start=1):
            figures[f"effect_{k}_{one.effect}"] = effect_figure(one, curve, self.robot)
        return [write_figure(figure, folder / f"{name}.png") for name, figure in figures.items()]

    def chosen(self, text: str = "best") -> tuple[GapEffect, ...]:
        """Return selected effects by name.

        Args:
            text: ``"best"`` for those that are named, or an identifier such as ``"spring"`` or ``"spring@7"``, with the
                joint by name or number.

        Raises:
            WrongUsage: this was not found.
        """
        if text == "best":
            return self.named
        name, _, where = text.partition("@")
        joints = joint_indices(self.joint_names, where.split(","), "--apply")
        every = (*self.named, *self.closest)
        matching = tuple(
            one
            for one in every
            if one.effect == name and (not joints or {*one.indices[:1]} & {*joints})
        )
        if not matching:
            there = ", ".join(
                f"{one.effect}@{','.join(f'{j + 1}' for j in one.indices[:1])}" for one in every
            )
            what = f"--apply {text}: this was not found"
            raise WrongUsage(what, why=f"found: {there or 'nothing'}")
        return matching

    def apply(
        self, effects: str | Sequence[GapEffect] = "best", *, robot_file: Path | str | None = None
    ) -> Identification:
        """Return the arm identified again with effects, from the logs that were searched, as the result before it was.

        Recordings that were held out as a whole stay so: ``validate`` proves the result on them, with the error that
        the search has shown.

        Args:
            effects: ``"best"`` for those that are named, a name such as ``"spring@7"``, or effects of this search.
            robot_file: where a copy of the robot file with the effects is written; None writes none.

        Raises:
            WrongUsage: the search was read from a file, or there is nothing to add.
        """
        if self.analysis is None:
            what = "a search that was read from a file cannot be applied"
            raise WrongUsage(what, fix="find_gap(...).apply()")
        chosen = self.chosen(effects) if isinstance(effects, str) else effects
        if not chosen:
            fix = "name a candidate of the table, such as apply('spring@7')"
            raise WrongUsage("no effect is named", fix=fix)
        first = self.analysis.search.logs[0].segments[0]
        specs = specs_of(chosen, float(first.t[0] - first.elapsed[0]))
        path = None if robot_file is None else Path(robot_file)
        if path is not None:
            write_robot(self.analysis.search.first.base.robot, specs, path)
        result = self._identified(specs)
        header = {
            **result.header,
            "inputs": {f"log {k}": hashed for k, hashed in enumerate(result.log_sha256, start=1)},
        }
        return replace(result, robot=replace(result.robot, path=path), header=header)

    @heard_by()
    def _identified(self, specs: Sequence[EffectSpec]) -> Identification:
        """Return the arm with effects, identified as before: filter, estimator, set, sizes of the residual model."""
        before, analysis, late = self.searched, self.analysis, self.signals.delay or 0.0
        assert before is not None
        assert analysis is not None
        problem, cutoff = analysis.search.first, before.cutoff or self.signals.cutoff
        own = replace(self.signals, delay=before.delay, cutoff=cutoff)
        if not any(spec.effect == "torque_delay" for spec in specs):
            late = before.delay
        unseen = self.unseen_logs
        fitted = [log for log in self.recordings if log not in unseen]
        model = problem.base.model
        logs = on_one_clock(condition_logs(fitted, model, replace(own, delay=late)))
        earlier = condition_logs(self.before, model, own) if self.before else []
        base, stack = stacked_with(logs, problem.base, specs, problem.theta, earlier)
        physical = before.in_force == "physical"
        options = IdentifyOptions(
            method=before.method if before.why == "as asked" else "auto",
            feasible=physical,
            # Why: an effect of one joint says nothing about how much is missing on the others.
            residual_model=before.model_error is not None if physical else None,
            drop_weak=True,
        )
        return identify(base.robot, Observations(stack), options, like=before)


def robot_file_beside(robot: Robot, effects: Sequence[GapEffect]) -> Path:
    """Return where the copy of a robot file with effects goes: beside a file of one's own, else here."""
    own, folder = robot.path, Path()
    if own is not None and packaged("robots").resolve() not in own.resolve().parents:
        folder = own.parent
    return folder / f"{new_name(robot, effects)}.yaml"


# ---------------------------------------------------------------- what was saved is read back, whatever it is
@overload
def load(path: Path | str) -> Identification | Gap | StoredTrajectory: ...


@overload
def load(path: Path | str, kind: type[T]) -> T: ...


@public
def load(path: Path | str, kind: type[Any] = object) -> Any:
    """Return what is in a result file: the object whose ``save`` wrote it, or the stored motion of a plan.

    Args:
        path: a file such as parameters.npz, or the folder of a run, whose parameters.npz is read.
        kind: the type that is expected, such as ``dynid.Identification``; it is the type of what is returned.

    Raises:
        WrongUsage: an argument is something else than what is wanted, or the file holds another type (E101).
        NotAnArtifact: the file is none of dynid's, or is damaged (E3xx).

    Example:
        dynid.load("out/kuka_lwr4plus", dynid.Identification)
    """
    file = parameters_of(Path(path))
    readers: dict[str, Callable[[Path], object]] = {
        "dynid/identification": load_run,
        "dynid/trajectory": read_trajectory,
        "dynid/gap": Gap.load,
    }
    schema = kind_of(file)
    if schema not in readers:
        read_artifact(file)  # ends with the message that a missing or damaged file gets
        raise NotAnArtifact(f"{file} holds nothing that dynid.load reads", where=file)
    loaded = readers[schema](file)
    return instance(loaded, kind, "path", f"a file with an object of type {kind.__name__}")


# ---------------------------------------------------------------- the search
@public
def find_gap(
    result: ResultLike,
    logs: LogsLike,
    options: GapOptions = GapOptions(),
    *,
    earlier: LogsLike | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Gap:
    """Find where a model and recordings disagree, which effect is missing, and how much smaller the gap is with it.

    Args:
        result: identified parameters, their folder or their file.
        logs: one or several recordings, or their paths; each motion twice, so that the noise is known.
        options: what is searched and how.
        earlier: logs that the model was identified from, to find what has changed since; None to look for their files,
            () for none.
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
    for word in options.effects:
        if word not in CATALOGUE:
            raise no_such("--effects: no effect", word, CATALOGUE)
    joints = joint_indices(result.robot.joint_names, options.joints, "--joints")
    wanted = SelectionOptions(
        options.effects, joints, 1.0 - options.false_alarm, options.max_effects
    )
    given = as_logs(logs, result.robot, options)
    before = as_logs(earlier, result.robot, options, "earlier") if earlier else []
    search = _Search(result, wanted, options)
    new = search.checked(given)
    if options.question not in ("auto", "changed"):
        before = []
    elif earlier is None:
        before = earlier_logs(result, new, options)
    return search.judged(search.answered(new, search.checked(before)), new)


def earlier_logs(result: Identification, new: Sequence[Log], options: GapOptions) -> list[Log]:
    """Return the recordings that a result was identified from, where their files are still what they were.

    Why: what the model left unexplained in them it leaves unexplained in new ones, and that is no change. A new log
    that is one of them cannot be compared with itself.
    """
    given = {log.sha256 for log in new if log.sha256}
    if options.question == "auto" and given & {*result.log_sha256}:
        return []
    logs, missing = list[Log](), list[str]()
    for name, sha in zip(result.header.get("logs", []), result.log_sha256, strict=False):
        path = Path(found_path(result, name))
        if sha in given:
            continue
        if path.exists() and sha256(path) == sha:
            logs.append(load_log(path, result.robot, options, identify=False))
        else:
            missing.append(str(path))
    if missing:
        text = f"missing, or changed since then: {', '.join(missing)}"
        stage("earlier", f"logs that the model was identified from are {text}")
    return logs


@dataclass(frozen=True)
class _Search:
    """Questions to one model.

    Attributes:
        result: the result.
        wanted: what is searched.
        options: how recordings are read.
    """

    result: Identification
    wanted: SelectionOptions
    options: GapOptions

    def checked(self, logs: Sequence[Log]) -> list[Log]:
        """Return checked recordings."""
        checked = [
            checked_log(log, self.result.robot, self.options, identify=False) for log in logs
        ]
        for log in checked:
            check_weight(log, self.result.robot)
        return checked

    def answered(self, new: Sequence[Log], before: Sequence[Log]) -> Gap:
        """Return the answer to the question that was asked, or else to the one that the logs allow."""
        question = self.options.question
        if question != "auto":
            return self.ask(question, new, before, ASKED[question])
        if any(log.sha256 and log.sha256 in self.result.log_sha256 for log in new):
            return self.of_the_arm(new, "the model was identified from these logs")
        if not before:
            why = "the logs that the model was identified from were not found"
            gap = self.of_the_arm(new, why)
            if not gap.nothing or self.judged(gap, new).verdict == gap.verdict:
                return gap
            # Why: new numbers for all parameters take in a load, and the model as it is does not.
            why += ", and the error of the model is larger than expected."
            changed = self.ask("changed", new, (), why)
            return changed if changed.named else gap
        changed = self.ask("changed", new, before, ASKED["changed"])
        if changed.named:
            return changed
        unchanged = changed.verdict == "nothing_changed"
        said = "Nothing has changed" if unchanged else "No change could be named"
        why = f"{changed.asked} {said}, so all {len(before) + len(new)} logs were searched"
        return self.of_the_arm([*before, *new], why)

    def ask(self, question: str, logs: Sequence[Log], earlier: Sequence[Log], why: str) -> Gap:
        """Ask one question of checked logs, and of those that the model was identified from; ``why`` in words."""
        result, options, base = self.result, self.options, self.result.base
        kept = question == "changed"
        # Why no delay otherwise: there it is one of the effects that are looked for.
        options = replace(
            options,
            cutoff=max(CUTOFF, result.cutoff) if options.cutoff is None else options.cutoff,
            delay=(result.delay if kept else 0.0) if options.delay is None else options.delay,
        )
        # Why anew: all parameters are refitted, and how friction turns is one of them.
        arm = base.robot if kept else replace(base.robot, estimated_coulomb=None)
        base, conditioned = self._conditioned(logs, options, arm)
        before = self._conditioned(earlier, options, arm)[1] if earlier else []
        stage("search")
        analysis = analyse_gap(
            conditioned,
            base,
            result if kept else None,
            self.wanted,
            earlier=before,
            possible=result.in_force == "physical",
        )
        if question == "arm":
            analysis = with_counterbalances(analysis, self._suspected(analysis))
        if kept and earlier:
            analysis = self._with_reestimated_payload(analysis, logs)
        read = Gap(searched=result, recordings=tuple(logs), before=tuple(earlier), signals=options)
        return self._recorded(read, analysis, question, why)

    def of_the_arm(self, logs: Sequence[Log], why: str) -> Gap:
        """Ask which effects remain after refitting all parameters, and which only implausible links imitate."""
        gap = self.ask("numbers", logs, (), f"{why}: {ASKED['numbers']}")
        assert gap.analysis is not None
        suspected = self._suspected(gap.analysis)
        sought = [one for one in suspected if one.searched]
        if not sought:
            return _with_likely(gap, suspected)
        reasons = (
            f"A counterbalance on {gap.joint_names[one.joint]} makes the links more plausible"
            + f" (without it, there is {one.instead_of})" * bool(one.instead_of)
            for one in sought
        )
        why = f"{gap.asked} {' and '.join(reasons)}: {ASKED['arm']}"
        analysis = with_counterbalances(gap.analysis, sought)
        # Why asked of what a name explains as well: a cylinder imitates a spring on the motions of the search alone.
        as_well = not any(one.rivals for one in sought) or analysis.left <= gap.analysis.left
        if as_well and any(one.name == COUNTERBALANCE for one in analysis.named):
            return self._recorded(gap, analysis, "arm", why)
        return _with_likely(replace(gap, asked=why), sought)

    def _suspected(self, analysis: GapAnalysis) -> list[Suspicion]:
        """Return the counterbalances that an analysis makes likely, of what is searched for."""
        search, effects, joints = analysis.search, self.wanted.effects, self.wanted.joints
        if effects and COUNTERBALANCE not in effects:
            return []
        # Why not beside what has no name: links that imitate that too would pass for a counterbalance.
        clean = search.rest.odds < REST_SURE
        every = suspicions(search.problem, search.selected)
        return [one for one in every if clean[one.joint] and (not joints or one.joint in joints)]

    def _recorded(self, read: Gap, analysis: GapAnalysis, question: str, why: str) -> Gap:
        """Return an analysis of what was read as the answer to a question."""
        record = record_of(analysis, self.result, question, why)
        flags = self.options.flags("ask", "mode", "effects", "joints", "false_alarm", "max_effects")
        return replace(read, **vars(record) | {"flags": flags}, analysis=analysis)

    def _conditioned(
        self, logs: Sequence[Log], options: GapOptions, arm: Robot
    ) -> tuple[BaseModel, list[ConditionedLog]]:
        """Return the model of an arm, and conditioned logs; of long ones stretches: minutes say what hours do.

        How friction turns at a reversal is estimated from them where the arm does not know it from a result.
        """
        seen = observe(arm, logs, options, base=self.result.base, drop_weak=True).stack
        searched, parts = stretches(seen.logs, LONGEST)
        if parts:
            stage(
                "stretches",
                f"{LONGEST:.0f} s are searched, in {parts} stretches spread evenly over the logs",
            )
        return seen.base, searched

    @heard_by()
    def _with_reestimated_payload(self, analysis: GapAnalysis, logs: Sequence[Log]) -> GapAnalysis:
        """Return an analysis whose load, if it names one, is as heavy as ``dynid identify --payload-from`` says."""
        load = next((one for one in analysis.named if one.name == "payload"), None)
        result = self.result
        if load is None or result.robot.torque.relative:
            return analysis
        options = IdentifyOptions(
            holdout=None,
            drop_weak=True,
            cutoff=result.cutoff or None,
            delay=result.delay,
            exclude=self.options.exclude,
        )
        try:
            now = identify(result.robot, logs, options, base=result.base)
            # Why the other way round: what was taken off hung there when the model was identified.
            loaded, bare = (now, result) if load.values["m"] >= 0.0 else (result, now)
            return with_reestimated_payload(analysis, load, find_payload(loaded, bare))
        except DynidError:
            # Why nothing is said: the load is there, and the search has numbers of its own.
            return analysis

    # ------------------------------------------------------------ the model as it is, and with what is named
    def judged(self, gap: Gap, new: Sequence[Log]) -> Gap:
        """Return an answer beside how the model as it is does on the new logs: "nothing" only where that agrees."""
        unknown = [log for log in new if not log.sha256 or log.sha256 not in self.result.log_sha256]
        # The worst of them.
        worst = max(
            self._replays(unknown, self.result),
            key=lambda one: one.relative_error_percent / (one.expected_percent or 1.0),
            default=None,
        )
        if worst is not None:
            kept = picked(worst, kept="relative_error_percent", expected="expected_percent")
            gap = replace(gap, kept_rms=tuple(joint.rms for joint in worst.joints), **kept)
        if gap.named and gap.unseen_logs:
            gap = self._proved(gap)
        # Why not the whole judgement: what another log says is no answer to a question about these.
        if gap.nothing and any(fact[0] != "good" for fact in of_search(gap)):
            gap = replace(gap, verdict="unexplained", advice="")
        return gap

    def _proved(self, gap: Gap) -> Gap:
        """Return an answer with the errors that ``apply`` and then ``validate`` reach on the recordings held out."""
        before, after = gap.improvement.before, self._errors(gap.apply(), gap)
        if {log.sha256 for log in gap.unseen_logs}.isdisjoint(self.result.log_sha256):
            before = self._errors(self.result, gap)
        at = gap.joint_names.index
        named = tuple(
            replace(
                one,
                rms_before=float(before[at(one.joint)]),
                rms_after=float(after[at(one.joint)]),
            )
            for one in gap.named
        )
        return replace(
            gap, named=named, improvement=replace(gap.improvement, before=before, after=after)
        )

    def _errors(self, result: Identification, gap: Gap) -> Floats:
        """Return the error of each joint on what was held out, with the filter of the search, (n,) [N m or N]."""
        replays = self._replays(gap.unseen_logs, result, gap.signals.cutoff)
        rms = [[joint.rms for joint in each.joints] for each in replays]
        rows = [each.motion.usable.sum(axis=0) for each in replays]
        return np.sqrt(np.average(np.square(rms), axis=0, weights=np.maximum(rows, 1)))

    @heard_by()
    def _replays(
        self, logs: Sequence[Log], result: Identification, cutoff: float | None = None
    ) -> list[Validation]:
        """Return replays of logs by a result, read as they were for the search."""
        read = picked(self.options, "exclude", "velocity") | {"cutoff": cutoff}
        return [validate(result, log, **read) for log in logs]


# ---------------------------------------------------------------- counterbalances, which heavier links imitate
def _with_likely(gap: Gap, suspected: Sequence[Suspicion]) -> Gap:
    """Return an answer with the counterbalances that an arm of other links would do for: what is odd is not nothing."""
    doubtful = [one for one in suspected if one.instead_of]
    if not doubtful or not gap.nothing:
        return gap
    assert gap.analysis is not None
    assert gap.searched is not None
    likely = []
    for one in doubtful:
        why = f"torques alone do not separate it from {one.instead_of}"
        effect = effect_of(one.selected(visible=0.0), gap.analysis, gap.searched, why)
        likely.append(replace(effect, probability=one.probability))
    links = " and ".join(dict.fromkeys(f"link {one.link}" for one in doubtful))
    return replace(
        gap,
        closest=(*likely, *gap.closest),
        verdict="unexplained" if any(one.odd for one in doubtful) else gap.verdict,
        advice=f"Give the mass of {links} from the data sheet with --link-mass and identify again.",
    )
