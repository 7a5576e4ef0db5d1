"""One identification from more logs than one process should read: work moves to the data, small factors come back.

Every log is cut into stretches; a task reads one, forms the triangular factor of each joint's rows and returns that,
(n, p + 1, p + 1), however long the stretch is. Factors are merged as a tree whose shape depends on the stretches alone,
so that one worker and fifty give the same bytes. A second round over the stretches gives the covariance of the
estimate, which allows for coloured residuals.

What looks at single rows of all logs at once (instruments, spikes, what reversals leave, the residual model, the
estimate of a delay) takes no part: this is weighted least squares with the physically possible set beside it.

Source: Demmel et al. 2012, "Communication-optimal parallel and sequential QR" (TSQR).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.errors import Finding, LogTooShort, SameRecording, WorkerDiffers, WrongUsage
from dynid.options import delay_or_auto, frequency_or_auto
from dynid.progress import SILENT, Progress
from dynid.threads import one_thread
from dynid.version import __version__
from dynid.workflows.cluster import Of, Pool, Task
from dynid.workflows.logs import LogOptions, checked_log, read_log

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.log import Log
    from dynid.model.base_model import BaseModel
    from dynid.signals.conditioned_log import ConditionedLog

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

#: Results that are merged at once.
BRANCHES = 8
#: Share of the stretches, the last ones, that is held out where there are this many or more.
HELD_OUT, FEWEST = 0.2, 5
#: Options of ``dynid identify`` that a job in stretches may set.
OPTIONS = ("cutoff", "delay", "velocity", "topic", "rate", "sort_time", "anyway", "drop_weak", "feasible")


@dataclass(frozen=True)
class Arm:
    """What every task needs to know of the arm and of how logs are read.

    Attributes:
        robot: name or path of the robot file.
        options: how logs are read.
        limits: limits that are raised.
        version: of dynid.
    """

    robot: str
    options: LogOptions
    limits: tuple[tuple[str, float], ...] = ()
    version: str = __version__


@dataclass(frozen=True)
class Looked:
    """What is known of a log before it is folded.

    Attributes:
        samples: number of samples, checked.
        rate: sample rate [Hz].
        cutoff: cut-off of the filter that its motion asks for [Hz].
        sha256: of its file.
        motion: positions at 5 Hz, two minutes at most, (M, n) [rad or m].
        findings: what was noticed.
    """

    samples: int
    rate: float
    cutoff: float
    sha256: str
    motion: Floats
    findings: tuple[Finding, ...]


@dataclass(frozen=True)
class Stretch:
    """Part of a log.

    Attributes:
        path: the log.
        start: its first sample.
        end: behind its last.
        cutoff: of the filter [Hz].
    """

    path: Path
    start: int
    end: int
    cutoff: float


@dataclass(frozen=True)
class Folded:
    """Rows as triangular factors.

    Attributes:
        factors: one factor of [W tau] per joint, (n, p + 1, p + 1).
        counts: number of rows of each, (n,).
        samples: number of instants.
    """

    factors: Floats
    counts: Ints
    samples: int


@one_thread
def identify_in_pieces(
    arm: Arm,
    logs: Sequence[Path],
    pool: Pool,
    *,
    seconds: float,
    options: Mapping[str, Any],
    progress: Progress = SILENT,
) -> Identification:
    """Identify the base parameters of an arm from logs that no process reads as a whole.

    Args:
        arm: the arm, and how logs are read.
        logs: the recordings, each of which the workers can read.
        pool: what runs the tasks.
        seconds: length of a stretch at most [s].
        options: ``drop_weak`` and ``feasible`` of ``dynid identify``.
        progress: told how far the work is.

    Raises:
        DynidError: a log is unfit, or the logs determine fewer parameters than the arm has.
    """
    from dynid.estimation.estimate import HoldOut, estimate
    from dynid.estimation.least_squares import weighted
    from dynid.estimation.stack import Earlier, Stack

    logs = [path.absolute() for path in logs]
    tasks = {f"look {k}": Task(look, (arm, path, len(logs) == 1)) for k, path in enumerate(logs)}
    looked = [found for found in results(pool, tasks, list(tasks), progress, "read") if isinstance(found, Looked)]
    hashes = [each.sha256 for each in looked]
    for k, each in enumerate(hashes):
        if each in hashes[:k]:
            raise SameRecording(f"{logs[k]} and {logs[hashes.index(each)]} are the same recording", where=str(logs[k]))
    cutoff = arm.options.cutoff or max(each.cutoff for each in looked)
    stretches = [part for path, each in zip(logs, looked, strict=True) for part in cut(path, each, seconds, cutoff)]
    judged = round(HELD_OUT * len(stretches)) if len(stretches) >= FEWEST else 0
    folds = {f"fold {k}": Task(fold, (arm, stretch)) for k, stretch in enumerate(stretches)}
    names = list(folds)
    parts = {"train": names[: len(names) - judged], "test": names[len(names) - judged :]}
    tasks = dict(folds)
    wanted = [tree(tasks, key, members, merged) for key, members in parts.items() if members]
    train, *rest = results(pool, tasks, wanted, progress, "fold")
    assert isinstance(train, Folded)
    whole = merged([train, *rest])

    base = model_of(arm)
    fit = weighted(whole.factors, whole.counts)
    tasks = {
        f"spread {k}": Task(spread, (arm, stretch, fit.theta, fit.noise, fit.solution.inverse))
        for k, stretch in enumerate(stretches)
    }
    (covariance,) = results(pool, tasks, [tree(tasks, "covariance", list(tasks), added)], progress, "errors")

    def stacked(folded: Folded) -> Stack:
        return Stack(
            base=base,
            factors=folded.factors[None],
            counts=folded.counts[None],
            log_of_block=np.full(1, -1),
            block=np.zeros(1, dtype=np.int64),
            rows=(),
            earlier=Earlier(folded.factors, fit.noise, covariance),
        )

    text = f"the last {judged} of {len(stretches)} stretches"
    held = HoldOut(stacked(train), stacked(rest[0]), text) if rest else None
    found = estimate(stacked(whole), base, method="wls", holdout=held, residual_model=False, **dict(options))
    findings = [finding for each in looked for finding in each.findings]
    return replace(
        found,
        quality=replace(found.quality, samples=whole.samples),
        why=f"folded in {len(stretches)} stretches of up to {seconds:g} s",
        motions=tuple(each.motion for each in looked),
        header={
            "robot": base.robot.name,
            "key": base.robot.model_key,
            "logs": [str(path) for path in logs],
            "log_sha256": hashes,
            "cutoff_hz": cutoff,
            "delay_applied_s": arm.options.delay or 0.0,
            "log_findings": [asdict(finding) for finding in findings],
        },
    )


def results(pool: Pool, tasks: Mapping[str, Task], wanted: Sequence[str], progress: Progress, what: str) -> list[Any]:
    """Return the results of some tasks, in their order.

    Raises:
        Exception: what the first of them, in that order, has raised.
    """
    found: dict[str, Any] = {}
    failed: dict[str, BaseException] = {}
    progress.stage(what)
    for done in pool.run(tasks, wanted):
        (failed if done.error is not None else found)[done.name] = done.error if done.error is not None else done.value
        progress.advance(len(found), len(wanted), what)
    for name in wanted:
        if name in failed:
            raise failed[name]
    return [found[name] for name in wanted]


def tree(tasks: dict[str, Task], key: str, members: Sequence[str], merge: Callable[[list[Any]], Any]) -> str:
    """Add the tasks that merge the results of others, neighbours first, and return the name of the last."""
    level, height = list(members), 0
    while len(level) > 1 or height == 0:
        above = []
        for first in range(0, len(level), BRANCHES):
            name = f"{key} {height}.{first}"
            tasks[name] = Task(merge, ([Of(each) for each in level[first : first + BRANCHES]],))
            above.append(name)
        level, height = above, height + 1
    return level[0]


def cut(path: Path, looked: Looked, seconds: float, cutoff: float) -> list[Stretch]:
    """Return the stretches of a log: as many as it takes, all of one length."""
    count = max(1, int(np.ceil(looked.samples / looked.rate / seconds - 1e-9)))
    limits.check("stretches", count, path)
    edges = np.linspace(0, looked.samples, count + 1).astype(int).tolist()
    return [Stretch(path, start, end, cutoff) for start, end in pairwise(edges)]


# ---------------------------------------------------------------- what the workers do
def look(arm: Arm, path: Path, alone: bool) -> Looked:
    """Read and check a log, and say how it is to be filtered.

    Raises:
        DynidError: it is unfit.
    """
    from dynid.estimation.estimate import LONGEST_MOTION
    from dynid.signals.filters import choose_filter
    from dynid.signals.motion import sampled

    log, base = checked(arm, path, alone), model_of(arm)
    return Looked(
        samples=len(log),
        rate=log.rate,
        cutoff=choose_filter(log, base.robot, arm.options.cutoff).cutoff,
        sha256=log.sha256,
        motion=sampled(log.t, log.q)[:LONGEST_MOTION],
        findings=log.findings,
    )


def fold(arm: Arm, stretch: Stretch) -> Folded:
    """Return the triangular factors of a stretch."""
    from dynid.estimation.stack import stack_logs

    base = model_of(arm)
    found = stack_logs([conditioned(arm, stretch)], base)
    factors, counts = found.whole
    return Folded(factors, counts, found.samples)


def merged(parts: list[Folded]) -> Folded:
    """Return the factors of all rows of some parts."""
    from dynid.estimation.least_squares import merge

    if len(parts) == 1:
        return parts[0]
    factors = np.array([[*each.factors] for each in parts]).swapaxes(0, 1)
    return Folded(
        np.array([merge(joint) for joint in factors]),
        np.sum([each.counts for each in parts], axis=0),
        sum(each.samples for each in parts),
    )


def spread(arm: Arm, stretch: Stretch, theta: Floats, noise: Floats, bread: Floats) -> Floats:
    """Return what a stretch adds to the covariance of an estimate, (p, p).

    Args:
        arm: the arm.
        stretch: the stretch.
        theta: the estimate, (p,).
        noise: standard deviation of each joint that it was weighted with, (n,) [N m or N].
        bread: sensitivity of the estimate to the scores, (p, p).
    """
    from dynid.estimation.covariance import automatic_lags, long_run_variance
    from dynid.estimation.observation_rows import rows_of

    base = model_of(arm)
    series: list[list[Floats]] = []
    for rows in rows_of(conditioned(arm, stretch), base.model.observer(base.reduction.base)):
        scores = np.einsum("mnp,mn->mp", rows.W, rows.residual(theta) / noise**2)
        if not (rows.follows and series):
            series.append([])
        series[-1].append(scores)
    runs = [np.concatenate(each) for each in series]
    return np.asarray(bread @ long_run_variance(runs, automatic_lags(runs)) @ bread.T)


def added(parts: list[Floats]) -> Floats:
    """Return the sum of some matrices."""
    return np.asarray(np.sum(parts, axis=0))


def model_of(arm: Arm) -> BaseModel:
    """Return the model of an arm, derived once in a process.

    Raises:
        WorkerDiffers: this worker has another dynid.
        WrongUsage: the robot has effects that scale with what is identified.
    """
    from dynid.estimation.stack import scale_with_model
    from dynid.workflows.model import base_model
    from dynid.workflows.robots import load_robot

    if arm.version != __version__:
        raise WorkerDiffers(f"a worker has dynid {__version__}, and this is {arm.version}")
    base = base_model(load_robot(arm.robot))
    if scale_with_model(base):
        raise WrongUsage(
            f"{arm.robot} has effects that scale with the parameters that are identified",
            why="their columns need all logs again and again",
            fix="leave out split_s",
        )
    return base


def conditioned(arm: Arm, stretch: Stretch) -> ConditionedLog:
    """Return a stretch of a log after the filters; its neighbours lend what the filters take at its ends."""
    from dynid.signals.conditioned_log import condition_log
    from dynid.signals.filters import choose_filter

    log, base = checked(arm, stretch.path, alone=False), model_of(arm)
    chosen = choose_filter(log, base.robot, stretch.cutoff)
    lent = chosen.first_kernels.shape[1] // 2 + chosen.first_step * (chosen.second_kernel.shape[1] // 2)
    part = slice(max(0, stretch.start - lent), min(len(log), stretch.end + lent))
    extra = {**log.extra}
    extra.pop("q_ref", None)
    piece = replace(
        log, t=log.t[part], q=log.q[part], tau=log.tau[part], qd=None if log.qd is None else log.qd[part], extra=extra
    )
    try:
        return condition_log(
            piece,
            base.model,
            cutoff=stretch.cutoff,
            delay=arm.options.delay or 0.0,
            measured_velocity=arm.options.velocity == "measured",
        )
    except LogTooShort as error:
        error.fix = "a longer split_s"
        raise


#: The log that this process has read last: its next task is often about another stretch of it.
_LAST: dict[tuple[object, ...], Log] = {}


def checked(arm: Arm, path: Path, alone: bool) -> Log:
    """Return a log in quantities of the arm, checked; read again only when it is another than the last one."""
    state = path.stat() if path.exists() else None
    key = (arm.robot, repr(arm.options), str(path), state and (state.st_mtime_ns, state.st_size))
    if key not in _LAST:
        _LAST.clear()
        with limits.raised(dict(arm.limits)):
            robot = model_of(arm).robot
            _LAST[key] = checked_log(read_log(path, robot, arm.options), robot, arm.options, alone=alone)
    return _LAST[key]


def options_in_pieces(texts: Mapping[str, str]) -> tuple[LogOptions, dict[str, Any]]:
    """Return how logs are read, and the options of the estimate, from those of a job.

    Raises:
        WrongUsage: one of them needs all rows in one process.
    """
    values = {key.replace("-", "_"): value for key, value in texts.items()}
    if "no_feasible" in values:
        values["feasible"] = "false" if values.pop("no_feasible") == "true" else "true"
    for key in values:
        if key not in OPTIONS:
            what = f"{key} needs all rows in one process, and split_s spreads them over several"
            raise WrongUsage(what, fix=f"leave out one of both; with split_s there are {', '.join(OPTIONS)}")
    flags = ("sort_time", "anyway", "drop_weak", "feasible")
    truths = {key: value == "true" for key, value in values.items() if key in flags}
    delay = delay_or_auto(values.get("delay", "off"), "delay")
    if delay is None:
        raise WrongUsage("delay: auto needs all rows in one process", fix="delay: off, or a number of seconds")
    reading = LogOptions(
        cutoff=frequency_or_auto(values.get("cutoff"), "cutoff"),
        delay=delay,
        velocity=values.get("velocity"),
        topic=values.get("topic"),
        rate=float(values["rate"]) if "rate" in values else None,
        sort_time=truths.pop("sort_time", False),
        anyway=truths.pop("anyway", False),
    )
    return reading, truths
