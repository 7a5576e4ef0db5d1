"""Child processes: they end with their parent, also when it is killed by force, and import nothing from the folder.

Python puts the current folder first on its path for ``-m`` and ``-c``; a ``numpy.py`` that came with somebody's logs
would then run.
"""

from __future__ import annotations

import errno
import os
import runpy
import signal
import sys
import threading
import time
from pathlib import Path

#: Variable in which a child finds the number of its parent.
PARENT = "_DYNID_PARENT"
#: Where the system cannot tell, the child looks this often whether its parent is still there [s].
PATIENCE = 0.5
#: Status of a child that the machine has stopped, such as a full disk or a folder that may only be read.
MACHINE = 6
_MACHINE = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EACCES, errno.EIO}
_PR_SET_PDEATHSIG = 1
_START = "import sys; sys.path[:1] = [sys.argv.pop(1)]; from dynid.children import main; main()"


def command(module: str, *words: str) -> list[str]:
    """Return the command line of a child that runs a module of this dynid; it needs ``environment``."""
    return [sys.executable, "-c", _START, str(Path(__file__).parents[1]), module, *words]


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
