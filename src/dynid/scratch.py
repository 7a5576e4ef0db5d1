"""Arrays that are too long for memory.

A recording of hours has some hundred million numbers. They are decoded once, into a temporary file without a name that
is mapped; from then on they are worked on piece by piece. After each piece ``release`` gives the pages of all such
files back, so that a process is no larger than one piece whatever the length.
"""

from __future__ import annotations

import mmap
import os
import tempfile
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from typing import IO, Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from dynid.errors import CannotWrite

#: Arrays up to this size stay in memory [bytes].
IN_MEMORY = 12 << 20
#: Size of the files of a store [bytes].
STORE = 64 << 20
#: Numbers of which a median is taken; of more, those that are evenly spread.
USUAL = 1 << 18
#: Rows of a piece.
PIECE = 1 << 16
#: Rows that are taken together when columns are reduced.
WIDE = 64
#: Mapped pages that may stay in memory [bytes].
PAGES = 96 << 20
#: What was mapped from files after the last release: libraries, for the most part [bytes].
_after_release = [0]
_MAPPED: weakref.WeakSet[mmap.mmap] = weakref.WeakSet()


class Growing:
    """Rows that come block by block; in memory while they are few, in a file when they are many.

    Args:
        width: numbers in a row; 0 for single numbers.
        dtype: their type.
    """

    def __init__(self, width: int, dtype: DTypeLike = np.float64) -> None:
        self._shape, self._dtype = ((width,) if width else ()), np.dtype(dtype)
        self._blocks: list[NDArray[Any]] = []
        self._bytes = 0
        self._file: IO[bytes] | None = None
        self._count = 0

    def __len__(self) -> int:
        """Return the number of rows."""
        return self._count

    def append(self, rows: NDArray[Any]) -> None:
        """Add rows, (N, width) or (N,)."""
        rows = np.ascontiguousarray(rows, dtype=self._dtype)
        self._count += len(rows)
        if self._file is not None:
            self._write(rows)
            return
        self._blocks.append(rows)
        self._bytes += rows.nbytes
        if self._bytes > IN_MEMORY:
            self._file = _file()
            for block in self._blocks:
                self._write(block)
            self._blocks = []

    def _write(self, rows: NDArray[Any]) -> None:
        assert self._file is not None
        try:
            self._file.write(rows.data)
        except OSError as error:
            raise _no_room(error) from error

    def whole(self) -> NDArray[Any]:
        """Return all rows; of a file they cannot be changed."""
        if self._file is None:
            if not self._blocks:
                return np.zeros((0, *self._shape), self._dtype)
            return self._blocks[0] if len(self._blocks) == 1 else np.concatenate(self._blocks)
        try:
            self._file.flush()
        except OSError as error:
            raise _no_room(error) from error
        mapped = mmap.mmap(self._file.fileno(), 0, access=mmap.ACCESS_READ)
        _MAPPED.add(mapped)
        return np.frombuffer(mapped, self._dtype).reshape(self._count, *self._shape)


def empty(shape: tuple[int, ...], dtype: DTypeLike = np.float64) -> NDArray[Any]:
    """Return an array to be filled, in a file where it is long; a new file holds zeros."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    if size <= IN_MEMORY:
        return np.empty(shape, dtype)
    with _file() as file:
        try:
            # Why: a mapped file that meets a full disk ends the process; room is taken before.
            os.posix_fallocate(file.fileno(), 0, size) if hasattr(
                os, "posix_fallocate"
            ) else file.truncate(size)
        except OSError as error:
            raise _no_room(error) from error
        mapped = mmap.mmap(file.fileno(), size)
    _MAPPED.add(mapped)
    return np.frombuffer(mapped, dtype).reshape(shape)


def spread(count: int, most: int) -> list[slice]:
    """Return parts of so many samples, evenly spread, that together are at most so many; all of them if few enough."""
    if count <= most:
        return [slice(0, count)]
    length = most // 16
    return [
        slice(start, start + length)
        for start in np.linspace(0, count - length, 16).astype(int).tolist()
    ]


def median_step(t: NDArray[np.float64]) -> float:
    """Return the median difference of numbers that follow each other, (N,), in their unit."""
    return float(np.median(np.concatenate([np.diff(t[part]) for part in spread(len(t), USUAL)])))


def floats(array: NDArray[Any]) -> NDArray[np.float64]:
    """Return an array as float64, itself where it is; piece by piece where it is long."""
    if array.dtype == np.float64 or 8 * array.size <= IN_MEMORY:
        return np.asarray(array, dtype=np.float64)
    found = empty(array.shape)
    for start in range(0, len(array), PIECE):
        found[start : start + PIECE] = array[start : start + PIECE]
        release()
    return found


def taken(array: NDArray[Any], rows: NDArray[np.intp]) -> NDArray[Any]:
    """Return some rows of an array, in the given order; piece by piece where they are many."""
    if array.nbytes <= IN_MEMORY:
        return np.asarray(array[rows])
    found = empty((len(rows), *array.shape[1:]), array.dtype)
    for start in range(0, len(rows), PIECE):
        found[start : start + PIECE] = array[rows[start : start + PIECE]]
        release()
    return found


def spans(count: int) -> Iterator[slice]:
    """Yield the pieces of so many samples, and give back memory after each of several."""
    for start in range(0, count, PIECE):
        yield slice(start, min(start + PIECE, count))
        if count > PIECE:
            release()


def filled(count: int, compute: Callable[[slice], NDArray[Any]]) -> NDArray[Any]:
    """Return numbers or flags of each sample, (N, ...), computed piece by piece; in a file where they are many.

    Args:
        count: number of samples N.
        compute: returns those of a piece.
    """
    found: NDArray[Any] | None = None
    for part in spans(count):
        some = compute(part)
        found = empty((count, *some.shape[1:]), some.dtype) if found is None else found
        found[part] = some
    return np.zeros(0) if found is None else found


def samples_where(count: int, condition: Callable[[slice], NDArray[np.bool_]]) -> NDArray[np.intp]:
    """Return the samples, (k,), of which a condition holds; it is asked piece by piece."""
    found = [np.flatnonzero(condition(part)) + part.start for part in spans(count)]
    return np.concatenate(found) if found else np.zeros(0, dtype=np.intp)


def extremes(x: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the smallest and the largest value of each column of samples, (n,) each."""
    low, high = zip(
        *((by_column(np.min, x[part]), by_column(np.max, x[part])) for part in spans(len(x))),
        strict=True,
    )
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


def joined(parts: Iterable[NDArray[Any]]) -> NDArray[Any]:
    """Return arrays of rows one after the other, in a file where they are many; a single one as it is."""
    first, *rest = parts
    if not rest:
        return first
    growing = Growing(first.shape[1] if first.ndim > 1 else 0, first.dtype)
    for part in (first, *rest):
        for start in range(0, len(part), PIECE):
            growing.append(part[start : start + PIECE])
            release()
    return growing.whole()


class Store:
    """Arrays that are kept together in files, for many of a middling size."""

    def __init__(self) -> None:
        self._file = np.zeros(0, np.uint8)
        self._used = 0

    def put(self, array: NDArray[Any]) -> NDArray[Any]:
        """Return an array as it is kept."""
        if self._used + array.nbytes > len(self._file):
            self._file, self._used = empty((max(STORE, array.nbytes),), np.uint8), 0
        kept = (
            self._file[self._used : self._used + array.nbytes]
            .view(array.dtype)
            .reshape(array.shape)
        )
        kept[...] = array
        # Unit: bytes; every array begins at a multiple of what a processor reads at once.
        self._used += -(-array.nbytes // 64) * 64
        return kept


def release() -> None:
    """Give back the memory of all mapped pages where they are many; what was written stays in the files.

    Why not always: pages that are used again have to be mapped again.
    """
    if (
        not _MAPPED
        or not hasattr(mmap, "MADV_DONTNEED")
        or _file_pages() - _after_release[0] < PAGES
    ):
        return
    for mapped in list(_MAPPED):
        with suppress(ValueError, OSError):
            mapped.madvise(mmap.MADV_DONTNEED)
    _after_release[0] = _file_pages()


def _file_pages() -> int:
    """Return how much memory this process has mapped from files [bytes]; a large number where nobody says."""
    try:
        with open("/proc/self/statm", "rb", buffering=0) as stream:  # noqa: PTH123
            return int(stream.read().split()[2]) * mmap.PAGESIZE
    except (OSError, ValueError, IndexError):
        return 1 << 62


def _file() -> IO[bytes]:
    try:
        return tempfile.TemporaryFile()
    except OSError as error:
        raise _no_room(error) from error


def _no_room(error: OSError) -> CannotWrite:
    return CannotWrite(
        f"no room for the columns of a long log in {tempfile.gettempdir()}: {error.strerror}",
        fix="free some space there, or set TMPDIR to another folder",
    )
