"""The one table of limits on what a file may ask for, checked before memory is taken.

A file from somebody else may say that it holds a petabyte, nest a list a million times, or never end. Each limit is far
above what a real recording or result needs and low enough for 1 GB of memory; ``raised`` changes some of them for the
code under it, which the common option ``--limit NAME=VALUE`` does for a whole command.
"""

from __future__ import annotations

import errno
import io
import os
import re
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any

from dynid.errors import TooLarge

MIB = 1 << 20
#: No limit may be raised so far.
ENDLESS = 1e18


@dataclass(frozen=True)
class Limit:
    """One line of the table.

    Attributes:
        most: the largest value that is accepted.
        unit: its unit, for messages.
        what: what is counted.
        why: why it is this large and no larger.
    """

    most: float
    unit: str
    what: str
    why: str


LIMITS: dict[str, Limit] = {
    "chunk_bytes": Limit(
        64 * MIB,
        "bytes",
        "one chunk of a bag, unpacked",
        "recorders close a chunk at 0.75 MiB, some at 4 MiB; one chunk at a time is held in memory",
    ),
    "expansion": Limit(
        200,
        "times",
        "how far packed data of more than 16 MiB may expand",
        "joint states pack three- to tenfold; a decompression bomb expands a thousandfold",
    ),
    "message_bytes": Limit(
        MIB,
        "bytes",
        "one message of a bag",
        "a joint state of 100 joints has 5 kB; 4096 messages are decoded together",
    ),
    "joint_sets": Limit(
        256,
        "sets",
        "different sets of joint names on one topic",
        "an arm and its gripper are two; each set is a log of its own",
    ),
    "connections": Limit(
        10_000, "connections", "publishers and topics of a bag", "a large robot has some hundred"
    ),
    "archive_bytes": Limit(
        4096 * MIB,
        "bytes",
        "all arrays of an .npz file, unpacked",
        "ten million samples of seven joints have 1.2 GB; long arrays are read piece by piece into a temporary file",
    ),
    "members": Limit(1000, "members", "arrays of an .npz file", "results have up to 60"),
    "header_bytes": Limit(
        32 * MIB, "bytes", "the JSON header of an .npz file", "headers have 10 kB to 1 MB"
    ),
    "yaml_bytes": Limit(
        MIB,
        "bytes",
        "a YAML or JSON file, or waypoints",
        "robot files have 5 kB; YAML is read at 1 MB in ten seconds",
    ),
    "urdf_bytes": Limit(16 * MIB, "bytes", "a URDF", "the longest that are published have 0.5 MB"),
    "text_bytes": Limit(
        4096 * MIB,
        "bytes",
        "a text log",
        "an hour of seven joints at 500 Hz has 400 MB; it is read block by block",
    ),
    "line_bytes": Limit(MIB, "bytes", "one line of a text log", "a row of 1000 columns has 20 kB"),
    "nesting": Limit(
        50,
        "levels",
        "lists and keys inside each other in YAML and JSON",
        "no file of dynid has ten",
    ),
    "samples": Limit(
        20_000_000,
        "samples",
        "samples of a log, also after resampling",
        "eleven hours at 500 Hz; five arrays of them",
    ),
    "motion_samples": Limit(
        1_000_000,
        "samples",
        "a planned motion",
        "17 minutes at the 1 kHz of its checks; it is held in memory",
    ),
    "matrix": Limit(
        16_000_000,
        "numbers",
        "a regressor that is worked on as a whole",
        "128 MB, of which a few are held at a time; random states of ten joints make 2 million",
    ),
    "rate_hz": Limit(
        100_000, "Hz", "sample rate of a log", "the fastest drivers publish at 10 kHz"
    ),
    "joints": Limit(
        32, "joints", "joints of a robot", "the model grows with their square; arms have up to ten"
    ),
    "effects": Limit(
        200,
        "columns",
        "the torque effects of a robot file",
        "each adds a column or more to the model; a search adds up to ten",
    ),
    "waypoints": Limit(
        500, "waypoints", "points of a motion", "one spline is solved for all; people give ten"
    ),
    "obstacles": Limit(
        500, "boxes", "obstacles around an arm", "each is compared with each link at each instant"
    ),
    "jobs": Limit(
        2000,
        "jobs",
        "jobs of a batch file",
        "each reads its files first; 100 arms with ten logs each have 1000",
    ),
    "links": Limit(
        1000, "links", "links or joints of a URDF", "a humanoid with hands has about 100"
    ),
    "columns": Limit(512, "columns", "columns of a log", "a humanoid publishes about 100 joints"),
    "name_length": Limit(
        100,
        "characters",
        "a name of a robot, joint or link",
        "names go into file names, of which systems keep 255",
    ),
}

#: Packed data of up to this size may expand as it likes; all chunks of a recording together up to that one.
_SMALL, _SMALL_RECORDING = 16 * MIB, 128 * MIB
_RAISED: ContextVar[Mapping[str, float] | None] = ContextVar("limits", default=None)


def limit(name: str) -> float:
    """Return the limit in force."""
    return (_RAISED.get() or {}).get(name, LIMITS[name].most)


@contextmanager
def raised(values: Mapping[str, float]) -> Iterator[None]:
    """Put other values of some limits in force for the code in the block."""
    token = _RAISED.set({**(_RAISED.get() or {}), **values})
    try:
        yield
    finally:
        _RAISED.reset(token)


def words() -> list[str]:
    """Return the words of a command line that put the raised limits in force in another process."""
    return [
        word
        for name, value in (_RAISED.get() or {}).items()
        for word in ("--limit", f"{name}={value:.10g}")
    ]


def check(name: str, size: float, where: Path | str) -> None:
    """Raise when a size is beyond a limit.

    Args:
        name: of the limit.
        size: what the file asks for.
        where: the file, and the place in it.

    Raises:
        TooLarge: names the limit and the option that raises it.
    """
    most = limit(name)
    # Why so: what is not a number is not below it either.
    if not size <= most:
        entry = LIMITS[name]
        trusted = (
            f"if the file is to be trusted: --limit {name}={_round_up(size)}"
            if size < ENDLESS
            else ""
        )
        raise TooLarge(
            f"{where}: {_spaced(size)} {entry.unit} for {entry.what}; at most {_spaced(most)} are read",
            where=str(where),
            why=entry.why,
            fix=trusted or "correct what asks for it: no limit may be so high",
        )


def check_expansion(packed: int, unpacked: int, where: Path | str, *, whole: bool = False) -> None:
    """Raise when packed data expands like a decompression bomb.

    Args:
        packed: size in the file [byte].
        unpacked: size in memory [byte].
        where: the file, and the place in it.
        whole: whether it is all chunks of a recording, of which each may be small, together.
    """
    if unpacked > (_SMALL_RECORDING if whole else _SMALL):
        check("expansion", unpacked / max(packed, 1), where)


def _spaced(value: float) -> str:
    return f"{value:,.0f}".replace(",", " ") if value < 1e15 else f"{value:.1e}"


def _round_up(size: float) -> int:
    digits = 10 ** max(0, len(str(int(size))) - 2)
    return int(-(-size // digits) * digits)


def read_limits(text: str) -> tuple[str, float]:
    """Return name and value of ``NAME=VALUE``.

    Raises:
        ValueError: no such limit, or no positive number.
    """
    name, _, value = text.partition("=")
    if name not in LIMITS:
        raise ValueError(f"no limit '{name}'; the limits are {', '.join(LIMITS)}")
    if not re.fullmatch(r"\d+(\.\d+)?([eE]\d{1,2})?", value) or not 0 < float(value) < ENDLESS:
        raise ValueError(f"'{value[:40]}' is not a positive number below {ENDLESS:g}")
    return name, float(value)


class _File(io.FileIO):
    """A file that has something to read or has ended; some of the kernel's have nothing yet, and give None."""

    def __init__(self, handle: int, name: str) -> None:
        super().__init__(handle, "rb")
        self.path = name

    def readinto(self, buffer: Any, /) -> Any:  # noqa: ANN401
        return self._there(super().readinto(buffer))

    def readall(self) -> Any:  # noqa: ANN401
        return self._there(super().readall())

    def _there(self, found: Any) -> Any:  # noqa: ANN401
        if found is None:
            raise OSError(errno.EAGAIN, "it has nothing to read", self.path)
        return found


def open_file(path: Path) -> IO[bytes]:
    """Open a regular file to read; a device, a pipe or a socket, which may never end, is refused.

    Raises:
        OSError: it cannot be opened, or is something else than a file.
    """
    # Why: opening a pipe that nobody writes to would wait for ever.
    handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_CLOEXEC", 0))
    try:
        mode = os.fstat(handle).st_mode
        if not stat.S_ISREG(mode):
            what = "it is a folder" if stat.S_ISDIR(mode) else "it is no regular file"
            raise OSError(errno.EINVAL, what, str(path))
        return io.BufferedReader(_File(handle, str(path)))
    except BaseException:
        os.close(handle)
        raise


def check_holes(path: Path) -> None:
    """Raise when a file is nearly all holes, which a file system packs into nothing: it was never written.

    Raises:
        TooLarge: names the limit and the option that raises it.
    """
    with open_file(path) as stream:
        found = os.fstat(stream.fileno())
        # Why the hole itself: some file systems tell no blocks.
        if found.st_size and os.lseek(stream.fileno(), 0, os.SEEK_HOLE) < found.st_size:
            check_expansion(512 * found.st_blocks, found.st_size, path)


def read_bytes(path: Path, name: str) -> bytes:
    """Return the content of a regular file that is no larger than a limit.

    Raises:
        TooLarge: it is larger.
        OSError: it cannot be opened, or is no regular file.
    """
    with open_file(path) as stream:
        check(name, os.fstat(stream.fileno()).st_size, path)
        return stream.read(int(limit(name)) + 1)
