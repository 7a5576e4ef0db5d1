"""A torque in words of its own: ``effect: formula`` of a robot file."""

from __future__ import annotations

from collections.abc import Sequence

from dynid.model.effects.expression import Node, read, refuse, term_of
from dynid.model.effects.interface import Effect
from dynid.model.effects.motion import Shape

FORMULA = "formula"


class Formula(Effect):
    """A torque by a formula of the robot file.

    Args:
        text: the formula.
        revolute: which joints of the arm turn.
        joint: the one that it acts on, 0-based.

    Raises:
        WrongRobotFile: it is no formula, or of another arm.
    """

    def __init__(self, text: str, revolute: Sequence[bool], joint: int = 0) -> None:
        super().__init__(
            name=FORMULA,
            title="formula, not in the catalogue",
            equation="a sum of products of signals",
            signature="what the formula says",
            separate="motion in which its factors vary one by one",
            needs_model=True,
        )
        self.text, self.revolute, self.joint = " ".join(text.split()), tuple(revolute), joint
        tree = read(self.text)
        parts = tree.parts if tree.head == "+" else (tree,)
        self.terms = tuple(term_of(part, self.text) for part in parts)
        if len({name for name, _ in self.terms}) < len(self.terms):
            refuse(self.text, "two terms have the same amplitude")
        last = max(node.joint for node in tree.within())
        if last > len(self.revolute):
            refuse(self.text, f"the arm has no joint {last}")

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the amplitudes."""
        torque = "N m" if self.revolute[self.joint] else "N"
        return dict.fromkeys(dict(self.terms), f"{torque} per unit of its factor")

    def nodes(self, shape: Shape) -> list[Node]:
        """Return what each amplitude multiplies."""
        return [node for _, node in self.terms]
