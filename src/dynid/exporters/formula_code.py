"""Formulas of effects as source code, where positions, speeds and accelerations are all that they take."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dynid.model.effects.catalogue import Added
from dynid.model.effects.formula import FUNCTIONS, Formula, Node

#: Largest power that is written as a product.
LARGEST = 6


@dataclass(frozen=True)
class Spelling:
    """How a language spells what formulas are made of.

    Attributes:
        item: an element of an array, ``"q"``, ``"qd"`` or ``"qdd"``, of a joint from 0.
        sign: Coulomb sign of a joint.
        call: a function of one number, by its name.
        absolute: name of the absolute value.
    """

    item: Callable[[str, int], str]
    sign: Callable[[int], str]
    call: Callable[[str, str], str]
    absolute: str


def sayable(added: Added) -> bool:
    """Return whether an effect is a formula that takes no time and none of the arm's own torques."""
    effect = added.effect
    return isinstance(effect, Formula) and all(_sayable(node) for _, node in effect.terms)


def columns(added: Added, language: Spelling) -> list[tuple[int, str]]:
    """Return the joint and the value of each column of such a formula."""
    effect, (own,) = added.effect, added.joints
    assert isinstance(effect, Formula)
    return [(own, _written(node, own, language)) for _, node in effect.terms]


def _is_coulomb(node: Node) -> bool:
    return node.head == "sign" and node.parts[0].head == "signal" and node.parts[0].text == "qd"


def _sayable(node: Node) -> bool:
    known = {"number", "+", "*", "^", *FUNCTIONS} - {"sign"}
    here = node.head in known or (node.head == "signal" and node.text != "tau") or _is_coulomb(node)
    whole = node.head != "^" or (node.value.is_integer() and 0 < abs(node.value) <= LARGEST)
    return here and whole and all(_sayable(part) for part in node.parts)


def _written(node: Node, own: int, language: Spelling) -> str:
    """Return a node as an expression, in brackets where it is made of several."""
    if node.head == "number":
        return repr(node.value) if node.value >= 0 else f"({node.value!r})"
    if node.head == "signal":
        return language.item(node.text, node.joint - 1 if node.joint else own)
    if _is_coulomb(node):
        joint = node.parts[0].joint
        return f"({language.sign(joint - 1 if joint else own)})"
    parts = [_written(part, own, language) for part in node.parts]
    if node.head in ("+", "*"):
        return f"({f' {node.head} '.join(parts)})"
    if node.head == "^":
        power = f"({' * '.join(parts * abs(int(node.value)))})"
        return power if node.value > 0 else f"(1.0 / {power})"
    return language.call(language.absolute if node.head == "abs" else node.head, parts[0])
