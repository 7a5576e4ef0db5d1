"""What works on this machine and what does not, found without importing any of the packages that are looked for."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from dynid.drivers.ros import APT, master_uri, missing_modules, ping_master, ros_folders
from dynid.version import __version__
from dynid.xdg import LOCAL_CONFIG, cache_folder, config_file

#: What dynid cannot do without.
REQUIRED = (
    *("numpy", "scipy", "sympy", "pyyaml", "matplotlib", "click", "rich"),
    *("rosbags", "lz4", "mcap", "jinja2", "threadpoolctl"),
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


@dataclass(frozen=True)
class Diagnosis:
    """What was found on this machine.

    Attributes:
        checks: everything that was looked at.
    """

    checks: tuple[Check, ...]

    @property
    def works(self) -> list[str]:
        """Names of what works."""
        return [check.name for check in self.checks if check.ok]

    @property
    def missing(self) -> list[Check]:
        """What does not work."""
        return [check for check in self.checks if check.ok is False]

    @property
    def usable(self) -> bool:
        """Whether dynid as a whole can run."""
        return not any(check.name in ("Python", *REQUIRED) for check in self.missing)


def doctor() -> Diagnosis:
    """Look at Python, packages, simulator, ROS, display, folders and configuration files."""
    return Diagnosis((*_packages(), *_ros(), *_ros2(), *_surroundings()))


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
    yield Check(
        "Python",
        sys.version_info >= (3, 10),
        platform.python_version(),
        "dynid needs Python 3.10 or newer",
    )
    for package in REQUIRED:
        version = version_of(package)
        yield Check(
            package,
            version is not None,
            version or "absent",
            f"dynid as a whole: pip install {package}",
        )
    bullet = version_of("pybullet")
    lost = 'preview, collision check: pip install "pybullet>=3.2.5" (3.12 and later: 8 minutes, needs a C++ compiler)'
    yield Check("PyBullet", bullet is not None, bullet or "absent", lost)


def _ros() -> Iterator[Check]:
    """Look for ROS 1 where ``dynid record`` would find it, and for a master."""
    missing = missing_modules()
    lost = f"record (reading bags works without): {APT}; or set DYNID_ROS_PATH to the folder that holds rospy"
    present = f"present, looked for in {', '.join(ros_folders()) or 'sys.path'}"
    yield Check("ROS 1", not missing, f"absent: {', '.join(missing)}" if missing else present, lost)
    uri = master_uri()
    answered = master_answers(uri)
    state = "answers" if answered else "does not answer"
    yield Check(
        "ROS master",
        answered,
        f"{uri} {state}",
        "record: start rosmaster --core, or set ROS_MASTER_URI",
    )


def _ros2() -> Iterator[Check]:
    """Say what of ROS 2 is there; nothing of dynid needs it."""
    program, distribution = shutil.which("ros2"), os.environ.get("ROS_DISTRO", "")
    found = sorted(path.parents[1] for path in Path("/opt/ros").glob("*/bin/ros2"))
    if program is not None:
        value = f"{distribution} ({program})".strip()
    elif found:
        value = f"{', '.join(path.name for path in found)} is installed, not sourced: source {found[-1]}/setup.bash"
    else:
        value = "absent"
    yield Check(
        "ROS 2", None, f"{value}; its recordings are read without it (dynid explain record-ros2)"
    )


def master_answers(uri: str) -> bool:
    """Return whether something listens at a ROS master's address, within a limit that holds for name look-up too."""
    try:
        ping_master(uri)
    except OSError:
        return False
    return True


def _surroundings() -> Iterator[Check]:
    display = os.environ.get("WAYLAND_DISPLAY") or os.environ.get("DISPLAY")
    yield Check(
        "display", bool(display), display or "none", "preview window: pictures are saved instead"
    )
    yield _folder("working folder", Path.cwd(), "results: give another folder with --out")
    cache = cache_folder()
    yield _folder("cache", cache, "models are built anew each time", f"{_size(cache) / 1e6:.1f} MB")
    for file in (LOCAL_CONFIG, config_file()):
        yield Check(
            "configuration", None, f"{file} {'is read' if file.is_file() else 'does not exist'}"
        )


def _folder(name: str, path: Path, lost: str, note: str = "") -> Check:
    nearest = next(p for p in (path, *path.parents) if p.exists())
    writable = os.access(nearest, os.W_OK)
    words = [str(path), *([note] if note else []), "" if writable else "cannot be written"]
    return Check(name, writable, "  ".join(word for word in words if word), lost)


def _size(folder: Path) -> int:
    return (
        sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
        if folder.is_dir()
        else 0
    )
