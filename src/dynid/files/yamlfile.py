"""YAML with line numbers: every value knows where it stands, every mistake says so.

Reads one file into a tree of ``Value``; unknown and duplicate keys, text in the place of a number and missing keys
raise the errors of the catalogue with ``file:line``. What a mapping may hold is a table of readers by key.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from dynid.errors import DynidError, Finding, NotANumber, NotYaml, UnknownKey, WrongRobotFile
from dynid.options import MOST, number_or_nan
from dynid.text import closest
from dynid.units import ANGLE

if TYPE_CHECKING:
    from dynid.robot import Joint  # with NumPy: help takes a tenth of a second without it

#: Size of numbers other than 0, in whatever unit. Why so small: they are added, and CAD programs round to them; large
#: ones (``MOST``) are multiplied and squared many times in a model.
SMALLEST = 1e-30
#: Without zeros in front, which YAML reads as octal.
_NUMBER = re.compile(r"[-+]?((0|[1-9]\d*)(\.\d*)?|\.\d+)([eE][-+]?\d+)?")
_PI = re.compile(
    r"(?P<sign>[-+]?)\s*(?:(?P<factor>\d+(?:\.\d*)?)\s*\*\s*)?pi\s*(?:/\s*(?P<divisor>\d+(?:\.\d*)?))?"
)


@dataclass(frozen=True)
class Context:
    """What the meaning of a value depends on besides the value.

    Attributes:
        angle_unit: unit of plain numbers that are angles.
        joints: joints of the arm, () while they are read.
        revolute: whether the joint at hand is revolute.
        findings: what was noticed; reading appends to it.
    """

    angle_unit: str = "rad"
    joints: tuple[Joint, ...] = ()
    revolute: bool = True
    findings: list[Finding] = field(default_factory=list)


@dataclass(frozen=True)
class Value:
    """One value of a YAML file with its place.

    Attributes:
        node: node of the parsed file.
        file: the file's path, for messages.
        path: place in the tree, such as ``joints[2].d``.
        context: what its meaning depends on.
    """

    node: yaml.Node
    file: Path
    path: str = ""
    context: Context = field(default_factory=Context)

    @property
    def where(self) -> str:
        """File and line for messages."""
        return f"{self.file}:{self.node.start_mark.line + 1}"

    @property
    def is_null(self) -> bool:
        """Whether the value is empty or ``null``."""
        return bool(self.node.tag == "tag:yaml.org,2002:null")

    @property
    def is_list(self) -> bool:
        """Whether the value is a list."""
        return isinstance(self.node, yaml.SequenceNode)

    @property
    def is_mapping(self) -> bool:
        """Whether the value has keys."""
        return isinstance(self.node, yaml.MappingNode)

    def wrong(
        self, text: str, fix: str = "", kind: type[DynidError] = WrongRobotFile, **more: str
    ) -> DynidError:
        """Return the mistake that a value is, named by file, line and place."""
        what = f"{self.where}: {self.path or 'the file'}{text}"
        return kind(what, where=self.where, fix=fix, **more)

    def mapping(self, known: Sequence[str], required: Sequence[str] = ()) -> dict[str, Value]:
        """Return the values by key, after checking that all keys are known, once given, and the required ones there.

        Args:
            known: the keys that it may have.
            required: those that it must have.
        """
        if not self.is_mapping:
            raise self.wrong(f" must have keys ({', '.join(known)})")
        values = {}
        for key_node, node in self.node.value:
            key, line = str(key_node.value), f"{self.file}:{key_node.start_mark.line + 1}"
            if key in values:
                raise NotYaml(f"{line}: key '{key}' is given twice", where=line)
            if key not in known:
                fix = f"rename or remove it; {self.path or 'the file'} may have: {', '.join(known)}"
                raise UnknownKey(
                    f"{line}: unknown key '{key}'{closest(key, known)}", where=line, fix=fix
                )
            values[key] = replace(self, node=node, path=f"{self.path}.{key}".lstrip("."))
        for key in required:
            if key not in values:
                raise self.wrong(f" lacks the key '{key}'")
        return values

    def read(self, keys: Mapping[str, Reader], required: Sequence[str] = ()) -> dict[str, Any]:
        """Return the values of a mapping that are there, by key, each as its reader reads it; see ``mapping``."""
        values = self.mapping(list(keys), required)
        return {key: read(values[key]) for key, read in keys.items() if key in values}

    def note(self, code: str, text: str, **evidence: object) -> None:
        """Keep a warning, for ``Robot.findings``."""
        self.context.findings.append(Finding(code, "warning", text, evidence))

    def within(self, **facts: Any) -> Value:  # noqa: ANN401
        """Return the value in another context."""
        return replace(self, context=replace(self.context, **facts))

    def entries(self) -> dict[str, Value]:
        """Return the values of a mapping by key, whatever the keys are, each once; {} for anything else."""
        if not self.is_mapping:
            return {}
        return self.mapping([str(key.value) for key, _ in self.node.value])

    def items(self, length: int | None = None) -> list[Value]:
        """Return the values of a list, after checking its length."""
        if not self.is_list:
            raise self.wrong(" must be a list")
        nodes = self.node.value
        if length is not None and len(nodes) != length:
            raise self.wrong(f" has {len(nodes)} entries, expected {length}")
        return [replace(self, node=node, path=f"{self.path}[{i}]") for i, node in enumerate(nodes)]

    def text(self) -> str:
        """Return a text value."""
        if not isinstance(self.node, yaml.ScalarNode) or self.is_null:
            raise self.wrong(" must be a word")
        return str(self.node.value)

    def texts(self) -> tuple[str, ...]:
        """Return a list of text values, for which a single one may stand."""
        return tuple(item.text() for item in (self.items() if self.is_list else [self]))

    def choice(self, known: Sequence[str]) -> str:
        """Return a text value out of a few."""
        word = self.text()
        if word not in known:
            raise self.wrong(f" = '{word}' is none of {', '.join(known)}{closest(word, known)}")
        return word

    def flag(self) -> bool:
        """Return true or false."""
        if self.node.tag != "tag:yaml.org,2002:bool":
            raise self.wrong(" must be true or false")
        return self.text().lower() in ("true", "yes", "on")

    def number(self) -> float:
        """Return a finite number."""
        raw = self._raw()
        if self.node.tag == "tag:yaml.org,2002:str" or not _NUMBER.fullmatch(raw):
            # What is meant, in whatever notation.
            meant = number_or_nan(raw.replace(",", "."))
            advice = f"is not read as that number by YAML; write {meant!r}"
            advice = advice if math.isfinite(meant) else "is not a number"
            raise self.wrong(f" = '{raw}' {advice}", kind=NotANumber)
        return self._checked(float(raw))

    def integer(self) -> int:
        """Return a whole number."""
        value = self.number()
        if value != int(value):
            raise self.wrong(f" = {value} must be a whole number", kind=NotANumber)
        return int(value)

    def angle(self) -> float:
        """Return an angle in rad; plain numbers are in the file's unit, ``pi/2`` and ``90 deg`` mean what they say."""
        raw = self._raw().strip()
        if match := _PI.fullmatch(raw):
            divisor = float(match["divisor"] or 1)
            value = math.pi * float(match["factor"] or 1) / divisor if divisor else math.inf
            return self._checked(-value if match["sign"] == "-" else value)
        for tag, factor in ANGLE.items():
            number = raw.removesuffix(tag).strip()
            if raw.endswith(tag) and _NUMBER.fullmatch(number):
                return self._checked(float(number) * factor)
        return self._checked(self.number() * ANGLE[self.context.angle_unit])

    def _raw(self) -> str:
        if not isinstance(self.node, yaml.ScalarNode):
            raise self.wrong(" must be one number", kind=NotANumber)
        return str(self.node.value)

    def _checked(self, value: float) -> float:
        if value and not SMALLEST <= abs(value) <= MOST:
            raise self.wrong(
                f" = '{self._raw()[:40]}' is not finite, or beyond what can be measured",
                "write 0, or correct the number",
                NotANumber,
                why=f"numbers other than 0 must lie between {SMALLEST:g} and {MOST:g}",
            )
        return value


#: What makes a value from its place in a file, or says what is wrong there.
Reader = Callable[[Value], Any]


def read_yaml(path: Path) -> Value:
    """Read a YAML file.

    Raises:
        NotYaml: it is not valid YAML or not text.
        OSError: it cannot be opened.
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
        raise NotYaml(f"{path} is not a text file", where=path) from error


def parse_yaml(text: str, path: Path) -> Value:
    """Parse YAML text that came from ``path``."""
    where, problem = str(path), " is empty"
    node = None
    try:
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except RecursionError:
        problem = ": lists and keys are nested too deep"
    except yaml.YAMLError as error:
        if mark := getattr(error, "problem_mark", None):
            where = f"{path}:{mark.line + 1}"
        hint = "; a tab is not allowed, indent with spaces" if "'\\t'" in str(error) else ""
        problem = f": not YAML: {getattr(error, 'problem', error)}{hint}"
    if node is None:
        raise NotYaml(f"{where}{problem}", where=where)
    return Value(node, path)
