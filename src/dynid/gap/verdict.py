"""The verdict: named, nothing missing or changed, unexplained or ambiguous, and the advice that follows from each.

Limits that have no other reason were set on seed 0 of ``benchmarks/gap_blind.py``, whose tables come from other seeds.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.gap import tuning
from dynid.gap.localisation import NEGLIGIBLE
from dynid.gap.refit import SURE_Z, HeldOutImprovement, possible
from dynid.gap.search import EffectSearch, still_changed
from dynid.gap.selected_effects import SelectedEffect
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Joints

#: Mean square of the whitened residual between reversals up to which nothing is missing, 0.9 to 1.1 in clean logs; with
#: the rows at reversals, which are known less well, up to so many times more.
NOTHING = 1.25
#: The same between reversals when the noise floor is only a lower bound: logs without repeats and without effects reach
#: 1.7.
NOTHING_UNSURE = 2.0
#: A delay below this share of the sampling period is how a recorder reads position and torque, not a missing effect.
SAMPLING = 0.3
#: Share of a joint's excess that one, two, three or more names on it must explain, more where more freedom explains it;
#: or ``NEGLIGIBLE`` may remain.
SHARES = (0.70, 0.85, 0.92)
#: Share of its joint's gap below which an effect by evidence is told as a part of it.
PART = 0.9
#: Chance below which an effect differs between logs and is no constant property of the arm.
SAME = 1e-3
#: A smaller companion of the same family on the same joint is the larger one's shape, not a second effect.
REDUNDANT = 0.25
#: So small compared with another effect on the same joint, it may be that one's shape, whatever its kind.
TRACE = 0.12
#: Standard errors between a shape parameter and its null: a 95 % interval. The Wald test of the amplitude, with what
#: the model has at the null, has told them apart already.
OUTSIDE = 1.96
LIKELY = "its probability is only"
SMALL_DELAY = "the delay is shorter than the sampling can resolve"
LITTLE = "it explains only"
NOT_SMALLER = "it does not reduce the error on unseen data"


@dataclass(frozen=True)
class GapVerdict:
    """What is said in the end.

    Attributes:
        word: ``named``, ``nothing_missing``, ``nothing_changed``, ``unexplained`` or ``ambiguous``.
        named: effects that are named.
        closest: effects that explain part of the gap, with the reason why they are no name.
        remainder: joints with more left than noise.
        alternatives: groups of identifiers that explain as much.
        advice: what to do next.
    """

    word: str
    named: tuple[SelectedEffect, ...]
    closest: tuple[tuple[SelectedEffect, str], ...]
    remainder: tuple[int, ...]
    alternatives: tuple[tuple[str, ...], ...]
    advice: str


def judge(
    search: EffectSearch,
    named: Sequence[SelectedEffect],
    refused: Sequence[tuple[SelectedEffect, str]],
    joints: Sequence[str],
) -> GapVerdict:
    """Judge a finished search.

    Args:
        search: the search, with what passed alone.
        named: what passed, with numbers.
        refused: what did not, with the reason.
        joints: joint names.
    """
    named, closest = tuple(named), tuple(refused)
    pooled = search.problem.pooled
    remainder = still_changed(search, named) if pooled else joints_with_more(search)
    groups = tuple(
        tuple(dict.fromkeys([one.name, *(name for name, _ in one.rivals)]))
        for one in named
        if one.rivals
    )
    if groups:
        word = "ambiguous"
    elif named:
        word = "named"
    elif remainder or (
        not pooled and (any(_matters(*pair) for pair in closest) or unrepeatable(search))
    ):
        word = "unexplained"
    else:
        word = "nothing_changed" if search.problem.since else "nothing_missing"
    advice = advice_of(word, search, named, closest, remainder, joints)
    # Why: the same effect on other joints is a group of one identifier, and told only where there is no other group.
    different = tuple(group for group in groups if len(group) > 1)
    return GapVerdict(word, named, closest, remainder, different or groups, advice)


def _matters(one: SelectedEffect, why: str) -> bool:
    """Return whether what is refused says all the same that something is missing."""
    return why != SMALL_DELAY and one.test.visible_rms >= tuning.MATERIAL


def joints_with_more(search: EffectSearch) -> tuple[int, ...]:
    """Return the joints with more left than noise, 0-based."""
    if search.rest is not None:
        large = np.array([one["all"] > tuning.MATERIAL_REST for one in search.rest.rms])
        limit = tuning.LOUDER if search.problem.noise.repeats else tuning.LOUDER_UNSURE
        louder = search.rest.level < -np.log(limit)
        return tuple(
            np.flatnonzero((large & (search.rest.odds > tuning.REST_SURE)) | louder).tolist()
        )
    limit = NOTHING if search.problem.noise.repeats else NOTHING_UNSURE
    above = (search.between_reversals > limit) | (search.after > NOTHING * limit)
    return tuple(np.flatnonzero(above).tolist())


def unrepeatable(search: EffectSearch) -> list[int]:
    """Return joints with disturbances that do not repeat, where what repeats is not larger than the noise itself.

    Where old and new logs are compared, all that they leave counts as noise, and such disturbances with it.
    """
    if search.rest is not None:
        return sorted({*search.problem.noise.unrepeatable, *(one.joint for one in search.strays)})
    covered = search.problem.noise.misfit if search.problem.pooled else ()
    return [
        j
        for j in search.problem.noise.unrepeatable
        if search.before[j] - 1 < 1 and j not in covered
    ]


def refusal(
    search: EffectSearch,
    effects: Sequence[SelectedEffect],
    one: SelectedEffect,
    improvement: HeldOutImprovement,
) -> str:
    """Return why a selected effect is not called by its name, or nothing."""
    if one.name == "torque_delay":
        rate = search.problem.segments[0].log.filter.rate
        return SMALL_DELAY if abs(search.delay) < SAMPLING / rate else ""
    if one.test.joint in unrepeatable(search) and one.test.visible_rms < 1:
        return "the disturbance of this joint does not repeat"
    return (
        undetermined(one)
        or ("its size differs between parts of the logs" if _differs(search, one) else "")
        or _shape_of_larger(effects, one)
        or _not_smaller(one, improvement)
        or _little_explained(search, effects, one)
    )


def _differs(search: EffectSearch, one: SelectedEffect) -> bool:
    """Return whether an effect differs between parts of the logs.

    Why not where implausible links would absorb it: what is seen of it with possible ones is the little that
    these miss, and follows the motion.
    """
    return search.problem.arm is None and one.test.chow_p_value < SAME


def undetermined(one: SelectedEffect) -> str:
    """Return why size or shape are not known well enough, or nothing."""
    if one.z < SURE_Z:
        return (
            f"its size is not determined: {one.z:.1f} standard errors from zero, limit {SURE_Z:g}"
        )
    for name in one.free_shape:
        if one.shape_z(name) < (OUTSIDE if name in one.effect.nulls else SURE_Z):
            return _open_shape(one, name)
    return "" if possible(one) else "no physical body has these parameters"


def _shape_of_larger(effects: Sequence[SelectedEffect], one: SelectedEffect) -> str:
    """Return why it may be part of a larger effect, or nothing."""
    size, others = (
        one.test.visible_rms,
        [(other, other.test) for other in effects if other is not one],
    )
    family = [
        larger.visible_rms
        for other, larger in others
        if one.effect.family
        and other.effect.family == one.effect.family
        and other.joints[:1] == one.joints[:1]
    ]
    if any(size < REDUNDANT * larger for larger in family):
        return "it is probably part of a larger effect of the same kind"
    if any(
        size < TRACE * larger.visible_rms for _, larger in others if larger.joint == one.test.joint
    ):
        return "it is small and may be a remainder of a much larger effect on this joint"
    return ""


def _little_explained(
    search: EffectSearch, effects: Sequence[SelectedEffect], one: SelectedEffect
) -> str:
    """Return how much of its joint's gap the effects on it explain, where that is too little, or nothing."""
    share, needed = explained_share(search, effects, one)
    if share >= needed:
        return ""
    return f"{LITTLE} {np.floor(100 * share):.0f} % of the gap of this joint, limit {100 * needed:.0f} %"


def explained_share(
    search: EffectSearch, effects: Sequence[SelectedEffect], one: SelectedEffect
) -> tuple[float, float]:
    """Return the share of its joint's gap that is explained, 1 where hardly anything is left, and the needed one."""
    j, n = one.test.joint, len(search.before)
    if search.rest is not None:
        left = search.rest.rms[j].get("all", 0.0) if j in joints_with_more(search) else 0.0
        return one.test.visible_rms**2 / max(one.test.visible_rms**2 + left**2, 1e-12), PART
    on_joint = [f for f in effects if j in f.effect.rows(f.joints, n) and f.name != "torque_delay"]
    left, excess = search.after[j] - 1, search.before[j] - 1
    share = max(1 - left / excess, 0.0) if excess > 0 and left > NEGLIGIBLE else 1.0
    return share, SHARES[min(max(len(on_joint), 1), len(SHARES)) - 1]


def _not_smaller(one: SelectedEffect, improvement: HeldOutImprovement) -> str:
    low, high = improvement.ratio[one.test.joint]
    return (
        f"{NOT_SMALLER} ({100 * (low - 1):+.0f} to {100 * (high - 1):+.0f} %)"
        if high >= 1.0
        else ""
    )


def _open_shape(one: SelectedEffect, name: str) -> str:
    """Return why a shape parameter stands in the way of a name."""
    null = one.effect.nulls.get(name)
    if null is None:
        return f"its {name} is not determined: {one.shape_z(name):.1f} standard errors from zero, limit {SURE_Z:g}"
    size = f"{name} = {one.values[name]:.2g} +- {one.std_errors[name]:.2g}"
    return f"{size} may be {null:g}, and with {null:g} the effect is in the model already"


def labels(selected: SelectedEffect, joints: Sequence[str]) -> list[str]:
    """Return an effect with its joints, and all that explain as much, in words."""
    return [
        f"{name} on {joints_text(where, joints)}"
        for name, where in (selected.key, *selected.rivals)
    ]


def joints_text(where: Joints, joints: Sequence[str]) -> str:
    """Return where an effect sits, in words."""
    return " from ".join(joints[j] for j in where) or "the whole arm"


def _exclude(search: EffectSearch, joints: Sequence[str]) -> str:
    """Return which disturbances do not repeat, and what to do about them."""
    said = []
    for one in sorted(search.strays, key=lambda one: -one.power):
        unit = search.problem.base.robot.joints[one.joint].torque_unit
        said.append(
            f"{joints[one.joint]} in {one.log} from {one.start:.1f} to {one.end:.1f} s (about {one.size:.2g} {unit})"
        )
    return (
        f"Something disturbed {'; '.join(said)} and did not repeat: look for a contact or a cable, and record again or "
        "leave that time out with --exclude."
    )


def advice_of(
    word: str,
    search: EffectSearch,
    named: Sequence[SelectedEffect],
    closest: Sequence[tuple[SelectedEffect, str]],
    remainder: Sequence[int],
    joints: Sequence[str],
) -> str:
    """Return what to do next."""
    bound = not (search.problem.noise.repeats or search.problem.matched or search.problem.pooled)
    repeat = (
        " Record each motion twice: without repeats the noise floor is only a lower bound."
        if bound
        else ""
    )
    stray = unrepeatable(search)
    if search.strays and word == "unexplained":
        return _exclude(search, joints)
    if stray and word == "unexplained":
        names = ", ".join(joints[j] for j in stray)
        return (
            f"The disturbance of {names} does not repeat: look for contacts, cables or a drifting sensor, then record "
            "again."
        )
    if word == "ambiguous":
        one = next(f for f in named if f.rivals)
        first, other = labels(one, joints)[:2]
        ways = dict.fromkeys([one.effect.separate, CATALOGUE[one.rivals[0][0]].separate])
        return f"To tell {first} and {other} apart: {'; '.join(ways)}."
    if word == "named":
        left = (
            f" More is missing on {', '.join(joints[j] for j in remainder)}." if remainder else ""
        )
        return f"Add it with --apply, then check the result on a new log with dynid validate.{left}{repeat}"
    if word == "unexplained":
        likely = next((one for one, why in closest if why.startswith(LIKELY)), None)
        if likely is not None:
            size = ", ".join(
                f"{x} = {likely.values[x]:.3g} +- {likely.std_errors[x]:.2g} {likely.units[x]}"
                for x in likely.amplitudes
            )
            return (
                f"Probably {likely.name} on {joints_text(likely.joints, joints)}, {size} "
                f"({100 * likely.probability:.0f} %); "
                f"{100 * tuning.SURE:.0f} % are needed to name it. "
                f"To be sure: {likely.effect.separate}.{repeat}"
            )
        near = (
            f" The closest candidate is {closest[0][0].name}: {closest[0][1]}." if closest else ""
        )
        look = "where.png shows on which joint and in which part of its motion."
        return f"No effect of the catalogue explains it.{near} {look}{repeat}"
    if word == "nothing_changed":
        return f"These logs show no change. --ask numbers searches for what the model has always lacked.{repeat}"
    return f"The residual of every joint is at its noise.{repeat}"
