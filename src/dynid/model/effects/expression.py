"""A torque in words: a sum of products over the motion, as in ``effect: formula`` of a robot file and in the catalogue.

The text is brought into Python's notation (``a cos(2 q4) |qd4|`` becomes ``a*cos(2*q4)*abs(qd4)``),
read by ``ast`` and made of a few kinds of nodes; anything else is refused and nothing is executed.

A name is a signal (``q4``, ``qd4``, ``qdd4``, ``tau4`` of joint 4, without a number of the joint that it acts on, and
``t``) or an amplitude, which is identified. Every term of the sum has one amplitude.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache, reduce
from typing import NoReturn

import numpy as np

from dynid.arrays import Floats
from dynid.errors import WrongRobotFile
from dynid.model.effects.friction import sign_of
from dynid.model.effects.motion import ArmMotion

FUNCTIONS: dict[str, Callable[[Floats], Floats]] = {
    name: getattr(np, name) for name in ("sin", "cos", "tanh", "exp", "sqrt", "abs", "sign")
}
FIX = "a sum of products such as 'a cos(2 q4) |qd4| + b tau4 qd4', see the reference of effects"
_TOKEN = re.compile(r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[A-Za-z_]\w*|[-+*/^(),|])")
_SIGNAL = re.compile(r"(tau|qdd|qd|q)([1-9]\d*)?")


@dataclass(frozen=True)
class Node:
    """A part of a formula.

    Attributes:
        head: ``number``, ``name``, ``signal``, ``t``, ``+``, ``*``, ``^`` or a function.
        parts: what it is made of.
        value: the number; of ``^`` the exponent.
        text: the name; of a signal its kind.
        joint: of a signal, from 1; 0 for the joint that the formula acts on.
    """

    head: str
    parts: tuple[Node, ...] = ()
    value: float = 0.0
    text: str = ""
    joint: int = 0

    def within(self) -> list[Node]:
        """Return it and all nodes in it."""
        return [self, *(node for part in self.parts for node in part.within())]

    def factors(self) -> list[Node]:
        """Return what its product is made of, itself where it is none."""
        return (
            [one for part in self.parts for one in part.factors()] if self.head == "*" else [self]
        )

    @property
    def coulomb(self) -> Node | None:
        """The velocity whose Coulomb sign it is, None where it is none."""
        return self.parts[0] if self.head == "sign" and self.parts[0].text == "qd" else None


def refuse(text: str, what: str) -> NoReturn:
    """Say what is wrong with a formula."""
    raise WrongRobotFile(f"formula '{text[:80]}': {what}", fix=FIX)


# ---------------------------------------------------------------- reading
@lru_cache(maxsize=1024)
def read(text: str) -> Node:
    """Return the node of a formula."""
    try:
        return _node(ast.parse(_python(text), mode="eval").body, text)
    except (SyntaxError, RecursionError, MemoryError):
        refuse(text, "it is not complete, or nested too deep")


def _python(text: str) -> str:
    """Return a formula in Python's notation: products, powers and absolute values written out."""
    words, place, ended, bars = list[str](), 0, False, 0
    while place < len(text):
        token = _TOKEN.match(text, place)
        if token is None:
            refuse(text, f"'{text[place:].strip()[:1]}' is not understood")
        word, place = token[1], token.end()
        opens = word == "(" or (word == "|" and not (bars and ended))
        if word == "|":
            bars += 1 if opens else -1
        starts = opens or word[0].isalnum() or word[0] in "._"
        function = word == "(" and bool(words) and words[-1] in FUNCTIONS
        if ended and starts and not function:
            words.append("*")
        words.append({"^": "**", "|": "abs(" if opens else ")"}.get(word, word))
        ended = not opens and word not in "+-*/^,"
    return " ".join(words)


def _node(tree: ast.expr, text: str) -> Node:
    """Return the node of a Python expression, if it is one of the few that a formula may hold."""
    minus = Node("number", value=-1.0)
    match tree:
        case ast.Constant(value=int() | float() as value):
            return Node("number", value=float(value))
        case ast.Name(id="t"):
            return Node("t")
        case ast.Name(id=name) if name not in FUNCTIONS:
            signal = _SIGNAL.fullmatch(name)
            if signal:
                return Node("signal", text=signal[1], joint=int(signal[2] or 0))
            return Node("name", text=name)
        case ast.UnaryOp(op=ast.USub(), operand=inner):
            return Node("*", (minus, _node(inner, text)))
        case ast.BinOp(left=left, op=ast.Pow(), right=right):
            powers = _node(right, text).factors()
            if any(one.head != "number" for one in powers):
                refuse(text, f"a number is missing instead of '{ast.unparse(right)}'")
            return Node("^", (_node(left, text),), math.prod(one.value for one in powers))
        case ast.BinOp(left=left, op=op, right=right) if type(op) in _JOINED:
            head, made = _JOINED[type(op)]
            first, second = _node(left, text), made(_node(right, text))
            flat = first.parts if first.head == head else (first,)
            return Node(head, (*flat, second))
        case ast.Call(func=ast.Name(id=name), args=[inner]) if name in FUNCTIONS:
            return Node(name, (_node(inner, text),))
    return refuse(text, f"'{ast.unparse(tree)}' is not expected")


#: Operators as sums and products: a difference adds the negative, a quotient multiplies the inverse.
_JOINED: dict[type[ast.operator], tuple[str, Callable[[Node], Node]]] = {
    ast.Add: ("+", lambda node: node),
    ast.Sub: ("+", lambda node: Node("*", (Node("number", value=-1.0), node))),
    ast.Mult: ("*", lambda node: node),
    ast.Div: ("*", lambda node: Node("^", (node,), -1.0)),
}


def formula_terms(text: str, joints: int) -> dict[str, Node]:
    """Return what each amplitude of a formula multiplies, for an arm with so many joints.

    Raises:
        WrongRobotFile: it is no formula, or of another arm.
    """
    tree, terms = read(text), dict[str, Node]()
    for node in tree.parts if tree.head == "+" else (tree,):
        factors = node.factors()
        names = [one.text for one in factors if one.head == "name"]
        if len(names) != 1 or sum(one.head == "name" for one in node.within()) != 1:
            refuse(text, "each term of the sum needs one amplitude, a name such as a, as a factor")
        if names[0] in terms:
            refuse(text, "two terms have the same amplitude")
        rest = tuple(one for one in factors if one.head != "name")
        terms[names[0]] = Node("*", rest) if rest else Node("number", value=1.0)
    last = max(node.joint for node in tree.within())
    if last > joints:
        refuse(text, f"the arm has no joint {last}")
    return terms


# ---------------------------------------------------------------- meaning
def value_of(node: Node, motion: ArmMotion, own: int) -> Floats:
    """Return the values of a node along a motion, (N,) or a number as (1,)."""
    if node.head == "number":
        return np.array([node.value])
    if node.head == "t":
        return motion.t
    if node.head in ("signal", "name"):
        values = getattr(motion, "rigid" if node.text == "tau" else node.text)
        return np.asarray(values[:, node.joint - 1 if node.joint else own])
    if speed := node.coulomb:
        return sign_of(motion, speed.joint - 1 if speed.joint else own)
    parts = [value_of(part, motion, own) for part in node.parts]
    if node.head == "^":
        return parts[0] ** node.value
    if node.head in FUNCTIONS:
        return FUNCTIONS[node.head](parts[0])
    return np.asarray(reduce(np.add if node.head == "+" else np.multiply, parts))
