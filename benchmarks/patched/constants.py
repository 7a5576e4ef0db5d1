"""What ``benchmarks/tuning.py`` does to a table of constants: patch one, or note which are read."""

from __future__ import annotations

import importlib
import json
import os
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

#: JSON of module, name and value of the constant that is patched.
PATCH = "DYNID_PATCHED_CONSTANT"
#: JSON of the module whose constants are watched, and of the file that gets the names of those that are read.
WATCH = "DYNID_WATCHED_CONSTANTS"


def apply() -> None:
    """Do what the variables of the environment say."""
    if PATCH in os.environ:
        module, name, value = json.loads(os.environ[PATCH])
        setattr(
            importlib.import_module(module),
            name,
            tuple(value) if isinstance(value, list) else value,
        )
    if WATCH in os.environ:
        watch(*json.loads(os.environ[WATCH]))


def watch(module: str, path: str) -> None:
    """Write each name that is read from a module into a file, when it is read for the first time."""
    importlib.import_module(module)
    seen: set[str] = set()

    class Watched(ModuleType):
        def __getattribute__(self, name: str) -> Any:
            if name.isupper() and name not in seen:
                seen.add(name)
                # Why at once and appended: processes that are killed have no end of their own.
                with Path(path).open("a") as stream:
                    stream.write(f"{name}\n")
            return super().__getattribute__(name)

    sys.modules[module].__class__ = Watched
