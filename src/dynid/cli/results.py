"""Commands on results and files of others: validate, compare, report, export, run, check, convert, import."""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.answer import Answer, Facts
from dynid.cli.options import Input, Output, dynid_command
from dynid.cli.prompt import may_write, write_once
from dynid.cli.session import Session
from dynid.disk import sha256, write_text
from dynid.errors import WrongUsage
from dynid.judgement.rules import Step
from dynid.options import LogOptions, option
from dynid.reports.tables import JunitCase
from dynid.reports.tables import junit as junit_xml
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
    from dynid.estimation.result import Identification
    from dynid.workflows.files import Checked


@dynid_command("validate")
def validate_command(
    session: Session,
    *,
    parameters: Identification,
    log: Path,
    options: ValidateOptions,
    mcap: Output | None = option(
        None,
        "Write measured, predicted and residual joint states with the arm's URDF for Foxglove, PlotJuggler and Rerun.",
    ),
    plot: bool = option(True, "Draw the figures."),
) -> Answer:
    """Compare predicted with measured torques on a recording that was not used to identify.

    Examples:
      dynid validate out/kuka_lwr4plus other.bag
      dynid validate out/arm other.bag --max-unexplained 5%     exit 1 when worse
      dynid validate out/arm other.bag --mcap replay.mcap     for Foxglove, PlotJuggler, Rerun
    """
    if mcap is not None:
        may_write(session, mcap)
    validation = dynid.validate(parameters, log, options)
    folder = validation.folder(parameters.path.parent / "validation")
    wrote = [validation.save(folder), *(validation.write_figures(folder) if plot else [])]
    if mcap is not None:
        wrote.append(validation.save_mcap(mcap, workflows.validate.urdf_of(parameters)))
    wrote += workflows.report.renewed(parameters.path)
    return replace(validation.answer(), wrote=wrote)


@dynid_command("compare")
def compare_command(
    session: Session,
    *,
    runs: tuple[Path, ...],
    baseline: Path | None = option(None, "Result that the runs are compared with.", metavar="RUN"),
    options: CompareOptions,
    csv: Output | None = option(None, "Write one row per run as CSV."),
    latex: Output | None = option(None, "Write a LaTeX table."),
    junit: Output | None = option(None, "Write a JUnit XML report."),
) -> Answer:
    """Compare identification results: one table, drift of an arm, regression against a baseline.

    Examples:
      dynid compare out/a out/b out/c                              one table
      dynid compare out/now --baseline out/january                 exit 1 when parameters changed significantly
      dynid compare out/now --baseline expected --tolerance 1%     exit 1 when a number moved by more: for CI
    """
    comparison = dynid.compare(runs, baseline=baseline, tolerance=options.tolerance)
    files = {csv: comparison.csv, latex: comparison.latex, junit: comparison.junit}
    wrote = [path for path in files if path is not None]
    for path in wrote:
        write_text(path, files[path]())
    return replace(comparison.answer(), wrote=wrote)


@dynid_command("report")
def report_command(
    session: Session,
    *,
    run: Identification,
    open: bool = option(False, "Open it in the browser.", pair=True),
) -> Answer:
    """Make the report of a result again.

    Examples:
      dynid report out/kuka_lwr4plus               writes report.html and summary.md there
      dynid report out/kuka_lwr4plus --open        and shows it in the browser
    """
    made = dynid.report(run)
    wrote = made.save(session.out or run.path.parent)
    if open:
        click.launch(str(wrote[0].resolve()))
    return replace(made.answer(), wrote=wrote)


@dynid_command("export")
@click.option(
    "--format",
    type=click.Choice([*FORMATS, "all"]),
    multiple=True,
    required=True,
    help="Format to write; may be given several times.",
)
def export_command(
    session: Session, *, run: Identification, format: tuple[str, ...], options: ExportOptions
) -> Answer:
    """Write the identified model as URDF, MJCF, YAML, C, Python or MATLAB.

    Examples:
      dynid export out/kuka_lwr4plus --format urdf
      dynid export out/kuka_lwr4plus --format urdf --urdf lwr.urdf       your own file, new inertial blocks
      dynid export out/kuka_lwr4plus --format c --format python
      dynid export out/kuka_lwr4plus --format mjcf --draws 100       arms for randomisation
    """
    return dynid.export(
        run,
        session.out or run.path.parent,
        options,
        formats=[name for name in FORMATS if name in format or "all" in format],
        seed=session.seed,
        write=partial(write_once, session),
    ).answer()


#: Options of reading logs that a check does not need: nothing is filtered.
FILTERING = ("cutoff", "velocity", "delay")


@dynid_command("check", without=FILTERING)
def check_command(
    session: Session,
    *,
    paths: tuple[str, ...],
    robot: str | None = option(
        None, "The arm of the logs; by default the robot file among the paths.", metavar="ROBOT"
    ),
    options: LogOptions,
    convert: bool = option(False, "Write log.npz: all columns as they were recorded."),
    fix: bool = option(False, "Write log.npz after the repairs that lose nothing, and list them."),
    strict: bool = option(False, "Exit with 1 when there are warnings."),
) -> Answer:
    """Look for mistakes in robot files, logs and results.

    Examples:
      dynid check my_arm.yaml                           a robot file
      dynid check log.bag --robot my_arm.yaml           a log of that arm
      dynid check log.bag --robot my_arm --convert      the same, and write out/my_arm/log.npz
      dynid check out/my_arm/parameters.npz             the header of a result
    """
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
    inputs = {"log": sha256(checked.path), **options.texts(), "fix": str(fix)}
    if not may_write(session, target, inputs):
        return []
    return [log.save(target, session.header(inputs))]


@dynid_command("convert", without=(*FILTERING, "exclude", "anyway", "sort_time"))
def convert_command(
    session: Session,
    *,
    log: Path,
    to: Output | None = option(None, "File to write: .npz or .csv; -o FILE is the same."),
    robot: str | None = option(
        None, "The arm of the log, whose file names topic and columns.", metavar="ROBOT"
    ),
    options: LogOptions,
) -> Answer:
    """Write a recording as .npz or .csv; every number stays as it was recorded.

    Examples:
      dynid convert recording/ -o run.csv                a folder of rosbag2 as a table
      dynid convert lab.csv --robot my_arm.yaml -o run.npz
    """
    target = to or session.out
    if target is None:
        raise WrongUsage(
            "no file to write is given",
            fix=shell("dynid", "convert", log, "-o", f"{log.stem}.npz"),
        )
    may_write(session, target, other="another --to")
    arm = dynid.load_robot(robot) if robot else None
    return workflows.files.convert(log, target, arm, options)


@dynid_command("import")
def import_command(session: Session, *, urdf: Input, options: ImportOptions) -> Answer:
    """Make a robot file from a URDF: DH table, limits, inertias as prior.

    Examples:
      dynid import ur5.urdf                                          writes out/ur5/ur5.yaml
      dynid import tiago.urdf --base torso_lift_link --tip arm_7_link    one arm of many
      dynid import panda.urdf --convention modified
    """
    text, answer = workflows.files.import_urdf(urdf, options)
    path = session.folder(urdf.stem) / f"{urdf.stem}.yaml"
    write_once(session, path, text)
    return replace(answer, next=[Step("", shell("dynid", "check", path))])


#: What the table of jobs shows of each.
COLUMNS = {
    "job": "name",
    "outcome": "outcome",
    "error %": "relative_error_percent",
    "held out %": "unseen_relative_error_percent",
    "what": "message",
}


@dynid_command("run")
def run_command(
    session: Session,
    *,
    batch: Input,
    options: RunOptions,
    junit: Output | None = option(None, "Write a JUnit XML report."),
    json_lines: bool = option(False, "Print one line of JSON for each job, when it ends."),
) -> Answer:
    """Identify, validate and compare many recordings from one YAML list.

    Examples:
      dynid run batch.yaml                         all jobs of the list, done ones are not done again
      dynid run batch.yaml --junit results.xml     for continuous integration
      dynid run batch.yaml --scheduler tcp://host:8786     on the workers of a Dask scheduler
      dynid run batch.yaml --json-lines | jq .name         follow the jobs as they end
    """
    if json_lines and session.json:
        raise WrongUsage("--json-lines and --json are two forms of one answer", fix="give one")
    number = count(1)

    def line(event: str, facts: Facts) -> None:
        if json_lines:
            session.emit_json({"schema": "dynid/run-event/1", "event": event, **facts}, indent=None)

    def ended(jobs: int, job: Facts) -> None:
        how = "reused" if job["reused"] else f"{job['seconds']:.1f} s"
        session.stage(f"{next(number)}/{jobs}", f"{job['name']}: {job['outcome']} ({how})")
        line("job", {key: job[key] for key in job if key != "answers"})

    words = ["--seed", str(session.seed), *["--force"] * session.force]
    jobs = run(batch, options, session.out or Path("out"), words, ended)
    wrote = [] if junit is None else [junit]
    for path in wrote:
        write_text(path, junit_xml("dynid run", [*map(case_of, jobs)]))
    outcomes = Counter(job["outcome"] for job in jobs)
    counts = {
        "passed": outcomes["passed"],
        "beyond_limit": outcomes["beyond a limit"],
        "failed": outcomes["failed"],
    }
    line("end", {**counts, "wrote": wrote})
    failed = [job["status"] for job in jobs if job["outcome"] == "failed"]
    said = "{passed} of {jobs} passed, {beyond_limit} beyond a limit, {failed} failed"
    rows = [{head: job[key] or None for head, key in COLUMNS.items()} for job in jobs]
    verdict = "verdict", said.format(jobs=len(jobs), **counts)
    return Answer(
        {"jobs": jobs, **counts},
        parts=() if json_lines else (Table(rows), "", verdict),
        wrote=wrote,
        status=failed[0] if failed else max(job["status"] for job in jobs),
    )


def case_of(job: Facts) -> JunitCase:
    """Return a job as a line of a test report."""
    robot, failed = Path(job["robot"]).stem, job["outcome"] == "failed"
    return JunitCase(job["name"], robot, job["message"], job["seconds"], failed)
