"""The interpreter of straight-line programs in C: compiled once on a machine that has a compiler, for long logs.

It runs any program on blocks of samples that stay in the processor's cache, where NumPy starts an array operation for
each of a thousand additions and products. It computes the same bits: the same operations in the same order, without
contracted ones. The source below is all that is ever compiled; programs reach it as numbers. Without a compiler, with a
cache that cannot be written or belongs to somebody else, NumPy goes on.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shutil
import stat
import subprocess
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.scratch import scratch_folder
from dynid.xdg import cache_folder

#: Samples that are evaluated together.
TOGETHER = 64
#: Samples of a process from which on a compilation pays: it takes as long as so many of them with NumPy.
WORTH = 500_000
#: A compiler that takes longer than this hangs [s].
PATIENCE = 60.0
_SOURCE = r"""
#include <string.h>
#define N 64
#if defined(__GNUC__) && !defined(__clang__)
#define EACH _Pragma("GCC ivdep") for (int i = 0; i < N; i++)
#else
#define EACH for (int i = 0; i < N; i++)
#endif
#if defined(__x86_64__) && defined(__gnu_linux__) && defined(__GNUC__) && !defined(__clang__)
__attribute__((target_clones("avx512f", "avx2", "default")))
#endif
void dynid_run(const int *calls, long many, double *pool, const double *inputs, long loads, long stride,
               const int *outputs, long entries, double *out, long count)
{
    for (long start = 0; start < count; start += N) {
        const long size = (count - start < N ? count - start : N) * (long)sizeof(double);
        for (long k = 0; k < loads; k++) memcpy(pool + k * N, inputs + k * stride + start, size);
        for (long k = 0; k < many; k++) {
            const int *call = calls + 4 * k;
            const double *a = pool + (long)call[1] * N, *b = pool + (long)call[2] * N;
            /* Rows are the same or apart: nothing depends on another place of a row. */
            double *x = pool + (long)call[3] * N;
            switch (call[0]) {
            case 0: EACH x[i] = a[i] + b[i]; break;
            case 1: EACH x[i] = a[i] - b[i]; break;
            case 2: EACH x[i] = a[i] * b[i]; break;
            default: EACH x[i] = a[i] * -1.0;
            }
        }
        for (long k = 0; k < entries; k++) memcpy(out + k * stride + start, pool + (long)outputs[k] * N, size);
    }
}
"""
#: Optimised for the machine only where the processor is asked at run time; no operation is contracted.
_FLAGS = ("-O3", "-ffp-contract=off", "-fPIC", "-shared")
Ints = NDArray[np.int32]
Floats = NDArray[np.float64]


@dataclass
class _State:
    """What this process knows about the compiled interpreter.

    Attributes:
        evaluated: samples that NumPy has evaluated.
        looked: whether a compiled interpreter was looked for.
        tried: whether one was compiled, or cannot be.
        library: the interpreter.
    """

    evaluated: int = 0
    looked: bool = False
    tried: bool = False
    library: ctypes.CDLL | None = None


_state = _State()


class CompiledProgram:
    """A program as numbers for the compiled interpreter.

    Args:
        calls: operation, first and second operand and result of each step, as rows of the pool, (K, 4).
        pool: rows that operations read and write, (rows, TOGETHER); constants stand in it.
        loads: inputs, which are its first rows.
        outputs: row of each entry, (E,).
    """

    def __init__(self, calls: Ints, pool: Floats, loads: int, outputs: Ints) -> None:
        if not (np.all((calls[:, 1:] >= 0) & (calls[:, 1:] < len(pool))) and np.all(outputs < len(pool))):
            raise ValueError("a program reads or writes beyond its rows")
        self._calls, self._pool, self._loads, self._outputs = calls, pool, loads, outputs

    def run(self, library: ctypes.CDLL, inputs: Floats, entries: Floats, count: int) -> None:
        """Evaluate the first samples of inputs, (>= loads, B), into entries, (E, B)."""
        stride = inputs.shape[1]
        places = [array.ctypes.data for array in (self._calls, self._pool, inputs, self._outputs, entries)]
        library.dynid_run(
            places[0], len(self._calls), places[1], places[2], self._loads, stride, places[3], len(self._outputs),
            places[4], count,
        )  # fmt: skip


def interpreter(samples: int) -> ctypes.CDLL | None:
    """Return the compiled interpreter where there is one, and compile it when so many samples make it worth while.

    Args:
        samples: that are evaluated next.
    """
    if _state.library is None and not _state.tried:
        _state.evaluated += samples
        if not _state.looked:
            _state.looked, _state.library = True, kept()
        elif _state.evaluated > WORTH:
            _state.tried, _state.library = True, _compiled()
    return _state.library


def place() -> Path:
    """Return where the compiled interpreter of this machine is kept."""
    facts = "\n".join((_SOURCE, *_FLAGS, platform.machine(), platform.system(), platform.libc_ver()[0]))
    return cache_folder() / "kernels" / f"{hashlib.sha256(facts.encode()).hexdigest()[:16]}.so"


def compiler() -> str | None:
    """Return the C compiler of this machine, None where there is none."""
    found = shutil.which("cc") if os.name == "posix" else None
    # Why: where the path of programs names the current folder, a cc that came with somebody's logs would run.
    return found if found is not None and Path(found).is_absolute() else None


def kept() -> ctypes.CDLL | None:
    """Return the compiled interpreter of this machine, None where none is kept."""
    return _loaded(place())


def _loaded(path: Path) -> ctypes.CDLL | None:
    """Return a compiled interpreter that this user has made, and nobody else can change."""
    try:
        for each in (path.parent, path):
            info = each.lstat()
            if info.st_uid != os.getuid() or info.st_mode & (stat.S_IWGRP | stat.S_IWOTH) or each.is_symlink():
                return None
        library = ctypes.CDLL(str(path))
        pointer, whole = ctypes.c_void_p, ctypes.c_long
        library.dynid_run.argtypes = [
            pointer, whole, pointer, pointer, whole, whole, pointer, whole, pointer, whole,
        ]  # fmt: skip
        library.dynid_run.restype = None
    except (OSError, AttributeError):
        return None
    return library


def _compiled() -> ctypes.CDLL | None:
    """Compile the interpreter into the cache, whole or not at all."""
    path, program = place(), compiler()
    if program is None:
        return None
    with suppress(OSError, subprocess.SubprocessError):
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        with scratch_folder(path.parent) as folder:
            made = folder / path.name
            words = [program, *_FLAGS, "-o", str(made), "-x", "c", "-"]
            # Why: a compiler that is stopped leaves its temporary files behind.
            given = {**os.environ, "TMPDIR": str(folder)}
            subprocess.run(words, input=_SOURCE.encode(), capture_output=True, check=True, timeout=PATIENCE, env=given)
            made.chmod(0o700)
            made.replace(path)
        return _loaded(path)
    return None
