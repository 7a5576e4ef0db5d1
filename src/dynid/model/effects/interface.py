"""What a torque effect is: columns of the regressor, an equation, a signature, and the shapes that are tried.

An effect is evaluated on a whole ``ArmMotion``: it may need the order of the samples, the time or the model's own
torque. The friction of the robot file, which one sample is enough for, is in ``friction``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from dynid.arrays import Floats
from dynid.model.effects.expression import Node, read, value_of
from dynid.model.effects.motion import ArmMotion, Joints, Shape, Shapes

#: Columns of an effect over a motion: (amplitudes, N) on its first joint, or (amplitudes, rows, N).
Law = Callable[[ArmMotion, Joints, Shape], Floats | list[Floats]]


@dataclass(eq=False, kw_only=True)
class Effect:
    """One effect of the catalogue.

    Attributes:
        name: identifier, the contract of files and JSON.
        title: name for people.
        equation: torque that it adds at joint j.
        signature: how it shows in the residual, for people.
        separate: the motion that separates it from similar effects.
        forms: its columns as closed forms, in the words of ``effect: formula`` with shape parameters in braces; there
            is also ``total``, the torque with friction, and in code ``z``, how far a bristle bends before it slides.
        forms_of: the same by shape.
        terms: its columns as they were read, of a formula of a robot file.
        law: its columns where a closed form does not make them; a shape may hold ``at``, the size at which they are to
            be exact.
        many: the columns of several shapes at once, where that is faster.
        scope: ``"joint"``, ``"pair"`` (joint and the other one it depends on) or ``"arm"``.
        neighbours: whether a pair is of joints that follow each other.
        spreads: whether one joint's effect changes the torques of all.
        uses: ``"refit"`` when no re-identification can absorb it, ``"frozen"`` when it can be a change of the arm,
            ``"arm"`` when only links that no arm has absorb it.
        positive: whether its only amplitude must be positive.
        needs_model: whether its columns change with the model.
        units: unit of each amplitude, a parameter that enters linearly, where they do not depend on the shape.
        units_of: the same by shape.
        shape_units: unit of each shape parameter.
        shapes: the shapes that are tried, where they do not depend on the motion.
        shapes_of: the same by motion and joint.
        steps: how a shape parameter is refined: ``"times"`` or ``"plus"``, and the first step.
        sized: the amplitude whose size its columns depend on, "" where none does.
        at: that size, at which its columns are exact; 0 for the slope there.
        more_of: what every simulator has and it is more of: ``fv``, ``fc``, ``fo`` or ``Im`` of its joint, or ``body``,
            the last link's.
        left_out: why no export holds it, "" where one does.
    """

    name: str
    title: str = ""
    equation: str = ""
    signature: str = ""
    separate: str = ""
    forms: tuple[str, ...] = ()
    forms_of: Callable[[Shape], tuple[str, ...]] | None = None
    terms: tuple[Node, ...] = ()
    law: Law | None = None
    many: Callable[[ArmMotion, Joints, Sequence[Shape]], list[Floats]] | None = None
    scope: Literal["joint", "pair", "arm"] = "joint"
    neighbours: bool = False
    spreads: bool = False
    uses: tuple[str, ...] = ("refit", "frozen")
    positive: bool = False
    needs_model: bool = False
    units: Mapping[str, str] = field(default_factory=dict)
    units_of: Callable[[Shape], dict[str, str]] | None = None
    shape_units: Mapping[str, str] = field(default_factory=dict)
    shapes: Sequence[dict[str, float]] = ({},)
    shapes_of: Callable[[ArmMotion, int], Shapes] | None = None
    steps: Mapping[str, tuple[str, float]] = field(default_factory=dict)
    sized: str = ""
    at: float = 0.0
    more_of: str = ""
    left_out: str = ""

    def candidate_joints(self, n: int) -> list[Joints]:
        """Return where it may sit on an arm of n joints."""
        if self.scope == "pair":
            pairs = [(j, k) for j in range(n) for k in range(n) if j != k]
            return [(j, k) for j, k in pairs if abs(j - k) == 1 or not self.neighbours]
        return [(j,) for j in range(n)] if self.scope == "joint" else [()]

    def rows(self, joints: Joints, n: int) -> tuple[int, ...]:
        """Return the joints whose torque it changes."""
        return joints[:1] if joints and not self.spreads else tuple(range(n))

    def grid(self, motion: ArmMotion, joints: Joints) -> Shapes:
        """Return the shapes that are tried; one empty shape when it is linear."""
        return self.shapes_of(motion, joints[0]) if self.shapes_of else list(self.shapes)

    def amplitudes(self, shape: Shape) -> dict[str, str]:
        """Return names and units of the parameters that enter linearly."""
        return dict(self.units) if self.units_of is None else self.units_of(shape)

    def at_size(self, sizes: Shape) -> Effect:
        """Return the effect with columns that are exact at one size, by name of its parameters; itself where all are.

        A torque that is not in proportion to its amplitude is, near a size, that of the size times amplitude over size.
        """
        return replace(self, at=float(sizes[self.sized])) if self.sized else self

    def tried(self, motion: ArmMotion, joints: Joints, shapes: Sequence[Shape]) -> list[Floats]:
        """Return the columns of several shapes, each (amplitudes, rows, N) [N m or N per unit]."""
        if self.many is not None:
            return self.many(motion, joints, shapes)
        if self.law is not None:
            laws = [self.law(motion, joints, {"at": self.at, **shape}) for shape in shapes]
            return [x[:, None] if x.ndim == 2 else x for x in map(np.asarray, laws)]
        with np.errstate(all="ignore"):
            # Signals of a pair belong to the neighbour, or to the joint that the torque leaks from.
            return [
                np.array(
                    [
                        [np.broadcast_to(value_of(node, motion, joints[-1]), len(motion))]
                        for node in self.nodes(shape)
                    ]
                )
                for shape in shapes
            ]

    def nodes(self, shape: Shape) -> list[Node]:
        """Return the closed forms of its columns, none where it has no such form."""
        texts = self.forms if self.forms_of is None else self.forms_of(shape)
        numbers = {name: f"{x:.17g}" for name, x in shape.items()}
        return [*self.terms, *(read(text.format(**numbers)) for text in texts)]

    def columns(self, motion: ArmMotion, joints: Joints, shape: Shape) -> Floats:
        """Return its columns in its rows, (amplitudes, rows, N) [N m or N per unit]."""
        return self.tried(motion, joints, [shape])[0]
