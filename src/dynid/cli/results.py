"""Commands on results and files of others: validate, compare, report, export, run, check, convert, import."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import FILE, INPUT, PATH, dynid_command, options_from
from dynid.cli.prompt import may_write, write_once
from dynid.cli.session import Session
from dynid.disk import sha256, write_text
from dynid.errors import WrongUsage
from dynid.judgement.rules import Step
from dynid.options import LogOptions
from dynid.reports.tables import JunitCase
from dynid.reports.tables import junit as junit_xml
from dynid.runs import RunFolder
from dynid.table import Table
from dynid.text import shell
from dynid.workflows.options import (
    FORMATS,
    CompareOptions,
    ExportOptions,
    ImportOptions,
    ValidateOptions,
)
from dynid.workflows.run import RunOptions, run

if TYPE_CHECKING:
    from dynid.workflows.files import Checked


@dynid_command(
    "validate",
    examples=(
        "dynid validate out/kuka_lwr4plus other.bag",
        "dynid validate out/arm other.bag --max-unexplained 5%     exit 1 when worse",
        "dynid validate out/arm other.bag --mcap replay.mcap     for Foxglove, PlotJuggler, Rerun",
    ),
)
@click.argument("parameters", type=PATH)
@click.argument("log", type=PATH)
@options_from(ValidateOptions)
@click.option(
    "--mcap",
    type=FILE,
    help="Write measured, predicted and residual joint states with the arm's URDF for Foxglove, PlotJuggler and Rerun.",
)
@click.option("--plot/--no-plot", default=True, help="Draw the figures.")
def validate_command(
    session: Session,
    parameters: Path,
    log: Path,
    options: ValidateOptions,
    mcap: Path | None,
    plot: bool,
) -> Answer:
    """Compare predicted with measured torques on a recording that was not used to identify."""
    stored = dynid.loading.load_run(parameters)
    run = RunFolder.of(stored.path)
    if mcap is not None:
        may_write(session, mcap)
    validation = dynid.validate(stored, log, options)
    folder = validation.folder(run.path / "validation")
    wrote = [validation.save(folder), *(validation.write_figures(folder) if plot else [])]
    if mcap is not None:
        wrote.append(validation.save_mcap(mcap, workflows.validate.urdf_of(stored)))
    wrote += workflows.report.renewed(stored.path)
    return replace(validation.answer(), wrote=wrote)


@dynid_command(
    "compare",
    examples=(
        "dynid compare out/a out/b out/c                              one table",
        "dynid compare out/now --baseline out/january                 exit 1 when parameters changed significantly",
        "dynid compare out/now --baseline expected --tolerance 1%     exit 1 when a number moved by more: for CI",
    ),
)
@click.argument("runs", nargs=-1, required=True, type=PATH, metavar="RUN...")
@click.option(
    "--baseline", type=PATH, metavar="RUN", help="Result that the runs are compared with."
)
@options_from(CompareOptions)
@click.option("--csv", type=FILE, help="Write one row per run as CSV.")
@click.option("--latex", type=FILE, help="Write a LaTeX table.")
@click.option("--junit", type=FILE, help="Write a JUnit XML report.")
def compare_command(
    session: Session,
    runs: tuple[Path, ...],
    baseline: Path | None,
    options: CompareOptions,
    **files: Path | None,
) -> Answer:
    """Compare identification results: one table, drift of an arm, regression against a baseline."""
    comparison = dynid.compare(runs, baseline=baseline, tolerance=options.tolerance)
    wrote = {kind: path for kind, path in files.items() if path is not None}
    for kind, path in wrote.items():
        write_text(path, getattr(comparison, kind)())
    return replace(comparison.answer(), wrote=[*wrote.values()])


@dynid_command(
    "report",
    examples=(
        "dynid report out/kuka_lwr4plus               writes report.html and summary.md there",
        "dynid report out/kuka_lwr4plus --open        and shows it in the browser",
    ),
)
@click.argument("run", type=PATH)
@click.option("--open/--no-open", default=False, help="Open it in the browser.")
def report_command(session: Session, run: Path, open: bool) -> Answer:
    """Make the report of a result again."""
    stored = dynid.loading.load_run(run)
    made = workflows.report.report(stored)
    wrote = made.save(session.out or stored.path.parent)
    if open:
        click.launch(str(wrote[0].resolve()))
    return replace(made.answer(), wrote=wrote)


@dynid_command(
    "export",
    examples=(
        "dynid export out/kuka_lwr4plus --format urdf",
        "dynid export out/kuka_lwr4plus --format urdf --urdf lwr.urdf       your own file, new inertial blocks",
        "dynid export out/kuka_lwr4plus --format c --format python",
        "dynid export out/kuka_lwr4plus --format mjcf --draws 100       arms for randomisation",
    ),
)
@click.argument("run", type=PATH)
@click.option(
    "--format",
    type=click.Choice([*FORMATS, "all"]),
    multiple=True,
    required=True,
    help="Format to write; may be given several times.",
)
@options_from(ExportOptions)
def export_command(
    session: Session, run: Path, format: tuple[str, ...], options: ExportOptions
) -> Answer:
    """Write the identified model as URDF, MJCF, YAML, C, Python or MATLAB."""
    stored = dynid.loading.load_run(run)
    made = workflows.export.export(
        stored,
        session.out or stored.path.parent,
        options,
        formats=[name for name in FORMATS if name in format or "all" in format],
        seed=session.seed,
        write=partial(write_once, session),
    )
    return made.answer()


#: Options of reading logs that a check does not need: nothing is filtered.
FILTERING = ("cutoff", "velocity", "delay")


@dynid_command(
    "check",
    examples=(
        "dynid check my_arm.yaml                           a robot file",
        "dynid check log.bag --robot my_arm.yaml           a log of that arm",
        "dynid check log.bag --robot my_arm --convert      the same, and write out/my_arm/log.npz",
        "dynid check out/my_arm/parameters.npz             the header of a result",
    ),
)
@click.argument("paths", metavar="PATH...", nargs=-1, required=True)
@click.option(
    "--robot",
    metavar="ROBOT",
    help="The arm of the logs; by default the robot file among the paths.",
)
@options_from(LogOptions, without=FILTERING)
@click.option("--convert", is_flag=True, help="Write log.npz: all columns as they were recorded.")
@click.option(
    "--fix", is_flag=True, help="Write log.npz after the repairs that lose nothing, and list them."
)
@click.option("--strict", is_flag=True, help="Exit with 1 when there are warnings.")
def check_command(
    session: Session,
    paths: Sequence[str],
    robot: str | None,
    options: LogOptions,
    convert: bool,
    fix: bool,
    strict: bool,
) -> Answer:
    """Look for mistakes in robot files, logs and results."""
    arm = dynid.load_robot(robot) if robot else None
    checks = workflows.files.check(paths, arm, options)
    wrote = [written(session, each, options, fix) if convert or fix else [] for each in checks]
    return workflows.files.checks_answer(checks, wrote, strict=strict)


def written(session: Session, checked: Checked, options: LogOptions, fix: bool) -> list[Path]:
    """Write log.npz of a log, with its repairs or as it was recorded, where that is not done yet."""
    log = checked.log if fix else checked.raw
    if log is None or checked.robot is None:
        return []
    target = session.folder(checked.robot.slug) / "log.npz"
    inputs = {"log": sha256(Path(checked.path)), **options.texts(), "fix": str(fix)}
    if not may_write(session, target, inputs):
        return []
    return [log.save(target, session.header(inputs))]


@dynid_command(
    "convert",
    examples=(
        "dynid convert recording/ -o run.csv                a folder of rosbag2 as a table",
        "dynid convert lab.csv --robot my_arm.yaml -o run.npz",
    ),
)
@click.argument("log", type=PATH)
@click.option(
    "--to",
    type=FILE,
    help="File to write: .npz or .csv; -o FILE is the same.",
)
@click.option(
    "--robot", metavar="ROBOT", help="The arm of the log, whose file names topic and columns."
)
@options_from(LogOptions, without=(*FILTERING, "exclude", "anyway", "sort_time"))
def convert_command(
    session: Session, log: Path, to: Path | None, robot: str | None, options: LogOptions
) -> Answer:
    """Write a recording as .npz or .csv; every number stays as it was recorded."""
    target = to or session.out
    if target is None:
        fix = shell("dynid", "convert", log, "-o", f"{log.stem}.npz")
        raise WrongUsage("no file to write is given", fix=fix)
    may_write(session, target, other="another --to")
    arm = dynid.load_robot(robot) if robot else None
    return workflows.files.convert(log, target, arm, options)


@dynid_command(
    "import",
    examples=(
        "dynid import ur5.urdf                                          writes out/ur5/ur5.yaml",
        "dynid import tiago.urdf --base torso_lift_link --tip arm_7_link    one arm of many",
        "dynid import panda.urdf --convention modified",
    ),
)
@click.argument("urdf", type=INPUT)
@options_from(ImportOptions)
def import_command(session: Session, urdf: Path, options: ImportOptions) -> Answer:
    """Make a robot file from a URDF: DH table, limits, inertias as prior."""
    text, answer = workflows.files.import_urdf(urdf, options)
    path = session.folder(urdf.stem) / f"{urdf.stem}.yaml"
    write_once(session, path, text)
    facts = {**answer.facts, "wrote": [path]}
    return replace(answer, facts=facts, next=[Step("", shell("dynid", "check", path))])


@dynid_command(
    "run",
    examples=(
        "dynid run batch.yaml                         all jobs of the list, done ones are not done again",
        "dynid run batch.yaml --junit results.xml     for continuous integration",
        "dynid run batch.yaml --scheduler tcp://host:8786     on the workers of a Dask scheduler",
        "dynid run batch.yaml --json-lines | jq .name         follow the jobs as they end",
    ),
)
@click.argument("batch", type=INPUT)
@options_from(RunOptions)
@click.option("--junit", type=FILE, help="Write a JUnit XML report.")
@click.option(
    "--json-lines", is_flag=True, help="Print one line of JSON for each job, when it ends."
)
def run_command(
    session: Session, batch: Path, options: RunOptions, junit: Path | None, json_lines: bool
) -> Answer:
    """Identify, validate and compare many recordings from one YAML list."""
    if json_lines and session.json:
        raise WrongUsage("--json-lines and --json are two forms of one answer", fix="give one")
    number = count(1)

    def line(event: str, facts: dict[str, Any]) -> None:
        if json_lines:
            facts = {"schema": "dynid/run-event/1", "event": event, **facts}
            session.emit_json(facts, indent=None)

    def ended(jobs: int, job: dict[str, Any]) -> None:
        how = "reused" if job["reused"] else f"{job['seconds']:.1f} s"
        session.stage(f"{next(number)}/{jobs}", f"{job['name']}: {job['outcome']} ({how})")
        line("job", {key: job[key] for key in job if key != "answers"})

    words = ["--seed", str(session.seed), *["--force"] * session.force]
    jobs = run(batch, options, session.out or Path("out"), words, ended)
    if junit is not None:
        write_text(junit, junit_xml("dynid run", [*map(case_of, jobs)]))
    wrote = [] if junit is None else [junit]
    outcomes = Counter(job["outcome"] for job in jobs)
    facts = {
        "passed": outcomes["passed"],
        "beyond_limit": outcomes["beyond a limit"],
        "failed": outcomes["failed"],
    }
    line("end", {**facts, "wrote": wrote})
    failed = [job["status"] for job in jobs if job["outcome"] == "failed"]
    columns = {
        "job": "name",
        "outcome": "outcome",
        "error %": "relative_error_percent",
        "held out %": "unseen_relative_error_percent",
        "what": "message",
    }
    rows = [{head: job[key] or None for head, key in columns.items()} for job in jobs]
    counts = f"{facts['beyond_limit']} beyond a limit, {facts['failed']} failed"
    verdict = ("verdict", f"{facts['passed']} of {len(jobs)} passed, {counts}")
    return Answer(
        {"schema": "dynid/run/1", "jobs": jobs, **facts},
        parts=() if json_lines else (Table(rows), "", verdict),
        wrote=wrote,
        status=failed[0] if failed else max(job["status"] for job in jobs),
    )


def case_of(job: dict[str, Any]) -> JunitCase:
    """Return a job as a line of a test report."""
    robot, failed = Path(job["robot"]).stem, job["outcome"] == "failed"
    return JunitCase(job["name"], robot, job["message"], job["seconds"], failed)
