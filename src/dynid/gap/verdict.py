"""The verdict: named, nothing missing, unexplained or ambiguous, and the advice that follows from each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.gap.refit import Fitted, Shrink
from dynid.gap.search import Search
from dynid.gap.selected_effects import Pick
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Place

#: Mean square of the whitened residual up to which nothing is missing.
NOTHING = 1.25
#: The same when the noise floor is only a lower bound: logs without repeats and without effects reach 1.7.
NOTHING_UNSURE = 2.0
#: The same with the rows at reversals, which are known less well: so many times more.
REVERSALS = 1.25
#: A delay below this share of the sampling period is how a recorder reads position and torque, not a missing effect.
SAMPLING = 0.3
#: Share of a joint's excess that one, two, three or more names on it must explain; or this much may remain.
SHARES, REMAINS = (0.70, 0.85, 0.92), 0.10
#: On a joint with disturbances that do not repeat, an effect is named when it is larger than they are.
CLEAR = 1.0
#: Chance below which an effect differs between logs and is no constant property of the arm.
SAME = 1e-3
#: A smaller companion of the same family on the same joint is the larger one's shape, not a second effect.
COMPANION = 0.25
#: So small beside another effect on the same joint, it may be that one's shape, whatever its kind.
TRACE = 0.12
SMALL_DELAY = "it is less than the sampling leaves open"
NOT_SMALLER = "the gap on unseen data did not shrink"


@dataclass(frozen=True)
class Verdict:
    """What is said in the end.

    Attributes:
        word: ``named``, ``nothing_missing``, ``unexplained`` or ``ambiguous``.
        named: effects that are named.
        closest: effects that explain part of the gap, with the reason why they are no name.
        remainder: joints with more left than noise.
        alternatives: groups of identifiers that explain as much.
        advice: what to do next.
    """

    word: str
    named: tuple[Fitted, ...]
    closest: tuple[tuple[Fitted, str], ...]
    remainder: tuple[int, ...]
    alternatives: tuple[tuple[str, ...], ...]
    advice: str


def judge(
    found: Search, fitted: Sequence[Fitted], proof: Shrink, joints: Sequence[str], withdrawn: Sequence[Fitted] = ()
) -> Verdict:
    """Judge a finished search.

    Args:
        found: the search.
        fitted: what it found, with numbers.
        proof: the held-out gap before and after.
        joints: joint names.
        withdrawn: what it found too, but did not shrink the held-out gap.
    """
    reasons = [(one, refusal(found, fitted, one, proof)) for one in fitted]
    named = tuple(one for one, why in reasons if not why)
    closest = (*((one, why) for one, why in reasons if why), *((one, NOT_SMALLER) for one in withdrawn))
    limit = NOTHING if found.setting.noise.repeats else NOTHING_UNSURE
    remainder = tuple(np.flatnonzero((found.calm > limit) | (found.after > REVERSALS * limit)).tolist())
    equals = tuple(
        tuple(dict.fromkeys([one.pick.effect.name, *(name for name, _ in one.pick.equals)]))
        for one in named
        if one.pick.equals
    )
    different = tuple(group for group in equals if len(group) > 1)
    if different or equals:
        word = "ambiguous"
    elif named:
        word = "named"
    elif [why for _, why in closest if why != SMALL_DELAY] or remainder or unrepeatable(found):
        word = "unexplained"
    else:
        word = "nothing_missing"
    advice = advice_of(word, found, named, closest, remainder, joints)
    return Verdict(word, named, closest, remainder, different or equals, advice)


def unrepeatable(found: Search) -> list[int]:
    """Return joints with disturbances that do not repeat, where what repeats is not larger still."""
    return [j for j in found.setting.noise.unrepeatable if found.before[j] < 1 + CLEAR**2]


def refusal(found: Search, fitted: Sequence[Fitted], one: Fitted, proof: Shrink) -> str:
    """Return why an accepted effect is not called by its name, or nothing."""
    pick = one.pick
    n = len(found.before)
    if pick.effect.name == "torque_delay":
        rate = found.setting.stretches[0].source.chosen.rate
        return SMALL_DELAY if abs(found.delay) < SAMPLING / rate else ""
    if pick.proof.joint in unrepeatable(found) and pick.proof.visible_rms < CLEAR:
        return "the disturbance of this joint does not repeat"
    if pick.proof.agreement < SAME:
        return "it is not the same in all parts of the logs"
    same = [
        f
        for f in fitted
        if f is not one
        and pick.effect.family
        and f.pick.effect.family == pick.effect.family
        and f.pick.place[:1] == pick.place[:1]
    ]
    if any(pick.proof.visible_rms < COMPANION * f.pick.proof.visible_rms for f in same):
        return "it is the shape of a larger effect of the same kind"
    here = [f for f in fitted if f is not one and f.pick.proof.joint == pick.proof.joint]
    if any(pick.proof.visible_rms < TRACE * f.pick.proof.visible_rms for f in here):
        return "it is small enough to be what a much larger effect leaves"
    j = pick.proof.joint
    on_joint = [f for f in fitted if j in f.pick.effect.rows(f.pick.place, n) and f.pick.effect.name != "torque_delay"]
    left, excess = found.after[j] - 1, found.before[j] - 1
    share = 1 - left / excess if excess > 0 else 1.0
    needed = SHARES[min(len(on_joint), len(SHARES)) - 1]
    if share < needed and left > REMAINS:
        return f"it explains {100 * max(share, 0):.0f} % of the gap of this joint"
    if proof.ratio[j, 1] >= 1.0:
        return NOT_SMALLER
    return ""


def labels(pick: Pick, joints: Sequence[str]) -> list[str]:
    """Return an effect with its place, and all that explain as much, in words."""
    return [f"{name} on {place_text(place, joints)}" for name, place in (pick.key, *pick.equals)]


def place_text(place: Place, joints: Sequence[str]) -> str:
    """Return where an effect sits, in words."""
    return " from ".join(joints[j] for j in place) or "the whole arm"


def advice_of(
    word: str,
    found: Search,
    named: Sequence[Fitted],
    closest: Sequence[tuple[Fitted, str]],
    remainder: Sequence[int],
    joints: Sequence[str],
) -> str:
    """Return what to do next."""
    noise = found.setting.noise
    bound = not (noise.repeats or found.setting.matched)
    repeat = " Record each motion twice: without repeats the noise floor is only a lower bound." if bound else ""
    stray = unrepeatable(found)
    if stray and not named:
        names = ", ".join(joints[j] for j in stray)
        return (
            f"What disturbs {names} does not repeat: look for contacts, cables or a wandering sensor, and record again."
        )
    if word == "ambiguous":
        pick = next(f.pick for f in named if f.pick.equals)
        first, other = labels(pick, joints)[:2]
        ways = dict.fromkeys([pick.effect.separate, CATALOGUE[pick.equals[0][0]].separate])
        return f"To tell {first} and {other} apart: {'; '.join(ways)}."
    if word == "named":
        left = f" More is left on {', '.join(joints[j] for j in remainder)}." if remainder else ""
        return f"Add it with --apply and check on a new log with dynid validate.{left}{repeat}"
    if word == "unexplained":
        near = ""
        if closest:
            one, why = closest[0]
            near = f" The closest candidate is {one.pick.effect.name}, but {why}."
        look = "Look at the pictures of where it is, and at what the joints share."
        return f"No effect of the catalogue explains it.{near} {look}{repeat}"
    return f"The model is as good as the noise lets anyone see.{repeat}"
