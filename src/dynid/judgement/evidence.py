"""What is known of a model when it is judged: numbers with units, and no words of its own.

A fact that was not looked at is None, or an empty tuple. That is not good: it is unknown.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dynid.judgement import tuning


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
    def surprise(self) -> float | None:
        """Error over the expected one; None where none was expected."""
        return self.percent / self.expected if self.expected else None

    @property
    def changed(self) -> bool:
        """Whether a trained motion is predicted so much worse than expected that the arm is another one there."""
        return self.same_motion and (self.surprise or 0.0) > tuning.EXPECTED[0]


@dataclass(frozen=True)
class EffectEvidence:
    """An effect that the model lacks.

    Attributes:
        effect: identifier.
        title: what it is, such as "Stribeck friction".
        where: the joint or joints, in words.
        sizes: name, value, standard error (None where the logs do not determine it) and unit of each number.
        named: whether it is proved; False for what is only likely, or one of several.
        probability: that it is this one, between 0 and 1.
        joint: name of the joint that shows it most.
        before: error of that joint on rows that were not fitted, without it [unit].
        after: and with it [unit].
        unit: of these.
        why_not: why it is not named.
        corrected: whether predictions allow for it already, as for a delay that was found when the arm was identified.
        rivals: others that explain as much, in words.
    """

    title: str
    where: str
    effect: str = ""
    sizes: tuple[tuple[str, float, float | None, str], ...] = ()
    named: bool = True
    probability: float | None = None
    joint: str = ""
    before: float | None = None
    after: float | None = None
    unit: str = "N m"
    why_not: str = ""
    corrected: bool = False
    rivals: tuple[str, ...] = ()


@dataclass(frozen=True)
class Event:
    """A disturbance that happened once.

    Attributes:
        log: path of the log.
        joint: name.
        start: in the log's time [s].
        end: in the log's time [s].
        size: largest torque [unit].
        unit: of it.
    """

    log: str
    joint: str
    start: float
    end: float
    size: float
    unit: str = "N m"


@dataclass(frozen=True)
class GapEvidence:
    """What a search for missing effects found.

    Attributes:
        question: ``"numbers"``, ``"arm"`` or ``"changed"``.
        ambiguous: whether several effects explain as much.
        effects: what was found, what is named first.
        joints: names of the joints, n.
        before: error of each joint on rows that were not fitted, without the named effects, (n,) [N m or N].
        after: and with them, (n,) [N m or N].
        noise: rms of the noise of each joint, (n,) [N m or N].
        known: rms of what recorder, filter and reversals do, and of what unsure parameters leave, (n,) [N m or N].
        repeats: whether the noise comes from repeats.
        more: names of joints where more is left than noise, with or without the named effects.
        unrepeatable: names of joints whose disturbance does not repeat.
        events: disturbances that happened once.
        kept: error of the model as it was on the new logs [%].
        expected: error that was expected there [%].
        kept_rms: error of each joint of that model there, (n,) [N m or N]; () where it was not kept.
        logs: paths of the logs.
        instead: what an arm of other links would have, where nothing is missing with these.
    """

    question: str
    ambiguous: bool = False
    effects: tuple[EffectEvidence, ...] = ()
    joints: tuple[str, ...] = ()
    before: tuple[float, ...] = ()
    after: tuple[float, ...] = ()
    noise: tuple[float, ...] = ()
    known: tuple[float, ...] = ()
    repeats: bool = False
    more: tuple[str, ...] = ()
    unrepeatable: tuple[str, ...] = ()
    events: tuple[Event, ...] = ()
    kept: float | None = None
    expected: float | None = None
    kept_rms: tuple[float, ...] = ()
    logs: tuple[str, ...] = ()
    instead: tuple[EffectEvidence, ...] = ()

    @property
    def allowed(self) -> tuple[float, ...]:
        """Rms of what no effect has to explain: noise, and known errors, (n,) [N m or N]."""
        known = self.known or (0.0,) * len(self.noise)
        return tuple(math.hypot(*pair) for pair in zip(self.noise, known, strict=True))

    @property
    def surprise(self) -> float | None:
        """Error of the model as it was over the expected one, where that is more than the noise; None where unknown."""
        if self.kept is None or not self.expected:
            return None
        rows = zip(self.kept_rms, self.allowed, strict=False)
        at_noise = len(self.kept_rms) == len(self.noise) > 0 and all(
            x <= tuning.AT_NOISE * noise for x, noise in rows
        )
        return 1.0 if at_noise else self.kept / self.expected

    @property
    def named(self) -> tuple[EffectEvidence, ...]:
        """Effects that are proved."""
        return tuple(one for one in self.effects if one.named)

    @property
    def missing(self) -> tuple[EffectEvidence, ...]:
        """Effects that are proved and that predictions do not allow for yet."""
        return tuple(one for one in self.named if not one.corrected)

    @property
    def errors(self) -> tuple[float, ...]:
        """Error of each joint on rows that were not fitted with the model as it is, (n,) [N m or N].

        A search takes back what the model corrects, to find it again: the error without it is not that of the model.
        """
        return self.after if self.named and not self.missing else self.before


@dataclass(frozen=True)
class OtherArm:
    """Another arm that explains the logs better.

    Attributes:
        name: of its robot file.
        percent: error with its link lengths [%].
        own: error with those of the robot file that was given [%].
    """

    name: str
    percent: float
    own: float


@dataclass(frozen=True)
class Change:
    """A number that changed since an earlier result.

    Attributes:
        name: of the number.
        before: its value.
        after: its value.
        p_value: chance of such a change when nothing has changed; None where it was not asked.
        unit: of the values, "" where they have none.
    """

    name: str
    before: float
    after: float
    p_value: float | None = None
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
        mass: of all links together [kg].
        reach: length of all links together [m].
        known: share of the parameters that are known as well as the torques need.
        open: number of parameters that the logs do not determine.
        condition: of the stacked regressor with normalised columns.
        seconds: length of the logs.
        left_out: share of the samples that do not count.
        gap: what a search for missing effects found.
        other: another arm that explains the logs better.
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
    mass: float | None = None
    reach: float | None = None
    known: float | None = None
    open: int | None = None
    condition: float | None = None
    seconds: float | None = None
    left_out: float | None = None
    gap: GapEvidence | None = None
    other: OtherArm | None = None
    changes: tuple[Change, ...] | None = None
    earlier: str = ""
    earlier_result: str = ""
    tolerance: float | None = None

    @property
    def of_another_arm(self) -> bool:
        """Whether the robot file does not describe the arm of the logs."""
        return self.other is not None or bool(self.alarms)
