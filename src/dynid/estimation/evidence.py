"""What is known of a result when it is judged: its own figures, and what lies beside its file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from dynid.estimation.covariance import KNOWN_WELL, NEGLIGIBLE, NOT_DETERMINED
from dynid.estimation.identified import SAME_MOTION, Identified
from dynid.estimation.least_squares import relative_error
from dynid.files import typed
from dynid.files.artifact import read_artifact, read_header, reading
from dynid.judgement.evidence import (
    EffectEvidence,
    Event,
    Evidence,
    GapEvidence,
    JointEvidence,
    OtherArm,
    Unseen,
)
from dynid.runs import RunFolder

#: Findings that say that no possible arm explains the torques, and that the robot file or the log is read wrongly.
DOUBTS, ALARMS = ("W404", "W405"), ("W329",)
#: How the text of what was held out begins where it is another motion than the fitted ones.
ANOTHER_MOTION = "another motion: "


def fingerprint(result: Identified) -> str:
    """Return what tells whether a replay or a search was made with the parameters that a result has now."""
    return hashlib.sha256(result.theta.tobytes()).hexdigest()[:16]


def found_log(result: Identified, number: int) -> Path:
    """Return the path of a log that a result was identified from, wherever the result is opened from.

    Args:
        result: the result.
        number: of the log.
    """
    named, beside = (list(result.header.get(key, [])) for key in ("logs", "logs_from_here"))
    name = Path(named[number] if number < len(named) else "")
    near = (
        [result.path.parent / beside[number]] if number < len(beside) and result.path.name else []
    )
    return next(
        (path for path in (name, *near, result.path.parent / name) if name.name and path.exists()),
        name,
    )


def here(name: str) -> str:
    """Return the path of a recording as it is typed here, whichever way it was given; one that is gone stays as it is.

    Why: the same file, named from two folders, is one recording. Links stay as they were typed.
    """
    return typed(Path(os.path.abspath(name))) if name and Path(name).exists() else name  # noqa: PTH100


def found_path(result: Identified, name: str) -> str:
    """Return where a recording is now that a command on a result was given, wherever the result is opened from.

    It is looked for as it was typed, beside the result, and from where the arm was identified.

    Args:
        result: the result.
        name: of the recording, as it was typed.
    """
    folder, header = result.path.parent, result.header
    pairs = zip(header.get("logs", []), header.get("logs_from_here", []), strict=False)
    starts = dict.fromkeys(near.removesuffix(log) for log, near in pairs if near.endswith(log))
    places = [Path(name), folder / name, *(folder / start / name for start in starts)]
    return here(str(next((path for path in places if path.exists()), name))) if name else ""


def evidence_of(result: Identified) -> Evidence:
    """Return what is known of a result, with the replays and the search that lie beside its file.

    Raises:
        NotAnArtifact: a file beside it is damaged.
    """
    known = sum(word in (KNOWN_WELL, NEGLIGIBLE) for word in result.knowledge)
    header, codes = (
        result.header,
        [found.code for found in result.findings if found.level != "info"],
    )
    found = Evidence(
        robot=result.robot.source or str(result.robot.path or result.robot.slug),
        result=str(result.path) if result.path.name else "",
        logs=tuple(typed(found_log(result, k)) for k in range(len(header.get("logs", [])))),
        joints=_joints(result),
        repeats=None
        if header.get("noise_floor_nm") is None
        else bool(header.get("noise_repeats_s", 0.0)),
        fitted=result.relative_error_percent,
        unseen=_held_out(result),
        possible=_possible(result),
        plain=relative_error(result.factors, result.plain) if result.factors.size else None,
        physical=result.in_force == "physical",
        doubts=tuple(code for code in codes if code in DOUBTS),
        alarms=tuple(code for code in codes if code in ALARMS),
        mass=None
        if result.robot.torque.relative
        else sum(link["mass_kg"] for link in result.links()),
        reach=float(
            sum(np.hypot(joint.a, joint.d) for joint in result.robot.joints if joint.revolute)
        )
        or None,
        known=known / max(1, len(result.names)),
        open=result.knowledge.count(NOT_DETERMINED),
        condition=result.condition_number_scaled,
        seconds=_seconds(result),
        left_out=_left_out(result),
        other=None if header.get("other_arm") is None else OtherArm(**header["other_arm"]),
    )
    return found if not result.path.name else _with_files(found, result)


def _joints(result: Identified) -> tuple[JointEvidence, ...]:
    found, noise = [], result.header.get("noise_floor_nm") or ()
    joints, sizes = result.robot.joints, _sizes(result)
    for quality, joint, size, floor in zip_longest(
        result.joints, joints, sizes, noise[: len(joints)]
    ):
        unit, limit = joint.torque_unit, joint.limits.torque
        one = JointEvidence(
            joint=quality.joint,
            unit="A" if result.robot.torque.relative else unit,
            torque=quality.torque_rms / size,
            fitted=quality.rms / size,
            noise=None if floor is None else floor / size,
            limit=None if limit is None else limit / size,
        )
        found.append(one)
    return tuple(found)


def _sizes(result: Identified) -> tuple[float, ...]:
    """Return what a torque of each joint is divided by to be shown: its gain where torques are amperes."""
    torque = result.robot.torque
    gains = torque.gain if torque.relative and torque.gain else (1.0,) * len(result.joints)
    return tuple(gain or 1.0 for gain in gains)


def _held_out(result: Identified) -> tuple[Unseen, ...]:
    percent, text = result.heldout_relative_error_percent, result.heldout
    if percent is None:
        return ()
    pairs = zip(result.joints, _sizes(result), strict=True)
    rms = tuple(x.heldout_rms / size for x, size in pairs if x.heldout_rms is not None)
    known = rms if len(rms) == len(result.joints) else ()
    return (Unseen(_held_out_name(text), percent, known, text.endswith(SAME_MOTION)),)


def _held_out_name(text: str) -> str:
    """Return what was held out as a sentence has it: a share of each log, a motion, or one log."""
    if text.endswith(SAME_MOTION):
        return f"the {text} (held out)"
    motion = text.removeprefix(ANOTHER_MOTION)
    return (
        f"{Path(text).name} (held out)"
        if motion == text
        else f"{motion} (held out, another motion)"
    )


def _possible(result: Identified) -> float | None:
    if result.in_force == "physical":
        return result.relative_error_percent
    if not result.factors.size:
        return None
    return relative_error(result.factors, result.reduction.K @ result.physical.x)


def _seconds(result: Identified) -> float | None:
    rate = float(result.header.get("kept_rate_hz", 0.0))
    return result.samples / rate if rate > 0.0 else None


def _left_out(result: Identified) -> float | None:
    rows = result.samples * np.count_nonzero(result.counts)
    return (
        max(0.0, 1.0 - float(result.counts.sum()) / rows) if rows and result.counts.size else None
    )


# ---------------------------------------------------------------- beside the file
def _with_files(evidence: Evidence, result: Identified) -> Evidence:
    """Add replays and the search beside a result, where they were made with the parameters that it has now."""
    folder = RunFolder.of(result.path)
    replays = [_replay(path, result) for path in folder.validations]
    return replace(
        evidence,
        # A log of a changed arm says nothing of the model.
        unseen=(*evidence.unseen, *(each for each in replays if each and not each.changed)),
        gap=_gap(folder.search, result) if folder.search.is_file() else None,
    )


def _replay(path: Path, result: Identified) -> Unseen | None:
    """Return a replay; None where it was made with other parameters."""
    from dynid.estimation import prediction

    if (read_header(path) or {}).get("of") != fingerprint(result):
        return None
    motion, header = prediction.load(path)
    result.robot.require_joints(header["joints"], path)
    joints, percent = prediction.check(motion, motion.tau_measured, result.robot.joint_names)
    rms = [one.rms / size for one, size in zip(joints, _sizes(result), strict=True)]
    log = found_path(result, str(header.get("log", path.parent.name)))
    return Unseen(
        name=Path(log).name,
        percent=percent,
        rms=tuple(rms),
        same_motion=bool(header.get("same_motion", False)),
        expected=header.get("expected_percent"),
        replayed=True,
        log=log,
    )


def _gap(path: Path, result: Identified) -> GapEvidence | None:
    """Return what a search found; None where it asked about other parameters."""
    header = read_header(path) or {}
    if dict(header.get("record") or {}).get("of") != fingerprint(result):
        return None
    artifact = read_artifact(path)
    with reading(path):
        found = partial(found_path, result)
        return gap_evidence(dict(artifact.header["record"]), artifact.arrays, result.delay, found)


def gap_evidence(
    record: dict[str, Any],
    arrays: Any,  # noqa: ANN401
    delay: float,
    found: Callable[[str], str] = here,
) -> GapEvidence:
    """Return the evidence of a search.

    Args:
        record: its record as plain values.
        arrays: its held-out errors by name.
        delay: by how much the searched model moves torques back [s].
        found: returns where a recording is now.
    """
    effects = [_effect(one, named=True) for one in record["named"]]
    effects = [replace(one, corrected=_corrected(one, delay)) for one in effects]
    closest = [_effect(one, named=False) for one in record["closest"]]
    # Why not beside "nothing": what was looked at and is none, such as a delay below the sampling, is no finding.
    nothing = str(record["verdict"]).startswith("nothing")
    numbers = {
        name: tuple(map(float, arrays[name])) for name in ("before", "after", "floor", "known")
    }
    effects += [] if nothing else closest
    return GapEvidence(
        question=str(record["question"]),
        ambiguous=record["verdict"] == "ambiguous",
        effects=tuple(effects),
        instead=tuple(one for one in closest if nothing and one.effect == "counterbalance"),
        joints=tuple(str(name) for name in record["joint_names"]),
        before=numbers["before"],
        after=numbers["after"],
        noise=numbers["floor"],
        known=numbers["known"],
        repeats=float(record.get("repeats") or 0.0) > 0.0,
        more=tuple(str(name) for name in record.get("more", ())),
        unrepeatable=tuple(str(name) for name in record["not_repeatable"]),
        events=tuple(
            Event(**{**event, "log": found(event["log"])}) for event in record.get("events", ())
        ),
        kept=None if record.get("kept") is None else float(record["kept"]),
        expected=None if record.get("expected") is None else float(record["expected"]),
        kept_rms=tuple(float(x) for x in record.get("kept_rms", ())),
        logs=tuple(found(str(path)) for path in record["logs"]),
    )


def _corrected(one: EffectEvidence, delay: float) -> bool:
    """Return whether most of a delay is known to the model."""
    found = [
        value for name, value, _, _ in one.sizes if one.effect == "torque_delay" and name == "delay"
    ]
    return bool(found) and abs(found[0] - delay) < 0.5 * abs(found[0])


def _effect(stored: dict[str, Any], *, named: bool) -> EffectEvidence:
    """Return a stored effect as evidence."""
    from dynid.model.effects.catalogue import CATALOGUE

    def title(name: str) -> str:
        return CATALOGUE[name].title if name in CATALOGUE else name

    name, errors, units = str(stored["effect"]), dict(stored["std_errors"]), dict(stored["units"])
    rivals = [str(text).partition(" on ") for text in stored["rivals"]]
    sizes = tuple(
        (
            str(key),
            float(value),
            _error(errors[key]) if key in errors else 0.0,
            str(units.get(key, "")),
        )
        for key, value in dict(stored["values"]).items()
    )
    after = stored["rms_after"]
    return EffectEvidence(
        title=title(name),
        effect=name,
        where=str(stored["where"]),
        sizes=sizes,
        named=named,
        probability=None if stored.get("probability") is None else float(stored["probability"]),
        joint=str(stored["joint"]),
        before=float(stored["rms_before"]),
        after=None if after is None else float(after),
        unit=str(stored["unit"]),
        why_not=str(stored["why_not"]),
        rivals=tuple(f"{title(rival)} on {where}" for rival, _, where in rivals),
    )


def _error(value: Any) -> float | None:  # noqa: ANN401
    """Return a standard error; None where the logs do not determine the number."""
    return None if value is None or not np.isfinite(float(value)) else float(value)
