"""Where files outside the working folder go: the XDG cache and configuration folders, nothing else."""

from __future__ import annotations

import os
from pathlib import Path

#: Configuration file of the working folder; it may not exist.
LOCAL_CONFIG = Path("dynid.yaml")


def cache_folder() -> Path:
    """Return the folder for models and crash files; it may not exist yet."""
    return _base("XDG_CACHE_HOME", ".cache") / "dynid"


def config_file() -> Path:
    """Return the user's configuration file; it may not exist."""
    return _base("XDG_CONFIG_HOME", ".config") / "dynid" / "config.yaml"


def _base(variable: str, default: str) -> Path:
    # Why: the XDG specification says that a relative path in these variables must be ignored.
    given = Path(os.environ.get(variable, ""))
    return given if given.is_absolute() else Path(os.path.expanduser("~")) / default  # noqa: PTH111 - needs no home
