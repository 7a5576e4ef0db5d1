"""Programs that dynid starts, a compiler or Octave: only installed ones, never one of the current folder.

Where the path of programs names the current folder, a ``cc`` that came with somebody's logs would run, and so would an
``as`` that the compiler looks for.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path

#: A program that dynid starts to make or to try something has this long [s]. evidence: cc takes 0.8 s for the LWR4+
#: with residual model and observer on a busy machine.
PATIENCE_S = 60.0


def search_path() -> str:
    """Return the path of programs without what depends on the current folder, or is it."""
    try:
        here = Path.cwd()
    except OSError:  # the folder is gone
        here = Path(os.devnull)
    words = os.environ.get("PATH", os.defpath).split(os.pathsep)
    return os.pathsep.join(
        word for word in words if Path(word).is_absolute() and Path(word) != here
    )


def installed(*names: str) -> str | None:
    """Return the first of some programs that is installed, None where none is."""
    return next(
        (found for name in names if (found := shutil.which(name, path=search_path()))), None
    )


def environment(folder: Path) -> dict[str, str]:
    """Return the environment of a program whose temporary files belong into a folder, also when it is stopped."""
    return {**os.environ, "PATH": search_path(), "TMPDIR": str(folder)}


def run(words: Sequence[str], folder: Path) -> None:
    """Run a program in a folder; it is ended, with all that it started, when it has taken ``PATIENCE_S``.

    Args:
        words: the program and its arguments.
        folder: where it runs, and where its temporary files belong.

    Raises:
        OSError: it cannot be started.
        subprocess.SubprocessError: it failed, or took too long.
    """
    pipe = subprocess.PIPE
    # Why a session: a shell script that is killed leaves behind what it waits for, and that holds the pipes open.
    with subprocess.Popen(
        words,
        stdin=pipe,
        stdout=pipe,
        stderr=pipe,
        env=environment(folder),
        cwd=folder,
        start_new_session=True,
    ) as child:
        try:
            said = child.communicate(timeout=PATIENCE_S)
        except BaseException:
            os.killpg(child.pid, signal.SIGKILL)
            raise
    if child.returncode:
        raise subprocess.CalledProcessError(child.returncode, words, *said)
