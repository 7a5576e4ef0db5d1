"""What works on this machine and what does not, found without importing any of the packages that are looked for."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dynid.answer import Answer, picked
from dynid.drivers.ros import APT, master_uri, missing_modules, ping_master, ros_folders
from dynid.errors import ExitStatus
from dynid.table import Table
from dynid.version import __version__
from dynid.xdg import LOCAL_CONFIG, cache_folder, config_file

#: What dynid cannot do without.
REQUIRED = (
    "numpy",
    "scipy",
    "sympy",
    "pyyaml",
    "matplotlib",
    "click",
    "rich",
    "rosbags",
    "lz4",
    "jinja2",
    "threadpoolctl",
    "lazy_loader",
    "mujoco",
)


@dataclass(frozen=True)
class Check:
    """One thing that was looked at.

    Attributes:
        name: what.
        ok: whether it works; None where it is only information.
        value: what was found.
        lost: what does not work without it.
    """

    name: str
    ok: bool | None
    value: str
    lost: str = ""


def doctor() -> Answer:
    """Look at Python, packages, simulator, ROS, display, folders and configuration files."""
    checks = (*_packages(), *_ros(), *_surroundings())
    works = [check.name for check in checks if check.ok]
    missing = [check for check in checks if check.ok is False]
    broken = any(check.name in REQUIRED for check in missing)
    return Answer(
        {
            "checks": checks,
            "works": works,
            "does_not_work": [check.name for check in missing],
        },
        parts=(
            Table([picked(check, "name", "ok", "value") for check in checks]),
            "",
            ("works", ", ".join(works)),
            *(("does not", f"{check.name}; lost: {check.lost}") for check in missing),
        ),
        status=ExitStatus.MACHINE if broken else ExitStatus.DONE,
    )


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
        f"ROS 2    {'present' if shutil.which('ros2') else 'absent'} (not needed)",
    ]


def _packages() -> Iterator[Check]:
    yield Check("Python", True, platform.python_version())
    lost = {name: f"dynid as a whole: pip install {name}" for name in REQUIRED}
    preview = 'pip install "pybullet>=3.2.5" (3.12 and later: 8 minutes, needs a C++ compiler)'
    lost["PyBullet"] = f"preview, collision check: {preview}"
    for name, without in lost.items():
        version = version_of(name)
        yield Check(name, version is not None, version or "absent", without)


def _ros() -> Iterator[Check]:
    """Look for ROS 1 where ``dynid record`` would find it, and for a master."""
    missing = missing_modules()
    lost = f"record (reading bags works without): {APT}; or set DYNID_ROS_PATH to the folder that holds rospy"
    value = f"present, looked for in {', '.join(ros_folders()) or 'sys.path'}"
    yield Check("ROS 1", not missing, f"absent: {', '.join(missing)}" if missing else value, lost)
    uri, state = master_uri(), "answers"
    try:
        ping_master(uri)
    except OSError:
        state = "does not answer"
    lost = "record: start rosmaster --core, or set ROS_MASTER_URI"
    yield Check("ROS master", state == "answers", f"{uri} {state}", lost)


def _surroundings() -> Iterator[Check]:
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    lost = "preview window: pictures are saved instead"
    yield Check("display", bool(display), display or "none", lost)
    yield _folder("working folder", Path.cwd(), "results: give another folder with --out")
    cache = cache_folder()
    size = sum(file.stat().st_size for file in cache.rglob("*") if file.is_file())
    yield _folder("cache", cache, "models are built anew each time", f"{size / 1e6:.1f} MB")
    for file in (LOCAL_CONFIG, config_file()):
        state = "is read" if file.is_file() else "does not exist"
        yield Check("configuration", None, f"{file} {state}")


def _folder(name: str, path: Path, lost: str, note: str = "") -> Check:
    nearest = next(p for p in (path, *path.parents) if p.exists())
    writable = os.access(nearest, os.W_OK)
    value = "  ".join(filter(None, (str(path), note, "cannot be written" * (not writable))))
    return Check(name, writable, value, lost)
