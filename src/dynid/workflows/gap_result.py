"""What a gap search found: tables, pictures, files, and the model with what was missing."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

from dynid import arguments
from dynid.answer import Judged, picked
from dynid.arguments import public
from dynid.errors import NotAnArtifact, WrongUsage
from dynid.estimation.evidence import evidence_of, gap_evidence
from dynid.estimation.result import Identification
from dynid.files import packaged
from dynid.files.artifact import read_header
from dynid.files.trajectoryfile import StoredTrajectory, read_trajectory
from dynid.gap.analysis import GapAnalysis, on_one_clock
from dynid.gap.apply import new_name, specs_of, stacked_with, write_robot
from dynid.gap.candidates import SelectionOptions
from dynid.gap.localisation import NEGLIGIBLE
from dynid.gap.record import GapEffect, GapRecord, read_record, write_record
from dynid.judgement.evidence import Evidence
from dynid.loading import condition_logs, load_run, parameters_of
from dynid.log import Log
from dynid.model.effects.catalogue import CATALOGUE
from dynid.progress import heard_by
from dynid.reports.figures import write_figure
from dynid.reports.gap_figures import effect_figure, improvement_figure, residual_figure
from dynid.robot import EffectSpec, Robot
from dynid.table import Table
from dynid.text import closest
from dynid.workflows.identify import identify
from dynid.workflows.options import GapOptions, IdentifyOptions
from dynid.workflows.parameters import Observations

if TYPE_CHECKING:
    from matplotlib.figure import Figure

T = TypeVar("T")

#: What the verdicts mean.
VERDICTS = {
    "named": "named",
    "nothing_missing": "no missing effect",
    "nothing_changed": "nothing has changed since the model was identified",
    "unexplained": "a residual above the noise that no effect of the catalogue explains",
    "ambiguous": "several effects fit equally well",
}
#: A joint with a larger share of the disagreement of all joints is told.
TOLD_SHARE = 0.1


def selection_options(robot: Robot, options: GapOptions) -> SelectionOptions:
    """Return what is searched on one arm, every name checked."""
    for word in options.effects:
        if word not in CATALOGUE:
            raise WrongUsage(
                f"--effects: no effect '{word}'{closest(word, CATALOGUE)}",
                fix=f"some of {','.join(CATALOGUE)}",
            )
    joints = joint_indices(robot.joint_names, ",".join(options.joints), "--joints")
    return SelectionOptions(options.effects, joints, 1.0 - options.false_alarm, options.max_effects)


def joint_indices(names: Sequence[str], text: str, option: str) -> tuple[int, ...]:
    """Return 0-based joints given by name, by number from 1, or as a range such as ``2-4``, separated by commas."""
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
            raise WrongUsage(
                f"{option}: no joint '{word}'{closest(word, names)}",
                fix=f"1 to {len(names)}, or a name",
            )
    return tuple(dict.fromkeys(found))


@dataclass(frozen=True, repr=False)
class Gap(Judged, GapRecord):
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
    def unseen_logs(self) -> tuple[Log, ...]:
        """The recordings that were held out as a whole; none where parts of recordings were."""
        names = self.heldout.split(", ")
        found = tuple(log for log in self.recordings if log.name in names)
        return found if 0 < len(found) == len(names) < len(self.recordings) else ()

    @property
    def evidence(self) -> Evidence:
        """What is known of the searched model with what was found."""
        record = picked(self, *(each.name for each in fields(GapRecord)))
        record |= {key: [asdict(one) for one in record[key]] for key in ("named", "closest")}
        delay = 0.0 if self.searched is None else self.searched.delay
        found = gap_evidence(record, asdict(self.improvement), delay)
        known = Evidence() if self.searched is None else evidence_of(self.searched)
        known = replace(known, result=known.result or self.made_from)
        return replace(known, asked="gap", gap=found)

    @property
    def noise_text(self) -> str:
        """Where the noise floor comes from and what it allows for."""
        return "; ".join(filter(None, [f"from {self.noise_from}", self.noise_note]))

    @property
    def where_text(self) -> str:
        """On which joints the disagreement is, and where in their motion."""
        loud = [one for one in self.joints if one.share > TOLD_SHARE and one.chi > 1 + NEGLIGIBLE]
        texts = (
            f"{self.joint_names[one.joint]} ({100 * one.share:.0f} % of the disagreement) {one.text}"
            for one in sorted(loud, key=lambda one: -one.share)
        )
        return "; ".join(texts) or "no joint is above its noise floor"

    @property
    def verdict_text(self) -> str:
        """The verdict in words."""
        text = VERDICTS[self.verdict]
        if self.verdict != "ambiguous":
            return text
        groups = ([f"{one.effect} on {one.where}", *one.rivals] for one in self.named if one.rivals)
        return f"{text}: {'; '.join(' or '.join(group) for group in groups)}"

    def table(self) -> Table:
        """Return one row per candidate: size, held-out rms of its joint before and, if it is named, after, p-value."""
        rows = [
            {
                "effect": one.effect,
                "where": one.where,
                "size": ", ".join(one.texts()),
                "rms before": one.rms_before,
                "rms after": one.rms_after,
                "unit": one.unit,
                "p-value": one.p_value,
                "result": one.message,
            }
            for one in (*self.named, *self.closest)
        ]
        return Table(
            rows, f"{self.robot}: {self.verdict_text}", (f"where: {self.where_text}", self.advice)
        )

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
                before, after = self.simulation[:, j].tolist()
                unit = "m" if row["unit"] == "N" else "rad"
                row |= {"simulated before": before, "simulated after": after, "in": unit}
            rows.append(row)
        return Table(rows, f"{self.robot}: held-out error ({self.heldout})")

    def summary(self) -> str:
        """Return the verdict, the sizes of what is named, where the gap is, the noise and the advice, line by line."""
        judged = self.judgement
        sizes = [f"{one.effect} on {one.where}: {', '.join(one.texts())}" for one in self.named]
        return "\n".join(
            [
                judged.sentence,
                *judged.reasons,
                *judged.warnings,
                *sizes,
                f"where: {self.where_text}",
                f"noise: {self.noise_text}",
                *([self.asked] if self.asked else []),
                self.advice,
            ]
        )

    def _repr_html_(self) -> str:
        return self.table()._repr_html_() + self.joint_table()._repr_html_()

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid gap`` says."""
        names = self.joint_names
        before, after = self.simulation if len(self.simulation) else (None, None)
        hidden = {name: joints for name, joints in self.cannot_judge.items() if name in CATALOGUE}
        return {
            "schema": "dynid/gap/1",
            **picked(self, "robot", "mode", "question", "asked", "verdict", "advice"),
            **picked(self, kept_relative_error_percent="kept"),
            **picked(self, expected_relative_error_percent="expected"),
            "where": [
                {"joint": names[one.joint], **picked(one, "share", "chi", region="text")}
                for one in self.joints
            ],
            "named": [one.facts() for one in self.named],
            "alternatives": [list(group) for group in self.alternatives],
            "closest": [one.facts() for one in self.closest],
            "formulas": [],
            "clues": list(self.clues),
            "gap": {
                "joints": list(names),
                **picked(
                    self.improvement,
                    heldout_before_nm="before",
                    heldout_after_nm="after",
                    noise_floor_nm="floor",
                    ratio_interval="ratio",
                ),
                "simulation_before": before,
                "simulation_after": after,
                **picked(self, "heldout", "noise_from"),
            },
            "not_repeatable": list(self.not_repeatable),
            "cannot_judge": {name: [names[j] for j in joints] for name, joints in hidden.items()},
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

    def plot_residual(self) -> Figure:
        """Return a figure of residual over noise power of each joint, by speed, position, load, time and direction."""
        return residual_figure(self.joints, self.joint_names, self.robot)

    def plot_improvement(self) -> Figure:
        """Return a figure of the held-out error of each joint before and after, with the noise."""
        title = f"{self.robot}: the gap on held-out data ({self.heldout})"
        return improvement_figure(self.improvement, self.joint_names, self.torque_units, title)

    def plot_effects(self) -> list[Figure]:
        """Return a figure of each named effect: unseen data without and with it, its curve in the data."""
        return [effect_figure(one, curve, self.robot) for one, curve in self.drawn()]

    def write_figures(self, folder: Path) -> list[Path]:
        """Write the figures as PNG: where.png, shrink.png, and one of each named effect."""
        figures = {"where": self.plot_residual(), "shrink": self.plot_improvement()}
        for k, (figure, (one, _)) in enumerate(
            zip(self.plot_effects(), self.drawn(), strict=True), start=1
        ):
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
        every = (*self.named, *self.closest)
        found = [
            one
            for one in every
            if one.effect == name and (not joints or {*one.indices[:1]} & {*joints})
        ]
        if not found:
            there = [
                f"{one.effect}@{','.join(f'{j + 1}' for j in one.indices[:1])}" for one in every
            ]
            why = f"found: {', '.join(there) or 'nothing'}"
            raise WrongUsage(f"--apply {text}: this was not found", why=why)
        return tuple(found)

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
        analysis = self.analysis
        if analysis is None:
            raise WrongUsage(
                "a search that was read from a file cannot be applied", fix="find_gap(...).apply()"
            )
        asked = self.chosen(effects) if isinstance(effects, str) else effects
        wanted = [(one.effect, one.indices) for one in asked]
        every = (*analysis.verdict.named, *(one for one, _ in analysis.verdict.closest))
        chosen = [one for one in every if (one.name, one.joints) in wanted]
        if not chosen:
            fix = "name a candidate of the table, such as apply('spring@7')"
            raise WrongUsage("no effect is named", fix=fix)
        robot = analysis.problem.base.robot
        specs = specs_of(chosen, robot)
        if robot_file is not None:
            write_robot(robot, specs, Path(robot_file))
        found = self._identified(specs)
        path = None if robot_file is None else Path(robot_file)
        header = {
            **found.header,
            "inputs": {f"log {k}": hashed for k, hashed in enumerate(found.log_sha256, start=1)},
            "effects": [asdict(spec) for spec in specs],
            "made_from": self.made_from,
        }
        return replace(found, robot=replace(found.robot, path=path), header=header)

    @heard_by()
    def _identified(self, specs: Sequence[EffectSpec]) -> Identification:
        """Return the arm with effects, identified as before: filter, estimator, set, sizes of the residual model."""
        before, analysis = self.searched, self.analysis
        assert before is not None
        assert analysis is not None
        late = self.signals.delay or 0.0
        if not any(spec.effect == "torque_delay" for spec in specs):
            late = before.delay
        signals = replace(self.signals, cutoff=before.cutoff or self.signals.cutoff, delay=late)
        unseen = {id(log) for log in self.unseen_logs}
        fitted = [log for log in self.recordings if id(log) not in unseen]
        model, every = analysis.problem.base.model, (*self.before, *fitted)
        logs = on_one_clock(condition_logs(fitted, model, signals))
        own = replace(signals, delay=before.delay)
        earlier = condition_logs(self.before, model, own) if self.before else []
        problem = analysis.problem
        base, stack = stacked_with(logs, problem.base, specs, problem.theta, earlier)
        seen = Observations(
            base=base,
            stack=stack,
            logs=tuple(str(log.source or "") for log in every),
            log_sha256=tuple(log.sha256 for log in every),
            delay=None,
            applied_delay=late,
            findings=(),
        )
        physical = before.in_force == "physical"
        options = IdentifyOptions(
            method=before.method if before.why == "as asked" else "auto",
            feasible=physical,
            # Why: an effect of one joint says nothing about how much is missing on the others.
            residual_model=before.model_error is not None if physical else None,
            drop_weak=True,
        )
        return identify(base.robot, seen, options, like=before)


def remove_search(folder: Path) -> None:
    """Remove what an earlier search left beside a result: its pictures and what was driven say nothing of a new one.

    Args:
        folder: of the result.
    """
    pictures = ("where.png", "shrink.png", "simulator.png", "effect_*.png")
    left = [path for pattern in pictures for path in (folder / "gap").glob(pattern)]
    for path in (*left, folder / "gap.npz", folder / "simulator_gap.npz"):
        path.unlink(missing_ok=True)


def robot_file_beside(robot: Robot, effects: Sequence[GapEffect]) -> Path:
    """Return where the copy of a robot file with effects goes: beside a file of one's own, else ./robots or here."""
    shipped = packaged("robots").resolve()
    folder = Path("robots") if Path("robots").is_dir() else Path()
    if (
        robot.path is not None
        and shipped not in robot.path.resolve().parents
        and os.access(robot.path.parent, os.W_OK)
    ):
        folder = robot.path.parent
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
    arguments.instance(kind, type, "kind", "a type such as dynid.Identification")
    file = parameters_of(arguments.path(path, "path"))
    schema = str((read_header(file) or {}).get("schema", "")).rpartition("/")[0]
    readers: dict[str, Callable[[Path], object]] = {
        "dynid/identification": load_run,
        "dynid/trajectory": read_trajectory,
        "dynid/gap": Gap.load,
    }
    if schema not in readers:
        raise NotAnArtifact(f"{file} holds nothing that dynid.load reads", where=str(file))
    found = readers[schema](file)
    if not isinstance(found, kind):
        raise arguments.refused("path", f"a file with an object of type {kind.__name__}", found)
    return found
