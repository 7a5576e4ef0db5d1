"""Results that are read: .npz files with arrays and one JSON header, whose contents are checked and never executed.

The header holds schema, dynid version, command line, seed, sha256 of every input, units and joint names.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from dynid.errors import Finding, NewerSchema, NotAnArtifact, TooLarge
from dynid.files.contents import Contents, Fact
from dynid.npz import HEADER, parse_json, read_npz, written_whole
from dynid.text import whole_number
from dynid.version import __version__


@dataclass(frozen=True)
class Artifact:
    """One result file.

    Attributes:
        schema: name and number, such as ``"dynid/regressor/1"``.
        header: JSON-able facts.
        arrays: arrays by name.
    """

    schema: str
    header: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]


#: What the headers of results say about the run, wherever they say it.
_RUN = Contents(
    "",
    {
        place: Fact(kind, needed=False)
        for place, kind in {
            "robot": str,
            "key": str | None,
            "dynid": str,
            "command": str,
            "seed": int | None,
            "robot_file": str,
            "robot_path": str,
            "logs": list[str],
            "log_sha256": list[str] | str,
            "inputs": dict[str, str],
            "joints": list[str],
            "cutoff_hz": float,
            "kept_rate_hz": float,
            "delay_s": float | None,
            "delay_std_error_s": float | None,
            "delay_applied_s": float | None,
            "log_findings": list[Finding],
            "findings": list[Finding],
        }.items()
    },
)
#: What reading a file that somebody has changed may raise on the way from its numbers to a value.
_DAMAGE = (
    KeyError,
    TypeError,
    ValueError,
    IndexError,
    AttributeError,
    OverflowError,
    ZeroDivisionError,
    RecursionError,
)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn what a changed or damaged file makes fail in the block into a mistake that names the file.

    Raises:
        NotAnArtifact: something of it is missing, or of another kind.
    """
    try:
        yield
    except _DAMAGE as error:
        raise NotAnArtifact(
            f"{path} is damaged: {type(error).__name__}: {error}", where=str(path)
        ) from error


# ---------------------------------------------------------------- results
def write_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    with written_whole(path) as stream:
        stream.write(text.encode("utf-8"))


def read_artifact(path: Path, contents: Contents | None = None) -> Artifact:
    """Read a result file without executing anything in it.

    Args:
        path: the file.
        contents: what it must hold; any result when None.

    Raises:
        NotAnArtifact: not a dynid result, damaged, or of another kind.
        NewerSchema: written by a newer dynid.
    """
    try:
        arrays = read_npz(path)
        header = parse_json(str(arrays.pop(HEADER)), path)
        found = str(header["schema"])
        _RUN.require(header, {}, path)
    except FileNotFoundError as error:
        raise NotAnArtifact(f"no such file: {path}", where=str(path)) from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise NotAnArtifact(
            f"{path} is not a dynid result, or is damaged: {error}", where=str(path)
        ) from error
    if contents is not None:
        _require_schema(path, header, contents.schema)
        with reading(path):
            contents.require(header, arrays, path)
    return Artifact(found, header, arrays)


def _require_schema(path: Path, header: Mapping[str, Any], schema: str) -> None:
    found = str(header["schema"])
    kind, _, number = found.rpartition("/")
    wanted, _, known = schema.rpartition("/")
    if kind == wanted and whole_number(number) > int(known):
        raise NewerSchema(
            f"{path} was written by dynid {header.get('dynid', '?')} (schema {number}); this is {__version__}",
            where=str(path),
        )
    if found != schema:
        raise NotAnArtifact(f"{path} holds {found}, expected {schema}", where=str(path))


def read_header(path: Path) -> dict[str, Any] | None:
    """Return only the header of a result file, or None when it is none."""
    try:
        header = dict(parse_json(str(read_npz(path, HEADER)[HEADER]), path))
        _RUN.require(header, {}, path)
    except (OSError, ValueError, KeyError, TypeError, TooLarge):
        return None
    return header
