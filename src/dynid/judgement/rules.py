"""Everything that dynid says of a model: rules in order, each with when it holds and a whole sentence.

Of answers the first rule that holds is said, of reasons and warnings each. A step comes with a command that works when
pasted, and with the lights that it may turn green: a later step for lights that earlier ones cover is left out.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from dynid.judgement import tuning
from dynid.judgement.evidence import (
    OPEN,
    Evidence,
    Light,
    Unseen,
    above_noise,
    at_noise,
    farthest,
    folder_of,
    shown,
    unseen_state,
    worst,
    worst_of,
)
from dynid.table import with_error
from dynid.text import shell

if TYPE_CHECKING:
    from dynid.judgement.gap import GapEffect


# ---------------------------------------------------------------- the answer
def answer(e: Evidence) -> str:
    """Return the answer to what was asked; what makes every other answer wrong goes before it."""
    if e.alarms:
        return "The robot file does not describe the arm of these logs."
    if e.asked == "gap":
        return of_gap(e)
    if e.asked == "replay" and e.unseen:
        return of_replay(e.unseen[-1], e)
    return of_changes(e) if e.asked == "change" else of_result(e)


def of_result(e: Evidence) -> str:
    """Return what a model is worth."""
    states, worst = e.states, worst_of(e.unseen, e)
    unseen = states["unseen motion"]
    # What is missing is why the model is no better, and what to do about it.
    if e.gap_evidence.missing:
        return of_gap(e)
    if unseen == "good" and states["physics"] == "bad" and states["fit"] != "bad":
        return (
            "The model predicts held-out motions to within their noise, but its parameters are not physically "
            "consistent: use it for torques, not for its links."
        )
    for light in e.lights:
        if light.state == "bad":
            said = f"Do not use this model yet: {light.text}."
            return of_gap(e) if light.name == "complete" else said
    if unseen == "open":
        logs = f"the training log{'s' * (len(e.logs) > 1)}"
        error = f"Relative torque error {shown(e.fitted)} % on {logs}. " if e.fitted else ""
        count = states["knowledge"] == "fair" and e.open
        rest = f"; {count} parameters are not determined." if count else "."
        return f"{error}Not yet validated on another motion{rest}"
    if unseen == "good" or not worst:
        weak = [text for name, text in FAIR.items() if states[name] == "fair"]
        but = ", but " * bool(weak) + " and ".join(weak)
        return f"The model predicts held-out motions to within their noise{but}."
    far = farthest(worst, e)
    more = ", more than noise" if far and far[2] > tuning.AT_NOISE else ""
    error = f"Relative torque error {shown(worst.percent)} % on {worst.name}{more}."
    if e.worst_elsewhere:
        return f"The model is usable. {error}"
    why = f": {FAIR['knowledge']}" if states["knowledge"] == "fair" else ""
    return f"{error} Validate it on another motion before you use it{why}."


#: What is said beside a model that predicts unseen motion, by the light that is only fair.
FAIR = {
    "fit": "its fit is only fair",
    "knowledge": "some parameters are poorly determined",
    "physics": "its physical consistency is doubtful",
    "complete": "an effect is missing",
}


def of_replay(unseen: Unseen, e: Evidence) -> str:
    """Return what a replayed log says."""
    state = unseen_state(unseen, e)
    error = f"Relative torque error {shown(unseen.percent)} %"
    if state == "good":
        if unseen.same_motion:
            return f"The model predicts {unseen.name} to within its noise, but was trained on this motion: try another."
        return f"The model predicts {unseen.name}, a motion not used for training, to within its noise."
    if unseen.surprise > tuning.EXPECTED[0]:
        much = f"{error} (expected {unseen.expected:.2g} %)"
        if unseen.changed:
            return (
                f"Something has changed since the model was identified. {much}, on the same motion."
            )
        return f"The model is worse on {unseen.name} than expected. {much}."
    what = f"{error} on {unseen.name}, a motion{'' if unseen.same_motion else ' not'} used for training."
    return "Do not use this model yet. " * (state == "bad") + what


def of_changes(e: Evidence) -> str:
    """Return what changed since an earlier result."""
    measure = "its uncertainty" if e.tolerance is None else f"{100 * e.tolerance:g} %"
    if e.changes is None:
        return (
            f"There is nothing to compare with: this model has other parameters than {e.earlier}."
        )
    if not e.changes:
        return f"Nothing has changed since {e.earlier} by more than {measure}."
    first, count = e.changes[0], len(e.changes) - 1
    more = f", and {count} more" if count else ""
    what = (
        "The arm has changed" if e.tolerance is None else f"Numbers differ by more than {measure}"
    )
    went = f"{first.before:.4g} to {first.after:.4g} {first.unit}".rstrip()
    return f"{what} since {e.earlier}: {first.name} went from {went}{more}."


# ---------------------------------------------------------------- missing effects
def of_gap(e: Evidence) -> str:
    """Return what is missing, or that the search found no more than noise."""
    gap, nothing = e.gap_evidence, e.nothing
    changed = gap.question == "changed"
    if nothing and e.odd:
        log = e.odd[0]
        error = f"relative torque error {shown(log.percent)} % there"
        return f"These logs show no missing effect, but {log.name} was not searched: {error}."
    if gap.named:
        named = [named_effect(one, changed=changed) for one in gap.named]
        return " ".join([*named, *["No other effect is missing."] * nothing])
    if not nothing:
        return unexplained(e)
    if changed:
        return "No change since the model was identified: the error of every joint is as expected."
    if gap.repeats:
        return "No missing effect found: on held-out data the residual of every joint is at its noise level."
    return "No missing effect found: on held-out data no residual is above the lower bound of its noise level."


def unexplained(e: Evidence) -> str:
    """Return what is said where something is missing and no effect is proved."""
    gap = e.gap_evidence
    if gap.events and {one.joint for one in gap.events}.issuperset(gap.more):
        one = gap.events[0]
        times = f"from {one.start:.1f} to {one.end:.1f} s of {one.log}"
        return f"A disturbance that does not repeat: {one.size:.2g} {one.unit} on {one.joint}, {times}."
    for effect in gap.likely:
        if (effect.probability or 0.0) >= 0.5:
            return likely_effect(effect)
    if gap.not_repeatable and {*gap.not_repeatable}.issuperset(gap.more):
        return f"The disturbance of {', '.join(gap.not_repeatable)} does not repeat, so it is no property of the arm."
    if (gap.surprise or 0.0) > tuning.EXPECTED[0]:
        return (
            f"Relative torque error {gap.kept:.3g} % on these logs (expected {gap.expected:.2g} %), "
            "and no known effect explains it."
        )
    names = ", ".join(gap.more or (name for name, _, _ in above_noise(gap)))
    if gap.likely and not names:
        return likely_effect(gap.likely[0])
    return f"The residual{' of ' * bool(names)}{names} is above the noise, and no known effect explains it."


def sizes_of(one: GapEffect) -> str:
    """Return where an effect sits and what it is, with its numbers; an order or a form is chosen, not measured."""
    texts = []
    for name, value, error, unit in one.sizes:
        if error != 0.0 or unit:
            number = f"about {value:.3g}" if error is None else f"= {with_error(value, error)}"
            spread = f" +- {error:.2g}" if error else ""
            texts.append(f", {name} {number}{spread} {unit}".rstrip())
    return one.title + "".join(texts)


def named_effect(one: GapEffect, *, changed: bool) -> str:
    """Return an effect that is proved, or one with others that explain as much."""
    if one.rivals:
        names = " or ".join((f"{one.title} on {one.where}", *one.rivals))
        return f"An effect is missing, and these explain it equally well: {names}."
    for name, value, error, unit in one.sizes:
        if one.effect == "payload" and name == "m":
            mass = with_error(abs(value), error) + (f" +- {error:.2g}" if error else "")
            word = "more" if value >= 0.0 else "less"
            than = "when it was identified" if changed else "its model"
            return f"The arm carries {mass} {unit} {word} than {than}."
    kind = "New effect since the model was identified" if changed else "Missing effect"
    kind = "Corrected effect" if one.corrected else kind
    part = "" if one.share is None else f", {100 * one.share:.0f} % of an unexplained gap"
    return f"{kind} on {one.where}{part}: {sizes_of(one)}."


def likely_effect(one: GapEffect) -> str:
    """Return an effect that is not proved."""
    why = f" Not named: {one.why_not}." if one.why_not else ""
    return f"Likely effect on {one.where}: {sizes_of(one)}.{why}"


# ---------------------------------------------------------------- why
def reasons(e: Evidence, sentence: str) -> Iterator[str]:
    """Yield why, in numbers beside what they are compared with; what the answer says is not said again."""
    if e.asked == "gap":
        yield from _gap_reasons(e)
        return
    tested = e.unseen[-1] if e.asked == "replay" and e.unseen else e.worst_elsewhere
    if tested and e.asked != "change":
        yield from _replay_reasons(tested, e, sentence)


def _replay_reasons(unseen: Unseen, e: Evidence, sentence: str) -> Iterator[str]:
    percent = f"{shown(unseen.percent)} %"
    expected = f" (expected {unseen.expected:.2g} %)" if unseen.expected else ""
    if percent not in sentence or unseen.name not in sentence:
        yield f"Relative torque error {percent} on {unseen.name}{expected}."
    if far := farthest(unseen, e):
        joint, error, times = far
        so_many = "" if times <= tuning.AT_NOISE else f", {shown(times)} times that"
        noise, floor = joint.noise or 0.0, joint.floor or 0.0
        least = f", taken as {100 * tuning.SENSOR:g} % of its torque, {floor:.3g}"
        level = f"noise {noise:.3g}{e.or_more}{least if floor > noise else ''}"
        size = f"{error:.3g} {joint.unit} ({level}{so_many})"
        yield f"Largest residual relative to noise: {joint.joint}, {size}."


def _gap_reasons(e: Evidence) -> Iterator[str]:
    gap, units = e.gap_evidence, {joint.joint: f" {joint.unit}" for joint in e.joints}
    # What an arm of other links would have, where nothing is missing with these.
    for one in gap.closest if gap.nothing else ():
        if one.effect == "counterbalance":
            yield likely_effect(one)
    errors = gap.improvement
    noises = dict(zip(gap.joint_names, errors.floor, strict=True))
    for one in {one.joint: one for one in gap.named}.values():
        if one.rms_after is not None:
            what = "without and with the correction" if one.corrected else "on held-out data"
            sizes = f"{one.rms_before:.3g} -> {one.rms_after:.3g} {one.unit}"
            yield f"Error of {one.joint} {what} {sizes}; noise {noises[one.joint]:.3g}."
    held_out = errors.after if gap.named else errors.before
    rows = zip(gap.joint_names, held_out, errors.floor, strict=True)
    left = [row for row in rows if not gap.named or row[0] in gap.more]
    if left and (gap.named or not gap.events):
        name, error, floor = max(left, key=lambda row: row[1] / max(row[2], 1e-12))
        size = f"{error:.3g}{units.get(name, '')} on held-out data (noise {floor:.3g}{e.or_more})"
        yield f"Largest residual relative to noise: {name}, {size}."
    if gap.kept is not None and gap.expected:
        percent = f"{gap.kept:.3g} % (expected {gap.expected:.3g} %)"
        yield f"Relative torque error of the original model on these logs: {percent}."


# ---------------------------------------------------------------- several facts together
def warnings(e: Evidence) -> Iterator[str]:
    """Yield what several facts together warn of."""
    # The answer to a replay says it of that one.
    rows, gap = e.unseen[:-1] if e.asked == "replay" else e.unseen, e.gap_evidence
    # A search may say why: the arm is another one there.
    changed = gap.logs if gap.question == "changed" and gap.named else ()
    rest = (row for row in rows if row.log not in changed)
    most = max(rest, key=lambda unseen: unseen.surprise, default=None)
    if most and most.surprise > tuning.EXPECTED[0] and not at_noise(most, e):
        times = shown(most.surprise)
        yield f"Do not rely on the expected error: on {most.name} it was {times} times too small."
    if e.gap is not None and not e.gap.repeats:
        yield "The noise is a lower bound, because no motion is repeated: record each motion twice."


# ---------------------------------------------------------------- what to do next
@dataclass(frozen=True)
class Step:
    """One thing to do.

    Attributes:
        why: the reason, one sentence.
        command: the command line; LOG stands for a recording that only the user can name.
        lights: names of the lights that it may turn green.
    """

    why: str
    command: str
    lights: tuple[str, ...] = ()


def steps(e: Evidence) -> Iterator[Step]:
    """Yield what to do next, most urgent first."""
    states = e.states
    if e.asked == "change" and e.changes and e.earlier_result:
        command = shell("dynid", "gap", folder_of(e.earlier_result), *e.fitted_logs)
        why = "Search for what has changed, such as a load, friction or a sensor."
        yield Step(why, f"{command} --ask changed")
    if e.alarms:
        why = "The robot file and the log do not belong together: see which edit of the file explains the torques."
        yield Step(why, shell("dynid", "check", e.fitted_logs[0], "--robot", e.robot), (*states,))
    if e.gap and states["complete"] != "good" and (not e.odd or e.gap_evidence.named):
        yield from _gap_steps(e)
    yield from _doubt_steps(e)
    yield from _unseen_steps(e)
    if states["knowledge"] != "good":
        plan = f"{e.open} parameters are not determined: plan" if e.open else "Plan"
        what = "a longer motion that excites more"
        if still := ", ".join(joint.joint for joint in e.joints if joint.torque == 0.0):
            what = f"a motion that moves {still}, and record its torque, which was not fitted"
        yield Step(f"{plan} {what}.", shell("dynid", "trajectory", e.robot), ("knowledge",))
    if states["complete"] == "open":
        why = "Search for missing effects; two recordings of one motion measure the noise."
        yield Step(why, e.search, ("complete",))
    if "bad" not in states.values() and states["unseen motion"] == "good":
        # Why: a file with bodies holds kilograms, which nobody knows where torques are amperes.
        command = f"{shell('dynid', 'export', e.run)} --format {'c' if e.amperes else 'urdf'}"
        yield Step("Use the model in a simulator or a controller.", command)


def _doubt_steps(e: Evidence) -> Iterator[Step]:
    doubtful = tuple(name for name in ("physics", "fit") if e.states[name] not in ("good", OPEN))
    if doubtful and not e.searched:
        yield Step("Search for the missing effect.", e.search, (*doubtful, "complete"))
    elif doubtful and not e.amperes:
        shares = [joint.percent or 0.0 for joint in e.joints]
        # The one whose joint is fitted worst; 2 where none is known.
        link = shares.index(max(shares)) + 1 if any(shares) else 2
        why = f"Give what is known of the arm, such as the mass of link {link} from its data sheet, and identify again."
        command = shell("dynid", "identify", e.robot, *e.fitted_logs)
        yield Step(why, f"{command} --link-mass {link}=LOW:HIGH", doubtful)


def _unseen_steps(e: Evidence) -> Iterator[Step]:
    state = e.states["unseen motion"]
    if state == "open":
        why = "Validate the model on a recording of another motion."
        yield Step(why, f"{shell('dynid', 'validate', e.run)} LOG", ("unseen motion",))
    elif state != "good" and not e.searched:
        why = "Search for what is missing, or has changed, on the motion that the model does not predict."
        yield Step(why, e.search, ("unseen motion", "complete"))
    elif state != "good":
        why = "Add a recording of another motion to the training logs."
        log = next((each.log for each in e.unseen if each.log), "LOG")
        yield Step(
            why, shell("dynid", "identify", e.robot, log, "--update", e.run), ("unseen motion",)
        )


def _gap_steps(e: Evidence) -> Iterator[Step]:
    gap, logs = e.gap_evidence, e.gap_evidence.logs or ("LOG",)
    search = shell("dynid", "gap", e.run, *logs, *gap.flags)
    first = next(iter((*gap.named, *gap.likely)), None)
    if gap.missing and gap.verdict != "ambiguous":
        why = "Add the effect to a copy of the robot file, and identify the arm with it."
        yield Step(why, f"{search} --apply best", ("complete", "fit", "unseen motion", "physics"))
        return
    if gap.events:
        times = dict.fromkeys(f"{max(0.0, x.start):.1f}-{x.end:.1f}" for x in gap.events)
        why = "Search again without the disturbances, or look for a contact or a cable there."
        yield Step(why, f"{search} --exclude {','.join(times)}", ("complete",))
    if gap.not_repeatable and not gap.events:
        why = f"Look for contacts, cables or a drifting sensor on {', '.join(gap.not_repeatable)}, then record again."
        yield Step(why, shell("dynid", "check", logs[0], "--robot", e.robot), ("complete",))
    elif first is not None and first.effect == "counterbalance" and gap.verdict != "ambiguous":
        # No motion helps: links of another mass make the same torques in every one.
        link = gap.joint_names.index(first.joint) + 1
        why = f"Give the mass of link {link} and a box around its centre of mass, from its drawing, and identify again."
        known = f"--link-mass {link}=LOW:HIGH --com-box {link}=X,Y,Z:X,Y,Z"
        command = f"{shell('dynid', 'identify', e.robot, *e.to_search)} {known}"
        yield Step(why, command, ("complete", "physics", "fit"))
    else:
        file = str(PurePath(e.result).parent / "gap.npz") if e.result else "GAP.npz"
        why = "Record the motion that decides, twice: the difference of repeats is noise."
        yield Step(why, shell("dynid", "trajectory", e.robot, "--for-gap", file), ("complete",))


# ---------------------------------------------------------------- the judgement
@dataclass(frozen=True)
class Judgement:
    """What is said of a model.

    Attributes:
        sentence: the answer.
        reasons: why, in numbers beside what they are compared with.
        lights: how good each side of it is.
        warnings: what several facts together warn of.
        steps: what to do next, most urgent first.
    """

    sentence: str
    reasons: tuple[str, ...]
    lights: tuple[Light, ...]
    warnings: tuple[str, ...]
    steps: tuple[Step, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The answer, why, and what to beware of."""
        return (self.sentence, *self.reasons, *self.warnings)

    @property
    def state(self) -> str:
        """``"bad"`` or ``"fair"`` as the worst light, ``"good"`` when proved on unseen motion, else ``"open"``.

        Torques that are proved on unseen motion are no worse for masses that no arm has: that is fair.
        """
        states = {light.name: light.state for light in self.lights}
        if states["unseen motion"] == "good" and states["physics"] == "bad":
            states["physics"] = "fair"
        overall = worst(state for state in states.values() if state != OPEN)
        return OPEN if overall == "good" and states["unseen motion"] == OPEN else overall

    def light(self, name: str) -> Light:
        """Return the light of one side: ``fit``, ``unseen motion``, ``knowledge``, ``physics`` or ``complete``."""
        return next(light for light in self.lights if light.name == name)

    def facts(self) -> dict[str, Any]:
        """Return the judgement for JSON."""
        return {
            "state": self.state,
            "sentence": self.sentence,
            "reasons": self.reasons,
            "lights": [light.facts() for light in self.lights],
            "warnings": self.warnings,
            "next": [{"why": step.why, "command": step.command} for step in self.steps],
        }

    def __repr__(self) -> str:
        """Return the answer, why, and what to do next."""
        next_steps = (f"next: {step.command}\n      {step.why}" for step in self.steps[:2])
        return "\n".join([*self.sentences, *next_steps])


def judge(evidence: Evidence) -> Judgement:
    """Return what is said of a model.

    Args:
        evidence: what is known of it.
    """
    sentence = answer(evidence)
    return Judgement(
        sentence,
        tuple(reasons(evidence, sentence)),
        evidence.lights,
        tuple(warnings(evidence)),
        merged(steps(evidence)),
    )


def merged(every: Iterable[Step]) -> tuple[Step, ...]:
    """Return steps with each command once, without those for lights that earlier ones may turn green.

    What a first step may turn green needs no second one, which often only makes sense without the first.
    """
    kept: dict[str, Step] = {}
    covered: set[str] = set()
    for step in every:
        if not step.lights or not covered.issuperset(step.lights):
            covered.update(step.lights)
            first = kept.get(step.command, step)
            kept[step.command] = replace(first, lights=(*first.lights, *step.lights))
    return tuple(kept.values())
