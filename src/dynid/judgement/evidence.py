"""What is known of a model when it is judged: numbers with units, and how good each side of the model is by them.

A fact that was not looked at is None, or an empty tuple. That is not good: it is unknown. A light is as bad as the
worst fact that it covers, and has the words of that fact.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import PurePath
from typing import TYPE_CHECKING, Any

from dynid.judgement import tuning
from dynid.text import shell

if TYPE_CHECKING:
    from dynid.judgement.gap import GapRecord


@dataclass(frozen=True)
class JointEvidence:
    """One joint.

    Attributes:
        joint: name.
        unit: of its torque.
        torque: rms of the measured torque on the fitted rows [unit].
        fitted: rms of what the model leaves of it [unit].
        noise: rms of what no model can explain: from repeats, or a lower bound [unit].
        limit: largest torque that the joint is built for [unit].
    """

    joint: str
    unit: str = "N m"
    torque: float | None = None
    fitted: float | None = None
    noise: float | None = None
    limit: float | None = None

    @property
    def percent(self) -> float | None:
        """What is unexplained of the torque on fitted rows [%]; None where that is not known."""
        return (
            100.0 * self.fitted / self.torque if self.fitted is not None and self.torque else None
        )

    @property
    def floor(self) -> float | None:
        """The noise that an error is compared with [unit]; None where none was measured."""
        least = tuning.SENSOR * (self.torque or 0.0)
        return None if self.noise is None else max(self.noise, least)

    def times(self, error: float) -> float | None:
        """Return an error [unit] over the noise; None where that is not known."""
        return error / self.floor if self.floor else None


@dataclass(frozen=True)
class Unseen:
    """Rows that were not fitted: what was held out, or a replayed log.

    Attributes:
        name: of the log, or what was held out.
        percent: relative error of all joints [%].
        rms: error of each joint, (n,) [N m or N]; () where it was not kept.
        same_motion: whether it repeats a fitted motion.
        expected: error that was expected on it [%].
        replayed: whether it is a replayed log; False for what was held out.
        log: path of the log.
    """

    name: str
    percent: float
    rms: tuple[float, ...] = ()
    same_motion: bool = False
    expected: float | None = None
    replayed: bool = False
    log: str = ""

    @property
    def surprise(self) -> float:
        """Error over the expected one; 0 where none was expected."""
        return self.percent / self.expected if self.expected else 0.0

    @property
    def changed(self) -> bool:
        """Whether a trained motion is predicted so much worse than expected that the arm is another one there."""
        return self.same_motion and self.surprise > tuning.EXPECTED[0]


@dataclass(frozen=True)
class Change:
    """One number in two results.

    Attributes:
        name: key of the JSON answer, a joint's figure with the joint in front; or base parameter.
        before: in the earlier result.
        after: in the later one.
        percent: change [%]; of a parameter against its value, or against ten standard errors where that is more.
        p_value: chance of such a change by noise alone; None where it was not asked.
        significant: whether it stands out among all parameters (Holm).
        unit: of the values, "" where they have none.
    """

    name: str
    before: float
    after: float
    percent: float = 0.0
    p_value: float | None = None
    significant: bool = False
    unit: str = ""


@dataclass(frozen=True)
class Evidence:
    """Everything that is known of one model of an arm.

    Attributes:
        asked: what the person wants to know now: ``"result"``, ``"replay"`` (the last of ``unseen``), ``"gap"`` or
            ``"change"``.
        robot: word that commands take for the arm.
        result: path of the result, "" for one that was not saved.
        logs: paths of the fitted logs.
        joints: one a joint.
        repeats: whether the noise comes from repeats; False for a lower bound, None where it was not looked at.
        fitted: relative error on the fitted rows [%].
        unseen: rows that were not fitted.
        possible: relative error of the nearest possible arm on the fitted rows [%].
        plain: that of the plain estimate [%].
        physical: whether predictions use the possible arm.
        doubts: codes of findings that say that no possible arm explains the torques.
        alarms: codes of findings that say that the robot file or the log is read wrongly.
        known: share of the parameters that are known as well as the torques need.
        open: number of parameters that the logs do not determine.
        gap: what a search for missing effects found.
        changes: numbers that changed since an earlier result, the surest first; None where there is no earlier one
            with the same parameters.
        earlier: name of that.
        earlier_result: path of that.
        tolerance: largest change that counts as none, as a share; None to measure by the noise.
    """

    asked: str = "result"
    robot: str = "ROBOT"
    result: str = ""
    logs: tuple[str, ...] = ()
    joints: tuple[JointEvidence, ...] = ()
    repeats: bool | None = None
    fitted: float | None = None
    unseen: tuple[Unseen, ...] = ()
    possible: float | None = None
    plain: float | None = None
    physical: bool | None = None
    doubts: tuple[str, ...] = ()
    alarms: tuple[str, ...] = ()
    known: float | None = None
    open: int | None = None
    gap: GapRecord | None = None
    changes: tuple[Change, ...] | None = None
    earlier: str = ""
    earlier_result: str = ""
    tolerance: float | None = None

    @cached_property
    def lights(self) -> tuple[Light, ...]:
        """How good fit, unseen motion, parameters, physics and missing effects are."""
        rows = []
        for name, title, covered, unknown in LIGHTS:
            facts = list(covered(self))
            state = worst(each for each, _ in facts) if facts else OPEN
            text = "; ".join(text for each, text in facts if each == state and text)
            rows.append(Light(name, title, state, text if facts else unknown))
        return tuple(rows)

    @cached_property
    def states(self) -> dict[str, str]:
        """State of each light by name."""
        return {light.name: light.state for light in self.lights}

    @cached_property
    def gap_evidence(self) -> GapRecord:
        """What the search found; a search that found nothing where there was none."""
        from dynid.judgement.gap import GapRecord  # with NumPy, and help must be fast

        return self.gap or GapRecord()

    @property
    def amperes(self) -> bool:
        """Whether torques are amperes, so that the sizes of masses are unknown."""
        return any(joint.unit == "A" for joint in self.joints)

    @property
    def or_more(self) -> str:
        """What follows a noise level: without repeats it is a lower bound."""
        source = self.gap_evidence if self.asked == "gap" else self
        return "" if source.repeats else " or more"

    @cached_property
    def searched(self) -> bool:
        """Whether a search has looked at everything that the model misses."""
        return self.gap is not None and not self.odd

    @cached_property
    def odd(self) -> list[Unseen]:
        """Replays that the model misses and no search has looked at."""
        seen = self.gap_evidence.logs
        return [
            each
            for each in self.unseen
            if each.log and each.log not in seen and unseen_state(each, self) != "good"
        ]

    @cached_property
    def nothing(self) -> bool:
        """Whether the search found that nothing is missing in its logs."""
        return worst(state for state, _ in of_search(self.gap_evidence)) == "good"

    @cached_property
    def worst_elsewhere(self) -> Unseen | None:
        """The motion that was not fitted and speaks most against the model."""
        return worst_of((u for u in self.unseen if not u.same_motion), self)

    @cached_property
    def run(self) -> str:
        """Word for the result in a command."""
        return folder_of(self.result) or "RESULT"

    @cached_property
    def fitted_logs(self) -> tuple[str, ...]:
        """The fitted logs in a command; LOG stands for a recording that only the user can name."""
        return tuple(filter(None, self.logs)) or ("LOG",)

    @cached_property
    def to_search(self) -> tuple[str, ...]:
        """The logs to search: replays that went wrong, else those of the search before, else the fitted ones."""
        return tuple(each.log for each in self.odd) or self.gap_evidence.logs or self.fitted_logs

    @cached_property
    def search(self) -> str:
        """The command that searches for missing effects."""
        return shell("dynid", "gap", self.run, *self.to_search)


def folder_of(result: str) -> str:
    """Return the word for a result in a command: its folder, or its file where that has another name."""
    path = PurePath(result)
    return str(path.parent) if path.name == "parameters.npz" else result


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
        title: the same as a reader sees it.
        state: ``"good"``, ``"fair"``, ``"bad"`` or ``"open"``.
        text: the facts that it is as bad as, in numbers.
    """

    name: str
    title: str
    state: str
    text: str

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


def shown(number: float) -> str:
    """Return a share in percent or a ratio as it is said: two digits, and whole numbers from a hundred on."""
    return f"{number:.0f}" if number >= 99.5 else f"{number:.2g}"


def over_noise(times: float) -> str:
    """Return how far an error is from its noise, in words."""
    return "at its noise" if times <= tuning.AT_NOISE else f"{shown(times)} times its noise"


def joint_state(joint: JointEvidence) -> str:
    """Return how well a joint is fitted: at its noise it is good, whatever share of its torque noise is.

    A joint that carries little has a large share missing by an error that its drive does not notice.
    """
    error, percent = joint.fitted or 0.0, joint.percent
    if percent is None:
        return "good"
    times = joint.times(error)
    if times is not None and times <= tuning.AT_NOISE:
        return "good"
    small = joint.limit is not None and error <= tuning.SMALL * joint.limit
    return min(grade(percent, tuning.FIT), STATES[2 - small], key=STATES.index)


def farthest(unseen: Unseen, evidence: Evidence) -> tuple[JointEvidence, float, float] | None:
    """Return the joint that is furthest above its noise on unseen rows, its error [unit] and that over its noise."""
    pairs = zip(evidence.joints, unseen.rms, strict=False)
    errors = (
        (joint, error, times) for joint, error in pairs if (times := joint.times(error)) is not None
    )
    return max(errors, key=lambda each: each[2], default=None)


def at_noise(unseen: Unseen, evidence: Evidence) -> bool:
    """Return whether every joint with torque is known to be at its noise on unseen rows."""
    far = farthest(unseen, evidence)
    known = all(joint.floor for joint in evidence.joints if joint.torque != 0.0)
    return far is not None and known and far[2] <= tuning.AT_NOISE


def unseen_state(unseen: Unseen, evidence: Evidence) -> str:
    """Return how good a model is on rows that were not fitted."""
    if at_noise(unseen, evidence):
        return "good"
    # What was held out is predicted by a model of the rest alone, a replay by the one that is judged.
    if not unseen.replayed and any(u.replayed and not u.same_motion for u in evidence.unseen):
        return "fair"
    worse = unseen.percent > tuning.UNSEEN_FAIR or unseen.surprise > tuning.EXPECTED[1]
    return "bad" if worse else "fair"


def worst_of(rows: Iterable[Unseen], evidence: Evidence) -> Unseen | None:
    """Return the unseen rows that speak most against a model; of two states alike those of another motion."""
    return max(
        rows,
        key=lambda row: (
            STATES.index(unseen_state(row, evidence)),
            not row.same_motion,
            row.percent,
        ),
        default=None,
    )


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
    """Little is no more than fair, because errors on other motions show the rest; hardly anything is bad."""
    if evidence.known is not None:
        text = f"{100 * evidence.known:.0f} % of the parameters are determined well enough for the torques"
        yield grade(1.0 - evidence.known, tuning.OPEN_SHARE), text


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


def _complete(evidence: Evidence) -> Iterator[Fact]:
    if evidence.gap is not None:
        yield from of_search(evidence.gap)
        for each in evidence.odd:
            yield "fair", f"{each.name} was not searched"


def above_noise(gap: GapRecord) -> list[tuple[str, float, float]]:
    """Return the joints that are not at their noise on rows that were not fitted, with error and noise [N m or N]."""
    rows = zip(gap.joint_names, gap.errors, gap.improvement.allowed, strict=True)
    return [row for row in rows if not row[2] or row[1] > tuning.MISSING[not gap.repeats] * row[2]]


def of_search(gap: GapRecord) -> list[Fact]:
    """Return what a search says of the logs that it has seen."""
    texts = (f"{name} {error:.2g}, noise {noise:.2g}" for name, error, noise in above_noise(gap))
    facts = [("fair", text) for text in texts] or [("good", "")] * len(gap.joint_names)
    if gap.surprise is not None:
        text = (
            f"relative torque error {gap.kept:.2g} % on the new logs, expected {gap.expected:.2g} %"
        )
        facts.append(unless_good(grade(gap.surprise, tuning.EXPECTED), text))
    named = [f"{one.title} on {one.where}" for one in gap.missing]
    if names := named or [f"perhaps {one.title} on {one.where}" for one in gap.likely]:
        facts.append(("fair", ", ".join(names)))
    if gap.more:
        facts.append(("fair", f"residual above the noise on {', '.join(gap.more)}"))
    if joints := dict.fromkeys((*gap.not_repeatable, *(each.joint for each in gap.events))):
        facts.append(("fair", f"disturbance that does not repeat on {', '.join(joints)}"))
    return facts or [("fair", "the search compared no joint with its noise")]


#: The lights: name, what it is about as a reader sees it, the facts that each covers, and what is said without any.
LIGHTS = (
    ("fit", "fit", _fit, "no log was fitted"),
    ("unseen motion", "validation", _unseen, "not validated on another motion"),
    (
        "knowledge",
        "parameters",
        _knowledge,
        "it is not known how well the logs determine the parameters",
    ),
    ("physics", "physics", _physics, "physical consistency was not checked"),
    ("complete", "missing effects", _complete, "not searched: dynid gap"),
)
