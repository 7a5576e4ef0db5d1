"""What a search found, as plain values: analysis -> record -> gap.npz, and back for reports and notebooks."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats
from dynid.files.artifact import packed, read_artifact, reading, unpacked
from dynid.gap.analysis import GapAnalysis
from dynid.gap.held_out import HeldOutEffect, HeldOutImprovement, clue, held_out_effects
from dynid.gap.localisation import JointGap
from dynid.gap.selected_effects import SelectedEffect
from dynid.gap.verdict import LIKELY, explained_share, joints_text, labels, unrepeatable
from dynid.judgement.evidence import EffectEvidence, Event, GapEvidence
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.motion import Joints
from dynid.npz import write_artifact
from dynid.robot import Robot
from dynid.units import joint_unit

SCHEMA = "dynid/gap/1"


@dataclass(frozen=True)
class GapEffect:
    """One selected effect, named or not.

    Attributes:
        effect: identifier of the catalogue.
        indices: 0-based joint that it acts on, with the one that it follows for a pair; () for the whole arm.
        joints: names of these joints; all for the whole arm.
        where: where it sits, in words.
        values: amplitudes and shape parameters by name.
        std_errors: their standard errors.
        units: their units.
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
    """

    effect: str
    indices: Joints
    joints: tuple[str, ...]
    where: str
    values: Mapping[str, float]
    std_errors: Mapping[str, float]
    units: Mapping[str, str]
    p_value: float
    joint: str
    rms_before: float
    rms_after: float | None
    unit: str
    why_not: str = ""
    rivals: tuple[str, ...] = ()
    rival_keys: tuple[tuple[str, Joints], ...] = ()
    share: float | None = None
    probability: float | None = 1.0

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
                name: {
                    "value": value,
                    "unit": self.units.get(name, ""),
                    "std_error": None if self.open(name) else self.std_errors.get(name),
                }
                for name, value in self.values.items()
            },
            "p_value": self.p_value,
            "probability": self.probability,
            "heldout_rms_before_nm": self.rms_before,
            "heldout_rms_after_nm": self.rms_after,
            **({"why_not": self.why_not} if self.why_not else {}),
            **({} if self.share is None else {"share_of_gap": self.share}),
        }

    def open(self, name: str) -> bool:
        """Return whether a shape parameter is held because the logs do not determine it."""
        return self.std_errors.get(name, 0.0) == float("inf")

    def texts(self) -> list[str]:
        """Return each parameter with its standard error and unit, in words."""
        texts = []
        for name, value in self.values.items():
            if self.open(name):
                texts.append(
                    f"{name} not determined, set to {value:.4g} {self.units.get(name, '')}".strip()
                )
                continue
            error = f" +- {self.std_errors[name]:.2g}" if name in self.std_errors else ""
            texts.append(f"{name} = {value:.4g}{error} {self.units.get(name, '')}".strip())
        return texts

    def evidence(self, *, named: bool, delay: float) -> EffectEvidence:
        """Return the effect as the judgement takes it.

        Args:
            named: whether it is proved.
            delay: by how much the searched model moves torques back [s].
        """

        def title(name: str) -> str:
            return CATALOGUE[name].title if name in CATALOGUE else name

        sizes = []
        for name, value in self.values.items():
            error = self.std_errors.get(name, 0.0)
            known = error if math.isfinite(error) else None
            sizes.append((name, value, known, self.units.get(name, "")))
        late = self.values.get("delay", 0.0) if self.effect == "torque_delay" else 0.0
        rivals = (text.partition(" on ") for text in self.rivals)
        return EffectEvidence(
            title=title(self.effect),
            where=self.where,
            effect=self.effect,
            sizes=tuple(sizes),
            named=named,
            probability=self.probability,
            joint=self.joint,
            before=self.rms_before,
            after=self.rms_after,
            unit=self.unit,
            why_not=self.why_not,
            # Whether most of a delay is known to the model.
            corrected=named and abs(late - delay) < 0.5 * abs(late),
            rivals=tuple(f"{title(rival)} on {where}" for rival, _, where in rivals),
        )


@dataclass(frozen=True)
class GapRecord:
    """One search.

    Attributes:
        robot: name of the arm.
        mode: ``"refit"``, or ``"frozen"`` for what has changed.
        verdict: ``"named"``, ``"nothing_missing"``, ``"nothing_changed"``, ``"unexplained"`` or ``"ambiguous"``.
        named: effects that are named.
        closest: effects that explain part of the gap, each with the reason why it is not named.
        alternatives: groups of identifiers that explain as much.
        advice: what to do next.
        joint_names: names of the joints, n of them.
        torque_units: their units of torque.
        joints: the disagreement of each joint before.
        improvement: the held-out error of each joint before and after all that is named.
        simulation: position error of the simulated held-out motion before and after it, (2, n) [rad or m]; (0, n)
            where it cannot be simulated.
        heldout: what was held out, in words.
        noise_from: where the noise floor comes from, in words.
        noise_note: what else the noise floor allows for, in words.
        not_repeatable: joints with disturbances that do not repeat.
        cannot_judge: effects that these logs cannot show, with the 0-based joints; () for the whole arm.
        logs: where the logs came from.
        made_from: the result that was searched; "" for one that is in no file.
        clues: what is known of joints that no effect explains, in words.
        question: ``"numbers"``, ``"arm"`` or ``"changed"``; "" where it was not stored.
        asked: which questions were asked, what they brought, and why, in words.
        curves: each effect that is named, on held-out rows of the joint that shows it most.
        of: tells the parameters that were searched from others.
        repeats: seconds of repeated motion that the noise comes from; 0 for a lower bound.
        more: names of joints with more left than noise.
        kept: error of the model as it was on the new logs [%]; None where its own logs were searched.
        expected: error that was expected there [%].
        kept_rms: error of each joint of that model there, (n,) [N m or N].
        events: disturbances that happened once.
        flags: what was asked for, as words of a command: ``("--effects", "spring")``; none for the defaults.
        delay: by how much the searched model moves torques back [s].
    """

    robot: str
    mode: str
    verdict: str
    named: tuple[GapEffect, ...]
    closest: tuple[GapEffect, ...]
    alternatives: tuple[tuple[str, ...], ...]
    advice: str
    joint_names: tuple[str, ...]
    torque_units: tuple[str, ...]
    joints: tuple[JointGap, ...]
    improvement: HeldOutImprovement
    simulation: Floats
    heldout: str
    noise_from: str
    noise_note: str
    not_repeatable: tuple[str, ...]
    cannot_judge: Mapping[str, tuple[int, ...]]
    logs: tuple[str, ...]
    made_from: str
    clues: tuple[str, ...] = ()
    question: str = ""
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
    delay: float = 0.0

    def drawn(self) -> list[tuple[GapEffect, HeldOutEffect]]:
        """Return the named effects that have a torque of their own, each with its curve."""
        effects = [one for one in self.named if one.effect != "torque_delay"]
        return list(zip(effects, self.curves, strict=False))

    @property
    def found(self) -> GapEvidence:
        """What was found as the judgement takes it."""
        errors, nothing = self.improvement, self.verdict.startswith("nothing")
        named, closest = (
            tuple(one.evidence(named=proved, delay=self.delay) for one in effects)
            for effects, proved in ((self.named, True), (self.closest, False))
        )
        return GapEvidence(
            question=self.question,
            ambiguous=self.verdict == "ambiguous",
            # Why not beside "nothing": what was looked at and is none, such as a delay below the sampling, is no
            # finding.
            effects=named if nothing else named + closest,
            joints=self.joint_names,
            before=tuple(errors.before.tolist()),
            after=tuple(errors.after.tolist()),
            noise=tuple(errors.floor.tolist()),
            known=tuple(errors.known.tolist()),
            repeats=self.repeats > 0.0,
            more=self.more,
            unrepeatable=self.not_repeatable,
            events=self.events,
            kept=self.kept,
            expected=self.expected,
            kept_rms=self.kept_rms,
            logs=tuple(filter(None, self.logs)),
            flags=self.flags,
            instead=tuple(one for one in closest if nothing and one.effect == "counterbalance"),
        )


def new_name(robot: Robot, effects: Sequence[GapEffect]) -> str:
    """Return the name of the copy, such as ``arm+stribeck2``."""
    index = {name: str(k + 1) for k, name in enumerate(robot.joint_names)}
    parts = [
        s.effect + ("_".join(index[j] for j in s.joints) if len(s.joints) < robot.n else "")
        for s in effects
    ]
    return "+".join([robot.slug, *parts])


def record_of(
    analysis: GapAnalysis, robot: Robot, question: str, asked: str, made_from: str
) -> GapRecord:
    """Return what an analysis found as plain values.

    Args:
        analysis: the analysis.
        robot: the arm.
        question: ``"numbers"``, ``"arm"`` or ``"changed"``.
        asked: which questions were asked and why, in words.
        made_from: the result that was searched; "" for one that is in no file.
    """
    verdict, names = analysis.verdict, robot.joint_names
    disturbed = unrepeatable(analysis.search)
    noise_from, noise_note = _noise_texts(analysis, names)
    simulation = (
        np.zeros((0, robot.n)) if analysis.simulation is None else np.array(analysis.simulation)
    )
    return GapRecord(
        robot=robot.name,
        mode="frozen" if question == "changed" else "refit",
        verdict=verdict.word,
        named=tuple(_effect(one, analysis, robot) for one in verdict.named),
        closest=tuple(_effect(one, analysis, robot, why) for one, why in verdict.closest),
        alternatives=verdict.alternatives,
        advice=verdict.advice,
        joint_names=names,
        torque_units=tuple(joint.torque_unit for joint in robot.joints),
        joints=analysis.joints,
        improvement=analysis.improvement,
        simulation=simulation,
        heldout=analysis.problem.held_text,
        noise_from=noise_from,
        noise_note=noise_note,
        not_repeatable=tuple(names[j] for j in disturbed),
        cannot_judge={name: tuple(joints) for name, joints in analysis.invisible.items()},
        logs=tuple(log.path for log in analysis.logs),
        made_from=made_from,
        # Why not of a change: what is left of it is no property of the arm.
        clues=()
        if analysis.problem.since
        else tuple(
            clue(analysis.search, j) for j in dict.fromkeys((*verdict.remainder, *disturbed))
        ),
        question=question,
        asked=asked,
        curves=tuple(held_out_effects(analysis.search.problem, verdict.named)),
        repeats=analysis.search.problem.noise.repeats,
        more=tuple(names[j] for j in verdict.remainder),
        events=() if verdict.word.startswith("nothing") else tuple(_events(analysis, robot)),
    )


def _events(analysis: GapAnalysis, robot: Robot) -> list[Event]:
    """Return what happened once, the loudest first."""
    paths = {log.name: log.path for log in analysis.logs}
    return [
        Event(
            log=paths.get(one.log) or one.log,
            joint=robot.joint_names[one.joint],
            start=one.start,
            end=one.end,
            size=one.size,
            unit=robot.joints[one.joint].torque_unit,
        )
        for one in sorted(analysis.search.strays, key=lambda one: -one.power)
    ]


def _effect(
    one: SelectedEffect, analysis: GapAnalysis, robot: Robot, why_not: str = ""
) -> GapEffect:
    names, j = robot.joint_names, one.joint
    shareless = why_not or one.name == "torque_delay"
    # Why none: it is against other names and what has none, and something else speaks against this one.
    other_reason = why_not and not why_not.startswith(LIKELY)
    return GapEffect(
        effect=one.name,
        indices=one.joints,
        joints=tuple(names[k] for k in one.joints or range(robot.n)),
        where=joints_text(one.joints, names),
        values=one.values,
        std_errors=one.std_errors,
        units={
            name: joint_unit(unit, revolute=robot.joints[j].revolute)
            for name, unit in one.units.items()
        },
        p_value=one.p_value,
        joint=names[j],
        rms_before=float(analysis.improvement.before[j]),
        rms_after=None if why_not else float(analysis.improvement.after[j]),
        unit=robot.joints[j].torque_unit,
        why_not=why_not,
        rivals=tuple(labels(one, names)[1:]),
        share=None if shareless else explained_share(analysis.search, one),
        rival_keys=one.rivals,
        probability=None if other_reason else one.probability,
    )


def _noise_texts(analysis: GapAnalysis, names: Sequence[str]) -> tuple[str, str]:
    problem = analysis.search.problem
    if problem.noise.repeats:
        source = f"{problem.noise.repeats:.0f} s of repeats"
    else:
        source = "the high frequencies of the residual, a lower bound because no motion is repeated"
    note = ""
    if problem.rows.compared and problem.same_motion:
        note = "same motion as the earlier logs: old and new are compared row by row"
    elif problem.rows.compared:
        note = "earlier and new logs are fitted together; the search looks for effects in the new logs only"
    elif problem.noise.misfit:
        note = f"the earlier residual was above the noise on {', '.join(names[j] for j in problem.noise.misfit)}"
    return source, note


def write_record(path: Path, record: GapRecord) -> None:
    """Write gap.npz."""
    arrays: dict[str, NDArray[Any]] = {}
    names = [each.name for each in fields(GapRecord)]
    facts = {
        "record": {name: packed(getattr(record, name), arrays, name) for name in names},
        # Why again: what is judged is read without anything of the search.
        "evidence": packed(record.found, arrays, "evidence"),
    }
    write_artifact(path, SCHEMA, facts, arrays)


def read_record(path: Path) -> GapRecord:
    """Read gap.npz.

    Raises:
        NotAnArtifact: it is damaged, or of another kind.
    """
    artifact = read_artifact(path, SCHEMA)
    with reading(path):
        stored = artifact.header["record"]
        record: GapRecord = unpacked(GapRecord, stored, artifact.arrays)
        _require_one_arm(record)
    return record


def _require_one_arm(record: GapRecord) -> None:
    """Raise when the parts of a record are not those of one search of one arm."""
    effects = [*record.named, *record.closest]
    keys = [key for one in effects for key in ((one.effect, one.indices), *one.rival_keys)]
    places = [
        *(joints for _, joints in keys),
        *record.cannot_judge.values(),
        [one.joint for one in record.joints],
    ]
    if not all(0 <= joint < len(record.joint_names) for joints in places for joint in joints):
        raise ValueError("it has joints that its arm lacks")
