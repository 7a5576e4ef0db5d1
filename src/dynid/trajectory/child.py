"""Work in a process of its own, which gets a pickled job and sends pickled answers.

Not by multiprocessing: it runs the script that called dynid once more in each process, so that every script would
have to guard itself by ``if __name__ == "__main__"``.
"""

from __future__ import annotations

import os
import pickle
import subprocess
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from tempfile import TemporaryFile
from typing import IO, Any

from dynid import children
from dynid.errors import DynidError

#: Work of a process: it gets a job and what sends an answer.
Work = Callable[[Any, Callable[[object], None]], None]

#: Matrices are small: threads of linear algebra would fight for the cores.
_MODEST = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")


@contextmanager
def working(
    work: Work, job: object, log: IO[bytes] | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """Run work, a function at the top of a module, on a job in a process that ends with the block.

    Args:
        work: what is done.
        job: its argument.
        log: file for what the process prints; stderr when None.
    """
    code = f"from {work.__module__} import {work.__name__}"
    with TemporaryFile() as task:
        pickle.dump(job, task)
        task.seek(0)
        # A session of its own: Ctrl-C reaches every process of the terminal.
        process = subprocess.Popen(
            children.python(f"{code}; from {__name__} import serve; serve({work.__name__})"),
            stdin=task,
            stdout=subprocess.PIPE,
            stderr=log,
            env=os.environ | _MODEST,
            start_new_session=True,
        )
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def answers(process: subprocess.Popen[bytes]) -> Iterator[Any]:
    """Yield what a process sends until it ends; work that failed sends its error as the last answer."""
    assert process.stdout is not None
    # A process that is killed leaves half an object.
    with process.stdout as stream, suppress(EOFError, pickle.UnpicklingError):
        while True:
            yield pickle.load(stream)  # noqa: S301 - from a process of our own


def serve(work: Work) -> None:
    """Do work on the job on stdin, and answer on what was stdout: a word that a library prints would be an answer."""
    stream = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())

    def send(answer: object) -> None:
        pickle.dump(answer, stream)
        stream.flush()

    try:
        work(pickle.load(sys.stdin.buffer), send)  # noqa: S301 - from our own process
    except BrokenPipeError:  # nobody reads answers any more
        os._exit(1)
    except DynidError as error:
        send(error)
    except Exception:  # noqa: BLE001 - work that failed would look like work that found nothing
        send(RuntimeError(traceback.format_exc()))
