"""What matplotlib draws with: its own defaults and what dynid sets, nothing of the working folder.

Matplotlib obeys a file ``matplotlibrc`` in the folder it is imported in, which may start programs (``text.usetex``) or
break every picture; a folder of somebody's logs may hold one.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from pathlib import Path
from typing import Any

#: Settings of windows and of the machine, which change no picture and which matplotlib does not reset either.
_NOT_OF_PICTURES = ("backend", "interactive", "toolbar", "timezone", "webagg", "date.epoch", "tk.")
_inside: ContextVar[bool] = ContextVar("inside", default=False)


@contextmanager
def own_style(settings: Mapping[str, Any] | None = None) -> Iterator[None]:
    """Draw with the defaults of matplotlib and some settings; inside of another such block, those are added."""
    mpl = _matplotlib()
    whole = {} if _inside.get() else _defaults(mpl)
    token = _inside.set(True)
    try:
        with mpl.rc_context({**whole, **(settings or {})}):
            yield
    finally:
        _inside.reset(token)


def _defaults(mpl: Any) -> dict[str, Any]:  # noqa: ANN401
    return {
        key: value
        for key, value in mpl.rcParamsDefault.items()
        if not key.startswith(_NOT_OF_PICTURES)
    }


def _matplotlib() -> Any:  # noqa: ANN401
    """Return matplotlib, which looks for its file in the current folder while it is imported."""
    if "matplotlib" not in sys.modules:
        here = os.open(".", os.O_RDONLY)
        try:
            os.chdir(Path(__file__).parent)
            import matplotlib as mpl
        finally:
            os.fchdir(here)
            os.close(here)
        return mpl
    return sys.modules["matplotlib"]
