"""Formulas of effects as source code: the closed forms of the catalogue, and those of a robot file."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from dynid.exporters.closed_forms import coulomb_sign_of
from dynid.model.effects.formula import Node

#: Largest power that is written as a product.
LARGEST = 6


@dataclass(frozen=True)
class Spelling:
    """How a language spells what formulas are made of.

    Attributes:
        item: an element of an array, ``"q"``, ``"qd"``, ``"qdd"``, ``"tau"`` or ``"total"``, of a joint from 0.
        sign: Coulomb sign of a joint.
        call: a function of one number, by its name.
        absolute: name of the absolute value.
        power: a number to the power of another one, with {x} and {p}.
        plain_sign: sign of a number, with {x}.
        time: time since the start, where it is kept.
        bristle: deflection of a bristle of a joint from 0 and of a length, where it is kept.
    """

    item: Callable[[str, int], str]
    sign: Callable[[int], str]
    call: Callable[[str, str], str]
    absolute: str
    power: str
    plain_sign: str
    time: str = ""
    bristle: Callable[[int, float], str] | None = None


def written(node: Node, language: Spelling) -> str:
    """Return a formula whose signals say their joints as an expression, in brackets where it is made of several."""
    coulomb = coulomb_sign_of(node)
    if coulomb is not None:
        return f"({language.sign(coulomb - 1)})"
    if not node.parts:
        return _atom(node, language)
    parts = [written(part, language) for part in node.parts]
    if node.head in ("+", "*"):
        return f"({f' {node.head} '.join(parts)})"
    if node.head == "^":
        return _power(parts[0], node.value, language)
    if node.head == "clip":
        low, high = (
            language.call(language.absolute, f"{parts[0]} {way} {node.value!r}") for way in "-+"
        )
        return f"(0.5 * ({high} - {low}))"
    if node.head == "sign":
        return language.plain_sign.format(x=parts[0])
    return language.call(language.absolute if node.head == "abs" else node.head, parts[0])


def _atom(node: Node, language: Spelling) -> str:
    if node.head == "number":
        return repr(node.value) if node.value >= 0 else f"({node.value!r})"
    if node.head == "t":
        return language.time
    if node.head == "bristle" and language.bristle is not None:
        return language.bristle(node.joint - 1, node.value)
    return language.item(node.text, node.joint - 1)


def _power(x: str, power: float, language: Spelling) -> str:
    if not (power.is_integer() and 0 < abs(power) <= LARGEST):
        return language.power.format(x=x, p=repr(power))
    product = f"({' * '.join([x] * abs(int(power)))})"
    return product if power > 0 else f"(1.0 / {product})"
