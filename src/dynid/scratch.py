"""Temporary files and folders that the next run removes when the run that made them was killed.

Their names carry the process that made them: ``dynid-<machine>-<process>-<random>``. A process that is killed by force
cannot clean up; the next one that writes into the same folder does, as far as that process ran on this machine and has
ended.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path

_MARK = re.compile(r"dynid-([0-9a-f]{8})-(\d+)-[^/]*$")


@cache
def _machine() -> str:
    """Return a word for this machine as it is running: the same process number elsewhere is another process."""
    facts = [os.uname().nodename if hasattr(os, "uname") else ""]
    for source in ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"):
        with suppress(OSError):
            place = Path(source)
            facts.append(str(place.readlink()) if place.is_symlink() else place.read_text())
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()[:8]


def prefix() -> str:
    """Return what the names of this process's temporary files and folders begin with, or have after a dot."""
    return f"dynid-{_machine()}-{os.getpid()}-"


@contextmanager
def scratch_folder(inside: Path | None = None) -> Iterator[Path]:
    """Give a folder that is removed with the block; a hidden one where it is made beside results.

    Args:
        inside: where to make it; the system's folder for temporary files when None.
    """
    place = Path(tempfile.gettempdir()) if inside is None else inside
    sweep(place)
    with tempfile.TemporaryDirectory(
        prefix=prefix() if inside is None else f".{prefix()}", dir=place, ignore_cleanup_errors=True
    ) as folder:
        yield Path(folder)


_SWEPT: set[Path] = set()


def sweep(folder: Path) -> None:
    """Remove what processes that have ended left behind in a folder; once per folder and process."""
    place = folder.absolute()
    if place in _SWEPT:
        return
    _SWEPT.add(place)
    with suppress(OSError), os.scandir(place) as entries:
        for entry in entries:
            match = _MARK.search(entry.name)
            if match is None or match[1] != _machine() or _runs(int(match[2])):
                continue
            with suppress(OSError):
                if entry.is_dir(follow_symlinks=False):
                    shutil.rmtree(entry.path, ignore_errors=True)
                else:
                    Path(entry.path).unlink()


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
