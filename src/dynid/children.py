"""Processes of Python that dynid starts: none of them imports from the working folder.

Python puts that folder first on its path for ``-m`` and ``-c``; a ``numpy.py`` that lies there would run.
"""

from __future__ import annotations

import os
import pickle
import queue
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any


def python(code: str, *words: str) -> list[str]:
    """Return the command line of a process that runs code, which imports this dynid and installed packages."""
    root = str(Path(__file__).parents[1])
    path = f"import sys; sys.path[:] = [{root!r}, *filter(None, sys.path)]; "
    return [sys.executable, "-c", path + code, *words]


class Worker:
    """A process that runs a function of dynid and sends objects, and ends when this process does.

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
        # Why a session of its own: Ctrl-C reaches every process of the terminal.
        self._process = subprocess.Popen(
            python("from dynid.children import serve; serve()"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=os.environ | modest,
            start_new_session=True,
        )
        task = pickle.dumps((function, arguments))
        # Why a thread: the process reads its task only when it has imported what it needs.
        self._thread = threading.Thread(target=self._exchange, args=(task, arrived), daemon=True)
        self._thread.start()

    def _exchange(self, task: bytes, arrived: queue.SimpleQueue[Any]) -> None:
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        # Why: a process that is ended in between leaves half an object, or a pipe that nobody reads.
        with suppress(OSError, EOFError, pickle.UnpicklingError):
            self._process.stdin.write(task)
            self._process.stdin.flush()
            while True:
                arrived.put(pickle.load(self._process.stdout))  # noqa: S301 - from a process of our own

    def running(self) -> bool:
        """Return whether anything can still arrive."""
        return self._thread.is_alive()

    def end(self) -> None:
        """End the process, whatever it does."""
        self._process.kill()
        self._thread.join()
        with suppress(OSError), self._process:
            pass


def serve() -> None:
    """Do the task of a ``Worker``: read it from standard input, send objects to standard output."""
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    # Why: a word that a library prints would be taken for an object.
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())
    function, arguments = pickle.load(sys.stdin.buffer)  # noqa: S301 - from the process that started this one
    threading.Thread(target=_end_with_parent, daemon=True).start()

    def send(answer: Any) -> None:  # noqa: ANN401
        pickle.dump(answer, answers)
        answers.flush()

    try:
        function(*arguments, send)
    except Exception:  # noqa: BLE001 - Why all: work that nobody hears of would look like work that found nothing.
        send(RuntimeError(traceback.format_exc()))


def _end_with_parent() -> None:
    """End this process when the other end of its standard input is closed."""
    sys.stdin.buffer.read()
    os._exit(1)
