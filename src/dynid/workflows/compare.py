"""Many results side by side, and what changed against a baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from dynid.answer import Answer, Answered, Facts, Judged, Part, picked
from dynid.arguments import public
from dynid.errors import WrongUsage
from dynid.estimation.compare import Comparison
from dynid.estimation.compare import compare as compared
from dynid.estimation.result import Identification
from dynid.files import typed
from dynid.judgement.evidence import Change, Evidence
from dynid.judgement.rules import Judgement
from dynid.loading import ResultLike, as_result, several
from dynid.reports.tables import JunitCase, junit, runs_csv, runs_latex
from dynid.table import Table
from dynid.workflows.options import CompareOptions

#: Rows of changed numbers that are shown.
SHOWN = 12


@dataclass(frozen=True)
class ComparedRun(Judged):
    """One run compared with the reference.

    Attributes:
        name: short name.
        result: its result.
        reference: name of the run that it is compared with, empty for the reference itself.
        comparison: what changed; None for the reference, or where another arm has other parameters.
        tolerance: largest change of any number that counts as none, as a share; None to measure by the noise.
        earlier: path of the reference.
    """

    name: str
    result: Identification
    reference: str = ""
    comparison: Comparison | None = None
    tolerance: float | None = None
    earlier: str = ""

    @property
    def changed(self) -> tuple[Change, ...]:
        """The numbers that changed: beyond the tolerance, or without one more than noise explains."""
        if self.comparison is None:
            return ()
        if self.tolerance is None:
            return self.comparison.drifted
        return self.comparison.beyond(self.tolerance)

    @property
    def drift(self) -> str:
        """Why the run has drifted from the reference; empty when it has not."""
        if not self.changed:
            return ""
        worst, more = self.changed[0], len(self.changed) - 1
        rest = f" and {more} more" if more else ""
        went = f"{worst.name} {worst.before:.4g} -> {worst.after:.4g}"
        return f"{went} ({worst.percent:+.2f} %){rest}"

    @property
    def evidence(self) -> Evidence:
        """What is known of its model, and what changed."""
        if not self.reference:
            return self.result.evidence
        units = {row["name"]: row["unit"] for row in self.result.parameter_rows()}
        changes = tuple(replace(each, unit=units.get(each.name, "")) for each in self.changed)
        return replace(
            self.result.evidence,
            asked="change",
            changes=None if self.comparison is None else changes,
            earlier=self.reference,
            earlier_result=self.earlier,
            tolerance=self.tolerance,
        )

    def table(self) -> Table:
        """Return the numbers that changed."""
        return Table(
            [
                {
                    "number": each.name,
                    "before": f"{each.before:.5g}",
                    "after": f"{each.after:.5g}",
                    "change": f"{each.percent:+.2f} %",
                    "p": "-" if each.p_value is None else f"{each.p_value:.1g}",
                }
                for each in self.changed
            ]
        )

    def facts(self) -> Facts:
        """Return the comparison as the JSON answer has it."""
        assert self.comparison is not None
        beyond = () if self.tolerance is None else self.changed
        return {
            **picked(self, run="name", against="reference"),
            **picked(self.comparison, "p_value", "figures", changed="drifted"),
            "beyond_tolerance": beyond,
            "passed": not self.drift,
            "judgement": self.judgement.facts(),
        }

    def described(self) -> Facts:
        """Return the run itself as the JSON answer has it."""
        facts = self.result.facts()
        return {
            "run": self.name,
            "path": self.result.path,
            **{
                key: facts[key]
                for key in (
                    "robot",
                    "method",
                    "rank",
                    "condition_number_scaled",
                    "relative_error_percent",
                    "heldout_relative_error_percent",
                    "joints",
                )
            },
            "parameters": {
                row["name"]: {"value": row["value"], "std_error": row["std_error"]}
                for row in facts["parameters"]
            },
            "log_sha256": self.result.log_sha256,
        }


@dataclass(frozen=True, repr=False)
class RunComparison(Answered):
    """Several results side by side.

    Attributes:
        runs: the runs, each with what changed against the baseline, or against the first run where there is none.
        baseline: name of the baseline, None without one.
        tolerance: largest change that counts as none, as a share; None to measure by the noise.
    """

    runs: tuple[ComparedRun, ...]
    baseline: str | None
    tolerance: float | None

    @property
    def passed(self) -> bool:
        """Whether no run has drifted from the baseline; True without one."""
        return self.baseline is None or not any(run.drift for run in self.runs)

    @property
    def judgement(self) -> Judgement:
        """What is said of the run that differs most from the reference; of the only run where there is none."""
        return max(self.runs, key=lambda run: (len(run.changed), bool(run.reference))).judgement

    def table(self) -> Table:
        """Return one row per run: robot, estimator, rank, condition number, errors."""
        rows = []
        for run in self.runs:
            result = run.result
            worst = max(result.joints, key=lambda joint: joint.relative_percent)
            held = result.heldout_relative_error_percent
            rows.append(
                {
                    "run": run.name,
                    "robot": result.robot.name,
                    "method": result.method,
                    "rank": f"{result.rank}",
                    "condition": f"{result.condition_number_scaled:.3g}",
                    "error": f"{result.relative_error_percent:.2f} %",
                    "held out": "-" if held is None else f"{held:.2f} %",
                    "weakest joint": f"{worst.joint} {worst.relative_percent:.1f} %",
                }
            )
        return Table(rows)

    def answer(self) -> Answer:
        """Return what ``dynid compare`` answers."""
        judged = [run for run in self.runs if run.reference or len(self.runs) == 1]
        parts = list[Part]()
        for run in judged:
            changes = run.table()
            parts += [*[run.name] * (len(judged) > 1), run.judgement, Table(changes[:SHOWN])]
            if len(changes) > SHOWN:
                parts.append(f"and {len(changes) - SHOWN} more; all with --json")
            parts += [""] * bool(changes)
        drifts = [f"{run.name}: {run.drift}" for run in self.runs if run.drift]
        return Answer(
            self.facts(),
            parts=(*parts, self.table()),
            next=[run.judgement.steps[0] for run in judged if run.changed][:1],
            limits=[] if self.baseline is None else drifts,
        )

    def facts(self) -> Facts:
        """Return what the JSON answer of ``dynid compare`` says."""
        return {
            "runs": [run.described() for run in self.runs],
            **picked(self, "baseline", "tolerance", "passed"),
            "comparisons": [run.facts() for run in self.runs if run.comparison],
            "judgement": self.judgement.facts(),
        }

    def _named(self) -> tuple[list[str], list[Identification]]:
        return [run.name for run in self.runs], [run.result for run in self.runs]

    def csv(self) -> str:
        """Return one row per run as CSV."""
        return runs_csv(*self._named())

    def latex(self) -> str:
        """Return one column per run as a LaTeX table."""
        return runs_latex(*self._named())

    def junit(self) -> str:
        """Return a JUnit XML report with one test per run that was compared."""
        cases = [
            JunitCase(run.name, run.result.robot.name, run.drift)
            for run in self.runs
            if run.reference
        ]
        return junit("dynid compare", cases)


@public
def compare(
    results: ResultLike | Sequence[ResultLike],
    *,
    baseline: ResultLike | None = None,
    tolerance: float | str | None = None,
) -> RunComparison:
    """Put results side by side, and say what changed against a baseline, or against the first of them.

    Args:
        results: the results, their folders or their files.
        baseline: what they are judged against, None for the first result, which judges nothing.
        tolerance: largest change of any number that counts as none, as ``0.01`` or ``"1%"``; None to measure by the
            noise.

    Raises:
        WrongUsage: there is no result, a tolerance is given without a baseline, a result has other parameters than the
            baseline, or an argument is something else than what is wanted (E101).

    Example:
        dynid.compare(["out/monday", "out/friday"], baseline="out/golden", tolerance="1%")
    """
    if baseline is None and tolerance is not None:
        raise WrongUsage("--tolerance needs a --baseline", fix="--baseline RUN")
    share = CompareOptions(tolerance).tolerance  # type: ignore[arg-type]  # it reads text
    given = [
        (_name(each, f"run {k}"), as_result(each, "results"))
        for k, each in enumerate(several(results, "results"), start=1)
    ]
    reference, first = given[0]
    if baseline is not None:
        reference, first = _name(baseline, "baseline"), as_result(baseline, "baseline")
    path = typed(first.path) if first.path.name else ""
    runs = []
    for name, result in given:
        if result is first and baseline is None:
            runs.append(ComparedRun(name, result))
            continue
        if baseline is not None:
            first.require(result.base)
        comparison = compared(first, result) if first.describes(result.base) else None
        runs.append(ComparedRun(name, result, reference, comparison, share, path))
    return RunComparison(tuple(runs), None if baseline is None else reference, share)


def _name(given: object, otherwise: str) -> str:
    """Return what a result is called: as it was given, or its number."""
    return str(given) if isinstance(given, (str, Path)) else otherwise
