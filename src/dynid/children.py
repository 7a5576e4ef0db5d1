"""Child processes: they end with their parent, also when it is killed by force, and import nothing from the folder.

Python puts the current folder first on its path for ``-m`` and ``-c``; a ``numpy.py`` that came with somebody's logs
would then run.
"""

from __future__ import annotations

import errno
import os
import pickle
import queue
import runpy
import signal
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

#: Variable in which a child finds the number of its parent.
PARENT = "_DYNID_PARENT"
#: Where the system cannot tell, the child looks this often whether its parent is still there [s].
PATIENCE = 0.5
#: Status of a child that the machine has stopped, such as a full disk or a folder that may only be read.
MACHINE = 6
_MACHINE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EIO}
_PR_SET_PDEATHSIG = 1
_START = "import sys; sys.path[:1] = [sys.argv.pop(1)]; from dynid.children import {0}; {0}()"


def command(module: str, *words: str) -> list[str]:
    """Return the command line of a child that runs a module of this dynid; it needs ``environment``."""
    return [
        sys.executable,
        "-c",
        _START.format("main"),
        str(Path(__file__).parents[1]),
        module,
        *words,
    ]


class Worker:
    """A process that runs a function of dynid and sends objects, without a word from the user's own script.

    Why not multiprocessing: it runs the script that called dynid once more in each process, so that every script would
    have to guard itself by ``if __name__ == "__main__"``.

    Args:
        function: a function of a module; its last argument is the function that sends an object.
        arguments: its other arguments.
        arrived: where objects arrive; a ``RuntimeError`` with the traceback where the function failed.
    """

    def __init__(
        self,
        function: Callable[..., None],
        arguments: tuple[Any, ...],
        arrived: queue.SimpleQueue[Any],
    ) -> None:
        # Why one thread of linear algebra: matrices are small, and threads would fight for the cores.
        modest = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        words = [sys.executable, "-c", _START.format("serve"), str(Path(__file__).parents[1])]
        with _deaf():
            self._process = subprocess.Popen(
                words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=environment() | modest
            )
        task = pickle.dumps((function, arguments))
        # Why a thread: the process reads its task only when it has imported what it needs.
        self._thread = threading.Thread(target=self._exchange, args=(task, arrived), daemon=True)
        self._thread.start()

    def _exchange(self, task: bytes, arrived: queue.SimpleQueue[Any]) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        # Why: a process that is ended in between leaves half an object, or a pipe that nobody reads.
        with suppress(OSError, EOFError, pickle.UnpicklingError), self._process.stdout as answers:
            with self._process.stdin as stdin:
                stdin.write(task)
            while True:
                arrived.put(pickle.load(answers))  # noqa: S301 - from a process of our own

    def running(self) -> bool:
        """Return whether anything can still arrive."""
        return self._thread.is_alive()

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._process.wait()
        self._thread.join()


@contextmanager
def _deaf() -> Iterator[None]:
    """Let a new process ignore Ctrl-C, which reaches every process of the terminal, from its first instant."""
    main = threading.current_thread() is threading.main_thread()
    handler = signal.signal(signal.SIGINT, signal.SIG_IGN) if main else None
    try:
        yield
    finally:
        if main:
            signal.signal(signal.SIGINT, handler)


def serve() -> None:
    """Do the task of a ``Worker``: read it from standard input, send objects to standard output."""
    end_with_parent(signal.SIGKILL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    # Why: a word that a library prints would be taken for an object.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def send(answer: Any) -> None:  # noqa: ANN401
        pickle.dump(answer, answers)
        answers.flush()

    try:
        function, arguments = pickle.load(sys.stdin.buffer)  # noqa: S301 - from the process that started this one
        function(*arguments, send)
    except Exception:  # noqa: BLE001 - Why all: work that nobody hears of would look like work that found nothing.
        send(RuntimeError(traceback.format_exc()))


def environment() -> dict[str, str]:
    """Return the environment of a child that ends with this process."""
    return {**os.environ, **variables()}


def variables() -> dict[str, str]:
    """Return the variables that such a child needs."""
    return {PARENT: str(os.getpid()), "PYTHONSAFEPATH": "1"}


def main() -> None:
    """Run the module that the command line names."""
    module = sys.argv[1]
    # Why: a command of dynid puts its temporary files away, the others have nothing to put away.
    end_with_parent(signal.SIGTERM if module == "dynid" else signal.SIGKILL)
    sys.argv = sys.argv[1:]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except OSError as error:
        if error.errno not in _MACHINE:
            raise
        sys.stderr.write(f"{error.strerror}\n")
        sys.exit(MACHINE)


def end_with_parent(number: int) -> None:
    """Let this process get a signal when the one that started it with ``environment`` ends; nothing without one."""
    parent = int(os.environ.pop(PARENT, "0") or "0")
    if not parent:
        return
    if sys.platform.startswith("linux"):
        import ctypes

        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, int(number), 0, 0, 0)
    else:
        threading.Thread(target=_watch, args=(parent, number), daemon=True).start()
    # Why: the parent may have ended before the system was asked to tell.
    if os.getppid() != parent:
        os._exit(130)


def _watch(parent: int, number: int) -> None:
    while os.getppid() == parent:
        time.sleep(PATIENCE)
    os.kill(os.getpid(), number)
