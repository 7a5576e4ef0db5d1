"""Long logs piece by piece: what is summed over all samples, and what changes each for itself, in the memory of one.

A short log is one piece, so everything has one way to be computed. After each piece of a long one the memory of its
columns is given back (``dynid.longarrays``).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.log import Log
from dynid.longarrays import PIECE, empty, spans, taken

Floats = NDArray[np.float64]

#: Samples that are taken together when columns are reduced.
WIDE = 64


@dataclass(frozen=True)
class Piece:
    """Some samples of a log, with those around them that they depend on.

    Attributes:
        log: the samples and those around them.
        own: which of these samples are the piece's own.
        where: where those are in the whole log.
    """

    log: Log
    own: slice
    where: slice


def pieces(log: Log, reach: int = 0) -> Iterator[Piece]:
    """Yield a log piece by piece.

    Args:
        log: the log.
        reach: samples on either side that a sample depends on.
    """
    if len(log) <= PIECE:
        yield Piece(log, slice(0, len(log)), slice(0, len(log)))
        return
    for where in spans(len(log)):
        first, last = max(0, where.start - reach), min(len(log), where.stop + reach)
        yield Piece(part_of(log, slice(first, last)), slice(where.start - first, where.stop - first), where)


def part_of(log: Log, part: slice) -> Log:
    """Return some samples of a log that follow each other, without a copy."""
    extra = {key: value[part] if has_rows(value, log) else value for key, value in log.extra.items()}
    qd = log.qd[part] if log.qd is not None else None
    return replace(log, t=log.t[part], q=log.q[part], tau=log.tau[part], qd=qd, extra=extra)


def take_samples(log: Log, keep: NDArray[np.intp]) -> Log:
    """Return the log with some of its rows, in the given order."""
    extra = {key: taken(value, keep) if has_rows(value, log) else value for key, value in log.extra.items()}
    qd = taken(log.qd, keep) if log.qd is not None else None
    return replace(log, t=taken(log.t, keep), q=taken(log.q, keep), tau=taken(log.tau, keep), qd=qd, extra=extra)


def changed(log: Log, change: Callable[[Log], Log]) -> Log:
    """Return a log after a change that treats each sample for itself.

    Args:
        log: the log.
        change: makes of any part of it the same part of the result; arrays that it hands on as they are stay as they
            are.
    """
    if len(log) <= PIECE:
        return change(log)
    found: Log | None = None
    for piece in pieces(log):
        part = change(piece.log)
        if found is None:
            found = _like(log, piece.log, part)
        for key, array in _arrays(part).items():
            whole = _arrays(found)[key]
            if not np.may_share_memory(whole, _arrays(log).get(key, empty((0,)))):
                whole[piece.where] = array
    assert found is not None
    return found


def _like(log: Log, before: Log, after: Log) -> Log:
    """Return a changed log as long as the whole one, with room for what has changed."""
    old, new = _arrays(before), _arrays(after)
    room = {
        key: _arrays(log)[key] if np.may_share_memory(array, old.get(key, empty((0,)))) else _room(len(log), array)
        for key, array in new.items()
    }
    extra = {key: room.get(f"extra {key}", value) for key, value in after.extra.items()}
    return replace(after, t=room["t"], q=room["q"], tau=room["tau"], qd=room.get("qd"), extra=extra)


def _room(count: int, array: NDArray[Any]) -> NDArray[Any]:
    return empty((count, *array.shape[1:]), array.dtype)


def _arrays(log: Log) -> dict[str, NDArray[Any]]:
    found = {"t": log.t, "q": log.q, "tau": log.tau} | ({} if log.qd is None else {"qd": log.qd})
    return found | {f"extra {key}": value for key, value in log.extra.items() if has_rows(value, log)}


def has_rows(value: object, log: Log) -> bool:
    """Return whether a value of ``extra`` has one row per sample."""
    return isinstance(value, np.ndarray) and value.ndim > 0 and len(value) == len(log)


def samples_where(count: int, condition: Callable[[slice], NDArray[np.bool_]]) -> NDArray[np.intp]:
    """Return the samples, (k,), of which a condition holds; it is asked piece by piece."""
    found = [np.flatnonzero(condition(part)) + part.start for part in spans(count)]
    return np.concatenate(found) if found else np.zeros(0, dtype=np.intp)


def extremes(x: NDArray[Any]) -> tuple[Floats, Floats]:
    """Return the smallest and the largest value of each column of samples, (n,) each."""
    low, high = zip(*((by_column(np.min, x[part]), by_column(np.max, x[part])) for part in spans(len(x))), strict=True)
    return np.min(low, axis=0), np.max(high, axis=0)


def by_column(reduce: Callable[..., NDArray[Any]], x: NDArray[Any]) -> NDArray[Any]:
    """Return the minimum, maximum or sum of each column of samples, (N, n) -> (n,).

    Why not at once: NumPy works along rows, and a row of seven joints is too short for what it costs to begin one.
    """
    whole = len(x) // WIDE * WIDE
    if x.ndim == 1 or not whole:
        return np.asarray(reduce(x, axis=0))
    wide = reduce(x[:whole].reshape(-1, WIDE * x.shape[1]), axis=0).reshape(WIDE, -1)
    return np.asarray(reduce(np.concatenate([wide, x[whole:]]), axis=0))
