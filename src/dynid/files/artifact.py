"""Results on disk: .npz files with arrays and one JSON header, written whole or not at all, never pickled.

The header holds schema, dynid version, command line, seed, sha256 of every input, units and joint names. Member files
carry a fixed date, so that two runs on the same inputs give the same bytes.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from dynid import limits
from dynid.errors import NewerSchema, NotAnArtifact, TooLarge
from dynid.npz import HEADER, parse_json, read_npz, write_npz, written_whole
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


def sha256(path: Path) -> str:
    """Return the sha256 of a file, or of all files of a folder in the order of their names.

    A file is read for it once per process, and again only when its size or time of change is another.
    """
    files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    return _sha256(tuple((file.absolute(), (info := file.stat()).st_mtime_ns, info.st_size) for file in files))


@lru_cache(maxsize=256)
def _sha256(files: tuple[tuple[Path, int, int], ...]) -> str:
    digest = hashlib.sha256()
    for file, _, _ in files:
        with limits.open_file(file) as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def write_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    with written_whole(path) as stream:
        stream.write(text.encode("utf-8"))


def write_artifact(path: Path, artifact: Artifact) -> None:
    """Write a result file whole; equal contents give equal bytes."""
    write_npz(path, {"schema": artifact.schema, "dynid": __version__, **artifact.header}, artifact.arrays)


def read_artifact(path: Path, schema: str | None = None) -> Artifact:
    """Read a result file without executing anything in it.

    Args:
        path: the file.
        schema: schema it must have, such as ``"dynid/regressor/1"``; any when None.

    Raises:
        NotAnArtifact: not a dynid result, damaged, or of another kind.
        NewerSchema: written by a newer dynid.
    """
    try:
        arrays = read_npz(path)
        header = parse_json(str(arrays.pop(HEADER)), path)
        found = str(header["schema"])
    except FileNotFoundError as error:
        raise NotAnArtifact(f"no such file: {path}", where=str(path)) from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise NotAnArtifact(f"{path} is not a dynid result, or is damaged", where=str(path)) from error
    if schema is not None and found != schema:
        kind, _, number = found.rpartition("/")
        if kind == schema.rsplit("/", 1)[0] and number.isdigit() and int(number) > int(schema.rsplit("/", 1)[1]):
            raise NewerSchema(
                f"{path} was written by dynid {header.get('dynid', '?')} (schema {number}); this is {__version__}",
                where=str(path),
            )
        raise NotAnArtifact(f"{path} holds {found}, expected {schema}", where=str(path))
    return Artifact(found, header, arrays)


def read_header(path: Path) -> dict[str, Any] | None:
    """Return only the header of a result file, or None when it is none."""
    try:
        return dict(parse_json(str(read_npz(path, HEADER)[HEADER]), path))
    except (OSError, ValueError, KeyError, TypeError, TooLarge):
        return None
