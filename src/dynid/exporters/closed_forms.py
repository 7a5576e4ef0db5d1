"""Effects of the catalogue as formulas, so that every language and simulator gets the same expression.

A formula is a ``Node`` of ``dynid.model.effects.formula`` with a signal ``total``, the torque with friction, and two
heads that remember: ``t``, and ``bristle``, the deflection before sliding. Effects without such a formula are listed
in ``WHOLE_ARM`` and ``REASONS``.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import Added
from dynid.model.effects.formula import Formula, Node
from dynid.model.effects.interface import Shape
from dynid.model.effects.laws import ANGLE_STEP
from dynid.robot import Robot

Floats = NDArray[np.float64]

#: Effects that turn the torque of the whole arm: at a moved position, under another gravity, with another body.
WHOLE_ARM = ("encoder_offset", "base_tilt", "tool_force", "payload")
#: Why there is no formula.
REASONS = {
    "joint_elasticity": "a link that moves against its motor is one more joint of a simulator",
    "backlash": "a link that moves against its motor is one more joint of a simulator",
    "torque_delay": "it is a delay of the log, not a torque of the arm",
}


@dataclass(frozen=True)
class Column:
    """One column of an effect on one joint.

    Attributes:
        name: its parameter, such as ``stribeck4_a``.
        joint: the joint that it acts on, 0-based.
        node: torque per unit of the parameter.
    """

    name: str
    joint: int
    node: Node


def columns_of(added: Added) -> list[Column] | None:
    """Return the columns of an effect as formulas, None where it has none."""
    effect, joints = added.effect, added.joints
    if isinstance(effect, Formula):
        nodes = [node for _, node in effect.terms]
    else:
        texts = _texts(effect.name, added.shape)
        if texts is None:
            return None
        nodes = [_parsed(text) for text in texts]
        if effect.name in ("torque_gain", "torque_constant"):
            nodes = [_renamed(node, "tau", "total") for node in nodes]
        if effect.name == "presliding_hysteresis":
            bristle = Node("bristle", value=added.shape["delta"])
            nodes = [Node("+", (bristle, Node("*", (Node("number", value=-1.0), nodes[0]))))]
    own, other = joints[0], joints[-1]
    # Signals of a pair belong to the neighbour, or to the joint that the torque leaks from.
    nodes = [_placed(node, other) for node in nodes]
    return [
        Column(column.parameter.name, own, node)
        for column, node in zip(added.columns, nodes, strict=True)
    ]


#: Effects without numbers that give them their shape.
_PLAIN = {
    "torque_offset": ("1",),
    "viscous": ("qd",),
    "viscous_change": ("qd",),
    "coulomb": ("sign(qd)",),
    "coulomb_change": ("sign(qd)",),
    "asymmetric_viscous": ("|qd|",),
    "load_friction": ("|tau| sign(qd)",),
    "torque_gain": ("tau",),
    "torque_constant": ("|qd| tau",),
    "torque_crosstalk": ("tau",),
    "motor_inertia": ("qdd",),
    "presliding_hysteresis": ("sign(qd)",),
    "joint_coupling": ("qd", "sign(qd)"),
    "counterbalance": ("sin(q)", "cos(q)"),
}
#: Effects whose shape parameters stand in braces.
_SHAPED = {
    "torque_ripple": ("cos({k} q)", "sin({k} q)"),
    "gear_friction": ("cos({k} q) sign(qd)", "sin({k} q) sign(qd)"),
    "position_friction": ("cos({h} q) sign(qd)", "sin({h} q) sign(qd)"),
    "stribeck": ("exp(-(|qd| / {vs})^{d}) sign(qd)",),
    "nonlinear_viscous": ("sign(1 qd) |qd|^{p}",),
    "warmup_friction": ("exp(-t / {tw}) sign(qd)", "exp(-t / {tw}) qd"),
    "torque_drift": ("{tc} (1 - exp(-t / {tc}))",),
    # Why so: it is max(0, x) without another function.
    "end_stop": ("0.5 (({side}) (q - ({q1})) + |({side}) (q - ({q1}))|)",),
}


def _texts(name: str, shape: Shape) -> list[str] | None:
    """Return each column of an effect of the catalogue in the words of ``effect: formula``."""
    if name == "spring":
        powers = [f"q^{k}" for k in range(1, round(shape["order"]) + 1)]
        return [*powers, *(["1"] if shape["constant"] else [])]
    known = _PLAIN.get(name) or _SHAPED.get(name)
    return (
        None
        if known is None
        else [text.format(**{key: f"{x:.17g}" for key, x in shape.items()}) for text in known]
    )


def _parsed(text: str) -> Node:
    """Return a formula of signals without amplitude."""
    return Formula(f"amplitude ({text})", (True,)).terms[0][1]


def _renamed(node: Node, old: str, new: str) -> Node:
    text = new if node.head == "signal" and node.text == old else node.text
    return replace(node, text=text, parts=tuple(_renamed(part, old, new) for part in node.parts))


def _placed(node: Node, joint: int) -> Node:
    """Return a formula whose signals all say their joint, from 1."""
    here = node.head in ("signal", "bristle") and not node.joint
    return replace(
        node,
        joint=joint + 1 if here else node.joint,
        parts=tuple(_placed(p, joint) for p in node.parts),
    )


def without_torque(robot: Robot) -> tuple[str, ...]:
    """Return the effects of a robot file that are no torque of states, one phrase each with the reason."""
    gone = [spec for spec in robot.effects if spec.effect in REASONS]
    return tuple(
        f"effect {spec.effect}{f' on {joints}' if (joints := ', '.join(spec.joints)) else ''}: {REASONS[spec.effect]}"
        for spec in gone
    )


def without_code(effects: Iterable[Added], robot: Robot) -> tuple[str, ...]:
    """Return the effects that exported code leaves out, one phrase each with the reason."""
    names = robot.joint_names
    gone = [(one, why) for one in effects if (why := why_not_code(one))]
    phrases = (f"effect {one.effect.name}{on_joints(one, names)}: {why}" for one, why in gone)
    return (*without_torque(robot), *phrases)


def why_not_code(added: Added) -> str:
    """Return why exported code leaves out the torque of an effect, "" where it holds it."""
    if any(remembers(column.node) for column in columns_of(added) or ()):
        return "it depends on what was before, and code keeps no state"
    if added.effect.name in WHOLE_ARM and added.effect.name != "payload":
        return "it turns the torque of the whole arm"
    return ""


def on_joints(added: Added, names: Sequence[str]) -> str:
    """Return the joints of an effect in words, "" for the whole arm."""
    return f" on {' and '.join(names[j] for j in added.joints)}" if added.joints else ""


def heads(node: Node) -> set[str]:
    """Return the heads in a formula; signals by their kind."""
    here = node.text if node.head == "signal" else node.head
    return {here}.union(*(heads(part) for part in node.parts))


def remembers(node: Node) -> bool:
    """Return whether it needs the time or a bristle, which have to be kept from step to step."""
    return bool(heads(node) & {"t", "bristle"})


def bristles(node: Node) -> set[tuple[int, float]]:
    """Return the bristles in a formula: joint from 0 and length [rad or m]."""
    here = {(node.joint - 1, node.value)} if node.head == "bristle" else set()
    return here.union(*(bristles(part) for part in node.parts))


def coulomb_sign_of(node: Node) -> int | None:
    """Return the joint, from 1, of a node that is a Coulomb sign, else None."""
    if node.head == "sign" and node.parts[0].head == "signal" and node.parts[0].text == "qd":
        return node.parts[0].joint
    return None


def dry_size(column: Column) -> Node | None:
    """Return what multiplies the Coulomb sign of the column's own joint, None where it is no dry friction."""
    factors = _factors(column.node)
    signs = [one for one in factors if coulomb_sign_of(one) == column.joint + 1]
    if len(signs) != 1:
        return None
    rest = tuple(one for one in factors if one is not signs[0])
    return Node("*", rest) if len(rest) > 1 else rest[0] if rest else Node("number", value=1.0)


def offset_step(added: Added) -> float:
    """Return the step by which the column of an encoder's offset is a difference [rad]."""
    return added.effect.at if abs(added.effect.at) > ANGLE_STEP else ANGLE_STEP


def representatives(base: BaseModel, theta: Floats) -> Floats:
    """Return the links' parameters where base parameters are carried by their representatives, (n, 11)."""
    model, values = base.model, np.zeros(11 * base.robot.n)
    rigid = base.reduction.base < len(model.link_columns)
    values[model.link_columns[base.reduction.base[rigid]]] = theta[rigid]
    return values.reshape(base.robot.n, 11)


def _factors(node: Node) -> list[Node]:
    return [one for part in node.parts for one in _factors(part)] if node.head == "*" else [node]
