"""What a search for missing effects found, as plain values: they are judged, printed, drawn and stored."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.judgement import tuning

#: Name, value, standard error and unit of a number of an effect: an error is None where the logs do not determine the
#: number, and 0 where it is chosen and not measured.
Size = tuple[str, float, float | None, str]


@dataclass(frozen=True)
class GapEffect:
    """One effect that was found, named or not.

    Attributes:
        effect: identifier of the catalogue.
        title: what it is, such as "Stribeck friction".
        indices: 0-based joint that it acts on, with the one that it follows for a pair; () for the whole arm.
        joints: names of these joints; all for the whole arm.
        where: where it sits, in words.
        sizes: its amplitudes and shape parameters.
        p_value: chance of such amplitudes when there is no effect.
        joint: name of the joint that shows it most.
        rms_before: held-out rms of that joint without any effect [N m or N].
        rms_after: and with all that is named [N m or N]; None for what is not named.
        unit: unit of these torques.
        why_not: why it is not named; "" when it is.
        rivals: other effects and joints that explain as much, in words.
        rival_keys: the same rivals as identifiers and 0-based joints.
        share: share of its joint's gap that is explained where that is a part; None where it is most, or not named.
        probability: posterior probability of the name, against what has no name and against other names; None where
            something else speaks against it.
        corrected: whether predictions allow for it already, as for a delay that was found when the arm was identified.
    """

    effect: str
    title: str
    where: str
    indices: tuple[int, ...] = ()
    joints: tuple[str, ...] = ()
    sizes: tuple[Size, ...] = ()
    p_value: float = 1.0
    joint: str = ""
    rms_before: float = 0.0
    rms_after: float | None = None
    unit: str = "N m"
    why_not: str = ""
    rivals: tuple[str, ...] = ()
    rival_keys: tuple[tuple[str, tuple[int, ...]], ...] = ()
    share: float | None = None
    probability: float | None = None
    corrected: bool = False

    @property
    def values(self) -> dict[str, float]:
        """Amplitudes and shape parameters by name."""
        return {name: value for name, value, _, _ in self.sizes}

    @property
    def std_errors(self) -> dict[str, float]:
        """Standard errors of those that are determined, by name."""
        return {name: error for name, _, error, _ in self.sizes if error}

    @property
    def message(self) -> str:
        """What is said of it: that it is named, as a part of its joint's gap or whole, or why not."""
        if self.why_not:
            return self.why_not
        if self.share is None:
            return "named"
        return f"named; explains {100 * self.share:.0f} % of the gap of {self.joint}, not the rest"

    def facts(self) -> dict[str, Any]:
        """Return the effect as the JSON answer of ``dynid gap`` has it."""
        return {
            "effect": self.effect,
            "joints": list(self.joints),
            "parameters": {
                name: {"value": value, "unit": unit, "std_error": error or None}
                for name, value, error, unit in self.sizes
            },
            "p_value": self.p_value,
            "probability": self.probability,
            "heldout_rms_before_nm": self.rms_before,
            "heldout_rms_after_nm": self.rms_after,
            **({"why_not": self.why_not} if self.why_not else {}),
            **({} if self.share is None else {"share_of_gap": self.share}),
        }

    def texts(self) -> list[str]:
        """Return each parameter with its standard error and unit, in words."""
        texts = []
        for name, value, error, unit in self.sizes:
            size = f"= {value:.4g}" if error is not None else f"not determined, set to {value:.4g}"
            spread = f" +- {error:.2g}" if error else ""
            texts.append(f"{name} {size}{spread} {unit}".strip())
        return texts


@dataclass(frozen=True)
class Event:
    """A disturbance that happened once.

    Attributes:
        log: path of the log.
        joint: name.
        start: in the log's time [s].
        end: in the log's time [s].
        size: largest torque that is left there [unit].
        unit: of it.
        power: over the usual power of what is left.
    """

    log: str
    joint: str
    start: float
    end: float
    size: float
    unit: str = "N m"
    power: float = 0.0


@dataclass(frozen=True)
class JointGap:
    """The disagreement of one joint.

    Attributes:
        joint: index.
        chi: mean square of the whitened residual; 1 at the noise level.
        share: of what all joints have above their floors, 0 to 1.
        regions: what its rows are cut by (speed, position, load, time, direction, reversal), which part, and the mean
            square of the whitened residual there.
        text: where it is, in words.
    """

    joint: int
    chi: float
    share: float
    regions: tuple[tuple[str, str, float], ...]
    text: str


#: An array of figures of joints where none was looked at.
_nothing = partial(np.zeros, 0)


@dataclass(frozen=True)
class HeldOutImprovement:
    """The gap before and after, on held-out rows; (n,) each.

    Attributes:
        before: rms without the effects [N m or N].
        after: rms with them [N m or N].
        ratio: lower and upper end of the 95 % interval of after / before, (n, 2).
        floor: the noise [N m or N].
        known: rms of what no effect has to explain, but for noise: what recorder, filter and reversals do, and base
            parameters that the searched rows leave unsure [N m or N].
        simulated_before: position error of the forward simulation without the effects [rad or m].
        simulated_after: and with them [rad or m].
    """

    before: Floats = field(default_factory=_nothing)
    after: Floats = field(default_factory=_nothing)
    ratio: Floats = field(default_factory=_nothing)
    floor: Floats = field(default_factory=_nothing)
    known: Floats = field(default_factory=_nothing)
    simulated_before: Floats = field(default_factory=_nothing)
    simulated_after: Floats = field(default_factory=_nothing)

    @property
    def allowed(self) -> Floats:
        """Rms of what no effect has to explain: noise, and known errors, (n,) [N m or N]."""
        return np.hypot(self.floor, self.known)


@dataclass(frozen=True)
class HeldOutEffect:
    """An effect on rows that were never fitted, of the joint that shows it most.

    Attributes:
        data: what the model leaves for the effect, everything fitted together, (M,) [N m or N].
        torque: what the effect says, (M,) [N m or N].
        against: values of the quantity that its torque follows most, (M,).
        follows: that quantity with its unit, such as ``"speed of joint_3 [rad/s]"``.
    """

    data: Floats
    torque: Floats
    against: Floats
    follows: str


@dataclass(frozen=True)
class GapRecord:
    """One search.

    Attributes:
        robot: name of the arm.
        question: ``"numbers"``, ``"arm"`` or ``"changed"``.
        verdict: ``"named"``, ``"nothing_missing"``, ``"nothing_changed"``, ``"unexplained"`` or ``"ambiguous"``.
        named: effects that are named.
        closest: effects that explain part of the gap, each with the reason why it is not named.
        advice: what to do next.
        joint_names: names of the joints, n of them.
        torque_units: their units of torque.
        joints: the disagreement of each joint before.
        improvement: the held-out error of each joint before and after all that is named.
        heldout: what was held out, in words.
        noise_from: where the noise floor comes from, in words.
        not_repeatable: names of joints with disturbances that do not repeat.
        cannot_judge: effects that these logs cannot show, with the 0-based joints; () for the whole arm.
        logs: where the logs came from.
        made_from: the result that was searched; "" for one that is in no file.
        clues: what is known of joints that no effect explains, in words.
        asked: which questions were asked, what they brought, and why, in words.
        curves: each effect that is named, on held-out rows of the joint that shows it most.
        of: tells the parameters that were searched from others.
        repeats: seconds of repeated motion that the noise comes from; 0 for a lower bound.
        more: names of joints with more left than noise, with or without the named effects.
        kept: error of the model as it was on the new logs [%]; None where its own logs were searched.
        expected: error that was expected there [%].
        kept_rms: error of each joint of that model there, (n,) [N m or N]; () where it was not kept.
        events: disturbances that happened once, the loudest first.
        flags: what was asked for, as words of a command: ``("--effects", "spring")``; none for the defaults.
    """

    robot: str = ""
    question: str = ""
    verdict: str = ""
    named: tuple[GapEffect, ...] = ()
    closest: tuple[GapEffect, ...] = ()
    advice: str = ""
    joint_names: tuple[str, ...] = ()
    torque_units: tuple[str, ...] = ()
    joints: tuple[JointGap, ...] = ()
    improvement: HeldOutImprovement = field(default_factory=HeldOutImprovement)
    heldout: str = ""
    noise_from: str = ""
    not_repeatable: tuple[str, ...] = ()
    cannot_judge: Mapping[str, tuple[int, ...]] = field(default_factory=dict)
    logs: tuple[str, ...] = ()
    made_from: str = ""
    clues: tuple[str, ...] = ()
    asked: str = ""
    curves: tuple[HeldOutEffect, ...] = ()
    of: str = ""
    repeats: float = 0.0
    more: tuple[str, ...] = ()
    kept: float | None = None
    expected: float | None = None
    kept_rms: tuple[float, ...] = ()
    events: tuple[Event, ...] = ()
    flags: tuple[str, ...] = ()

    @property
    def mode(self) -> str:
        """``"refit"``, or ``"frozen"`` for what has changed."""
        return "frozen" if self.question == "changed" else "refit"

    @property
    def nothing(self) -> bool:
        """Whether nothing is missing, or has changed."""
        return self.verdict.startswith("nothing")

    @property
    def likely(self) -> tuple[GapEffect, ...]:
        """Effects that are not proved.

        Why none beside "nothing": what was looked at and is none, such as a delay below the sampling, is no finding.
        """
        return () if self.nothing else self.closest

    @property
    def missing(self) -> tuple[GapEffect, ...]:
        """Effects that are proved and that predictions do not allow for yet."""
        return tuple(one for one in self.named if not one.corrected)

    @property
    def alternatives(self) -> tuple[tuple[str, ...], ...]:
        """Groups of identifiers that explain as much; of one where these are the same effect on other joints."""
        groups = tuple(
            tuple(dict.fromkeys([one.effect, *(name for name, _ in one.rival_keys)]))
            for one in self.named
            if one.rival_keys
        )
        return tuple(group for group in groups if len(group) > 1) or groups

    @property
    def errors(self) -> Floats:
        """Error of each joint on rows that were not fitted with the model as it is, (n,) [N m or N].

        A search takes back what the model corrects, to find it again: the error without it is not that of the model.
        """
        corrected = self.named and not self.missing
        return self.improvement.after if corrected else self.improvement.before

    @property
    def surprise(self) -> float | None:
        """Error of the model as it was over the expected one, where that is more than the noise; None where unknown."""
        if self.kept is None or not self.expected:
            return None
        limit = tuning.AT_NOISE * self.improvement.allowed
        at_noise = self.kept_rms and bool(np.all(np.less_equal(self.kept_rms, limit)))
        return 1.0 if at_noise else self.kept / self.expected

    def drawn(self) -> list[tuple[GapEffect, HeldOutEffect]]:
        """Return the named effects that have a torque of their own, each with its curve."""
        effects = [one for one in self.named if one.effect != "torque_delay"]
        return list(zip(effects, self.curves, strict=False))
