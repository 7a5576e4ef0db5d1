"""Many arms over many days: which have changed, and which differ from others of their model."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import DynidError, NotAnArtifact, WrongUsage
from dynid.options import Options, bytes_or_none, option, share
from dynid.progress import SILENT, Progress
from dynid.table import Table
from dynid.text import chance, csv_row, whole_number
from dynid.workflows.cluster import mapped, opened
from dynid.workflows.results import parameters_of
from dynid.workflows.run import cores

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from dynid.estimation.fleet import FleetFindings, History

#: Results that one task reads, and from how many on they are read side by side.
AT_ONCE, MANY = 100, 400
#: Columns of a list of results.
COLUMNS = ("result", "arm", "time")
SECONDS = 86400.0
#: Days of the epoch that stand for dates.
FIRST_DATE, LAST_DATE = 7305, 84_000
#: What this command writes, which ``out/*/*`` names as well.
WRITTEN = ("fleet.csv", "fleet.html")
_DATE = re.compile(r"\d{4}-?\d\d-?\d\d(?!\d)")


@dataclass(frozen=True)
class FleetOptions(Options):
    """What counts as a change, and where results are read."""

    false_alarms: float = option(
        0.05,
        "Largest share of false alarms among the arms that are called changed, on average over arms and days.",
        metavar="SHARE",
        shown="5%",
        read=share,
    )
    jobs: int | None = option(
        None,
        "How many results are read at a time (default: one per core).",
        metavar="N",
        kind="count",
    )
    scheduler: str | None = option(
        None,
        "Read the results on the workers of this Dask scheduler, such as tcp://host:8786.",
        metavar="ADDRESS",
    )
    memory: int | None = option(
        None,
        "Memory of each process that reads, such as 4GB (default: an equal share of the machine's).",
        metavar="SIZE",
        read=bytes_or_none,
    )
    fail_if_changed: bool = option(False, "End with exit code 1 when an arm has changed.")


@dataclass(frozen=True)
class Run:
    """One result in the history of an arm.

    Attributes:
        path: its parameters.npz.
        arm: name of the arm.
        time: as it was given.
        day: the same as a number [days]; of the epoch where it is a date.
    """

    path: Path
    arm: str
    time: str
    day: float


@dataclass(frozen=True)
class Row:
    """What of a result takes part.

    Attributes:
        robot: name of the robot.
        names: base parameters, (p,).
        value: plain estimates, (p,), each in its unit.
        std_error: their standard errors, (p,); infinite where the log does not determine them.
    """

    robot: str
    names: tuple[str, ...]
    value: NDArray[np.float64]
    std_error: NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class ArmType:
    """The arms of one robot file.

    Attributes:
        robot: its name.
        found: what their histories say.
        times: the time of each run as it was given, by arm and day.
        units: of the parameters, by name.
    """

    robot: str
    found: FleetFindings
    times: dict[tuple[str, float], str]
    units: dict[str, str]

    def since(self, arm: str, day: float) -> str:
        """Return when a change was first seen, as the run's time was given."""
        return self.times.get((arm, day)) or _text_of(day)


@dataclass(frozen=True, repr=False)
class Fleet:
    """What the results of a fleet say.

    Attributes:
        types: one for each robot and set of base parameters.
        runs: number of results that took part.
        false_alarms: expected share of false ones among the arms that are called changed.
        unread: results that could not be read, and why.
        wrote: files that were written.
    """

    types: tuple[ArmType, ...]
    runs: int
    false_alarms: float
    unread: tuple[tuple[str, str], ...] = ()
    wrote: tuple[Path, ...] = field(default=())

    @property
    def arms(self) -> int:
        """Number of arms."""
        return sum(len(each.found.history.arms) for each in self.types)

    @property
    def changed(self) -> list[str]:
        """Names of the arms that have changed, the most certain first."""
        return list(dict.fromkeys(c.arm for each in self.types for c in each.found.changes))

    @property
    def tested(self) -> int:
        """Number of arms with enough runs to see a change."""
        import numpy as np

        return sum(int(np.any(~np.isnan(each.found.p_values), axis=1).sum()) for each in self.types)

    def changes(self) -> Table:
        """Return one row per parameter that changed."""
        rows = [
            {
                "arm": c.arm,
                "parameter": c.parameter,
                "since": each.since(c.arm, c.since),
                "before": f"{c.before:.4g}",
                "after": f"{c.after:.4g} {each.units.get(c.parameter, '')}".strip(),
                "change": _change(c.before, c.after),
                "+-": f"{1.96 * c.std_error:.2g}",
                "p": chance(c.p_value),
            }
            for each in self.types
            for c in each.found.changes
        ]
        return Table(rows)

    def outliers(self) -> Table:
        """Return one row per parameter in which an arm differs from others of its model."""
        rows = [
            {
                "arm": o.arm,
                "parameter": o.parameter,
                "value": f"{o.value:.4g}",
                "usual": f"{o.usual:.4g} {each.units.get(o.parameter, '')}".strip(),
                "difference": f"{abs(o.value - o.usual) / o.spread:.1f} standard deviations",
                "compared with": o.other or "the fleet",
                "p": chance(o.p_value),
            }
            for each in self.types
            for o in each.found.outliers
        ]
        return Table(rows)

    def __repr__(self) -> str:
        """Return the verdict and what changed."""
        return "\n".join([self.verdict(), *([repr(self.changes())] if self.changed else [])])

    def verdict(self) -> str:
        """Return how many arms changed, in a sentence."""
        if not self.tested:
            return "no arm has three runs, which are needed to see a change"
        among = f"{len(self.changed)} of {self.tested} arms changed"
        return f"{among}; at most {100 * self.false_alarms:g} % of the named ones are expected to be false alarms"

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid fleet`` says."""
        return {
            "schema": "dynid/fleet/1",
            "arms": self.arms,
            "arms_tested": self.tested,
            "runs": self.runs,
            "false_alarm_share": self.false_alarms,
            "changed": [
                {
                    **asdict(c),
                    "robot": each.robot,
                    "since": each.since(c.arm, c.since),
                    "unit": each.units.get(c.parameter),
                }
                for each in self.types
                for c in each.found.changes
            ],
            "unlike_twins": [
                {**asdict(o), "robot": each.robot, "unit": each.units.get(o.parameter)}
                for each in self.types
                for o in each.found.outliers
            ],
            "usual": [
                {"robot": each.robot, **asdict(w)} for each in self.types for w in each.found.usual
            ],
            "runs_left_out": {
                arm: int(off)
                for each in self.types
                for arm, off in zip(each.found.history.arms, each.found.off, strict=True)
                if off
            },
            "unread": [{"result": path, "why": why} for path, why in self.unread],
        }

    def csv(self) -> str:
        """Return one row per parameter that changed or differs from that of other arms."""
        head = (
            "finding",
            "robot",
            "arm",
            "parameter",
            "unit",
            "since",
            "before",
            "after",
            "std_error",
            "p_value",
        )
        rows = [csv_row(head)]
        for each in self.types:
            unit = each.units.get
            for c in each.found.changes:
                since = each.since(c.arm, c.since)
                rows.append(
                    csv_row(
                        (
                            "changed",
                            each.robot,
                            c.arm,
                            c.parameter,
                            unit(c.parameter),
                            since,
                            c.before,
                            c.after,
                            c.std_error,
                            c.p_value,
                        )
                    )
                )
            for o in each.found.outliers:
                rows.append(
                    csv_row(
                        (
                            "unlike its model",
                            each.robot,
                            o.arm,
                            o.parameter,
                            unit(o.parameter),
                            None,
                            o.usual,
                            o.value,
                            o.spread,
                            o.p_value,
                        )
                    )
                )
        return "\n".join([*rows, ""])

    def save(self, folder: Path) -> list[Path]:
        """Write fleet.html and fleet.csv."""
        from dynid.files.artifact import write_text
        from dynid.reports.fleet_page import fleet_page

        pages = [
            (
                each.robot,
                each.found,
                {day: text for (_, day), text in each.times.items()},
                each.units,
            )
            for each in self.types
        ]
        page = fleet_page(self.verdict(), pages, self.runs, self.unread)
        wrote = [folder / name for name in WRITTEN]
        for path, text in zip(wrote, (self.csv(), page), strict=True):
            write_text(path, text)
        return wrote


def _change(before: float, after: float) -> str:
    return (
        f"{100 * (after - before) / abs(before):+.1f} %"
        if abs(before) > 1e-9
        else f"{after - before:+.3g}"
    )


def fleet(
    results: Sequence[Path], options: FleetOptions = FleetOptions(), *, progress: Progress = SILENT
) -> Fleet:
    """Find which arms have changed, and which differ from others of their model.

    Args:
        results: results as ``ARM/TIME`` or ``DATE/ARM`` folders or their parameters.npz, or CSV lists with
            ``result,arm,time``.
        options: what counts as a change, and where results are read.
        progress: reports how far the work is.

    Raises:
        WrongUsage: a path does not say arm and time, or a list lacks a column.
        NotAnArtifact: none of the results can be read.
    """
    from dynid.estimation.fleet import look_at

    runs = ordered([run for path in results if path.name not in WRITTEN for run in runs_of(path)])
    rows, unread = read_rows(runs, options, progress)
    if not rows:
        why = f": {unread[0][1]}" if unread else ""
        raise NotAnArtifact(
            f"none of {len(runs)} results can be read{why}", where=str(runs[0].path) if runs else ""
        )
    kinds: dict[tuple[str, tuple[str, ...]], list[tuple[Run, Row]]] = {}
    for run, row in rows:
        kinds.setdefault((row.robot, row.names), []).append((run, row))
    progress.stage("look", f"{len(rows)} results of {len({run.arm for run, _ in rows})} arms")
    types = []
    for (robot, _), members in kinds.items():
        found = look_at(history_of(members), options.false_alarms)
        times = {(run.arm, run.day): run.time for run, _ in members}
        types.append(ArmType(robot, found, times, _units(members[0][0].path)))
    return Fleet(tuple(types), len(rows), options.false_alarms, unread)


# ---------------------------------------------------------------- which arm, and when
def runs_of(path: Path) -> list[Run]:
    """Return the runs that a path stands for: one result, or those of a list.

    Raises:
        WrongUsage: the path does not say arm and time, or a list lacks a column.
    """
    if path.suffix == ".csv":
        return _listed(path)
    file = parameters_of(path)
    folder = file.parent if file.name == "parameters.npz" else file.with_suffix("")
    words = [word for word in folder.absolute().parts if word != folder.anchor]
    if len(words) < 2:
        raise WrongUsage(
            f"{path} does not say which arm it belongs to and when it was made",
            fix="ARM/TIME folders, or a CSV list",
        )
    arm, time = words[-2:]
    if _DATE.match(arm) and not _DATE.match(time):
        arm, time = time, arm
    return [Run(file, arm, time, _day(time))]


def _listed(path: Path) -> list[Run]:
    from dynid.files.yamlfile import read_text

    try:
        rows = list(csv.DictReader(read_text(path).splitlines()))
    except OSError as error:
        raise WrongUsage(f"cannot read {path}: {error.strerror}", where=str(path)) from error
    except csv.Error as error:
        raise WrongUsage(f"{path} is not a list of results: {error}", where=str(path)) from error
    found = []
    for number, row in enumerate(rows, start=2):
        if any(not row.get(key) for key in COLUMNS):
            what = f"{path}:{number}: a list of results has the columns {', '.join(COLUMNS)}"
            raise WrongUsage(what, where=f"{path}:{number}", fix="name them in its first line")
        file = parameters_of(path.parent / row["result"])
        found.append(Run(file, row["arm"], row["time"], _day(row["time"])))
    return found


def _day(text: str) -> float:
    """Return a time as a number of days; NaN where only its place among the others is known."""
    if _DATE.match(text):
        for form in (text, text.replace("_", "T", 1)):
            try:
                at = datetime.fromisoformat(form)
            except ValueError:
                continue
            return (at if at.tzinfo else at.replace(tzinfo=timezone.utc)).timestamp() / SECONDS
    return float(text) if re.fullmatch(r"[-+]?\d{1,9}(\.\d+)?", text) else float("nan")


def _text_of(day: float) -> str:
    """Return a number of days as a date, where it is one from 1990 to 2199."""
    if not FIRST_DATE <= day < LAST_DATE:
        return f"{day:g}"
    return datetime.fromtimestamp(day * SECONDS, tz=timezone.utc).strftime("%Y-%m-%d")


def ordered(runs: Sequence[Run]) -> list[Run]:
    """Return the runs of each arm in order of time; runs whose time is only a name stand a day apart.

    Raises:
        WrongUsage: two runs of an arm have the same time.
    """
    arms: dict[str, list[Run]] = {}
    for run in runs:
        arms.setdefault(run.arm, []).append(run)
    found = []
    for members in arms.values():
        if any(run.day != run.day for run in members):
            words = sorted(members, key=_numbers_as_such)
            members = [replace(run, day=float(k)) for k, run in enumerate(words)]
        members = sorted(members, key=lambda run: run.day)
        for one, other in pairwise(members):
            if one.day == other.day:
                raise WrongUsage(
                    f"{one.path} and {other.path} are runs of {one.arm} at the same time",
                    fix="a CSV list",
                )
        found += members
    return found


def _numbers_as_such(run: Run) -> list[tuple[int, str]]:
    """Return what puts run 10 behind run 9."""
    return [(whole_number(word), word) for word in re.split(r"(\d+)", run.time)]


# ---------------------------------------------------------------- reading
def read_rows(
    runs: Sequence[Run], options: FleetOptions, progress: Progress = SILENT
) -> tuple[list[tuple[Run, Row]], tuple[tuple[str, str], ...]]:
    """Return what takes part of each result, and which cannot be read and why."""
    parts = [runs[first : first + AT_ONCE] for first in range(0, len(runs), AT_ONCE)]
    paths = [[run.path.absolute() for run in part] for part in parts]
    workers = min(options.jobs or cores(), len(parts)) if len(runs) >= MANY else 1
    read: dict[int, list[Row | str]] = {}
    progress.stage("read")
    with opened(
        workers, scheduler=options.scheduler, memory=options.memory, progress=progress
    ) as client:
        for k, rows, error in mapped(client, rows_of, paths, progress=progress):
            if error is not None:
                raise error
            read[k] = rows
            progress.advance(len(read), len(parts), f"{len(runs)} results")
    every = [row for k in range(len(parts)) for row in read[k]]
    found = [(run, row) for run, row in zip(runs, every, strict=True) if isinstance(row, Row)]
    unread = [
        (str(run.path), row) for run, row in zip(runs, every, strict=True) if isinstance(row, str)
    ]
    return found, tuple(unread)


def rows_of(paths: Sequence[Path]) -> list[Row | str]:
    """Return what takes part of results, or why one cannot be read."""
    return [_row(path) for path in paths]


def _row(path: Path) -> Row | str:
    import numpy as np

    from dynid.estimation.covariance import NOT_DETERMINED
    from dynid.estimation.result_files import CONTENTS
    from dynid.files.artifact import read_artifact, reading
    from dynid.model.base_model import reduction_from

    try:
        artifact = read_artifact(path, CONTENTS)
        header, arrays = artifact.header, artifact.arrays
        with reading(path):
            robot, names = header["robot"], reduction_from(header["reduction"], arrays).base_names
        stored = header["result"]
        error = np.sqrt(np.maximum(np.diagonal(arrays["plain_covariance"]), 0.0))
        if stored["rank"] < len(names):
            error = np.where(
                [word == NOT_DETERMINED for word in stored["knowledge"]], np.inf, error
            )
        return Row(robot, names, arrays["plain"], error)
    except DynidError as mistake:
        return f"{mistake.code} {mistake.what}"


def history_of(members: Sequence[tuple[Run, Row]]) -> History:
    """Return the runs of arms of one type as arrays; runs of each arm in order of time."""
    import numpy as np

    from dynid.estimation.fleet import History

    arms: dict[str, list[tuple[Run, Row]]] = {}
    for run, row in members:
        arms.setdefault(run.arm, []).append((run, row))
    names = members[0][1].names
    most = max(2, *(len(each) for each in arms.values()))
    t = np.full((len(arms), most), np.nan)
    value, error = (np.full((len(arms), most, len(names)), np.nan) for _ in range(2))
    for a, each in enumerate(arms.values()):
        for k, (run, row) in enumerate(each):
            t[a, k], value[a, k], error[a, k] = run.day, row.value, row.std_error
    return History(tuple(arms), names, t, value, error)


def _units(path: Path) -> dict[str, str]:
    """Return the unit of each base parameter, from a result that has them."""
    from dynid.estimation.result_files import load

    try:
        return {str(row["name"]): str(row["unit"]) for row in load(path).parameter_rows()}
    except DynidError:
        return {}
