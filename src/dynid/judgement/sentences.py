"""The words of a judgement: the answer first, then why, in numbers that stand beside what they are compared with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from dynid.judgement import tuning
from dynid.judgement.evidence import EffectEvidence, Evidence, GapEvidence, Unseen
from dynid.judgement.lights import (
    Light,
    at_noise,
    farthest,
    finds_nothing,
    floor,
    joint_state,
    shown,
    surprise,
    unsearched,
    unseen_state,
)
from dynid.table import with_error


def first_sentence(evidence: Evidence, lights: Sequence[Light]) -> str:
    """Return the answer to what was asked; what makes every other answer wrong goes before it."""
    states = {light.name: light.state for light in lights}
    if evidence.other is not None:
        other = evidence.other
        return (
            f"These logs fit another arm better: with the link lengths of {other.name} the model misses "
            f"{shown(other.percent)} % of the torque, with these {shown(other.own)} %."
        )
    if evidence.alarms:
        return "The robot file does not describe the arm of these logs."
    if evidence.asked == "gap" and evidence.gap is not None:
        nothing, odd = finds_nothing(evidence.gap), unsearched(evidence)
        if nothing and odd:
            return (
                f"These logs miss nothing, but the model misses {shown(odd[0].percent)} % of the torque of "
                f"{odd[0].name}, which was not searched."
            )
        return of_gap(evidence.gap, nothing=nothing)
    if evidence.asked == "replay" and evidence.unseen:
        return of_replay(evidence.unseen[-1], evidence)
    if evidence.asked == "change":
        return of_changes(evidence)
    return of_result(evidence, states)


# ---------------------------------------------------------------- a result
def of_result(evidence: Evidence, states: dict[str, str]) -> str:
    """Return what a model is worth."""
    fitted = (
        ""
        if evidence.fitted is None
        else f"{shown(evidence.fitted)} % of the torque it was fitted to"
    )
    if evidence.gap is not None and evidence.gap.missing:
        # Why first: it is why the model is no better, and what to do about it.
        return of_gap(evidence.gap, nothing=False)
    tested = _worst_unseen(evidence)
    if tested is not None and states["unseen motion"] == "bad":
        many = "" if evidence.fitted is None else f", {shown(evidence.fitted)} % on the fitted rows"
        return f"Do not use this model yet: it misses {shown(tested.percent)} % of the torque of {tested.name}{many}."
    if states["fit"] == "bad" and (joints := weak_joints(evidence)):
        percent, names = (
            max(percent for _, percent in joints),
            ", ".join(name for name, _ in joints),
        )
        whole = (
            ""
            if evidence.fitted is None
            else f", {shown(evidence.fitted)} % on all joints together"
        )
        most = "up to " if len(joints) > 1 else ""
        return f"Do not use this model for {names}: it misses {most}{shown(percent)} % of the torque there{whole}."
    if states["fit"] == "bad":
        return f"Do not use this model yet: it misses {fitted or 'much of the torque it was fitted to'}."
    if states["physics"] == "bad" and states["unseen motion"] == "good":
        return (
            "The torques are right up to their noise on motions that were not fitted, but no arm has such masses: use "
            "this model for torques, not for its bodies."
        )
    if states["physics"] == "bad":
        return "Do not use this model yet: no arm with possible masses has these torques."
    if states["complete"] == "bad" and evidence.gap is not None:
        return of_gap(evidence.gap, nothing=False)
    if states["unseen motion"] == "open":
        start = f"The model misses {fitted}" if fitted else "The model is there"
        return f"{start}; it was not tested on another motion."
    if states["unseen motion"] == "good":
        weak = [
            name for name in ("fit", "knowledge", "physics", "complete") if states[name] == "fair"
        ]
        rest = {
            "fit": "its fit is only fair",
            "knowledge": "some parameters are known badly",
            "physics": "its bodies are doubtful",
            "complete": "an effect is missing",
        }
        but = f", but {' and '.join(rest[name] for name in weak)}" if weak else ""
        return f"The model predicts motions that it was not fitted to, up to their noise{but}."
    assert tested is not None
    return f"The model is usable: it misses {shown(tested.percent)} % of the torque of {tested.name}, more than noise."


def weak_joints(evidence: Evidence) -> list[tuple[str, float]]:
    """Return the joints whose fit is bad, and what is unexplained there [%]."""
    return [
        (joint.joint, 100.0 * joint.fitted / joint.torque)
        for joint in evidence.joints
        if joint.fitted is not None and joint.torque and joint_state(joint) == "bad"
    ]


def _worst_unseen(evidence: Evidence) -> Unseen | None:
    """Return the unseen rows that speak most against the model."""
    order = {"good": 0, "fair": 1, "bad": 2}
    return max(
        evidence.unseen, key=lambda u: (order[unseen_state(u, evidence)], u.percent), default=None
    )


# ---------------------------------------------------------------- a replay
def of_replay(unseen: Unseen, evidence: Evidence) -> str:
    """Return what a replayed log says."""
    state, times = unseen_state(unseen, evidence), surprise(unseen)
    if state == "good":
        if unseen.same_motion:
            return f"The model predicts {unseen.name} up to its noise, but that motion was fitted: test another one."
        return f"The model predicts {unseen.name}, a motion that was not fitted, up to its noise."
    if times is not None and times > tuning.EXPECTED[0]:
        much = f"it misses {shown(unseen.percent)} % of the torque where {unseen.expected:.2g} % was expected"
        if unseen.same_motion:
            return (
                f"Something has changed since the model was identified: {much}, on the same motion."
            )
        return f"The model is worse on {unseen.name} than it expected: {much}."
    what = "a motion that was fitted" if unseen.same_motion else "a motion that was not fitted"
    word = "Do not use this model yet: it" if state == "bad" else "The model"
    weak = ", ".join(name for name, _ in weak_joints(evidence)) if state != "bad" else ""
    but = f" Do not use it for {weak}." if weak else ""
    return f"{word} misses {shown(unseen.percent)} % of the torque of {unseen.name}, {what}.{but}"


# ---------------------------------------------------------------- what changed
def of_changes(evidence: Evidence) -> str:
    """Return what changed since an earlier result."""
    changed = evidence.changes or ()
    since = f" since {evidence.earlier}" if evidence.earlier else ""
    if evidence.changes is None:
        than = f" than {evidence.earlier}" if evidence.earlier else ""
        return f"There is nothing to compare with: this model has other parameters{than}."
    measure = "its uncertainty" if evidence.tolerance is None else f"{100 * evidence.tolerance:g} %"
    if not changed:
        return f"Nothing has changed{since} by more than {measure}."
    first = changed[0]
    more = (
        ""
        if len(changed) == 1
        else ", and 1 more number"
        if len(changed) == 2
        else f", and {len(changed) - 1} more"
    )
    unit = f" {first.unit}" if first.unit else ""
    what = (
        "The arm has changed"
        if evidence.tolerance is None
        else f"Numbers have moved by more than {measure}"
    )
    kind = "" if first.p_value is None else "parameter "
    return f"{what}{since}: {kind}{first.name} went from {first.before:.4g} to {first.after:.4g}{unit}{more}."


# ---------------------------------------------------------------- missing effects
def of_gap(gap: GapEvidence, *, nothing: bool) -> str:
    """Return what is missing."""
    changed, effects = gap.question == "changed", gap.effects
    if gap.named and gap.ambiguous:
        names = " or ".join(f"{one.title} on {one.where}" for one in gap.named)
        return f"Something is missing, and these explain it equally well: {names}."
    if gap.named:
        return " ".join(
            [
                *(_named(one, changed=changed) for one in gap.named),
                *["Nothing else is missing."] * nothing,
            ]
        )
    if nothing:
        if changed:
            return "Nothing has changed since the model was identified: every joint is as it was expected."
        joints = (
            "every joint is at its noise"
            if gap.repeats
            else "no joint is above the least noise that it can have"
        )
        return f"Nothing is missing: {joints}, on rows that were not used."
    if gap.events:
        event = gap.events[0]
        return (
            f"Something happened once: {event.size:.2g} {event.unit} on {event.joint}, from {event.start:.1f} to "
            f"{event.end:.1f} s of {event.log}."
        )
    likely = [
        one
        for one in effects
        if not one.named and one.probability is not None and one.probability >= 0.5
    ]
    if likely:
        return _likely(likely[0])
    where = _where(gap)
    if gap.unrepeatable:
        return f"What disturbs {', '.join(gap.unrepeatable)} does not repeat, so it is no property of the arm."
    if (gap.surprise or 0.0) > tuning.EXPECTED[0]:
        return (
            f"The model misses {gap.kept:.3g} % of the torque of these logs where {gap.expected:.2g} % was expected, "
            "and no effect explains it."
        )
    return f"Something is missing{where} that no effect explains."


def _likely(one: EffectEvidence) -> str:
    size = f", {_size(one)}" if one.sizes else ""
    why = f" It is not named: {one.why_not}." if one.why_not else ""
    return f"{_start(one.where)} may have {one.title}{size}.{why}"


def _named(one: EffectEvidence, *, changed: bool) -> str:
    if one.effect == "payload" and (
        mass := next((size for size in one.sizes if size[0] == "m"), None)
    ):
        _, value, error, unit = mass
        word = "more" if value >= 0.0 else "less"
        spread = f" +- {error:.2g}" if error else ""
        than = "when it was identified" if changed else "the model knows of"
        return f"The arm carries {with_error(abs(value), error)}{spread} {unit} {word} than {than}."
    size = f", {_size(one)}" if one.sizes else ""
    since = "It was not there when the model was identified." if changed else "The model lacks it."
    return f"{_start(one.where)}: {one.title}{size}. {'The model corrects it already.' if one.corrected else since}"


def _start(where: str) -> str:
    """Return where an effect sits as the beginning of a sentence; names of joints stay as they are."""
    return "The" + where[3:] if where.startswith("the ") else where


def _size(one: EffectEvidence) -> str:
    """Return the sizes of an effect with their errors."""
    shown = []
    for name, value, error, unit in one.sizes:
        # Why: an order or a form is chosen, not measured.
        if error == 0.0 and not unit:
            continue
        number = (
            f"about {value:.3g}"
            if error is None
            else with_error(value, error)
            if error
            else f"{value:.4g}"
        )
        spread = f" +- {error:.2g}" if error else ""
        shown.append(f"{name} {number}{spread} {unit}".strip())
    return ", ".join(shown)


def _where(gap: GapEvidence) -> str:
    names = gap.more or tuple(
        name
        for name, error, noise in zip(gap.joints, gap.before, gap.allowed, strict=True)
        if error > tuning.MISSING[not gap.repeats] * noise
    )
    return f" on {', '.join(names)}" if names else ""


# ---------------------------------------------------------------- why
def reasons(evidence: Evidence, sentence: str) -> tuple[str, ...]:
    """Return why, in numbers beside what they are compared with; what the first sentence says is not said again."""
    found = []
    if evidence.asked == "gap" and evidence.gap is not None:
        found += _gap_reasons(evidence.gap, {joint.joint: joint.unit for joint in evidence.joints})
    elif evidence.asked == "replay" and evidence.unseen:
        found += _replay_reasons(evidence.unseen[-1], evidence, sentence)
    elif evidence.asked == "change":
        found += _change_reasons(evidence)
    else:
        tested = _worst_unseen(
            replace(evidence, unseen=tuple(u for u in evidence.unseen if not u.same_motion))
        )
        if tested is not None:
            found += _replay_reasons(tested, evidence, sentence)
    # Why not beside another arm: what this model is good for is not the question then.
    whole = evidence.asked in ("result", "replay") and not evidence.of_another_arm
    return (*found, *_small_reasons(evidence)) if whole else tuple(found)


def _change_reasons(evidence: Evidence) -> list[str]:
    first = next(iter(evidence.changes or ()), None)
    if first is None or first.p_value is None:
        return []
    times = 1e6 if first.p_value < 1e-6 else float(f"{1 / first.p_value:.1g}")
    most = "less than " if first.p_value < 1e-6 else ""
    return [f"Noise alone would do that to {first.name} {most}once in {times:,.0f} comparisons."]


def _small_reasons(evidence: Evidence) -> list[str]:
    """Return what a model is good for, and what not, where joints miss much of a torque that is small."""
    small = [
        (100.0 * joint.fitted / joint.torque, joint)
        for joint in evidence.joints
        if joint.fitted is not None
        and joint.torque
        and joint.fitted > tuning.FIT[1] / 100.0 * joint.torque
    ]
    small = [each for each in small if joint_state(each[1]) == "fair"]
    if not small:
        return []
    percent, worst = max(small, key=lambda each: each[0])
    assert worst.fitted
    assert worst.torque
    assert worst.limit
    names = [joint.joint for _, joint in small]
    who = names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    carry = "carries" if len(names) == 1 else "carry"
    at = "" if len(names) == 1 else f" on {worst.joint}"
    return [
        f"{who} {carry} little here: the model misses {worst.fitted:.2g} of {worst.torque:.2g} {worst.unit}{at} "
        f"({shown(percent)} %), {100 * worst.fitted / worst.limit:.1g} % of what the joint is built for. "
        f"That does for motion and simulation. It is too coarse to tell forces below "
        f"{tuning.AT_NOISE * worst.fitted:.2g} {worst.unit} there."
    ]


def _replay_reasons(unseen: Unseen, evidence: Evidence, sentence: str) -> list[str]:
    found, expected = [], f"{unseen.expected:.2g} % was expected" if unseen.expected else ""
    if f"{shown(unseen.percent)} %" not in sentence or unseen.name not in sentence:
        missed = f"The model misses {shown(unseen.percent)} % of the torque of {unseen.name}"
        found.append(f"{missed}; {expected}." if expected else f"{missed}.")
    elif expected and expected not in sentence:
        found.append(f"{expected} there.")
    far = farthest(unseen, evidence)
    if far is not None:
        joint, error, times = far
        bound = "" if evidence.repeats else " at least"
        far_off = "" if times <= tuning.AT_NOISE else f" ({times:.2g} times)"
        noise = f"noise{bound} {floor(joint) or 0.0:.3g}{far_off}"
        found.append(
            f"{joint.joint} is furthest from its noise there: {error:.3g} {joint.unit}, {noise}."
        )
    return found


def _gap_reasons(gap: GapEvidence, units: dict[str, str]) -> list[str]:
    found = [_likely(one) for one in gap.instead]
    rows = list(zip(gap.joints, gap.before, gap.after, gap.noise, strict=True))
    for one in gap.named:
        if one.before is not None and one.after is not None:
            noise = next((row[3] for row in rows if row[0] == one.joint), None)
            beside = "" if noise is None else f"; noise {noise:.3g}"
            sizes = f"{one.before:.3g} -> {one.after:.3g} {one.unit}"
            what = (
                f"without and with the correction {sizes}"
                if one.corrected
                else f"on unseen rows {sizes}"
            )
            found.append(f"Error of {one.joint} {what}{beside}.")
    left = [row for row in rows if row[0] in gap.more]
    if gap.named and left:
        name, _, after, noise = max(left, key=lambda row: row[2] / max(row[3], 1e-12))
        others = (
            f", and on {len(left) - 1} more joint{'s' * (len(left) > 2)}" if len(left) > 1 else ""
        )
        unit = f" {units[name]}" if name in units else ""
        found.append(
            f"More than noise is left on {name}: {after:.3g}{unit}, noise {noise:.3g}{others}."
        )
    if not gap.named and not gap.events and rows:
        name, error, _, noise = max(rows, key=lambda row: row[1] / max(row[3], 1e-12))
        unit = f" {units[name]}" if name in units else ""
        bound = "" if gap.repeats else " at least"
        found.append(
            f"{name} is furthest from its noise: {error:.3g}{unit} on unseen rows, noise{bound} {noise:.3g}."
        )
    if gap.kept is not None and gap.expected:
        found.append(
            f"The model as it was misses {gap.kept:.3g} % of these torques; {gap.expected:.3g} % was expected."
        )
    return found


# ---------------------------------------------------------------- several facts together
def _explained(unseen: Unseen, evidence: Evidence) -> bool:
    """Return whether a search names why a model misses more of a log than it expected: the arm is another one there."""
    gap = evidence.gap
    return (
        gap is not None and bool(gap.named) and gap.question == "changed" and unseen.log in gap.logs
    )


def warnings(evidence: Evidence, lights: Sequence[Light]) -> tuple[str, ...]:
    """Return what several facts together warn of."""
    states = {light.name: light.state for light in lights}
    found = []
    # Why not the last replay where it is what was asked: the answer says it.
    told = evidence.unseen[:-1] if evidence.asked == "replay" else evidence.unseen
    broken = [
        (times, each) for each in told if (times := surprise(each)) and times > tuning.EXPECTED[0]
    ]
    if broken:
        times, each = max(broken, key=lambda one: one[0])
        if at_noise(each, evidence) is not True and not _explained(each, evidence):
            found.append(
                f"Do not rely on the expected error: on {each.name} it was {times:.2g} times too small."
            )
    if (
        evidence.seconds is not None
        and evidence.seconds < tuning.SECONDS
        and states["fit"] == "good"
    ):
        found.append(
            f"A log of {evidence.seconds:.2g} s is easy to fit, which says little about other motions."
        )
    if evidence.gap is not None and not evidence.gap.repeats:
        found.append(
            "The noise is a lower bound, because no motion is repeated: record each motion twice."
        )
    if states["physics"] == "bad" and evidence.physical:
        found.append(
            "Torques may be right where masses are not: use this model for the fitted motions only."
        )
    return tuple(found)
