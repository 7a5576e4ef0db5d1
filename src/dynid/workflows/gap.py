"""Find where model and measurement disagree, name the missing effect with evidence, and add it to the model."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import WrongUsage
from dynid.gap.record import GapEffect, GapRecord
from dynid.log import Log
from dynid.options import option, share
from dynid.progress import SILENT, Progress
from dynid.robot import EffectSpec, Robot
from dynid.table import Table
from dynid.threads import one_thread
from dynid.workflows.logs import LogOptions, as_list, checked_log, condition_logs, load_log
from dynid.workflows.results import base_model_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from dynid.estimation.result import Identification
    from dynid.gap.analysis import GapAnalysis
    from dynid.gap.counterbalance import Suspicion
    from dynid.gap.significance import Key
    from dynid.gap.stepwise_selection import SelectionOptions
    from dynid.model.base_model import BaseModel
    from dynid.signals.conditioned_log import ConditionedLog

#: What the verdicts mean.
VERDICTS = {
    "named": "named",
    "nothing_missing": "nothing is missing",
    "nothing_changed": "nothing has changed since the model was identified",
    "unexplained": "something is missing that no effect of the catalogue explains",
    "ambiguous": "fit equally well",
}
#: The questions, and the names that two of them had before.
QUESTIONS = ("numbers", "arm", "changed")
MODES = {"refit": "numbers", "frozen": "changed"}
#: A kept model that misses so many times more of new torques than of its own, although nothing has changed, is told.
EXTRAPOLATES = 1.5
#: Longer recordings are searched in stretches that are so long together [s]: whitened columns of a hundred candidates
#: of eight minutes take half a gigabyte.
LONGEST = 480.0
#: What is left of a counterbalance, when links have taken up the most of it, is taken for one of these.
LOOKALIKES = ("torque_offset", "spring", "end_stop")
#: A link that would be so many times as heavy is told.
TOLD_MASS = 2.0
#: A joint with a larger share of the disagreement of all joints is told.
TOLD_SHARE = 0.1


def _words(value: Any, name: str) -> tuple[str, ...]:  # noqa: ANN401
    """Return words given as text with commas or one by one; () for ``all`` and for nothing."""
    items = () if value is None or value == "all" else (value,) if isinstance(value, (str, int)) else value
    words = [word.strip() for item in items for word in str(item).split(",")]
    return tuple(word for word in words if word)


@dataclass(frozen=True)
class GapOptions(LogOptions):
    """What is searched. The filter keeps what happens at reversals where no other cut-off is asked for."""

    ask: str = option(
        "auto",
        "numbers: what no identification can absorb; arm: what only links that no arm has would absorb; changed: what "
        "is different since the model was identified; auto asks what the logs can answer, and says why.",
        choices=("auto", *QUESTIONS), shown="",
    )  # fmt: skip
    mode: str | None = option(
        None, "Earlier names of two questions: refit is --ask numbers, frozen is --ask changed.", choices=tuple(MODES)
    )
    effects: tuple[str, ...] = option(
        "all", "Effects to try, by identifier, separated by commas.", metavar="all|LIST", shown="", kind="effects",
        read=_words,
    )  # fmt: skip
    joints: tuple[str, ...] = option(
        None,
        "Joints to search, by name, by number, or as a range such as 2-4 (default: all).",
        metavar="LIST",
        read=_words,
    )
    false_alarm: float = option(
        "1%", "Probability of naming an effect in logs where nothing is missing.", metavar="SHARE", shown="", read=share
    )
    max_effects: int = option(3, "Largest number of effects that are selected.", shown="", kind="count")

    @property
    def question(self) -> str:
        """What is asked.

        Raises:
            WrongUsage: two different questions were given.
        """
        asked = MODES[self.mode] if self.mode else self.ask
        if self.ask not in ("auto", asked):
            raise WrongUsage(f"--mode {self.mode} is --ask {asked}, but --ask {self.ask} was given too")
        return asked


@dataclass(frozen=True, repr=False)
class Gap(GapRecord):
    """What ``find_gap`` found.

    Attributes:
        analysis: the rows and the search; None when it was read from a file.
        searched: the result that was searched; None when it was read from a file.
        recordings: the recordings, checked; none when it was read from a file.
        before: those that the result was identified from, where what has changed since was named.
        signals: how they were read.
    """

    analysis: GapAnalysis | None = field(default=None, compare=False)
    searched: Identification | None = field(default=None, compare=False)
    recordings: tuple[Log, ...] = field(default=(), compare=False)
    before: tuple[Log, ...] = field(default=(), compare=False)
    signals: GapOptions = field(default=GapOptions(), compare=False)

    @property
    def noise_text(self) -> str:
        """Where the noise floor comes from and what it allows for."""
        return "; ".join(["from " + self.noise_from, *([self.noise_note] if self.noise_note else [])])

    @property
    def where_text(self) -> str:
        """On which joints the disagreement is, and where in their motion."""
        from dynid.gap.localisation import NEGLIGIBLE

        loud = [one for one in self.joints if one.share > TOLD_SHARE and one.chi > 1 + NEGLIGIBLE]
        return "; ".join(
            f"{self.joint_names[one.joint]} ({100 * one.share:.0f} % of the disagreement) {one.text}"
            for one in sorted(loud, key=lambda one: -one.share)
        ) or "no joint is above its noise floor"  # fmt: skip

    @property
    def verdict_text(self) -> str:
        """The verdict in words."""
        groups = [" or ".join([f"{one.effect} on {one.where}", *one.rivals]) for one in self.named if one.rivals]
        return ": ".join([VERDICTS[self.verdict], *(["; ".join(groups)] if self.verdict == "ambiguous" else [])])

    def table(self) -> Table:
        """Return one row per candidate: size, held-out rms of its joint before and, if it is named, after, p-value."""
        rows = [
            {
                "effect": one.formula or one.effect,
                "where": one.where,
                "size": ", ".join(one.texts()),
                "rms before": one.rms_before,
                "rms after": one.rms_after,
                "unit": one.unit,
                "p-value": one.p_value,
                "said": one.said,
            }
            for one in (*self.named, *self.closest, *self.formulas)
        ]
        return Table(rows, f"{self.robot}: {self.verdict_text}", (f"where: {self.where_text}", self.advice))

    def joint_table(self) -> Table:
        """Return one row per joint: held-out rms before and after, noise [N m or N], errors of the simulated motion."""
        held_out, rows = self.improvement, []
        for j, name in enumerate(self.joint_names):
            row = {
                "joint": name,
                "rms before": float(held_out.before[j]),
                "rms after": float(held_out.after[j]),
                "noise": float(held_out.floor[j]),
                "unit": self.torque_units[j],
            }
            if len(self.simulation):
                row |= {f"simulated {word}": float(self.simulation[k, j]) for k, word in enumerate(("before", "after"))}
            rows.append(row)
        return Table(rows, f"{self.robot}: held-out error ({self.heldout})")

    def summary(self) -> str:
        """Return the verdict, the sizes of what is named, where the gap is, the noise and the advice, line by line."""
        sizes = [f"{one.effect} on {one.where}: {', '.join(one.texts())}" for one in self.named]
        sizes += [f"{one.formula} on {one.where}: {', '.join(one.texts())}" for one in self.formulas]
        lines = [
            self.verdict_text,
            *([self.asked] if self.asked else []),
            *sizes,
            f"where: {self.where_text}",
            f"noise: {self.noise_text}",
            self.advice,
        ]
        return "\n".join(lines)

    def to_dataframe(self) -> DataFrame:
        """Return the table of effects as a pandas DataFrame."""
        return self.table().to_dataframe()

    def __repr__(self) -> str:
        """Return the table of effects as text."""
        return repr(self.table())

    def _repr_html_(self) -> str:
        return self.table()._repr_html_() + self.joint_table()._repr_html_()

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid gap`` says."""
        from dynid.model.effects.catalogue import CATALOGUE

        held_out = self.improvement
        before, after = self.simulation if len(self.simulation) else (None, None)
        return {
            "schema": "dynid/gap/1",
            "robot": self.robot,
            "mode": self.mode,
            "question": self.question,
            "asked": self.asked,
            "verdict": self.verdict,
            "where": [
                {"joint": self.joint_names[one.joint], "share": one.share, "region": one.text, "chi": one.chi}
                for one in self.joints
            ],
            "named": [one.facts() for one in self.named],
            "alternatives": [list(group) for group in self.alternatives],
            "closest": [one.facts() for one in self.closest],
            "formulas": [one.facts() for one in self.formulas],
            "clues": list(self.clues),
            "gap": {
                "joints": list(self.joint_names),
                "heldout_before_nm": held_out.before,
                "heldout_after_nm": held_out.after,
                "noise_floor_nm": held_out.floor,
                "ratio_interval": held_out.ratio,
                "simulation_before": before,
                "simulation_after": after,
                "heldout": self.heldout,
                "noise_from": self.noise_from,
            },
            "not_repeatable": list(self.not_repeatable),
            "cannot_judge": {
                name: [self.joint_names[j] for j in joints]
                for name, joints in self.cannot_judge.items()
                if name in CATALOGUE
            },
            "advice": self.advice,
        }

    def save(self, path: Path | str) -> None:
        """Write gap.npz."""
        from dynid.gap.record import write_record

        write_record(Path(path), self)

    @classmethod
    def load(cls, path: Path | str) -> Gap:
        """Read gap.npz; what is read prints as it did, and cannot be applied."""
        from dynid.gap.record import read_record

        return _with_methods(read_record(Path(path)))

    def plot_residual(self) -> Figure:
        """Return a figure of residual over noise power of each joint, by speed, position, load, time and direction."""
        from dynid.reports.gap_figures import residual_figure

        return residual_figure(self.joints, self.joint_names, self.robot)

    def plot_improvement(self) -> Figure:
        """Return a figure of the held-out error of each joint before and after, with the noise."""
        from dynid.reports.gap_figures import improvement_figure

        title = f"{self.robot}: the gap on unseen data ({self.heldout})"
        return improvement_figure(self.improvement, self.joint_names, self.torque_units, title)

    def plot_effects(self) -> list[Figure]:
        """Return a figure of each named effect and formula: unseen data without and with it, its curve in the data."""
        from dynid.reports.gap_figures import effect_figure

        return [effect_figure(one, curve, self.robot) for one, curve in self.drawn()]

    def write_figures(self, folder: Path) -> list[Path]:
        """Write the figures as PNG: where.png, shrink.png, and one of each named effect and formula."""
        from dynid.reports.figures import write_figure

        figures = {"where": self.plot_residual(), "shrink": self.plot_improvement()}
        for k, (figure, (one, _)) in enumerate(zip(self.plot_effects(), self.drawn(), strict=True), start=1):
            figures[f"effect_{k}_{one.effect}"] = figure
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
        joints = joint_indices(self.joint_names, where, "--apply")
        found = [
            one
            for one in self._selected()
            if one.effect == name and (not joints or one.indices[:1] in [(j,) for j in joints])
        ]
        if not found:
            there = [f"{one.effect}@{','.join(str(j + 1) for j in one.indices[:1])}" for one in self._selected()]
            raise WrongUsage(f"--apply {text}: this was not found", why=f"found: {', '.join(there) or 'nothing'}")
        return tuple(found)

    def _selected(self) -> list[GapEffect]:
        """Return all effects that were found, named or not, and formulas."""
        return [*self.named, *self.closest, *self.formulas]

    def apply(
        self, effects: str | Sequence[GapEffect] = "best", *, robot_file: Path | str | None = None
    ) -> Identification:
        """Return the arm identified again with effects, from the logs that were searched, as the result before it was.

        Args:
            effects: ``"best"`` for those that are named, a name such as ``"spring@7"``, or effects of this search.
            robot_file: where a copy of the robot file with the effects is written; None writes none.

        Raises:
            WrongUsage: the search was read from a file, or there is nothing to add.
        """
        from dynid.gap.apply import specs_of, write_robot

        analysis = self.analysis
        if analysis is None:
            raise WrongUsage("a search that was read from a file cannot be applied", fix="find_gap(...).apply()")
        wanted = {(one.effect, one.indices) for one in (self.chosen(effects) if isinstance(effects, str) else effects)}
        every = (*analysis.verdict.named, *(one for one, _ in analysis.verdict.closest), *analysis.wording.formulas)
        chosen = [one for one in every if (one.name, one.joints) in wanted]
        if not chosen:
            raise WrongUsage("no effect is named", fix="name a candidate of the table, such as apply('spring@7')")
        robot = analysis.problem.base.robot
        specs = specs_of(chosen, robot)
        if robot_file is not None:
            write_robot(robot, specs, Path(robot_file))
        found = self._identified(specs)
        header = {
            **found.header,
            "inputs": {f"log {k}": hashed for k, hashed in enumerate(found.log_sha256, start=1)},
            "effects": [asdict(spec) for spec in specs],
            "made_from": self.made_from,
        }
        path = None if robot_file is None else Path(robot_file)
        return replace(found, robot=replace(found.robot, path=path), header=header)

    def _identified(self, specs: Sequence[EffectSpec]) -> Identification:
        """Return the arm with effects, identified as before: filter, estimator, set, sizes of the residual model."""
        from dynid.gap.analysis import on_one_clock
        from dynid.gap.apply import stacked_with
        from dynid.workflows.identify import IdentifyOptions, identify
        from dynid.workflows.parameters import Observations

        before, analysis = self.searched, self.analysis
        assert before is not None
        assert analysis is not None
        late = self.signals.delay if any(spec.effect == "torque_delay" for spec in specs) else before.delay
        signals = replace(self.signals, cutoff=before.cutoff or self.signals.cutoff, delay=late)
        model, every = analysis.problem.base.model, (*self.before, *self.recordings)
        logs = on_one_clock(condition_logs(self.recordings, model, signals))
        earlier = condition_logs(self.before, model, replace(signals, delay=before.delay)) if self.before else []
        base, stack = stacked_with(logs, analysis.problem.base, specs, analysis.problem.theta, earlier)
        seen = Observations(
            base=base,
            stack=stack,
            logs=tuple(str(log.source or "") for log in every),
            log_sha256=tuple(log.sha256 for log in every),
            delay=None,
            applied_delay=late or 0.0,
            findings=(),
        )
        asked = before.why == "as asked"
        options = IdentifyOptions(
            method=before.method if asked else "auto",
            # Why not where the data contradicted every possible arm: with what was missing they may not any more.
            feasible=True if before.in_force == "physical" else False if asked or before.choice == "as asked" else None,
            # Why: an effect of one joint says nothing about how much is missing on the others.
            residual_model=before.model_error is not None if before.in_force == "physical" else None,
            drop_weak=True,
        )
        return identify(base.robot, seen, options, like=before)


def _with_methods(record: GapRecord, **more: Any) -> Gap:  # noqa: ANN401
    return Gap(**{each.name: getattr(record, each.name) for each in fields(GapRecord)}, **more)


@one_thread
def find_gap(
    result: Identification,
    logs: Log | Sequence[Log],
    options: GapOptions = GapOptions(),
    *,
    earlier: Sequence[Log] = (),
    base: BaseModel | None = None,
    progress: Progress = SILENT,
) -> Gap:
    """Find where a model and recordings disagree, which effect is missing, and how much smaller the gap is with it.

    Args:
        result: identified parameters.
        logs: one or several recordings, as read or checked; each motion twice, so that the noise is known.
        options: what is searched and how.
        earlier: logs that the model was identified from (``earlier_logs``), to find what has changed since.
        base: the result's base model, where it is there already.
        progress: told how far the work is.

    Raises:
        WrongUsage: there is no effect or no joint of a name that was given.
        DynidError: the first serious fault of a log.
    """
    question, base = options.question, base or base_model_of(result)
    search = _Search(result, base, selection_options(base.robot, options), options, progress)
    new = search.checked(as_list(logs))
    before = search.checked(earlier) if question in ("auto", "changed") else []
    if question != "auto":
        return search.ask(question, new, before, "as asked")
    known = {sha for sha in result.log_sha256 if sha}
    if any(log.sha256 in known for log in new):
        return search.of_the_arm(new, "the model was identified from these logs, so nothing can have changed")
    if not before:
        why = "the logs that the model was identified from are not at hand, so nothing can be said about changes"
        return search.of_the_arm(new, why)
    changed = search.ask("changed", new, before, "the model was identified from other logs: what has changed since?")
    if changed.named:
        return changed
    said = VERDICTS["nothing_changed"] if changed.verdict == "nothing_changed" else "no change has a name"
    why = f"{changed.asked} {said}; so all {len(before) + len(new)} logs were searched for what has always been missing"
    return search.of_the_arm([*before, *new], why)


@dataclass(frozen=True)
class _Search:
    """Questions to one model.

    Attributes:
        result: the result.
        base: its base model.
        wanted: what is searched.
        options: how recordings are read.
        progress: told how far the work is.
    """

    result: Identification
    base: BaseModel
    wanted: SelectionOptions
    options: GapOptions
    progress: Progress

    def checked(self, logs: Sequence[Log]) -> list[Log]:
        """Return checked recordings."""
        return [checked_log(log, self.base.robot, self.options, identify=False) for log in logs]

    def ask(
        self,
        question: str,
        logs: Sequence[Log],
        earlier: Sequence[Log],
        why: str,
        also: tuple[Key, ...] = (),
        conditioned: list[ConditionedLog] | None = None,
        words: bool = True,
    ) -> Gap:
        """Ask one question of checked logs.

        Args:
            question: one of ``QUESTIONS``.
            logs: the recordings.
            earlier: those that the model was identified from, to find what has changed since.
            why: why this is asked, in words.
            also: effects that are tried whatever is asked.
            conditioned: the recordings as ``conditioned`` returns them for this question, where they are at hand.
            words: whether what is left is put into words.
        """
        from dynid.gap.analysis import analyse_gap, relative_error
        from dynid.gap.problem import kept_model
        from dynid.gap.record import record_of

        options = signals_of(self.result, self.options, question)
        conditioned = conditioned or self.conditioned(logs, options)
        before = self.conditioned(earlier, options) if earlier else []
        self.progress.stage("search")
        kept = kept_model(self.result) if question == "changed" else None
        arm = question == "arm"
        wanted = replace(self.wanted, also=also)
        possible = self.result.in_force == "physical"
        analysis = analyse_gap(
            conditioned, self.base, kept, wanted, self.progress, earlier=before, arm=arm, possible=possible, words=words
        )
        if question == "changed":
            now = relative_error(conditioned, self.base, self.result.theta)
            then = relative_error(before, self.base, self.result.theta) if before else 0.0
            why += _kept_error(now, then, analysis.verdict.word == "nothing_changed")
            analysis = self._weighed(analysis, logs) if earlier else analysis
        made_from = str(self.result.path) if self.result.path.name else ""
        record = record_of(analysis, self.base.robot, question, why, made_from)
        return _with_methods(
            record,
            analysis=analysis,
            searched=self.result,
            recordings=tuple(logs),
            before=tuple(earlier),
            signals=options,
        )

    def _in_words(self, gap: Gap) -> Gap:
        """Return an answer with what is left put into words."""
        from dynid.gap.analysis import in_words
        from dynid.gap.record import record_of

        assert gap.analysis is not None
        analysis = in_words(gap.analysis, self.progress)
        record = record_of(analysis, self.base.robot, gap.question, gap.asked, gap.made_from)
        more = {key: getattr(gap, key) for key in ("searched", "recordings", "before", "signals")}
        return _with_methods(record, analysis=analysis, **more)

    def _weighed(self, analysis: GapAnalysis, logs: Sequence[Log]) -> GapAnalysis:
        """Return an analysis whose load, if it names one, is as heavy as ``dynid identify --payload-from`` says."""
        from dynid.errors import DynidError
        from dynid.estimation.payload import find_payload
        from dynid.gap.loads import named_load, weighed
        from dynid.workflows.identify import IdentifyOptions, identify

        load, result = named_load(analysis), self.result
        if load is None or result.robot.torque.relative:
            return analysis
        options = IdentifyOptions(
            holdout=None, drop_weak=True, cutoff=result.cutoff or None, delay=result.delay, exclude=self.options.exclude
        )
        try:
            now = identify(self.base.robot, logs, options, base=self.base)
            # Why the other way round: what was taken off hung there when the model was identified.
            loaded, bare = (now, result) if load.values["m"] >= 0.0 else (result, now)
            return weighed(analysis, load, find_payload(loaded, bare))
        except DynidError:
            # Why nothing is said: the load is there, and the search has numbers of its own.
            return analysis

    def conditioned(self, logs: Sequence[Log], options: GapOptions) -> list[ConditionedLog]:
        """Return conditioned logs, of long ones stretches: minutes say what hours do, and all candidates fit."""
        from dynid.signals.conditioned_log import stretches

        whole = condition_logs(logs, self.base.model, options, self.progress)
        found, parts = stretches(whole, LONGEST)
        if parts:
            self.progress.stage(
                "stretches", f"{LONGEST:.0f} s are searched, in {parts} stretches spread evenly over the logs"
            )
        return found

    def of_the_arm(self, logs: Sequence[Log], why: str) -> Gap:
        """Ask what the model has always lacked: what no numbers absorb, and what only odd links would."""
        from dynid.gap.counterbalance import suspicions
        from dynid.gap.possible_arm import COUNTERBALANCE

        # Why once: both questions filter the same logs alike.
        conditioned = self.conditioned(logs, signals_of(self.result, self.options, "numbers"))
        # Why without words at first: of two answers one is given, and words take as long as all else.
        found = self.ask("numbers", logs, (), f"{why}: what can no numbers absorb?", (), conditioned, words=False)
        analysis = found.analysis
        suspected = [] if analysis is None else suspicions(analysis.problem, analysis.search.selected)
        effects, joints = self.wanted.effects, self.wanted.joints
        suspected = [
            one for one in suspected if not effects or COUNTERBALANCE in effects if not joints or one.joint in joints
        ]
        if not suspected:
            return self._in_words(found)
        names = self.base.robot.joint_names
        why = f"{found.asked} {_suspected(suspected, names)}: what would only odd links absorb?"
        places = [(one.joint,) for one in suspected]
        named = [(one.effect, one.indices) for one in found.named]
        also = tuple(key for key in named if key[1] not in places or key[0] not in LOOKALIKES)
        odd = self.ask("arm", logs, (), why, also, conditioned, words=False)
        if any(one.effect == COUNTERBALANCE for one in odd.named):
            return self._in_words(odd)
        return replace(self._in_words(found), asked=f"{why} {_not_told(suspected, odd)}")


def _suspected(suspected: Sequence[Suspicion], names: Sequence[str]) -> str:
    """Return why it is asked what only odd links would absorb."""
    said = []
    for one in suspected:
        without, beside = one.masses
        heavy = f" (without one, link {one.link} would weigh {without:.3g} kg, not {beside:.3g})"
        odd = without > TOLD_MASS * beside
        said.append(f"possible links do better beside a counterbalance of {names[one.joint]}{heavy if odd else ''}")
    return " and ".join(said)


def _not_told(suspected: Sequence[Suspicion], odd: Gap) -> str:
    """Return why no counterbalance is named, and what would tell."""
    said = [one.said for one in odd.closest if one.indices[:1] in [(each.joint,) for each in suspected]]
    links = " and ".join(dict.fromkeys(f"of link {one.link}" for one in suspected))
    sure = all(one.sure for one in suspected)
    what = "only absurd links do as well" if sure else "torques alone do not tell it from heavier links"
    return (
        f"{what}{f' ({said[0]})' if said else ''}: give the mass {links} from the data sheet (known: link_mass in the "
        "robot file) and identify again"
    )


def _kept_error(now: float, then: float, unchanged: bool) -> str:
    """Return how well the kept model does on new and on its own logs [%], in words."""
    if not then:
        return f" (the kept model misses {now:.3g} % of these torques)"
    text = f" (the kept model misses {now:.3g} % of these torques, {then:.3g} % of those it was identified from"
    if unchanged and now > EXTRAPOLATES * then:
        return f"{text}: it extrapolates to another motion)"
    return f"{text})"


def signals_of(result: Identification, options: GapOptions, question: str) -> GapOptions:
    """Return options with cut-off and delay of the search where nothing else was asked for."""
    from dynid.gap.analysis import CUTOFF

    # Why no delay otherwise: there it is one of the effects that are looked for.
    delay = result.delay if question == "changed" else 0.0
    cutoff = max(CUTOFF, result.cutoff) if options.cutoff is None else options.cutoff
    return replace(options, cutoff=cutoff, delay=delay if options.delay is None else options.delay)


def selection_options(robot: Robot, options: GapOptions) -> SelectionOptions:
    """Return what is searched on one arm, every name checked."""
    from dynid.files.yamlfile import closest
    from dynid.gap.stepwise_selection import SelectionOptions
    from dynid.model.effects.catalogue import CATALOGUE

    for word in options.effects:
        if word not in CATALOGUE:
            raise WrongUsage(
                f"--effects: no effect '{word}'{closest(word, CATALOGUE)}", fix=f"some of {','.join(CATALOGUE)}"
            )
    joints = joint_indices(robot.joint_names, ",".join(options.joints), "--joints")
    return SelectionOptions(options.effects, joints, options.false_alarm, options.max_effects)


def joint_indices(names: Sequence[str], text: str, option: str) -> tuple[int, ...]:
    """Return 0-based joints given by name, by number from 1, or as a range such as ``2-4``, separated by commas."""
    from dynid.files.yamlfile import closest

    found: list[int] = []
    for word in (w.strip() for w in text.split(",")):
        span = re.fullmatch(r"([0-9]{1,9})(?:-([0-9]{1,9}))?", word)
        if not word:
            continue
        if word in names:
            found.append(list(names).index(word))
        elif span and 1 <= int(span[1]) <= int(span[2] or span[1]) <= len(names):
            found += range(int(span[1]) - 1, int(span[2] or span[1]))
        else:
            raise WrongUsage(f"{option}: no joint '{word}'{closest(word, names)}", fix=f"1 to {len(names)}, or a name")
    return tuple(dict.fromkeys(found))


def earlier_logs(
    result: Identification, logs: Sequence[Log], options: GapOptions = GapOptions(), progress: Progress = SILENT
) -> list[Log]:
    """Return the recordings that a result was identified from, where their files are still what they were.

    Why: what the model left unexplained in them it leaves unexplained in new ones, and that is no change. A new log
    that is one of them cannot be compared with itself.

    Args:
        result: the result.
        logs: the new recordings.
        options: how recordings are read.
        progress: told what is not at hand.
    """
    from dynid.files.artifact import sha256

    new = {log.sha256 for log in logs if log.sha256}
    before = [(Path(name), sha) for name, sha in zip(result.header.get("logs", []), result.log_sha256, strict=False)]
    own = new & {sha for _, sha in before}
    if own:
        if options.question == "changed":
            progress.stage("earlier", "the model was identified from a log given here: nothing has changed in that one")
        elif options.question == "auto":
            return []
    there = [path for path, sha in before if sha not in new and path.is_file() and sha256(path) == sha]
    missing = [str(path) for path, sha in before if sha not in own and path not in there]
    if missing:
        text = f"not at hand, or not what they were: {', '.join(missing)}"
        progress.stage("earlier", f"logs that the model was identified from are {text}")
    return [load_log(path, result.robot, options, identify=False) for path in there]


def robot_file_beside(robot: Robot, effects: Sequence[GapEffect]) -> Path:
    """Return where the copy of a robot file with effects goes: beside a file of one's own, else ./robots or here."""
    import os

    from dynid.files.robotfile import packaged
    from dynid.gap.apply import new_name

    shipped = packaged("robots").resolve()
    folder = Path("robots") if Path("robots").is_dir() else Path()
    if robot.path is not None and shipped not in robot.path.resolve().parents and os.access(robot.path.parent, os.W_OK):
        folder = robot.path.parent
    return folder / f"{new_name(robot, effects)}.yaml"
