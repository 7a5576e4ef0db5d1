"""A torque in words of its own: ``effect: formula``, a sum of products over the motion, read by a parser of its own.

    formula  = [-] term {(+ | -) term}
    term     = factor {[* | /] factor}
    factor   = atom [^ number]
    atom     = number | name | function ( formula {, number} ) | ( formula ) | "|" formula "|"

A name is a signal (``q4``, ``qd4``, ``qdd4``, ``tau4`` of joint 4, without a number of the joint that it acts on, and
``t``) or an amplitude, which is identified. Every term of the sum has one amplitude; nothing in the text is executed.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from dynid.errors import WrongRobotFile
from dynid.model.effects.friction import sign_of
from dynid.model.effects.interface import ArmMotion, Effect, Floats, Joints, Shape

#: Longest text, and deepest nesting: a formula that people read is shorter.
LONGEST, DEEPEST = 1000, 20
FUNCTIONS: dict[str, Callable[[Floats], Floats]] = {
    "sin": np.sin,
    "cos": np.cos,
    "tanh": np.tanh,
    "exp": np.exp,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "sign": np.sign,
}
FIX = "a sum of products such as 'a cos(2 q4) |qd4| + b tau4 qd4', see the reference of effects"
_TOKEN = re.compile(
    r"\s*(?:(?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)|(?P<name>[A-Za-z_]\w*)|(?P<sign>[-+*/^(),|]))"
)
_SIGNAL = re.compile(r"(tau|qdd|qd|q)(\d*)")


@dataclass(frozen=True)
class Node:
    """A part of a formula.

    Attributes:
        head: ``number``, ``name``, ``signal``, ``t``, ``+``, ``*``, ``^``, ``clip`` or a function.
        parts: what it is made of.
        value: the number; of ``^`` the exponent, of ``clip`` the limit.
        text: the name; of a signal its kind.
        joint: of a signal, from 1; 0 for the joint that the formula acts on.
    """

    head: str
    parts: tuple[Node, ...] = ()
    value: float = 0.0
    text: str = ""
    joint: int = 0

    def names(self) -> list[str]:
        """Return the amplitudes in it, one for each place."""
        found = [self.text] if self.head == "name" else []
        return found + [name for part in self.parts for name in part.names()]

    def signals(self) -> set[tuple[str, int]]:
        """Return the signals in it, (kind, joint from 1)."""
        found = {(self.text, self.joint)} if self.head == "signal" else set()
        return found.union(*(part.signals() for part in self.parts))


class Formula(Effect):
    """A torque by a formula of the robot file.

    Args:
        text: the formula.
        revolute: which joints of the arm turn.
        joint: the one that it acts on, 0-based.

    Raises:
        WrongRobotFile: it is no formula, or of another arm.
    """

    name = "formula"
    title = "formula, not in the catalogue"
    equation = "a sum of products of signals"
    signature = "what the formula says"
    separate = "motion in which its factors vary one by one"
    needs_model = True

    def __init__(self, text: str, revolute: Sequence[bool], joint: int = 0) -> None:
        self.text, self.revolute, self.joint = " ".join(text.split()), tuple(revolute), joint
        self.terms = tuple(_term(node, self.text) for node in _summands(_Parser(self.text).whole()))
        names = [name for name, _ in self.terms]
        if len(set(names)) < len(names):
            _refuse(self.text, "two terms have the same amplitude")
        beyond = [
            joint
            for _, node in self.terms
            for _, joint in node.signals()
            if joint > len(self.revolute)
        ]
        if beyond:
            _refuse(self.text, f"the arm has no joint {beyond[0]}")

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the amplitudes."""
        torque = "N m" if self.revolute[self.joint] else "N"
        return {
            name: _unit(torque, _dimension(node, self.revolute, self.joint))
            for name, node in self.terms
        }

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N)."""
        with np.errstate(all="ignore"):
            values = np.array(
                [
                    np.broadcast_to(_value(node, motion, joints[0]), len(motion))
                    for _, node in self.terms
                ]
            )
        if not np.all(np.isfinite(values)):
            _refuse(self.text, "it is not finite along this motion")
        return values[:, None]


def formula_text(terms: Sequence[str]) -> str:
    """Return the formula of products that are written without amplitudes: a, b, c ... before each."""
    return " + ".join(
        f"{name} {term}".strip() for name, term in zip("abcdefgh", terms, strict=False)
    )


def _refuse(text: str, what: str) -> NoReturn:
    raise WrongRobotFile(f"formula '{text[:80]}': {what}", fix=FIX)


# ---------------------------------------------------------------- reading
class _Parser:
    """Reads one formula by recursive descent."""

    def __init__(self, text: str) -> None:
        self.text, self.at, self.depth = text, 0, 0
        if len(text) > LONGEST:
            _refuse(text, f"it is longer than {LONGEST} characters")
        self.tokens: list[tuple[str, str]] = []
        place = 0
        while place < len(text.rstrip()):
            found = _TOKEN.match(text, place)
            if found is None:
                _refuse(text, f"'{text[place:].strip()[:1]}' is not understood")
            self.tokens.append((str(found.lastgroup), found[str(found.lastgroup)]))
            place = found.end()

    def whole(self) -> Node:
        """Return the formula."""
        node = self._sum(bars=False)
        if self.at < len(self.tokens):
            _refuse(self.text, f"'{self.tokens[self.at][1]}' is not expected")
        return node

    def _next(self) -> str:
        return self.tokens[self.at][1] if self.at < len(self.tokens) else ""

    def _take(self, wanted: str) -> bool:
        found = self._next() == wanted
        self.at += found
        return found

    def _demand(self, wanted: str) -> None:
        if not self._take(wanted):
            _refuse(self.text, f"'{wanted}' is missing before '{self._next() or 'the end'}'")

    def _sum(self, *, bars: bool) -> Node:
        self.depth += 1
        if self.depth > DEEPEST:
            _refuse(self.text, f"it is nested deeper than {DEEPEST}")
        parts = [self._signed(self._take("-"), bars=bars)]
        while self._next() in ("+", "-"):
            negative = self._take("-")
            self.at += not negative
            parts.append(self._signed(negative, bars=bars))
        self.depth -= 1
        return parts[0] if len(parts) == 1 else Node("+", tuple(parts))

    def _signed(self, negative: bool, *, bars: bool) -> Node:
        node = self._product(bars=bars)
        return Node("*", (Node("number", value=-1.0), node)) if negative else node

    def _product(self, *, bars: bool) -> Node:
        parts = [self._factor(bars=bars)]
        while self._next() not in ("", "+", "-", ")", ",") and not (bars and self._next() == "|"):
            over = self._take("/")
            self.at += not over and self._next() == "*"
            factor = self._factor(bars=bars)
            parts.append(Node("^", (factor,), -1.0) if over else factor)
        return parts[0] if len(parts) == 1 else Node("*", tuple(parts))

    def _factor(self, *, bars: bool) -> Node:
        node = self._atom(bars=bars)
        if not self._take("^"):
            return node
        negative = self._take("-")
        return Node("^", (node,), -self._number() if negative else self._number())

    def _number(self) -> float:
        kind, text = self.tokens[self.at] if self.at < len(self.tokens) else ("", "the end")
        if kind != "number":
            _refuse(self.text, f"a number is missing before '{text}'")
        self.at += 1
        return float(text)

    def _atom(self, *, bars: bool) -> Node:
        kind, text = self.tokens[self.at] if self.at < len(self.tokens) else ("", "the end")
        if kind == "number":
            return Node("number", value=self._number())
        self.at += 1
        if kind == "name":
            return self._named(text)
        if text == "(":
            node = self._sum(bars=False)
            self._demand(")")
            return node
        if text == "|" and not bars:
            node = Node("abs", (self._sum(bars=True),))
            self._demand("|")
            return node
        return _refuse(self.text, f"'{text}' is not expected")

    def _named(self, text: str) -> Node:
        if text in FUNCTIONS or text == "clip":
            self._demand("(")
            inner, limit = self._sum(bars=False), 0.0
            if text == "clip":
                self._demand(",")
                limit = self._number()
            self._demand(")")
            return Node(text, (inner,), limit)
        signal = _SIGNAL.fullmatch(text)
        if signal and signal[2] != "0":
            return Node("signal", text=signal[1], joint=int(signal[2] or 0))
        return Node("t") if text == "t" else Node("name", text=text)


def _summands(node: Node) -> tuple[Node, ...]:
    return node.parts if node.head == "+" else (node,)


def _term(node: Node, text: str) -> tuple[str, Node]:
    """Return the amplitude of a term and what it multiplies."""
    factors = _factors(node)
    names = [one.text for one in factors if one.head == "name"]
    if len(names) != 1 or len(node.names()) != 1:
        _refuse(text, "each term of the sum needs one amplitude, a name such as a, as a factor")
    rest = tuple(one for one in factors if one.head != "name")
    return names[0], Node("*", rest) if rest else Node("number", value=1.0)


def _factors(node: Node) -> tuple[Node, ...]:
    return (
        tuple(one for part in node.parts for one in _factors(part)) if node.head == "*" else (node,)
    )


# ---------------------------------------------------------------- meaning
def _value(node: Node, motion: ArmMotion, own: int) -> Floats:
    """Return the values of a node along a motion, (N,) or a number as (1,)."""
    if node.head == "number":
        return np.array([node.value])
    if node.head == "t":
        return motion.t
    if node.head == "signal":
        values = motion.rigid if node.text == "tau" else getattr(motion, node.text)
        return np.asarray(values[:, node.joint - 1 if node.joint else own])
    inner = node.parts[0]
    if node.head == "sign" and inner.head == "signal" and inner.text == "qd":
        return sign_of(motion, inner.joint - 1 if inner.joint else own)
    parts = [_value(part, motion, own) for part in node.parts]
    if node.head == "+":
        return np.asarray(sum(parts))
    if node.head == "*":
        product = parts[0]
        for part in parts[1:]:
            product = product * part
        return product
    if node.head == "^":
        return np.asarray(parts[0] ** node.value)
    return (
        np.clip(parts[0], -node.value, node.value)
        if node.head == "clip"
        else FUNCTIONS[node.head](parts[0])
    )


#: Exponents of N m (or N), rad (or m) and s.
_OF = {"q": (0, 1, 0), "qd": (0, 1, -1), "qdd": (0, 1, -2), "tau": (1, 0, 0)}


def _dimension(node: Node, revolute: Sequence[bool], own: int) -> dict[str, float]:
    """Return the exponents of the units of a node; sums have that of their first part."""
    if node.head == "t":
        return {"s": 1.0}
    if node.head == "signal":
        turns = revolute[node.joint - 1 if node.joint else own]
        units = ("N m", "rad", "s") if turns else ("N", "m", "s")
        return {
            name: float(power) for name, power in zip(units, _OF[node.text], strict=True) if power
        }
    inner = [_dimension(part, revolute, own) for part in node.parts]
    if node.head == "*":
        names = tuple(dict.fromkeys(name for part in inner for name in part))
        return {name: sum(part.get(name, 0.0) for part in inner) for name in names}
    if node.head == "^":
        return {name: power * node.value for name, power in inner[0].items()}
    return inner[0] if node.head in ("+", "abs", "clip") else {}


def _unit(torque: str, dimension: dict[str, float]) -> str:
    """Return the unit of an amplitude whose factor has a dimension, such as N m s/rad."""
    left = {torque: 1.0}
    for name, power in dimension.items():
        left[name] = left.get(name, 0.0) - power
    over = [_power(name, power) for name, power in left.items() if power > 0]
    under = [_power(name, -power) for name, power in left.items() if power < 0]
    if not under:
        return " ".join(over)
    below = under[0] if len(under) == 1 else f"({' '.join(under)})"
    return f"{' '.join(over) or '1'}/{below}"


def _power(name: str, power: float) -> str:
    return name if power == 1 else f"({name})^{power:g}" if " " in name else f"{name}^{power:g}"
