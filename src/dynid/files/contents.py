"""What each kind of result holds: the facts of its header and its arrays, declared once and asked where it is read.

A result may come from somebody else, or from a program that changed it. What the code behind a reader takes for granted
(types, shapes that agree, ranges, order) is therefore said in a table beside the reader, and never asked anywhere else.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from functools import cache
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.scratch import spans

#: Numbers beyond this are not measured, counted or computed by anybody: those of a header, and those of arrays, of
#: which five may be multiplied.
_LARGEST, LARGEST = 1e150, 1e60
#: Limits of sizes that several kinds of results have, by their names in the tables.
_LIMITS = {"N": "samples", "T": "motion_samples", "n": "joints", "B": "obstacles"}
_SIZE = re.compile(r"([A-Za-z]+)(?:\+(\d+))?")


@dataclass(frozen=True)
class Fact:
    """What the header says under a key.

    Attributes:
        kind: type of the value, such as ``list[str]``; a dataclass stands for a mapping with its fields.
        size: name of the number of its entries; "" where that is free.
        least: smallest number in it; infinity and NaN pass only where neither bound is given.
        most: largest number.
        needed: whether it must be there.
    """

    kind: Any
    size: str = ""
    least: float | None = None
    most: float | None = None
    needed: bool = True


@dataclass(frozen=True)
class Array:
    """What an array holds.

    Attributes:
        shape: sizes by name, such as ``"N n"``, ``"p+1"`` or ``"3"``; ``"n?"`` may also be 0, ``"_"`` is any size.
        kind: type of its numbers.
        gaps: whether NaN may stand for what is not known.
        endless: whether infinity may.
        least: smallest number.
        most: largest number.
        rising: whether each number is larger than the one before.
        needed: whether it must be there.
    """

    shape: str
    kind: Any = np.float64
    gaps: bool = False
    endless: bool = False
    least: float = -LARGEST
    most: float = LARGEST
    rising: bool = False
    needed: bool = True


@dataclass(frozen=True)
class Contents:
    """What a kind of result holds.

    Attributes:
        schema: name and number, such as ``"dynid/regressor/1"``.
        facts: of the header, by their places: ``"result.rank"``; ``*`` stands for every entry of a list or mapping.
        arrays: by name; ``*`` stands for a number, and a size that ends in it belongs to that number.
    """

    schema: str
    facts: Mapping[str, Fact] = field(default_factory=dict)
    arrays: Mapping[str, Array] = field(default_factory=dict)

    def require(
        self, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]], where: Path | str
    ) -> None:
        """Raise when a result holds something else than its table says.

        Args:
            header: facts.
            arrays: by name.
            where: the file.

        Raises:
            TooLarge: it has more samples or joints than the limit.
            KeyError: something is missing.
            TypeError: a fact is of another kind.
            ValueError: a number is out of its range, or sizes contradict each other.
        """
        sizes: dict[str, int] = {}
        for place, fact in self.facts.items():
            for value in _values(header, place.split("."), fact.needed):
                if fault := _fault(value, fact.kind, place):
                    raise TypeError(fault)
                if fact.size:
                    _agree(sizes, fact.size, len(value), place)
                if fact.least is not None or fact.most is not None:
                    _require_range(value, fact, place)
        for pattern, declared in self.arrays.items():
            for name, number in _named(pattern, arrays, declared.needed):
                _require_array(arrays[name], declared, name, number, sizes)
        for name, limit in _LIMITS.items():
            limits.check(limit, sizes.get(name, 0), where)


def _values(node: Any, words: list[str], needed: bool) -> Iterator[Any]:  # noqa: ANN401
    """Yield what a header holds at a place."""
    if not words:
        yield node
    elif words[0] == "*":
        for each in node.values() if isinstance(node, Mapping) else node:
            yield from _values(each, words[1:], needed)
    elif not isinstance(node, Mapping):
        raise TypeError(f"'{words[0]}' is looked for in {node!r:.60}, which has no keys")
    elif needed or words[0] in node:
        yield from _values(node[words[0]], words[1:], needed)


def _agree(sizes: dict[str, int], name: str, size: int, where: str) -> None:
    """Note a size that is met for the first time; raise when it is another one than before."""
    if sizes.setdefault(name, size) != size:
        raise ValueError(f"'{where}' has {size} entries, expected {sizes[name]}")


def _require_range(value: Any, fact: Fact, place: str) -> None:  # noqa: ANN401
    for number in value if isinstance(value, list) else [value]:
        if number is None:
            continue
        low = -_LARGEST if fact.least is None else fact.least
        high = _LARGEST if fact.most is None else fact.most
        if not low <= number <= high:
            raise ValueError(f"'{place}' is {number:g}; it must lie between {low:g} and {high:g}")


def _named(
    pattern: str, arrays: Mapping[str, NDArray[Any]], needed: bool
) -> Iterator[tuple[str, str]]:
    """Yield the names of arrays that a pattern stands for, and their numbers."""
    if "*" in pattern:
        expression = re.compile(re.escape(pattern).replace(r"\*", r"(\d{1,4})"))
        yield from ((name, match[1]) for name in arrays if (match := expression.fullmatch(name)))
    elif needed or pattern in arrays:
        yield pattern, ""


def _require_array(
    array: NDArray[Any], declared: Array, name: str, number: str, sizes: dict[str, int]
) -> None:
    wanted = declared.shape.split()
    if array.ndim == len(wanted):
        for word, size in zip(wanted, array.shape, strict=True):
            match = _SIZE.fullmatch(word.rstrip("?").replace("*", ""))
            if match is not None and not (size == 0 and word.endswith("?")):
                key = match[1] + (number if "*" in word else "")
                _agree(sizes, key, size - int(match[2] or 0), name)
    shape = tuple(
        int(word) if word.isdigit() else size
        for word, size in zip(wanted, (*array.shape, *[0] * len(wanted)), strict=False)
    )
    require_numbers(
        shape, declared.kind, gaps=declared.gaps, endless=declared.endless, **{name: array}
    )
    if declared.kind is np.bool_:
        return
    for part in (
        array[some].astype(np.float64, copy=False) for some in spans(len(array) if shape else 0)
    ):
        if np.any(part < declared.least) or np.any(part > declared.most):
            raise ValueError(f"'{name}' must lie between {declared.least:g} and {declared.most:g}")
    if declared.rising and not all(
        np.all(np.diff(array[max(0, some.start - 1) : some.stop]) > 0) for some in spans(len(array))
    ):
        raise ValueError(f"the values of '{name}' do not increase")


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
            raise ValueError(
                f"'{name}' is {array.dtype} {array.shape}, expected {kind.__name__} {shape}"
            )
        for part in (array[some] for some in spans(len(array) if shape else 0)):
            size = np.abs(part.astype(np.float64, copy=False))
            known = (size < LARGEST) | (gaps & np.isnan(part)) | (endless & np.isinf(size))
            if not known.all():
                raise ValueError(
                    f"'{name}' holds numbers that are not finite, or larger than {LARGEST:g}"
                )


# ---------------------------------------------------------------- types of facts
def _fault(value: Any, kind: Any, place: str) -> str:  # noqa: ANN401
    """Return what a value of JSON has of another type than it should, and where; "" when it is of that type."""
    parts: list[tuple[Any, Any, str]] | None
    if get_origin(kind) in (Union, UnionType):
        parts = [] if any(not _fault(value, one, place) for one in get_args(kind)) else None
    elif get_origin(kind) in (list, tuple, dict) or is_dataclass(kind):
        parts = _parts(value, kind, place)
    else:
        parts = [] if _is(value, kind) else None
    if parts is None:
        return f"'{place}' is {value!r:.60}, expected {_words(kind)}"
    return next(filter(None, (_fault(*part) for part in parts)), "")


def _parts(value: Any, kind: Any, place: str) -> list[tuple[Any, Any, str]] | None:  # noqa: ANN401
    """Return the values in a list or mapping with their types and places; None when it is not of the type."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (list, tuple) and isinstance(value, list):
        kinds = inner if origin is tuple and Ellipsis not in inner else inner[:1] * len(value)
        if len(kinds) == len(value):
            return [
                (item, each, f"{place}[{k}]")
                for k, (item, each) in enumerate(zip(value, kinds, strict=True))
            ]
    elif origin is dict and isinstance(value, Mapping):
        return [(item, inner[1], f"{place}.{key}") for key, item in value.items()]
    elif origin is None and isinstance(value, Mapping):
        known = _fields(kind)
        if set(value) <= set(known) and all(
            key in value for key, (_, needed) in known.items() if needed
        ):
            return [(item, known[key][0], f"{place}.{key}") for key, item in value.items()]
    return None


def _is(value: Any, kind: Any) -> bool:  # noqa: ANN401
    """Return whether a value that holds no others is of a type."""
    if kind in (int, float):
        if isinstance(value, bool) or not isinstance(value, (int, float) if kind is float else int):
            return False
        # Why endless ones pass: NaN and infinity are written for what is not known.
        return -_LARGEST < value < _LARGEST or (
            isinstance(value, float) and not math.isfinite(value)
        )
    if get_origin(kind) is Literal:
        return isinstance(value, str) and value in get_args(kind)
    return kind is Any or isinstance(value, kind)


@cache
def _fields(kind: type[Any]) -> dict[str, tuple[Any, bool]]:
    """Return type of each field of a dataclass, and whether it has to be given."""
    hints = get_type_hints(kind)
    missing = {
        each.name: each.default is MISSING and each.default_factory is MISSING
        for each in fields(kind)
    }
    return {name: (hints[name], needed) for name, needed in missing.items()}


def _words(kind: Any) -> str:  # noqa: ANN401
    """Return a type as a person calls it."""
    origin, inner = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return " or ".join(map(_words, inner))
    if origin is Literal:
        return " or ".join(map(repr, inner))
    if origin is tuple and Ellipsis not in inner:
        return f"a list of {len(inner)}: {', '.join(map(_words, inner))}"
    if origin in (list, tuple):
        return f"a list, each entry {_words(inner[0])}"
    if is_dataclass(kind) and isinstance(kind, type):
        return f"a mapping with the keys {', '.join(_fields(kind))}"
    names = {
        str: "text",
        int: "a whole number",
        float: "a number",
        bool: "true or false",
        NoneType: "null",
    }
    return names.get(kind, "a mapping")
