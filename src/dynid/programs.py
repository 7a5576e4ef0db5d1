"""Programs that dynid starts, a compiler or Octave: only installed ones, never one of the current folder.

Where the path of programs names the current folder, a ``cc`` that came with somebody's logs would run, and so would an
``as`` that the compiler looks for.
"""

from __future__ import annotations

import os
import shutil
from pathlib import Path


def search_path() -> str:
    """Return the path of programs without what depends on the current folder, or is it."""
    try:
        here = Path.cwd()
    except OSError:  # the folder is gone
        here = Path(os.devnull)
    words = os.environ.get("PATH", os.defpath).split(os.pathsep)
    return os.pathsep.join(word for word in words if Path(word).is_absolute() and Path(word) != here)


def installed(*names: str) -> str | None:
    """Return the first of some programs that is installed, None where none is."""
    return next((found for name in names if (found := shutil.which(name, path=search_path()))), None)


def environment(folder: Path) -> dict[str, str]:
    """Return the environment of a program whose temporary files belong into a folder, also when it is stopped."""
    return {**os.environ, "PATH": search_path(), "TMPDIR": str(folder)}
