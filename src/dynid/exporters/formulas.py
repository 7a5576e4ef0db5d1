"""Effects of the catalogue as formulas, for every language and simulator.

A formula is written in NumPy's spelling with elements ``q[0]``.
Effects without one act on the torques of all joints, or are left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynid.estimation.one_state import coulomb
from dynid.model.effects.catalogue import CATALOGUE, Added
from dynid.model.effects.expression import Node
from dynid.model.printing import number
from dynid.robot import Robot


@dataclass(frozen=True)
class Column:
    """One column of an effect on one joint.

    Attributes:
        added: the effect.
        name: its parameter, such as ``stribeck4_a``.
        joint: the joint that it acts on, 0-based.
        node: torque per unit of the parameter; its signals say their joints, from 1.
    """

    added: Added
    name: str
    joint: int
    node: Node

    @property
    def signals(self) -> set[str]:
        """Kinds of the signals in the formula, with ``t``."""
        return {node.text or node.head for node in self.node.within()}

    @property
    def remembers(self) -> bool:
        """Whether it needs the time or a bristle, which have to be kept from step to step."""
        return bool(self.signals & {"t", "z"})

    @property
    def dry_size(self) -> Node | None:
        """What multiplies the Coulomb sign of its own joint, None where it is no dry friction."""
        factors = self.node.factors()
        rest = [one for one in factors if not one.coulomb or one.coulomb.joint != self.joint + 1]
        if len(rest) != len(factors) - 1:
            return None
        return Node("*", (Node("number", value=1.0), *rest))


def columns_of(added: Added) -> list[Column]:
    """Return the columns of an effect as formulas, none where it has no formula."""
    # Signals of a pair belong to the neighbour, or to the joint that the torque leaks from.
    return [
        Column(added, name, added.joints[0], _placed(node, added.joints[-1] + 1))
        for name, node in zip(added.names, added.effect.nodes(added.shape), strict=False)
    ]


def _placed(node: Node, joint: int) -> Node:
    """Return a formula whose signals all say their joint, from 1."""
    parts = tuple(_placed(part, joint) for part in node.parts)
    if node.head not in ("signal", "name"):
        return replace(node, parts=parts)
    return Node("signal", text=node.text, joint=node.joint or joint)


# ---------------------------------------------------------------- spelling
def written(node: Node, robot: Robot, bristle: int = 0) -> str:
    """Return a formula whose signals say their joints as an expression, in brackets where it is made of several.

    Args:
        node: the formula.
        robot: the arm, for the shape of its Coulomb signs.
        bristle: number of its bristle, where it has one.
    """
    if speed := node.coulomb:
        j = speed.joint - 1
        return f"({coulomb(robot, j, f'qd[{j}]')})"
    parts = [written(part, robot, bristle) for part in node.parts]
    match node.head:
        case "number":
            return number(node.value)
        case "t":
            return "t"
        case "signal":
            return f"{node.text}[{bristle if node.text == 'z' else node.joint - 1}]"
        case "+" | "*":
            return f"({f' {node.head} '.join(parts)})"
        case "^":
            return f"pow({parts[0]}, {node.value!r})"
    return f"{node.head}({parts[0]})"


# ---------------------------------------------------------------- words
def phrase(added: Added, names: Sequence[str]) -> str:
    """Return an effect and its joints in words, such as ``spring on A4``."""
    joints = " and ".join(names[j] for j in added.joints)
    return f"{added.effect.name} on {joints}" if joints else added.effect.name


#: What is said of Coulomb friction that follows a reversal over a distance.
DISTANCE = "the distance over which Coulomb friction turns at a reversal: here it turns with the velocity alone"


def without_torque(robot: Robot) -> tuple[str, ...]:
    """Return what is no torque of states, friction's distance and effects of a robot file, one phrase each."""
    lines = [DISTANCE] * any(robot.coulomb_shape.distance)
    for spec in robot.effects:
        if spec.effect in CATALOGUE and (why := CATALOGUE[spec.effect].left_out):
            where = f" on {', '.join(spec.joints)}" if spec.joints else ""
            lines.append(f"effect {spec.effect}{where}: {why}")
    return tuple(lines)


def why_not_code(added: Added) -> str:
    """Return why exported code leaves out the torque of an effect, "" where it holds it."""
    columns = columns_of(added)
    if any(column.remembers for column in columns):
        return "it depends on what was before, and code keeps no state"
    on_arm = not columns and added.effect.more_of != "body"
    return added.effect.left_out or "it acts on the torques of all joints" * on_arm
