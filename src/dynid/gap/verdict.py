"""The verdict: why something found has no name, what is named or unexplained, and the advice that follows from each."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import expit

from dynid.gap import tuning
from dynid.gap.counterbalance import COUNTERBALANCE
from dynid.gap.delays import EffectSearch
from dynid.gap.selected_effects import SelectedEffect
from dynid.model.effects.catalogue import CATALOGUE, DELAY
from dynid.model.effects.motion import Joints

#: A delay below this share of the sampling period is how a recorder reads position and torque, not a missing effect.
SAMPLING = 0.3
#: Chance above which the 95 % interval of an effect holds zero. Evidence: 99 % takes no wrong name of 150 cases, but
#: the friction of joint 7 of the LWR4+: on another motion joint 3 is 16 % worse then, instead of 4 %.
OPEN = 0.05
#: A shape within this factor of an end of its range lies there: all wrong ones did within 1.06.
AT_END = 1.1
#: Share of the square of what an effect changes in held-out rows by which it must lower their squared errors: 1 where
#: it is as large there as where it was found, -1 where it is not there at all. evidence: benchmarks/gap_choices.md,
#: effects that were hidden 0.72 and more, false ones 0.43 and less.
HELD_OUT = 0.5
#: Square of the change that an effect counts as making there at least, in units of the noise over all rows: what they
#: do not show they cannot prove. evidence: there too, false elasticities lowered squared errors by 0.02 and less.
SEEN = 12.0
LIKELY = "its probability is only"


def refusal(search: EffectSearch, one: SelectedEffect, changed: Sequence[int], fall: float) -> str:
    """Return why an effect is not called by its name, or nothing; the first reason that holds is said.

    Args:
        search: the search.
        one: the effect that is judged, beside all others.
        changed: joints on which old and new logs do not agree, before anything is taken out; all where nobody asks.
        fall: by how much it lowers the squared held-out errors, over the square of what it changes there.
    """
    sure, late = search.options.sure, one.name == DELAY
    rate = search.problem.rows.logs[0].filter.rate
    acts = one.effect.rows(one.joints, search.problem.base.robot.n)
    probability = 1.0 if late else expit(one.log_odds)
    # How large what is left of its joints is, over the effect.
    # Why not of a change: what has always been left stands for nothing that is new.
    left = search.rest.rms[[one.joint, *one.joints[:1]]].max() / max(one.visible, 1e-12)
    alone = not (late or one.name == COUNTERBALANCE or search.problem.rows.compared)
    reasons = (
        # Recorders of five public arms skew by up to 0.3 periods.
        (
            late and abs(one.values["delay"]) * rate < SAMPLING,
            "the delay is shorter than the sampling can resolve",
        ),
        # Of names given with 90 to 99 % as many are right.
        (
            probability < sure,
            f"{LIKELY} {np.floor(100 * probability):.0f} %, and {100 * sure:.3g} % are needed",
        ),
        # Evidence grows with the length of a log: 7 of 56 cases had a name at 0.06 to 0.2 of the noise.
        (one.visible < tuning.MATERIAL, f"its torque is {one.visible:.2g} times the noise"),
        (one.p_value > OPEN, "the interval of its size holds zero"),
        (one.always, "it explains old and new logs equally well if it was always there"),
        # On another motion a real arm differs from its model by more than the rows say, although nothing has changed.
        # Evidence: LWR4+ 1, 2 -> 3: a rotor of joint 2, of which joint 5 alone differed and differed as much with it.
        (
            not {*acts} & {*changed},
            "where it acts, old and new logs agree without it",
        ),
        # A dead band looks like half a gain: what was left was 1.85 times as large, and held-out rows agreed with it.
        (
            alone and left > 1.0,
            f"the remaining residual of this joint is {left:.1f} times as large: it may stand for something else",
        ),
        # Presliding of 0.1 to 0.9 mrad looks like a hysteresis of 2.00 mrad on 10 of 11 arms, a dead band like a hump.
        (
            bool(end := at_an_end(search, one)),
            f"{end} is at an end of its range: it may stand for another law",
        ),
        # Of all joints together: parameters of all joints move with an effect.
        (
            fall < HELD_OUT,
            f"on held-out data it explains only {100 * max(fall, 0):.0f} % of what it should",
        ),
    )
    return next((text for no, text in reasons if no), "")


def at_an_end(search: EffectSearch, one: SelectedEffect) -> str:
    """Return the shape parameter at an end of its range, or nothing: there the rows ask for another law."""
    for (effect, name), (low, high) in tuning.RANGES.items():
        wide = search.problem.rows.reversal[one.joint] / tuning.SLOW_RAD if name == "vs" else 1.0
        if effect == one.name and not AT_END * low < one.values[name] / wide < high / AT_END:
            return name
    return ""


def verdict_of(search: EffectSearch, remainder: Sequence[int]) -> str:
    """Return the verdict on a search whose refused effects are taken out; `remainder`: joints above their noise."""
    if any(one.rivals for one in search.selected):
        return "ambiguous"
    if search.selected:
        return "named"
    if remainder or (not search.problem.rows.compared and unrepeatable(search)):
        return "unexplained"
    return "nothing_changed" if search.problem.since else "nothing_missing"


def joints_with_more(search: EffectSearch) -> tuple[int, ...]:
    """Return the joints with more left than noise, 0-based."""
    rest, noise, louder = search.rest, np.ones(1), tuning.LOUDER
    if not search.problem.noise.repeats:
        # Why the quietest band: noise of the spectrum is measured with what is missing in it.
        noise, louder = rest.quiet, tuning.LOUDER_UNSURE
    large = (rest.rms > tuning.MATERIAL_REST * noise**0.5) & (rest.odds > tuning.REST_SURE)
    return tuple(np.flatnonzero(large | (rest.level > louder * noise)).tolist())


def unrepeatable(search: EffectSearch) -> list[int]:
    """Return joints with disturbances that do not repeat."""
    names = search.problem.base.robot.joint_names
    once = (names.index(event.joint) for event in search.events)
    return sorted({*search.problem.noise.unrepeatable, *once})


def explained_share(search: EffectSearch, one: SelectedEffect) -> float | None:
    """Return the share of its joint's gap that an effect explains; None where it leaves no sure residual."""
    rms, odds = search.rest.rms[one.joint], search.rest.odds[one.joint]
    return one.visible / (one.visible + rms) if odds > tuning.REST_SURE else None


def joints_text(where: Joints, joints: Sequence[str]) -> str:
    """Return where an effect sits, in words."""
    return " from ".join(joints[j] for j in where) or "the whole arm"


def advice_of(
    verdict: str,
    search: EffectSearch,
    closest: Sequence[tuple[SelectedEffect, str]],
    remainder: Sequence[int],
) -> str:
    """Return what to do next."""
    joints = search.problem.base.robot.joint_names
    repeat = (
        ""
        if search.problem.noise.repeats
        else " Record each motion twice: without repeats the noise level is only a lower bound."
    )
    if verdict == "ambiguous":
        one = next(f for f in search.selected if f.rivals)
        first, other = (
            f"{name} on {joints_text(where, joints)}" for name, where in (one.key, one.rivals[0])
        )
        ways = dict.fromkeys([one.effect.separate, CATALOGUE[one.rivals[0][0]].separate])
        return f"To tell {first} and {other} apart: {'; '.join(ways)}."
    if verdict == "named":
        more = ", ".join(joints[j] for j in remainder)
        left = f" More is missing on {more}." if more else ""
        return f"Add it with --apply, then check the result on a new log with dynid validate.{left}{repeat}"
    if verdict == "nothing_changed":
        return f"These logs show no change. --ask numbers searches for what the model has always lacked.{repeat}"
    if verdict == "nothing_missing":
        return f"The residual of every joint is at its noise.{repeat}"
    stray = unrepeatable(search)
    if stray and {*stray}.issuperset(remainder):
        what = [
            f"{x.joint} in {x.log} from {x.start:.1f} to {x.end:.1f} s (about {x.size:.2g} {x.unit})"
            for x in search.events
        ] or [joints[j] for j in stray]
        return (
            f"A disturbance of {'; '.join(what)} does not repeat: look for a contact, a cable or a drifting sensor, "
            "and record again or leave that time out with --exclude."
        )
    for likely, why in closest:
        if not why.startswith(LIKELY):
            continue
        size = ", ".join(
            f"{x} = {likely.values[x]:.3g} +- {likely.std_errors[x]:.2g} {likely.units[x]}"
            for x in likely.amplitudes
        )
        return (
            f"Probably {likely.name} on {joints_text(likely.joints, joints)}, {size}: {why}. "
            f"To be sure: {likely.effect.separate}.{repeat}"
        )
    near = "".join(
        f" The closest candidate is {one.name} on {joints_text(one.joints, joints)}: {why}."
        for one, why in closest[:1]
    )
    return (
        f"No effect of the catalogue explains it.{near} where.png shows on which joint and in which part of its "
        f"motion.{repeat}"
    )
