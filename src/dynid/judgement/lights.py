"""Lights: how good each side of a model is, each no better than the worst fact that it covers."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from dynid.judgement import tuning
from dynid.judgement.evidence import Evidence, GapEvidence, JointEvidence, Unseen

#: From best to worst. A light that no fact stands behind is open, which is no praise.
STATES = ("good", "fair", "bad")
OPEN = "open"


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
        return {"knowledge": "parameters", "complete": "missing effects"}.get(self.name, self.name)

    @property
    def shown(self) -> str:
        """The state as a reader sees it."""
        return "untested" if self.state == OPEN else self.state

    def facts(self) -> dict[str, Any]:
        """Return the light for JSON."""
        return {"name": self.name, "state": self.state, "text": self.text}


#: A state and the fact that it comes from, in words.
Fact = tuple[str, str]


def worst(states: Iterable[str]) -> str:
    """Return the worst of some states, ``"good"`` of none."""
    return max(states, key=STATES.index, default="good")


def grade(value: float, limits: tuple[float, float]) -> str:
    """Return the state of a number that should be small."""
    return "good" if value <= limits[0] else "fair" if value <= limits[1] else "bad"


def _light(name: str, facts: Sequence[Fact], unknown: str) -> Light:
    """Return the light of some facts: as bad as the worst of them, whose words it has."""
    if not facts:
        return Light(name, OPEN, unknown)
    state = worst(each for each, _ in facts)
    return Light(name, state, "; ".join(text for each, text in facts if each == state and text))


def lights(evidence: Evidence) -> tuple[Light, ...]:
    """Return the lights of fit, unseen motion, parameters, physics and missing effects."""
    return (
        _light("fit", _of_fit(evidence), "no log was fitted"),
        _unseen_light(evidence),
        _light(
            "knowledge",
            _of_knowledge(evidence),
            "it is not known how well the logs determine the parameters",
        ),
        _light("physics", _of_physics(evidence), "nobody asked whether such an arm can exist"),
        _light("complete", _of_gap(evidence), "nobody has searched for missing effects: dynid gap"),
    )


def shown(percent: float) -> str:
    """Return a share in percent as it is said: two digits, and whole numbers from a hundred on."""
    return f"{percent:.0f}" if percent >= 99.5 else f"{percent:.2g}"


# ---------------------------------------------------------------- errors and what they are compared with
def floor(joint: JointEvidence) -> float | None:
    """Return the noise that an error of a joint is compared with [unit]; None where none was measured."""
    return None if joint.noise is None else max(joint.noise, tuning.SENSOR * (joint.torque or 0.0))


def ratio(error: float, joint: JointEvidence) -> float | None:
    """Return an error over the noise of its joint; None where that is not known."""
    noise = floor(joint)
    return None if not noise else error / noise


def at_noise(unseen: Unseen, evidence: Evidence) -> bool | None:
    """Return whether every joint is at its noise on unseen rows; None where the noise is not known."""
    if not evidence.joints or len(unseen.rms) != len(evidence.joints):
        return None
    ratios = [ratio(error, joint) for error, joint in zip(unseen.rms, evidence.joints, strict=True)]
    known = [each for each in ratios if each is not None]
    return None if len(known) < len(ratios) else max(known) <= tuning.AT_NOISE


def joint_state(joint: JointEvidence) -> str:
    """Return how well a joint is fitted: at its noise it is good, whatever share of its torque noise is.

    Why the limit: a joint that carries little has a large share missing by an error that its drive does not notice.
    """
    if joint.fitted is None or not joint.torque:
        return "good"
    times = ratio(joint.fitted, joint)
    if times is not None and times <= tuning.AT_NOISE:
        return "good"
    state = grade(100.0 * joint.fitted / joint.torque, tuning.FIT)
    small = joint.limit is not None and joint.fitted <= tuning.SMALL * joint.limit
    return "fair" if state == "bad" and small else state


def surprise(unseen: Unseen) -> float | None:
    """Return an error over the expected one; None where none was expected."""
    return unseen.percent / unseen.expected if unseen.expected else None


def farthest(unseen: Unseen, evidence: Evidence) -> tuple[JointEvidence, float, float] | None:
    """Return the joint that is furthest above its noise on unseen rows, its error [unit] and that over its noise."""
    if len(unseen.rms) != len(evidence.joints):
        return None
    found = [
        (joint, error, times)
        for joint, error in zip(evidence.joints, unseen.rms, strict=True)
        if (times := ratio(error, joint)) is not None
    ]
    return max(found, key=lambda each: each[2], default=None)


def over_noise(times: float) -> str:
    """Return how far an error is from its noise, in words."""
    return "at its noise" if times <= tuning.AT_NOISE else f"{times:.2g} times its noise"


def unseen_state(unseen: Unseen, evidence: Evidence) -> str:
    """Return how good a model is on rows that were not fitted."""
    if at_noise(unseen, evidence):
        return "good"
    # Why: what was held out is predicted by a model of the rest alone, a replay by the one that is judged.
    if not unseen.replayed and any(
        each.replayed and not each.same_motion for each in evidence.unseen
    ):
        return "fair"
    state = "fair" if unseen.percent <= tuning.UNSEEN_FAIR else "bad"
    times = surprise(unseen)
    return (
        state if times is None else worst((state, "bad" if times > tuning.EXPECTED[1] else "fair"))
    )


# ---------------------------------------------------------------- the facts of each light
def _of_fit(evidence: Evidence) -> list[Fact]:
    found: list[Fact] = []
    for joint in evidence.joints:
        if joint.fitted is None or not joint.torque:
            continue
        percent, times, state = (
            100.0 * joint.fitted / joint.torque,
            ratio(joint.fitted, joint),
            joint_state(joint),
        )
        noise = "" if times is None or state == "good" else f", {over_noise(times)}"
        found.append((state, f"{joint.joint} {shown(percent)} %{noise}" if state != "good" else ""))
    if found and evidence.fitted is not None:
        found.insert(
            0, (worst(state for state, _ in found), f"{shown(evidence.fitted)} % unexplained")
        )
    if evidence.alarms:
        found.append(
            (
                "bad",
                f"the robot file does not describe the arm of the logs ({', '.join(evidence.alarms)})",
            )
        )
    if evidence.other is not None:
        found.append(("bad", f"{evidence.other.name} explains the logs better"))
    if evidence.left_out is not None:
        state = grade(evidence.left_out, tuning.LEFT_OUT)
        found.append(
            (
                state,
                f"{100 * evidence.left_out:.0f} % of the samples left out"
                if state != "good"
                else "",
            )
        )
    return found


def _unseen_light(evidence: Evidence) -> Light:
    """Return the light of rows that were not fitted; the same motion again can only speak against a model."""
    facts: list[tuple[str, Unseen]] = []
    for each in evidence.unseen:
        state = unseen_state(each, evidence)
        if each.same_motion and state == "good":
            continue
        facts.append((state, each))
    # Why one text: all replays together fill a page, and what is worst says why.
    told = max(
        facts,
        key=lambda fact: (STATES.index(fact[0]), not fact[1].same_motion, fact[1].percent),
        default=None,
    )
    texts = [
        (state, _unseen_text(each, evidence) if (state, each) == told else "")
        for state, each in facts
    ]
    return _light("unseen motion", texts, "no recording of another motion was replayed")


def _unseen_text(unseen: Unseen, evidence: Evidence) -> str:
    """Return what came out on unseen rows beside what it is compared with."""
    text = f"{shown(unseen.percent)} % unexplained on {unseen.name}"
    far = farthest(unseen, evidence)
    if unseen.expected:
        text += f", {unseen.expected:.2g} % expected"
    return text if far is None else f"{text}, {far[0].joint} {over_noise(far[2])}"


def _of_knowledge(evidence: Evidence) -> list[Fact]:
    """Return how much the logs say; too little is no more than fair, because errors on other motions tell the rest."""
    found: list[Fact] = []
    if evidence.known is not None:
        text = f"{100 * evidence.known:.0f} % of the parameters known as well as the torques need"
        found.append(("good" if evidence.known >= tuning.KNOWN else "fair", text))
    if evidence.condition is not None and evidence.condition > tuning.CONDITION:
        found.append(("fair", f"condition number {evidence.condition:.3g}"))
    if evidence.seconds is not None and evidence.seconds < tuning.SECONDS:
        found.append(("fair", f"only {evidence.seconds:.2g} s of motion"))
    return found


def _of_physics(evidence: Evidence) -> list[Fact]:
    found: list[Fact] = []
    if evidence.physical is not None:
        if evidence.physical:
            found.append(("good", "every link is a body that can exist"))
        else:
            found.append(
                ("fair", "predictions use the plain estimate, which no arm with masses need have")
            )
    if evidence.possible is not None and evidence.plain is not None:
        near = grade(evidence.possible / max(evidence.plain, 1e-9), tuning.POSSIBLE)
        small = evidence.possible <= tuning.FIT[0]
        state = "good" if near == "good" or evidence.possible <= tuning.HARMLESS else near
        # Why not bad: what a possible arm leaves may be friction; it is no more than fair, and told.
        state = "fair" if state == "bad" and small else state
        text = f"the nearest possible arm leaves {evidence.possible:.2g} %, the plain estimate {evidence.plain:.2g} %"
        found.append((state, text if state != "good" else ""))
    if evidence.doubts:
        state = "bad" if evidence.physical is False else "fair"
        found.append(
            (
                state,
                f"bodies that can exist explain the torques worse ({', '.join(dict.fromkeys(evidence.doubts))})",
            )
        )
    if evidence.mass is not None and evidence.reach:
        state = grade(evidence.mass / evidence.reach**2, tuning.MASS)
        text = f"the links weigh {evidence.mass:.3g} kg in all on {evidence.reach:.2g} m of arm"
        found.append((state, text if state != "good" else ""))
    return found


def _of_gap(evidence: Evidence) -> list[Fact]:
    if evidence.gap is None:
        return []
    missed = [("fair", f"the search has not seen {each.name}") for each in unsearched(evidence)]
    return [*_of_search(evidence.gap), *missed]


def finds_nothing(gap: GapEvidence) -> bool:
    """Return whether a search says that nothing is missing in the logs that it has seen."""
    return worst(state for state, _ in _of_search(gap)) == "good"


def _of_search(gap: GapEvidence) -> list[Fact]:
    found: list[Fact] = []
    for name, error, noise in zip(gap.joints, gap.errors, gap.allowed, strict=True):
        more = not noise or error > tuning.MISSING[not gap.repeats] * noise
        found.append(
            ("fair" if more else "good", f"{name} {error:.2g}, noise {noise:.2g}" if more else "")
        )
    if (surprised := gap.surprise) is not None:
        state = grade(surprised, tuning.EXPECTED)
        text = f"the model misses {gap.kept:.2g} % of the new torques, {gap.expected:.2g} % was expected"
        found.append((state, text if state != "good" else ""))
    if gap.missing or len(gap.effects) > len(gap.named):
        named = ", ".join(f"{one.title} on {one.where}" for one in gap.missing)
        likely = ", ".join(
            f"perhaps {one.title} on {one.where}" for one in gap.effects if not one.named
        )
        found.append(("fair", named or likely))
    if gap.more:
        found.append(("fair", f"more than noise on {', '.join(gap.more)}"))
    if gap.unrepeatable or gap.events:
        joints = dict.fromkeys((*gap.unrepeatable, *(each.joint for each in gap.events)))
        found.append(("fair", f"what does not repeat on {', '.join(joints)}"))
    return found or [("fair", "the search compared no joint with its noise")]


def unsearched(evidence: Evidence) -> list[Unseen]:
    """Return replays that the model misses and that the search for missing effects has not looked at."""
    seen = () if evidence.gap is None else evidence.gap.logs
    return [
        each
        for each in evidence.unseen
        if each.log and each.log not in seen and unseen_state(each, evidence) != "good"
    ]
