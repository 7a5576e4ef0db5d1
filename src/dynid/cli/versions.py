"""Versions of what dynid stands on, found without importing any of it."""

from __future__ import annotations

import importlib.metadata
import platform

from dynid.drivers.ros import missing_modules
from dynid.version import __version__


def version_of(package: str) -> str | None:
    """Return the version of an installed package, or None."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def version_lines() -> list[str]:
    """Return dynid's version and those it depends on most."""
    return [
        f"dynid    {__version__}",
        f"Python   {platform.python_version()}",
        f"numpy    {version_of('numpy') or 'absent'}",
        f"PyBullet {version_of('pybullet') or 'absent'}",
        f"ROS 1    {'present' if not missing_modules() else 'absent'} (rospy)",
    ]
