"""``dynid compare RUN...``: many results in one table, and whether an arm or a result has drifted."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus, WrongUsage

if TYPE_CHECKING:
    from dynid.estimation.compare import Comparison
    from dynid.estimation.result import StoredResult

_FILE = click.Path(dir_okay=False, path_type=Path)
#: Rows of changed numbers that are shown without -v.
SHOWN = 12


@dynid_command(
    "compare",
    examples=(
        "dynid compare out/a out/b out/c                              one table",
        "dynid compare out/now --baseline out/january                 exit 1 when parameters changed significantly",
        "dynid compare out/now --baseline expected --tolerance 1%     exit 1 when a number moved by more: for CI",
        "dynid compare --methods kuka_lwr4plus run.bag                all estimators on the same log",
    ),
)
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@click.option("--baseline", type=click.Path(path_type=Path), metavar="RUN", help="What the runs are judged against.")
@click.option("--tolerance", metavar="SHARE", help="Largest change of any number; without it noise is the measure.")
@click.option("--methods", is_flag=True, help="Run all estimators on the same logs instead: --methods ROBOT LOG...")
@click.option("--csv", "csv_file", type=_FILE, metavar="FILE", help="Write one row a run as CSV.")
@click.option("--latex", "latex_file", type=_FILE, metavar="FILE", help="Write a LaTeX table.")
@click.option("--junit", "junit_file", type=_FILE, metavar="FILE", help="Write a JUnit XML report.")
def command(
    common: Common,
    runs: tuple[Path, ...],
    baseline: Path | None,
    tolerance: str | None,
    methods: bool,
    csv_file: Path | None,
    latex_file: Path | None,
    junit_file: Path | None,
) -> ExitStatus:
    """Compare identification results: one table, drift of an arm, regression against a baseline."""
    from dynid.files.artifact import write_text
    from dynid.options import share as share_of
    from dynid.reports import tables

    if methods:
        from dynid.cli.methodtable import compare_methods

        common.terminal.emit_json(compare_methods(common, runs))
        return ExitStatus.DONE
    if baseline is None and tolerance is not None:
        raise WrongUsage("--tolerance needs a --baseline", fix="--baseline RUN")
    share = None if tolerance is None else share_of(tolerance, "--tolerance")
    names, stored = load_runs(runs)
    judged = stored if baseline is None else [*load_runs((baseline,))[1], *stored]
    comparisons = compared(names, judged, required=baseline is not None)
    verdicts = [verdict(comparison, share) for comparison in comparisons]
    passed = baseline is None or not any(verdicts)
    wrote: list[Path] = []
    cases = [tables.Case(name, run.robot.name, why) for name, run, why in zip(names, stored, verdicts, strict=False)]
    texts = (
        (csv_file, tables.runs_csv(names, stored)),
        (latex_file, tables.runs_latex(names, stored)),
        (junit_file, tables.junit("dynid compare", cases)),
    )
    for path, text in texts:
        if path is not None:
            write_text(path, text)
            common.terminal.wrote(path)
            wrote.append(path)
    show_runs(common, names, stored)
    pairs = list(zip(names if baseline is not None else names[1:], comparisons, strict=True))
    first = str(baseline) if baseline is not None else names[0]
    for name, comparison in pairs:
        if comparison is not None:
            show_comparison(common, name, first, comparison, share)
    if baseline is not None:
        for name, why in zip(names, verdicts, strict=True):
            if why:
                common.terminal.say(f"limit      {name}: {why}")
        common.terminal.answer()
        common.terminal.fact("verdict", f"{'as' if passed else 'not as'} the baseline {first}")
    common.terminal.emit_json(
        {
            "schema": "dynid/compare/1",
            "runs": [described(name, run) for name, run in zip(names, stored, strict=True)],
            "baseline": None if baseline is None else str(baseline),
            "tolerance": share,
            "comparisons": [facts(name, first, comparison, share) for name, comparison in pairs if comparison],
            "passed": passed,
            "wrote": wrote,
        }
    )
    return ExitStatus.DONE if passed else ExitStatus.LIMIT_NOT_MET


def load_runs(runs: tuple[Path, ...]) -> tuple[list[str], list[StoredResult]]:
    """Return results with short names for them: the folder's, or the whole path where two would be the same."""
    from dynid.estimation import result

    paths = [run / "parameters.npz" if run.is_dir() else run for run in runs]
    names = [path.parent.name if path.name == "parameters.npz" and path.parent.name else str(path) for path in paths]
    if len(set(names)) < len(names):
        names = [str(run) for run in runs]
    return names, [result.load(path) for path in paths]


def compared(names: list[str], judged: list[StoredResult], *, required: bool) -> list[Comparison | None]:
    """Return each result after the first compared with the first; None where another arm has other parameters.

    Raises:
        WrongUsage: a comparison is required and cannot be made.
    """
    from dynid.estimation.compare import compare, same_parameters

    first = judged[0]
    found: list[Comparison | None] = []
    for run in judged[1:]:
        if same_parameters(first.identification, run.identification):
            found.append(compare(first.identification, run.identification))
        elif required:
            raise WrongUsage(
                f"{run.path} has other base parameters than {first.path}: {run.robot.name}, {first.robot.name}",
                fix="identify both with the same robot file",
            )
        else:
            found.append(None)
    return found


def verdict(comparison: Comparison | None, share: float | None) -> str:
    """Return why a run has drifted from its baseline; empty when it has not."""
    if comparison is None:
        return ""
    if share is None:
        changed = comparison.drifted
        return f"{', '.join(each.name for each in changed)} changed more than noise explains" if changed else ""
    beyond = comparison.beyond(share)
    if not beyond:
        return ""
    worst = beyond[0]
    more = f" and {len(beyond) - 1} more" if len(beyond) > 1 else ""
    return f"{worst.name} {worst.before:.4g} -> {worst.after:.4g} ({worst.percent:+.2f} %){more}"


def show_runs(common: Common, names: list[str], stored: list[StoredResult]) -> None:
    """Print one row a run."""
    rows = []
    for name, run in zip(names, stored, strict=True):
        found = run.identification
        worst = max(found.joints, key=lambda joint: joint.relative_percent)
        held = found.heldout_relative_error_percent
        rows.append(
            [
                name,
                run.robot.name,
                found.method,
                f"{found.rank}",
                f"{found.condition_number_scaled:.3g}",
                f"{found.relative_error_percent:.2f} %",
                "-" if held is None else f"{held:.2f} %",
                f"{worst.joint} {worst.relative_percent:.1f} %",
            ]
        )
    heads = ["run", "robot", "method", "rank", "condition", "unexplained", "held out", "weakest joint"]
    common.terminal.table(heads, rows)


def show_comparison(common: Common, name: str, first: str, comparison: Comparison, share: float | None) -> None:
    """Print what changed against the first run."""
    listed = comparison.drifted if share is None else comparison.beyond(share)
    measure = "more than noise explains" if share is None else f"by more than {100 * share:g} %"
    common.terminal.answer()
    common.terminal.answer(
        f"{name} against {first}: {len(listed)} numbers changed {measure}; "
        f"chance of the largest change by noise: {comparison.p_value:.2g}"
    )
    most = len(listed) if common.terminal.common.verbose else SHOWN
    rows = []
    for each in listed[:most]:
        chance = getattr(each, "p_value", None)
        shown = "-" if chance is None or chance != chance else f"{chance:.1g}"
        rows.append([each.name, f"{each.before:.5g}", f"{each.after:.5g}", f"{each.percent:+.2f} %", shown])
    if rows:
        common.terminal.table(["number", "before", "after", "change", "p"], rows)
    if len(listed) > most:
        common.terminal.answer(f"and {len(listed) - most} more; all with -v or --json")


def described(name: str, run: StoredResult) -> dict[str, Any]:
    """Return one run for JSON."""
    found = run.identification
    parameters = {
        each: {"value": float(value), "std_error": float(error)}
        for each, value, error in zip(found.names, found.theta, found.std_error, strict=True)
    }
    return {
        "run": name,
        "path": str(run.path),
        "robot": run.robot.name,
        "method": found.method,
        "rank": found.rank,
        "condition_number_scaled": found.condition_number_scaled,
        "relative_error_percent": found.relative_error_percent,
        "heldout_relative_error_percent": found.heldout_relative_error_percent,
        "joints": [
            {"joint": j.joint, "rms_nm": j.rms, "relative_error_percent": j.relative_percent} for j in found.joints
        ],
        "parameters": parameters,
        "log_sha256": list(run.log_sha256),
    }


def facts(name: str, first: str, comparison: Comparison, share: float | None) -> dict[str, Any]:
    """Return one comparison for JSON."""
    from dataclasses import asdict

    return {
        "run": name,
        "against": first,
        "p_value": comparison.p_value,
        "changed": [asdict(each) for each in comparison.drifted],
        "beyond_tolerance": [] if share is None else [asdict(each) for each in comparison.beyond(share)],
        "figures": [asdict(each) for each in comparison.figures],
        "passed": not verdict(comparison, share),
    }
