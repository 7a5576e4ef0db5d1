"""Results on disk: .npz files with arrays and one JSON header, written whole or not at all, never pickled.

The header holds schema, dynid version, command line, seed, sha256 of every input, units and joint names. Member files
carry a fixed date, so that two runs on the same inputs give the same bytes.
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from functools import lru_cache
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.errors import NewerSchema, NotAnArtifact, TooLarge
from dynid.files import hashed
from dynid.longarrays import spans
from dynid.npz import HEADER, parse_json, read_npz, write_npz, written_whole
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


#: Numbers beyond this are not measured, counted or computed by anybody: those of a header, and those of arrays, of
#: which five may be multiplied.
_LARGEST, LARGEST = 1e150, 1e60
#: What the headers of results say about the run, wherever they say it.
_HEADER: dict[str, Any] = {
    "robot": str, "key": str | None, "dynid": str, "command": str, "seed": int | None, "robot_file": str,
    "robot_path": str, "logs": list[str], "log_sha256": list[str] | str, "inputs": dict[str, str], "joints": list[str],
    "cutoff_hz": float, "kept_rate_hz": float, "delay_s": float | None, "delay_std_error_s": float | None,
    "delay_applied_s": float | None, "log_findings": list[dict[str, Any]], "findings": list[dict[str, Any]],
}  # fmt: skip
#: What reading a file that somebody has changed may raise on the way from its numbers to a value.
_DAMAGE = (
    KeyError, TypeError, ValueError, IndexError, AttributeError, OverflowError, ZeroDivisionError, RecursionError,
)  # fmt: skip


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn what a changed or damaged file makes fail in the block into a mistake that names the file.

    Raises:
        NotAnArtifact: something of it is missing, or of another kind.
    """
    try:
        yield
    except _DAMAGE as error:
        raise NotAnArtifact(f"{path} is damaged: {type(error).__name__}: {error}", where=str(path)) from error


def require_fields(value: Any) -> None:  # noqa: ANN401
    """Raise when a field of a dataclass, or of one in it, is not of the type that it is declared with.

    Raises:
        TypeError: names the field.
    """
    for each in fields(value):
        try:
            hint = eval(str(each.type), vars(sys.modules[type(value).__module__]))
        except NameError:  # a type that is imported for type checkers only
            continue
        _require(getattr(value, each.name), hint, each.name)


def require_numbers(
    shape: tuple[int, ...],
    kind: Any = np.float64,  # noqa: ANN401
    *,
    gaps: bool = False,
    endless: bool = False,
    **arrays: NDArray[Any],
) -> None:
    """Raise when arrays have another shape or type than dynid writes, or hold what nobody measures or computes.

    Args:
        shape: what each must have.
        kind: type of its numbers, such as ``np.integer``.
        gaps: whether NaN may stand for what is not known.
        endless: whether infinity may.
        arrays: by their names in the file.

    Raises:
        ValueError: names the array.
    """
    for name, array in arrays.items():
        if array.shape != shape or not (array.dtype.isnative and np.issubdtype(array.dtype, kind)):
            raise ValueError(f"'{name}' is {array.dtype} {array.shape}, expected {kind.__name__} {shape}")
        for part in (array[some] for some in spans(len(array) if shape else 0)):
            size = np.abs(part)
            known = (size < LARGEST) | (gaps & np.isnan(part)) | (endless & np.isinf(size))
            if not known.all():
                raise ValueError(f"'{name}' holds values that are no numbers, or that nothing has")


def _require(value: Any, hint: Any, name: str) -> None:  # noqa: ANN401
    """Raise when a value is not of a type; numbers of numpy count as numbers."""
    origin, inner = get_origin(hint), get_args(hint)
    if origin in (tuple, list) and isinstance(value, origin):
        same = origin is list or inner[-1:] == (Ellipsis,)
        for item, kind in zip(value, inner[:1] * len(value) if same else inner, strict=True):
            _require(item, kind, name)
    elif (origin or hint) in (dict, Mapping) and isinstance(value, Mapping):
        for key, item in value.items():
            _require(key, str, name)
            _require(item, inner[1] if inner else Any, name)
    elif is_dataclass(hint) and isinstance(hint, type) and isinstance(value, hint):
        require_fields(value)
    elif not _is(value, hint, origin, name):
        raise TypeError(f"'{name}' is {value!r:.60}, which is no {getattr(hint, '__name__', hint)}")


def _is(value: Any, hint: Any, origin: Any, name: str) -> bool:  # noqa: ANN401
    """Return whether a value that holds no others is of a type."""
    if origin is np.ndarray:
        return isinstance(value, np.ndarray) and value.dtype.kind in "fiub"
    if origin in (Union, UnionType):
        return any(_fits(value, one, name) for one in get_args(hint))
    if hint in (float, int):
        number = isinstance(value, (int, float, np.integer, np.floating)) and not isinstance(value, bool)
        if hint is float and number and not np.isfinite(value):
            return True
        return number and abs(value) < _LARGEST and (hint is float or float(value).is_integer())
    if origin is Literal:
        return value in get_args(hint)
    if hint in (str, bool):
        return isinstance(value, hint)
    return origin not in (tuple, list, dict, Mapping) and hint not in (dict, Mapping) and not is_dataclass(hint)


def _fits(value: Any, hint: Any, name: str) -> bool:  # noqa: ANN401
    try:
        _require(value, hint, name)
    except (TypeError, ValueError):
        return False
    return True


def sha256(path: Path) -> str:
    """Return the sha256 of a file, or of all files of a folder in the order of their names.

    A file is read for it once per process, and again only when its size or time of change is another.
    """
    if not path.is_dir():
        return hashed.sha256(path)
    return _of_folder(tuple(map(hashed.state_of, sorted(p for p in path.iterdir() if p.is_file()))))


@lru_cache(maxsize=256)
def _of_folder(files: tuple[hashed.State, ...]) -> str:
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
        for name, kind in _HEADER.items():
            if name in header:
                _require(header[name], kind, name)
    except FileNotFoundError as error:
        raise NotAnArtifact(f"no such file: {path}", where=str(path)) from error
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise NotAnArtifact(f"{path} is not a dynid result, or is damaged: {error}", where=str(path)) from error
    if schema is not None and found != schema:
        kind, _, number = found.rpartition("/")
        if kind == schema.rsplit("/", 1)[0] and whole_number(number) > int(schema.rsplit("/", 1)[1]):
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
