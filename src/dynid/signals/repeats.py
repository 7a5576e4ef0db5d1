"""Samples that were not measured again: held by the driver, stored twice, or recorded in another log already.

They look like independent measurements and make every interval too narrow, and a held position is a velocity of zero
followed by a jump. They are left out. Sensors do not read all joints twice exactly alike while the arm moves, so equal
rows tell; where only the positions are equal, coarse encoders are told from held samples by whether all moving joints
change together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, LogTooShort
from dynid.log import Log
from dynid.longarrays import empty, spans
from dynid.robot import Robot
from dynid.signals.motion import any_moves, moving, runs
from dynid.signals.pieces import take_samples
from dynid.signals.stamps import LEAST_SAMPLES, same_rows, with_findings

Flags = NDArray[np.bool_]

#: Share of the samples in motion that must be repeats: one in twenty narrows intervals by 3 %.
STALE_SHARE = 0.05
#: Of the joints that move, this share changes at nearly every fresh sample where samples are held as a whole.
TOGETHER = 0.8
#: So many rows in a row that an earlier log, or an earlier part of this one, has too are a copy of it.
LEAST_COPY = 50
#: Rows whose numbers are few, as those of an arm at rest, are equal by chance: a copy has this share of distinct ones.
DISTINCT = 0.5


def without_stale(log: Log, robot: Robot) -> Log:
    """Return the log without samples that repeat the one before them while the arm moves (W325).

    Args:
        log: with increasing time and finite columns, in SI units.
        robot: its robot.
    """
    busy = any_moves(log, robot)[1:]
    same_q = same_rows(log.q)
    stale = same_q & same_rows(log.tau)
    if not _counts(stale & busy, busy) and _held(log, robot, busy, same_q):
        stale = same_q
    share = float(np.sum(stale & busy) / max(1, busy.sum()))
    if not _counts(stale & busy, busy):
        return log
    # Why also at rest: the samples of a driver that holds them are as far apart there.
    kept = take_samples(log, np.flatnonzero(np.concatenate([[True], ~stale | ~_near_motion(busy)])))
    if len(kept) < LEAST_SAMPLES:
        raise LogTooShort(f"only {len(kept)} of {len(log)} samples are not repeats of the one before", where=log.topic)
    fresh = log.rate * (1 - share)
    text = (
        f"{100 * share:.0f} % of the samples in motion repeat the one before them: they are left out; "
        f"new ones come at {fresh:.0f} Hz"
    )
    return with_findings(kept, Finding("W325", "warning", text, {"share": share, "rate_hz": fresh}))


def _counts(stale: Flags, busy: Flags) -> bool:
    return bool(busy.any()) and float(stale.sum()) > STALE_SHARE * float(busy.sum())


def _near_motion(busy: Flags) -> Flags:
    """Return the steps between the first and the last one in motion."""
    where = np.flatnonzero(busy)
    near = np.zeros(len(busy), dtype=bool)
    near[where[0] : where[-1] + 1] = True
    return near


def _held(log: Log, robot: Robot, busy: Flags, same_q: Flags) -> bool:
    """Return whether positions are held as a whole: where any joint changes, those that move change nearly all."""
    if not _counts(same_q & busy, busy):
        return False
    alive, changes, count = moving(log, robot), 0, 0
    for part in spans(len(busy)):
        after = slice(part.start + 1, part.stop + 1)
        several = (alive[after].sum(axis=1) >= 2) & ~same_q[part]
        moved = (log.q[after] != log.q[part])[several][alive[after][several]]
        changes, count = changes + int(moved.sum()), count + len(moved)
    return changes > TOGETHER * count


def without_copies(logs: Sequence[Log]) -> tuple[list[Log], tuple[Finding, ...]]:
    """Return logs without the samples that an earlier one, or an earlier part of the same one, has too (W326).

    Args:
        logs: checked logs of one arm; those of which nothing is left are dropped.
    """
    kept: list[Log] = []
    findings: list[Finding] = []
    seen = _Seen()
    for number, log in enumerate(logs, start=1):
        keys = _keys(log)
        copied = _copied(keys, seen)
        if number < len(logs):
            seen.add(keys[~copied])
        if not copied.any():
            kept.append(log)
            continue
        share = float(np.mean(copied))
        text = (
            f"{100 * share:.0f} % of the samples of {log.name} (log {number}) are in an earlier recording too: "
            "a copy tells nothing new, they are left out"
        )
        findings.append(Finding("W326", "warning", text, {"log": number, "share": share}))
        rest = np.flatnonzero(~copied)
        if len(rest) >= LEAST_COPY:
            kept.append(replace(take_samples(log, rest), findings=log.findings))
    return kept, tuple(findings)


class _Seen:
    """Keys of samples in rising arrays, each twice as long as the next at least: none is sorted often, however many."""

    def __init__(self) -> None:
        self._arrays: list[NDArray[np.uint64]] = []

    def add(self, keys: NDArray[np.uint64]) -> None:
        """Add keys, (N,)."""
        if not len(keys):
            return
        latest = np.sort(keys)
        while self._arrays and len(self._arrays[-1]) < 2 * len(latest):
            latest = np.concatenate([self._arrays.pop(), latest])
            latest.sort(kind="stable")  # which merges what rises already
        self._arrays.append(latest)

    def has(self, keys: NDArray[np.uint64]) -> Flags:
        """Return which of some keys were added, (N,)."""
        found = np.zeros(len(keys), dtype=bool)
        for array in self._arrays:
            place = np.minimum(np.searchsorted(array, keys), len(array) - 1)
            found |= array[place] == keys
        return found


def _copied(keys: NDArray[np.uint64], seen: _Seen) -> Flags:
    """Return which samples with such keys, (N,), are copies of samples with keys that were seen before, or before."""
    copied = np.zeros(len(keys), dtype=bool)
    rising = np.sort(keys)
    repeats = any(np.any(rising[part.start + 1 : part.stop + 1] == rising[part]) for part in spans(len(keys) - 1))
    del rising
    again = seen.has(keys)
    if not repeats and not again.any():
        return copied
    inside = np.ones(len(keys), dtype=bool)
    inside[np.unique(keys, return_index=True)[1]] = False
    for run in runs(again | inside, LEAST_COPY):
        copied[run] = len(np.unique(keys[run])) >= DISTINCT * (run.stop - run.start)
    return copied


def _keys(log: Log) -> NDArray[np.uint64]:
    """Return a hash of the positions and torques of each sample, (N,)."""
    # Why: odd factors keep every bit; a sum of products over a row is a hash as good as these logs need.
    factors = np.random.default_rng(0).integers(1, 2**63, 2 * log.n, dtype=np.uint64) * np.uint64(2) + np.uint64(1)
    found = empty((len(log),), np.uint64)
    for part in spans(len(log)):
        rows = np.ascontiguousarray(np.hstack([log.q[part], log.tau[part]]) + 0.0).view(np.uint64)
        mixed = rows ^ (rows >> np.uint64(29))
        found[part] = np.sum(mixed * factors, axis=1, dtype=np.uint64)
    return found
