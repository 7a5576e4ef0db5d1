"""Results that are read: .npz files with arrays and one JSON header, which are never executed.

The header holds schema, dynid version, command line, seed, sha256 of every input, units and joint names.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats
from dynid.errors import NewerSchema, NotAnArtifact, TooLarge
from dynid.npz import HEADER, read_npz
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


#: What reading a file that somebody has changed may raise on the way from its numbers to a value.
_DAMAGE = (
    LookupError,
    TypeError,
    ValueError,
    AttributeError,
    ArithmeticError,
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
            f"{path} is damaged: {type(error).__name__}: {error}", where=path
        ) from error


def read_artifact(path: Path, schema: str = "") -> Artifact:
    """Read a result file without executing anything in it.

    Args:
        path: the file.
        schema: what it must be; any result when "".

    Raises:
        NotAnArtifact: not a dynid result, damaged, or of another kind.
        NewerSchema: written by a newer dynid.
    """
    try:
        arrays = read_npz(path)
        header = json.loads(str(arrays.pop(HEADER)))
        present = str(header["schema"])
    except FileNotFoundError as error:
        raise NotAnArtifact(f"no such file: {path}", where=path) from error
    except (OSError, *_DAMAGE) as error:
        raise NotAnArtifact(
            f"{path} is not a dynid result, or is damaged: {error}", where=path
        ) from error
    if schema:
        require_schema(path, header, schema)
    return Artifact(present, header, arrays)


def require_schema(path: Path, header: Mapping[str, Any], schema: str) -> None:
    """Check what a file holds by its header.

    Raises:
        NotAnArtifact: something else.
        NewerSchema: written by a newer dynid.
    """
    present = str(header.get("schema"))
    kind, _, number = present.rpartition("/")
    wanted, _, known = schema.rpartition("/")
    if kind == wanted and whole_number(number) > int(known):
        raise NewerSchema(
            f"{path} was written by dynid {header.get('dynid', '?')} (schema {number}); this is {__version__}",
            where=path,
        )
    if present != schema:
        raise NotAnArtifact(f"{path} holds {present}, expected {schema}", where=path)


def read_header(path: Path) -> dict[str, Any]:
    """Return only the header of a result file, empty when it is none."""
    try:
        return json.loads(str(read_npz(path, HEADER)[HEADER]))
    except (OSError, *_DAMAGE, TooLarge):
        return {}


def kind_of(path: Path) -> str:
    """Return what a result file holds, such as ``dynid/log``; empty when it is none."""
    return str(read_header(path).get("schema", "")).rpartition("/")[0]


# ---------------------------------------------------------------- values of dataclasses
def packed(value: Any, arrays: dict[str, NDArray[Any]], name: str) -> Any:  # noqa: ANN401
    """Return a value as a header has it: the names of its arrays stand in their places.

    Args:
        value: plain values, arrays, and dataclasses, mappings and sequences of these.
        arrays: where its arrays go, each under the place that it has in the value.
        name: of the value.
    """
    if isinstance(value, np.ndarray):
        arrays[name] = value
        return name
    if is_dataclass(value):
        value = {each.name: getattr(value, each.name) for each in fields(value)}
    if isinstance(value, Mapping):
        return {key: packed(each, arrays, f"{name}.{key}") for key, each in value.items()}
    if isinstance(value, (tuple, list)):
        return [packed(each, arrays, f"{name}.{k}") for k, each in enumerate(value)]
    return value


def unpacked(kind: Any, stored: Any, arrays: Mapping[str, NDArray[Any]]) -> Any:  # noqa: ANN401
    """Return the value of a type that ``packed`` was given; sequences come back as tuples."""
    origin, inner = get_origin(kind), get_args(kind)
    # Why so: from NumPy 2.5 on it is no longer np.ndarray.
    if origin is get_origin(Floats):
        return arrays[stored]
    if origin is UnionType:
        return None if stored is None else unpacked(inner[0], stored, arrays)
    if isinstance(kind, type) and is_dataclass(kind):
        hints = get_type_hints(kind)
        return kind(
            **{
                key: unpacked(hints[key], each, arrays)
                for key, each in stored.items()
                # Why: an older dynid may have written more.
                if key in hints
            }
        )
    if origin is Mapping:
        return {key: unpacked(inner[1], each, arrays) for key, each in stored.items()}
    if origin in (tuple, Sequence):
        several = inner if origin is tuple and inner[1:] != (...,) else inner[:1] * len(stored)
        pairs = zip(several, stored, strict=True)
        return tuple(unpacked(each, value, arrays) for each, value in pairs)
    return stored
