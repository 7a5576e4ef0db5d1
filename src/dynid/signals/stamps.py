"""Time stamps and samples: order, duplicates, gaps and rate; samples that were not measured again.

Samples that the driver held, stored twice, or that another recording has too look like independent measurements: they
make every interval too narrow, and a held position is a velocity of zero followed by a jump. They are left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from dynid.arrays import Floats, Mask
from dynid.errors import Finding, LogTooShort, NotFinite, TimeNotIncreasing, TooManyLost
from dynid.log import Log
from dynid.robot import Robot
from dynid.signals import tuning
from dynid.signals.columns import take_samples
from dynid.signals.motion import moving


def with_rising_time(log: Log, *, sort_time: bool) -> Log:
    """Return the log with increasing time: sorted if asked for, samples with a repeated stamp dropped (W311).

    Raises:
        NotFinite: a stamp is not a number.
        TimeNotIncreasing: time goes back, or stands still in many samples.
        LogTooShort: hardly any samples.
    """
    bad = np.flatnonzero(~(np.abs(log.t) < tuning.LATEST_S))
    if len(bad):
        raise NotFinite(
            f"the time is not a valid number in {len(bad)} samples, first in row {bad[0] + 1}",
            fix="remove these rows, or record again",
        )
    _check_length(log)
    if sort_time:
        log = take_samples(log, np.argsort(log.t, kind="stable"))
    _check_order(log)
    step = np.diff(log.t)
    usual = np.median(step[step > 0]) if step.any() else np.inf
    if usual < 1.0 / tuning.FASTEST_HZ:
        raise TimeNotIncreasing(
            f"the samples are {usual:.1e} s apart: is its time in seconds?",
            fix="write the time in seconds",
        )
    again = np.append(False, step == 0)
    repeated = int(again.sum())
    if not repeated:
        return log
    # Why: a sample that is stored twice leaves nothing open; two samples with one stamp do.
    differ = again[1:] & ~(same_rows(log.q) & same_rows(log.tau))
    if differ.sum() > tuning.DUPLICATE_SHARE * len(log):
        raise TimeNotIncreasing(
            f"time stands still in {repeated} of {len(log)} samples: the stamps are too coarse",
            fix="write the time with more digits, or give --rate without it",
        )
    first = log.t[np.argmax(again)]
    text = f"{repeated} samples repeat the time stamp of their predecessor, first at {first:.3f} s: dropped"
    found = Finding("W311", "warning", text, {"samples": repeated})
    return _left(log, ~again, found)


def _check_length(log: Log) -> None:
    if len(log) < tuning.LEAST_SAMPLES:
        raise LogTooShort(
            f"{len(log)} samples are too few: at least {tuning.LEAST_SAMPLES} are needed"
        )


def _left(log: Log, keep: Mask, why: Finding) -> Log:
    """Return the samples that are kept, (N,), with the finding of the others."""
    kept = take_samples(log, np.flatnonzero(keep))
    _check_length(kept)
    return with_findings(kept, why)


def same_rows(x: Floats) -> Mask:
    """Return which samples of x, (N, n), equal the one before them, (N - 1,)."""
    return np.all(x[1:] == x[:-1], axis=1)


def _check_order(log: Log) -> None:
    back = np.flatnonzero(np.diff(log.t) < 0)
    if not len(back):
        return
    row, before = back[0], log.t[back[0]]
    overlap = " ".join(
        f"--exclude {np.floor(1000 * log.t[i + 1]) / 1000:.3f}-{np.ceil(1000 * log.t[i]) / 1000:.3f}"
        for i in back[:3]
    )
    more = f" and {len(back) - 1} times more" * (len(back) > 1)
    raise TimeNotIncreasing(
        f"time goes back {before - log.t[row + 1]:.3g} s at row {row + 2} (t = {before:.2f} s){more}: "
        "two recordings joined? stamps shuffled?",
        fix=f"leave the overlap out with {overlap}, or use --sort-time if stamps are just shuffled",
    )


def with_even_clock(log: Log) -> Log:
    """Return the log on an even clock where its samples were taken evenly and only the stamps came late (W323).

    A recorder on a busy machine stamps what arrives. Whether stamps or samples are uneven is asked of the positions: a
    sample lies on the line between its neighbours but for the curvature, if its time is right.
    """
    step = np.diff(log.t)
    usual = np.mean(step[step < 1.5 * np.median(step)])
    # Either no sample is lost, however late single stamps are, or each step says how many are.
    for count in (np.ones(len(step)), np.maximum(1.0, np.round(step / usual))):
        number = np.append(0.0, np.cumsum(count))
        slope, start = np.polyfit(number, log.t, 1)
        t, close = start + slope * number, (count[:-1] == 1) & (count[1:] == 1)
        given, even = (_bend(clock, log.q, close) for clock in (log.t, t))
        straighter = np.mean(even[given > 0] / given[given > 0]) if given.any() else 1.0
        if (
            straighter <= tuning.STRAIGHTER
            and np.abs(t - log.t).max() <= tuning.GAP_SAMPLES * slope
        ):
            break
    else:
        return log
    late, rate = float(np.std(log.t - t)), float(1 / slope)
    log = replace(log, t=t)
    if late < tuning.STRAY_WORTH_SAYING * slope:
        return log
    text = f"stamps stray by {1e3 * late:.2g} ms, the samples are evenly spaced: a clock of {rate:.4g} Hz is used"
    return with_findings(log, Finding("W323", "info", text, {"stray_s": late, "rate_hz": rate}))


def _bend(t: Floats, q: Floats, close: Mask) -> Floats:
    """Return the mean square distance of samples from the line between their neighbours, (n,)."""
    share = (t[1:-1] - t[:-2]) / (t[2:] - t[:-2])
    away = (x[1:-1] - x[:-2] - share * (x[2:] - x[:-2]) for x in q.T)
    return np.array([np.sum(x**2, where=close) for x in away]) / max(1, close.sum())


def without_intervals(log: Log, exclude: Sequence[tuple[float, float]]) -> Log:
    """Return the log without the samples of some intervals: the one place where ``--exclude`` takes effect.

    Args:
        log: a raw or a checked log.
        exclude: first and last time of each interval, both included, in the log's own clock, which is that of messages
            and tables; not the time since the first sample [s].

    Raises:
        LogTooShort: nothing is left.
    """
    if not exclude:
        return log
    keep = ~np.any([(log.t >= start) & (log.t <= end) for start, end in exclude], axis=0)
    if not keep.any():
        raise LogTooShort("--exclude leaves no sample", fix="exclude less")
    return take_samples(log, np.flatnonzero(keep))


def check_gaps(log: Log, exclude: Sequence[tuple[float, float]]) -> Iterator[Finding]:
    """Yield finding W312 for gaps of a log with increasing time; excluded intervals are none.

    Raises:
        TooManyLost: more than one sample in twenty is missing.
    """
    step = np.diff(log.t)
    usual = float(np.median(step))
    for start, end in exclude:
        step[(log.t[:-1] <= end) & (log.t[1:] >= start)] = usual
    shortest = tuning.GAP_SAMPLES * usual
    gaps = log.t[:-1][step > shortest].tolist()
    # Why: a longer step is a pause of the recording, in which nothing was lost.
    kept = step[step <= max(tuning.PAUSE_S, shortest)]
    between = np.maximum(1.0, np.round(kept / usual)) - 1.0
    # Why: jitter lengthens some steps and shortens others; the mean step distinguishes lost samples from late ones.
    lost = max(0.0, min(between.sum(), kept.sum() / usual - len(kept)))
    share = lost / (lost + len(log))
    longest = int(np.argmax(step))
    where = f"longest {1000 * step[longest]:.0f} ms at {log.t[longest]:.2f} s"
    if share > tuning.LOST_SHARE:
        raise TooManyLost(
            f"{100 * share:.0f} % of the samples are missing ({len(gaps)} gaps, {where}); at most 5 % may be missing"
        )
    if gaps:
        evidence = {"gaps": len(gaps), "longest_s": float(step[longest]), "at_s": gaps}
        many = "gap" if len(gaps) == 1 else "gaps"
        text = f"{log.name}: {len(gaps)} {many}, {where}: cut there, not bridged"
        yield Finding("W312", "warning", text, evidence)


def with_findings(log: Log, *findings: Finding) -> Log:
    """Return the log with further findings."""
    return replace(log, findings=(*log.findings, *findings))


def without_stale(log: Log, robot: Robot) -> Log:
    """Return the log without samples that repeat the one before them while the arm moves (W325).

    Args:
        log: with increasing time and finite columns, in SI units.
        robot: its robot.
    """
    alive = moving(log, robot)[1:]
    busy, same_q = alive.any(axis=1), same_rows(log.q)

    def many(flags: Mask) -> bool:
        return bool(np.sum(flags[busy]) > tuning.STALE_SHARE * busy.sum())

    stale = same_q & same_rows(log.tau)
    if not many(stale) and many(same_q):
        # Held as a whole: where any joint changes, those that move change nearly all.
        several = (alive.sum(axis=1) >= 2) & ~same_q
        moved = (np.diff(log.q, axis=0) != 0.0)[alive & several[:, None]]
        if moved.sum() > tuning.CHANGE_TOGETHER * len(moved):
            stale = same_q
    if not many(stale):
        return log
    share = float(np.mean(stale[busy]))
    # Why also at rest between motions: the samples of a driver that holds them are as far apart there.
    first, last = np.flatnonzero(busy)[[0, -1]]
    stale[:first] = stale[last + 1 :] = False
    new = log.rate * (1 - share)
    text = (
        f"{100 * share:.0f} % of the samples in motion repeat the one before them: they are left out; "
        f"new ones come at {new:.0f} Hz"
    )
    found = Finding("W325", "warning", text, {"share": share, "rate_hz": new})
    return _left(log, np.append(True, ~stale), found)


def without_copies(logs: Sequence[Log]) -> tuple[list[Log], tuple[Finding, ...]]:
    """Return logs without those whose positions and torques are all those of an earlier one (W326)."""
    kept, findings = list[Log](), list[Finding]()
    for number, log in enumerate(logs, start=1):
        same = (x for x in kept if np.array_equal(x.q, log.q) and np.array_equal(x.tau, log.tau))
        if first := next(same, None):
            text = f"log {number}, {log.name}, holds the samples of {first.name}: it is left out"
            findings.append(Finding("W326", "warning", text, {"log": number}))
        else:
            kept.append(log)
    return kept, tuple(findings)
