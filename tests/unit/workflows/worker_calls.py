"""What the tests of the workers let them do."""

import os
import signal
import time
from pathlib import Path


def half(k):
    if k == 3:
        raise ValueError("broken")
    return k / 2


def nap(k):
    time.sleep(0.1)
    return k


def die_once(folder, k):
    """Kill the worker that does this for the first time."""
    mark = Path(folder) / f"done{k}"
    if not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return k


def die(folder, k):
    os.kill(os.getpid(), signal.SIGKILL)


def call(function, folder, k):
    return function(folder, k)
