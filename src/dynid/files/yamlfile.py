"""YAML with line numbers: every value knows where it stands, every mistake says so.

Reads one file into a tree of ``Value``; unknown and duplicate keys, text in the place of a number and missing keys
raise the errors of the catalogue with ``file:line``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from dynid.errors import DynidError, NotANumber, NotYaml, UnknownKey, WrongRobotFile
from dynid.text import closest
from dynid.units import ANGLE

#: Sizes of numbers other than 0, in whatever unit. Large ones are multiplied and squared many times in a model; small
#: ones are added, and CAD programs round to them.
SMALLEST, LARGEST = 1e-30, 1e12
_NUMBER = re.compile(r"[-+]?(\d+(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
_NOT_TEXT = re.compile("[\\0\ud800-\udfff]")
_OCTAL = re.compile(r"[-+]?0\d+")
_PI = re.compile(
    r"(?P<sign>[-+]?)\s*(?:(?P<factor>\d+(?:\.\d*)?)\s*\*\s*)?pi\s*(?:/\s*(?P<divisor>\d+(?:\.\d*)?))?"
)


@dataclass(frozen=True)
class Value:
    """One value of a YAML file with its place.

    Attributes:
        node: node of the parsed file.
        file: the file's path, for messages.
        path: place in the tree, such as ``joints[2].d``.
    """

    node: yaml.Node
    file: Path
    path: str

    @property
    def where(self) -> str:
        """File and line for messages."""
        return f"{self.file}:{self.node.start_mark.line + 1}"

    @property
    def is_null(self) -> bool:
        """Whether the value is empty or ``null``."""
        return isinstance(self.node, yaml.ScalarNode) and self.node.tag == "tag:yaml.org,2002:null"

    @property
    def is_list(self) -> bool:
        """Whether the value is a list."""
        return isinstance(self.node, yaml.SequenceNode)

    @property
    def is_mapping(self) -> bool:
        """Whether the value has keys."""
        return isinstance(self.node, yaml.MappingNode)

    def mapping(self, known: Sequence[str], required: Sequence[str] = ()) -> dict[str, Value]:
        """Return the values by key, after checking that all keys are known, once given, and the required ones there."""
        if not isinstance(self.node, yaml.MappingNode):
            raise WrongRobotFile(
                f"{self.path or 'the file'} must have keys ({', '.join(known)})", where=self.where
            )
        found: dict[str, Value] = {}
        for key_node, value_node in self.node.value:
            key, line = str(key_node.value), f"{self.file}:{key_node.start_mark.line + 1}"
            if key in found:
                raise NotYaml(f"{line}: key '{key}' is given twice", where=line)
            if key not in known:
                fix = f"rename or remove it; {self.path or 'the file'} may have: {', '.join(known)}"
                raise UnknownKey(
                    f"{line}: unknown key '{key}'{closest(key, known)}", where=line, fix=fix
                )
            found[key] = Value(value_node, self.file, f"{self.path}.{key}" if self.path else key)
        for key in required:
            if key not in found:
                raise WrongRobotFile(
                    f"{self.where}: {self.path or 'the file'} lacks the key '{key}'",
                    where=self.where,
                )
        return found

    def entries(self) -> dict[str, Value]:
        """Return the values of a mapping by key, whatever the keys are, each once; {} for anything else."""
        return (
            self.mapping([str(key.value) for key, _ in self.node.value]) if self.is_mapping else {}
        )

    def items(self, length: int | None = None) -> list[Value]:
        """Return the values of a list, after checking its length."""
        if not isinstance(self.node, yaml.SequenceNode):
            raise WrongRobotFile(f"{self.where}: {self.path} must be a list", where=self.where)
        values = [
            Value(node, self.file, f"{self.path}[{i}]") for i, node in enumerate(self.node.value)
        ]
        if length is not None and len(values) != length:
            raise WrongRobotFile(
                f"{self.where}: {self.path} has {len(values)} entries, expected {length}",
                where=self.where,
            )
        return values

    def text(self) -> str:
        """Return a text value."""
        if not isinstance(self.node, yaml.ScalarNode) or self.is_null:
            raise WrongRobotFile(f"{self.where}: {self.path} must be a word", where=self.where)
        found = str(self.node.value)
        # Why: no name of a file holds them, and what writes or opens one raises what nobody expects.
        if _NOT_TEXT.search(found):
            raise WrongRobotFile(
                f"{self.where}: {self.path} contains an invalid character", where=self.where
            )
        return found

    def choice(self, known: Sequence[str]) -> str:
        """Return a text value out of a few."""
        word = self.text()
        if word not in known:
            raise WrongRobotFile(
                f"{self.where}: {self.path} = '{word}' is none of {', '.join(known)}{closest(word, known)}",
                where=self.where,
            )
        return word

    def flag(self) -> bool:
        """Return true or false."""
        if isinstance(self.node, yaml.ScalarNode) and self.node.tag == "tag:yaml.org,2002:bool":
            return str(self.node.value).lower() in ("true", "yes", "on")
        raise WrongRobotFile(f"{self.where}: {self.path} must be true or false", where=self.where)

    def number(self) -> float:
        """Return a finite number."""
        return self._checked(self._plain(), self._raw())

    def integer(self) -> int:
        """Return a whole number."""
        value = self.number()
        if value != int(value):
            raise NotANumber(
                f"{self.where}: {self.path} = {value} must be a whole number", where=self.where
            )
        return int(value)

    def angle(self, unit: str) -> float:
        """Return an angle in rad; plain numbers are in ``unit``, ``pi/2`` and ``90 deg`` are understood as they say."""
        raw = self._raw()
        match = _PI.fullmatch(raw.strip())
        if match:
            divisor = float(match["divisor"] or 1)
            value = math.pi * float(match["factor"] or 1) / divisor if divisor else math.inf
            return self._checked(-value if match["sign"] == "-" else value, raw)
        for tag, factor in ANGLE.items():
            number = raw.strip().removesuffix(tag).strip()
            if raw.strip().endswith(tag) and _NUMBER.fullmatch(number):
                return self._checked(float(number) * factor, raw)
        return self._checked(self._plain() * ANGLE[unit], raw)

    def _raw(self) -> str:
        if not isinstance(self.node, yaml.ScalarNode):
            raise NotANumber(f"{self.where}: {self.path} must be one number", where=self.where)
        return str(self.node.value)

    def _plain(self) -> float:
        raw = self._raw()
        if (
            _OCTAL.fullmatch(raw)
            or not _NUMBER.fullmatch(raw)
            or self.node.tag == "tag:yaml.org,2002:str"
        ):
            raise NotANumber(
                f"{self.where}: {self.path} = '{raw}' {_number_advice(raw)}", where=self.where
            )
        return float(raw)

    def _checked(self, value: float, raw: str) -> float:
        if not math.isfinite(value):
            raise NotANumber(f"{self.where}: {self.path} = '{raw}' is not finite", where=self.where)
        if value and not SMALLEST <= abs(value) <= LARGEST:
            raise NotANumber(
                f"{self.where}: {self.path} = '{raw[:40]}' is beyond what can be measured",
                where=self.where,
                why=f"numbers other than 0 must lie between {SMALLEST:g} and {LARGEST:g}",
                fix="write 0, or correct the number",
            )
        return value


def _number_advice(raw: str) -> str:
    """Say what to write for a text that was meant as a number."""
    if re.fullmatch(r"[-+]?\d+[eE][-+]?\d+", raw):
        mantissa, exponent = re.split("[eE]", raw)
        return f"is text in YAML; write {mantissa}.0e{exponent}"
    if re.fullmatch(r"[-+]?\d+,\d+", raw):
        return f"is text; write {raw.replace(',', '.')}"
    if re.fullmatch(r"[-+]?\d+:\d+", raw):
        return "is a base-60 number in YAML; write it in degrees or radians"
    if _OCTAL.fullmatch(raw):
        return f"is octal in YAML; write {raw.lstrip('0') or '0'}"
    if _NUMBER.fullmatch(raw):
        return f"is text in YAML; write {float(raw)!r} without quotes"
    return "is not a number"


def read_yaml(path: Path) -> Value:
    """Read a YAML file.

    Args:
        path: the file.

    Raises:
        NotYaml: it is not valid YAML or not text.
        DynidError: it cannot be opened.
    """
    return parse_yaml(read_text(path), path)


def read_text(path: Path) -> str:
    """Return the text of a YAML file.

    Raises:
        NotYaml: it is not text.
        OSError: it cannot be opened.
    """
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise NotYaml(f"{path} is not a text file", where=str(path)) from error


def parse_yaml(text: str, path: Path) -> Value:
    """Parse YAML text that came from ``path``."""
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except RecursionError:
        raise NotYaml(f"{path}: lists and keys are nested too deep", where=str(path)) from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark
        line = f"{path}:{mark.line + 1}" if mark else str(path)
        hint = "; a tab is not allowed, indent with spaces" if "'\\t'" in str(error) else ""
        raise NotYaml(f"{line}: not YAML: {error.problem}{hint}", where=line) from error
    except yaml.YAMLError as error:
        raise NotYaml(f"{path}: not YAML: {error}", where=str(path)) from error
    if node is None:
        raise NotYaml(f"{path} is empty", where=str(path))
    return Value(node, path, "")


__all__ = ["DynidError", "Value", "parse_yaml", "read_yaml"]
