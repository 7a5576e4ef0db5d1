"""Command lines of processes of Python that dynid starts."""

from __future__ import annotations

import sys
from pathlib import Path


def python(code: str, *words: str) -> list[str]:
    """Return the command line of a process that runs code with this dynid and installed packages.

    Python puts the working folder first on its path for ``-c``: a ``numpy.py`` that lies there would run.
    """
    path = (
        f"import sys; sys.path[:] = [{str(Path(__file__).parents[1])!r}, *filter(None, sys.path)]; "
    )
    return [sys.executable, "-c", path + code, *words]
