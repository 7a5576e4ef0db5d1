"""What follows from evidence before anything is said: how good each side of a model is, and why, in numbers.

A light is as bad as the worst fact that it covers, and has the words of that fact.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from math import isfinite
from pathlib import PurePath
from typing import Any

from dynid.judgement import tuning
from dynid.judgement.evidence import Evidence, GapEvidence, JointEvidence, Unseen
from dynid.text import shell

#: From best to worst. A light that no fact stands behind is open, which is no praise.
STATES = ("good", "fair", "bad")
OPEN = "open"
#: A state and the fact that it comes from, in words.
Fact = tuple[str, str]


@dataclass(frozen=True)
class Light:
    """One light.

    Attributes:
        name: what it is about; a key of JSON answers.
        state: ``"good"``, ``"fair"``, ``"bad"`` or ``"open"``.
        text: the facts that it is as bad as, in numbers.
    """

    name: str
    state: str
    text: str

    @property
    def title(self) -> str:
        """What it is about, as a reader sees it."""
        names = {
            "unseen motion": "validation",
            "knowledge": "parameters",
            "complete": "missing effects",
        }
        return names.get(self.name, self.name)

    @property
    def shown(self) -> str:
        """The state as a reader sees it."""
        return "untested" if self.state == OPEN else self.state

    def facts(self) -> dict[str, Any]:
        """Return the light for JSON."""
        return {"name": self.name, "state": self.state, "text": self.text}


def worst(states: Iterable[str]) -> str:
    """Return the worst of some states, ``"good"`` of none."""
    return max(states, key=STATES.index, default="good")


def grade(value: float, limits: tuple[float, float]) -> str:
    """Return the state of a number that should be small."""
    return "good" if value <= limits[0] else "fair" if value <= limits[1] else "bad"


def unless_good(state: str, text: str) -> Fact:
    """Return a fact that is worth words only where it is not good."""
    return state, "" if state == "good" else text


def shown(percent: float) -> str:
    """Return a share in percent as it is said: two digits, and whole numbers from a hundred on."""
    return f"{percent:.0f}" if percent >= 99.5 else f"{percent:.2g}"


def over_noise(times: float) -> str:
    """Return how far an error is from its noise, in words."""
    return "at its noise" if times <= tuning.AT_NOISE else f"{times:.2g} times its noise"


def joint_state(joint: JointEvidence) -> str:
    """Return how well a joint is fitted: at its noise it is good, whatever share of its torque noise is.

    A joint that carries little has a large share missing by an error that its drive does not notice.
    """
    error, percent = joint.fitted, joint.percent
    if error is None or percent is None:
        return "good"
    times = joint.times(error)
    if times is not None and times <= tuning.AT_NOISE:
        return "good"
    small = joint.limit is not None and error <= tuning.SMALL * joint.limit
    return min(grade(percent, tuning.FIT), STATES[2 - small], key=STATES.index)


def farthest(unseen: Unseen, evidence: Evidence) -> tuple[JointEvidence, float, float] | None:
    """Return the joint that is furthest above its noise on unseen rows, its error [unit] and that over its noise."""
    if len(unseen.rms) != len(evidence.joints):
        return None
    pairs = zip(evidence.joints, unseen.rms, strict=True)
    errors = (
        (joint, error, times) for joint, error in pairs if (times := joint.times(error)) is not None
    )
    return max(errors, key=lambda each: each[2], default=None)


def at_noise(unseen: Unseen, evidence: Evidence) -> bool:
    """Return whether every joint is known to be at its noise on unseen rows."""
    far, known = farthest(unseen, evidence), all(joint.floor for joint in evidence.joints)
    return far is not None and known and far[2] <= tuning.AT_NOISE


def unseen_state(unseen: Unseen, evidence: Evidence) -> str:
    """Return how good a model is on rows that were not fitted."""
    if at_noise(unseen, evidence):
        return "good"
    # What was held out is predicted by a model of the rest alone, a replay by the one that is judged.
    if not unseen.replayed and any(u.replayed and not u.same_motion for u in evidence.unseen):
        return "fair"
    worse = unseen.percent > tuning.UNSEEN_FAIR or (unseen.surprise or 0.0) > tuning.EXPECTED[1]
    return "bad" if worse else "fair"


def worst_of(rows: Iterable[Unseen], evidence: Evidence) -> Unseen | None:
    """Return the unseen rows that speak most against a model; of two states alike those of another motion."""

    def weight(row: Unseen) -> tuple[int, bool, float]:
        return STATES.index(unseen_state(row, evidence)), not row.same_motion, row.percent

    return max(rows, key=weight, default=None)


# ---------------------------------------------------------------- the facts of each light
def _fit(evidence: Evidence) -> Iterator[Fact]:
    states = []
    for joint in evidence.joints:
        if joint.percent is not None:
            times = joint.times(joint.fitted or 0.0)
            noise = "" if times is None else f", {over_noise(times)}"
            text = f"{joint.joint} {shown(joint.percent)} %{noise}"
            states.append(unless_good(joint_state(joint), text))
    if states and evidence.fitted is not None:
        yield (
            worst(state for state, _ in states),
            f"relative torque error {shown(evidence.fitted)} %",
        )
    yield from states
    if evidence.alarms:
        codes = ", ".join(evidence.alarms)
        yield "bad", f"the robot file does not describe the arm of the logs ({codes})"
    if evidence.other is not None:
        yield "bad", f"{evidence.other.name} explains the logs better"
    if evidence.left_out is not None:
        text = f"{100 * evidence.left_out:.0f} % of the samples left out"
        yield unless_good(grade(evidence.left_out, tuning.LEFT_OUT), text)


def _unseen(evidence: Evidence) -> Iterator[Fact]:
    """The same motion again can only speak against a model; of all replays the worst says why."""
    rows = [u for u in evidence.unseen if not u.same_motion or unseen_state(u, evidence) != "good"]
    if most := worst_of(rows, evidence):
        far = farthest(most, evidence)
        expected = f", {most.expected:.2g} % expected" if most.expected else ""
        joint = f", {far[0].joint} {over_noise(far[2])}" if far else ""
        text = f"relative torque error {shown(most.percent)} % on {most.name}{expected}{joint}"
        yield unseen_state(most, evidence), text


def _knowledge(evidence: Evidence) -> Iterator[Fact]:
    """Too little is no more than fair, because errors on other motions show the rest."""
    if evidence.known is not None:
        text = (
            f"{100 * evidence.known:.0f} % of the parameters determined well enough for the torques"
        )
        yield "good" if evidence.known >= tuning.KNOWN else "fair", text
    if evidence.condition is not None and evidence.condition > tuning.CONDITION:
        size = f"condition number {evidence.condition:.3g}"
        yield "fair", size if isfinite(evidence.condition) else "the regressor is rank deficient"
    if evidence.seconds is not None and evidence.seconds < tuning.SECONDS:
        yield "fair", f"only {evidence.seconds:.2g} s of motion"


def _physics(evidence: Evidence) -> Iterator[Fact]:
    if evidence.physical:
        yield "good", "the parameters are physically consistent"
    if evidence.physical is False:
        yield "fair", "predictions use least squares, which need not be physically consistent"
    possible, free = evidence.possible, evidence.plain
    if possible is not None and free is not None:
        near = grade(possible / max(free, 1e-9), tuning.POSSIBLE)
        state = "good" if possible <= tuning.HARMLESS else near
        # What a possible arm leaves may be friction: it is no more than fair.
        state = "fair" if state == "bad" and possible <= tuning.FIT[0] else state
        text = f"relative torque error {possible:.2g} % if physically consistent, {free:.2g} % by least squares"
        yield unless_good(state, text)
    if evidence.doubts:
        codes = ", ".join(dict.fromkeys(evidence.doubts))
        state = "bad" if evidence.physical is False else "fair"
        yield state, f"physically consistent parameters fit worse ({codes})"
    if evidence.mass is not None and evidence.reach:
        text = f"the links weigh {evidence.mass:.3g} kg in all on {evidence.reach:.2g} m of arm"
        yield unless_good(grade(evidence.mass / evidence.reach**2, tuning.MASS), text)


def _complete(evidence: Evidence) -> Iterator[Fact]:
    if evidence.gap is not None:
        yield from of_search(evidence.gap)
        for each in unsearched(evidence):
            yield "fair", f"{each.name} was not searched"


def of_search(gap: GapEvidence) -> list[Fact]:
    """Return what a search says of the logs that it has seen."""
    facts = []
    for name, error, noise in zip(gap.joints, gap.errors, gap.allowed, strict=True):
        more = not noise or error > tuning.MISSING[not gap.repeats] * noise
        state = "fair" if more else "good"
        facts.append(unless_good(state, f"{name} {error:.2g}, noise {noise:.2g}"))
    if gap.surprise is not None:
        text = (
            f"relative torque error {gap.kept:.2g} % on the new logs, expected {gap.expected:.2g} %"
        )
        facts.append(unless_good(grade(gap.surprise, tuning.EXPECTED), text))
    if gap.missing or len(gap.effects) > len(gap.named):
        named = [f"{one.title} on {one.where}" for one in gap.missing]
        likely = [f"perhaps {one.title} on {one.where}" for one in gap.effects if not one.named]
        facts.append(("fair", ", ".join(named or likely)))
    if gap.more:
        facts.append(("fair", f"residual above the noise on {', '.join(gap.more)}"))
    if joints := dict.fromkeys((*gap.unrepeatable, *(each.joint for each in gap.events))):
        facts.append(("fair", f"disturbance that does not repeat on {', '.join(joints)}"))
    return facts or [("fair", "the search compared no joint with its noise")]


def unsearched(evidence: Evidence) -> list[Unseen]:
    """Return replays that the model misses and that the search for missing effects has not looked at."""
    seen = () if evidence.gap is None else evidence.gap.logs
    return [
        each
        for each in evidence.unseen
        if each.log and each.log not in seen and unseen_state(each, evidence) != "good"
    ]


#: The lights: name, the facts that each covers, and what is said where there is none.
LIGHTS = (
    ("fit", _fit, "no log was fitted"),
    ("unseen motion", _unseen, "not validated on another motion"),
    ("knowledge", _knowledge, "it is not known how well the logs determine the parameters"),
    ("physics", _physics, "physical consistency was not checked"),
    ("complete", _complete, "not searched: dynid gap"),
)


def lights(evidence: Evidence) -> tuple[Light, ...]:
    """Return the lights of fit, unseen motion, parameters, physics and missing effects."""
    rows = []
    for name, covered, unknown in LIGHTS:
        facts = list(covered(evidence))
        state = worst(each for each, _ in facts) if facts else OPEN
        text = "; ".join(text for each, text in facts if each == state and text)
        rows.append(Light(name, state, text if facts else unknown))
    return tuple(rows)


@dataclass(frozen=True)
class Case:
    """Evidence with what the rules ask of it."""

    evidence: Evidence

    @cached_property
    def lights(self) -> tuple[Light, ...]:
        """How good each side is."""
        return lights(self.evidence)

    @cached_property
    def states(self) -> dict[str, str]:
        """State of each light by name."""
        return {light.name: light.state for light in self.lights}

    @cached_property
    def gap(self) -> GapEvidence:
        """What the search found; a search that found nothing where there was none."""
        return self.evidence.gap or GapEvidence("")

    @property
    def or_more(self) -> str:
        """What follows a noise level: without repeats it is a lower bound."""
        source = self.gap if self.evidence.asked == "gap" else self.evidence
        return "" if source.repeats else " or more"

    @cached_property
    def searched(self) -> bool:
        """Whether a search has looked at everything that the model misses."""
        return self.evidence.gap is not None and not self.odd

    @cached_property
    def odd(self) -> list[Unseen]:
        """Replays that the model misses and no search has looked at."""
        return unsearched(self.evidence)

    @cached_property
    def nothing(self) -> bool:
        """Whether the search found that nothing is missing in its logs."""
        return worst(state for state, _ in of_search(self.gap)) == "good"

    @cached_property
    def weak(self) -> dict[str, float]:
        """Joints whose fit is bad, and what is unexplained there [%]."""
        return {x.joint: x.percent or 0.0 for x in self.evidence.joints if joint_state(x) == "bad"}

    @cached_property
    def worst_unseen(self) -> Unseen | None:
        """The unseen rows that speak most against the model."""
        return worst_of(self.evidence.unseen, self.evidence)

    @cached_property
    def worst_elsewhere(self) -> Unseen | None:
        """The same of motion that was not fitted."""
        return worst_of((u for u in self.evidence.unseen if not u.same_motion), self.evidence)

    @cached_property
    def run(self) -> str:
        """Word for the result in a command."""
        return folder_of(self.evidence.result) or "RESULT"

    @cached_property
    def logs(self) -> tuple[str, ...]:
        """The fitted logs in a command; LOG stands for a recording that only the user can name."""
        return tuple(filter(None, self.evidence.logs)) or ("LOG",)

    @cached_property
    def to_search(self) -> tuple[str, ...]:
        """The logs to search: replays that went wrong, else those of the search before, else the fitted ones."""
        return tuple(each.log for each in self.odd) or self.gap.logs or self.logs

    @cached_property
    def search(self) -> str:
        """The command that searches for missing effects."""
        return shell("dynid", "gap", self.run, *self.to_search)


def folder_of(result: str) -> str:
    """Return the word for a result in a command: its folder, or its file where that has another name."""
    path = PurePath(result)
    return str(path.parent) if path.name == "parameters.npz" else result
