"""What formulas are made of: functions of position, load, speed and time, of a joint and its neighbours.

A factor is one or several texts that belong together, such as sine and cosine of one angle; a product of factors is a
list of products of texts. What a text means is known to ``model/effects/formula.py`` alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, product

#: Harmonics of an angle.
HARMONICS = 4
#: What a reader pays for a factor; the shortest of equally good formulas is taken.
PLAIN, CURVED, HARMONIC, NEIGHBOUR, SUM, CLIPPED = 1.0, 1.1, 0.2, 0.5, 1.0, 1.0
#: Factors of speed and acceleration, and what each costs; {} is the number of the joint.
MOTIONS = {
    "qd{}": PLAIN,
    "|qd{}|": PLAIN,
    "sign(qd{})": PLAIN,
    "qd{}^2": CURVED,
    "qd{0} |qd{0}|": CURVED,
    "qdd{}": PLAIN,
}


@dataclass(frozen=True)
class Factor:
    """One factor of a product.

    Attributes:
        texts: its forms; an angle has two, sine and cosine.
        cost: what each costs.
        joint: number of the joint from 1, 0 for none or several.
        kind: ``one``, ``angle``, ``sum``, ``load``, ``clip``, ``motion`` or ``time``.
    """

    texts: tuple[str, ...]
    cost: float
    joint: int
    kind: str


@dataclass(frozen=True)
class Library:
    """The factors for the torque of one joint.

    Attributes:
        places: factors of position and load, 1 first.
        motions: factors of speed, acceleration and time, 1 first.
    """

    places: tuple[Factor, ...]
    motions: tuple[Factor, ...]

    def products(self) -> Iterator[tuple[Factor, ...]]:
        """Yield every product of a place with a motion, with two of either, that is no effect of its own already."""
        one, *places = self.places
        still, *motions = self.motions
        for place, motion in product(self.places, self.motions):
            if place is not one or (motion is not still and motion.texts[0][:4] != "sign"):
                yield tuple(x for x in (place, motion) if x not in (one, still))
        single = [x for x in places if x.kind in ("angle", "load")]
        for pair, motion in product(combinations(single, 2), self.motions):
            if pair[0].joint != pair[1].joint or "load" in {x.kind for x in pair}:
                yield tuple(x for x in (*pair, motion) if x is not still)
        for place, pair in product(self.places, combinations(motions, 2)):
            if pair[0].joint != pair[1].joint or "qdd" in pair[1].texts[0]:
                yield tuple(x for x in (place, *pair) if x is not one)


def library_of(joint: int, n: int, revolute: Sequence[bool], loads: Sequence[float]) -> Library:
    """Return the factors for the torque of one joint.

    Args:
        joint: 0-based.
        n: number of joints.
        revolute: which of them turn.
        loads: sizes of the joint's own load at which it may be clipped [N m or N].
    """
    own = joint + 1
    near = [k for k in (own, own - 1, own + 1) if 1 <= k <= n]
    places = [Factor((), 0.0, 0, "one")]
    for k in near:
        more = 0.0 if k == own else NEIGHBOUR
        if revolute[k - 1]:
            for h in range(1, HARMONICS + 1):
                places.append(
                    Factor(waves(f"{_times(h)}q{k}"), PLAIN + (h - 1) * HARMONIC + more, k, "angle")
                )
        else:
            places.append(Factor((f"q{k}",), PLAIN + more, k, "angle"))
        places.append(Factor((f"tau{k}",), PLAIN + more, k, "load"))
        places.append(Factor((f"|tau{k}|",), CURVED + more, k, "load"))
    places.append(Factor((f"tau{own}^2",), CURVED, own, "load"))
    for k in near[1:]:
        if revolute[k - 1] and revolute[joint]:
            for h, sign in product(range(1, HARMONICS + 1), "+-"):
                angle = f"{_times(h)}q{own} {sign} {_times(h)}q{k}"
                places.append(Factor(waves(angle), PLAIN + SUM + (h - 1) * HARMONIC, 0, "sum"))
    places += [
        Factor((f"clip(tau{own}, {level:.3g})",), PLAIN + CLIPPED, own, "clip")
        for level in loads
        if level > 0
    ]
    motions = [Factor((), 0.0, 0, "one")]
    for k in near:
        more = 0.0 if k == own else NEIGHBOUR
        motions += [
            Factor((text.format(k),), cost + more, k, "motion") for text, cost in MOTIONS.items()
        ]
    motions.append(Factor(("t",), PLAIN, 0, "time"))
    return Library(tuple(places), tuple(motions))


def waves(angle: str) -> tuple[str, str]:
    """Return sine and cosine of an angle."""
    return f"sin({angle})", f"cos({angle})"


def _times(harmonic: int) -> str:
    return "" if harmonic == 1 else f"{harmonic} "


def forms(factors: Sequence[Factor]) -> list[tuple[str, ...]]:
    """Return the texts of the columns of a product, factor by factor."""
    return [tuple(texts) for texts in product(*(factor.texts for factor in factors))]


def cost_of(factors: Sequence[Factor], columns: int) -> float:
    """Return what so many columns of a product cost."""
    return columns * sum(factor.cost for factor in factors) + columns
