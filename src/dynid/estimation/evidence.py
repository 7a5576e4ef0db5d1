"""What is known of a result when it is judged: its own figures, and what lies beside its file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import zip_longest
from pathlib import Path

from dynid.estimation.identified import SAME_MOTION, Identified, torque_units
from dynid.estimation.least_squares import KNOWN_WELL, NEGLIGIBLE, NOT_DETERMINED, relative_error
from dynid.files import typed
from dynid.files.artifact import read_header, reading
from dynid.files.gapfile import read_record
from dynid.judgement.evidence import Evidence, JointEvidence, Unseen
from dynid.judgement.gap import GapRecord
from dynid.runs import RunFolder

#: Findings that say that no possible arm explains the torques, and that the robot file or the log is read wrongly.
DOUBTS, ALARMS = ("W404", "W405"), ("W329",)


def fingerprint(result: Identified) -> str:
    """Return what tells whether a replay or a search was made with the parameters that a result has now."""
    return hashlib.sha256(result.theta.tobytes()).hexdigest()[:16]


def here(name: str) -> str:
    """Return the path of a recording as it is typed here, whichever way it was given; one that is gone stays as it is.

    Why: the same file, named from two folders, is one recording. Links stay as they were typed.
    """
    return typed(Path(os.path.abspath(name))) if name and Path(name).exists() else name  # noqa: PTH100


def found_path(result: Identified, name: str) -> str:
    """Return where a recording is now: as it was typed, or beside the result where that was identified from it."""
    header = result.header
    from_result = dict(zip(header.get("logs", []), header.get("logs_from_here", []), strict=False))
    paths = [Path(name), result.path.parent / from_result.get(name, name)]
    return here(str(next((path for path in paths if path.exists()), name))) if name else ""


def evidence_of(result: Identified) -> Evidence:
    """Return what is known of a result, with the replays and the search that lie beside its file.

    Raises:
        NotAnArtifact: a file beside it is damaged.
    """
    header, robot, knowledge = result.header, result.robot, result.knowledge
    codes = [finding.code for finding in result.findings if finding.level != "info"]
    physical, factors = result.in_force == "physical", result.factors
    unknown = header.get("noise_floor_nm") is None
    possible = result.relative_error_percent
    if not physical:
        possible = relative_error(factors, result.reduction.K @ result.physical.x)
    evidence = Evidence(
        robot=robot.source or str(robot.path or robot.slug),
        result=str(result.path) if result.path.name else "",
        logs=tuple(found_path(result, name) for name in header.get("logs", [])),
        joints=joint_evidence(result),
        repeats=None if unknown else bool(header.get("noise_repeats_s", 0.0)),
        fitted=result.relative_error_percent,
        unseen=_held_out(result),
        possible=possible,
        plain=relative_error(factors, result.plain),
        physical=physical,
        doubts=tuple(code for code in codes if code in DOUBTS),
        alarms=tuple(code for code in codes if code in ALARMS),
        known=sum(map(knowledge.count, (KNOWN_WELL, NEGLIGIBLE))) / max(1, len(result.names)),
        open=knowledge.count(NOT_DETERMINED),
    )
    if not result.path.name:
        return evidence
    folder = RunFolder.of(result.path)
    replays = [_replay(path, result) for path in folder.validations]
    return replace(
        evidence,
        # A log of a changed arm says nothing of the model.
        unseen=(*evidence.unseen, *(each for each in replays if each and not each.changed)),
        gap=_gap(folder.search, result) if folder.search.is_file() else None,
    )


def joint_evidence(result: Identified) -> tuple[JointEvidence, ...]:
    """Return what is known of each joint on the training logs, in the units that its torques are shown in."""
    joints, noise = [], result.header.get("noise_floor_nm") or ()
    robot = result.robot
    given = robot.joints, torque_units(robot), robot.shown_gains, noise[: robot.n]
    for quality, joint, unit, size, floor in zip_longest(result.joints, *given):
        limit = joint.limits.torque
        joints.append(
            JointEvidence(
                joint=quality.joint,
                unit=unit,
                torque=quality.torque_rms / size,
                fitted=quality.rms / size,
                noise=None if floor is None else floor / size,
                limit=None if limit is None else limit / size,
            )
        )
    return tuple(joints)


def _held_out(result: Identified) -> tuple[Unseen, ...]:
    percent, text = result.heldout_relative_error_percent, result.heldout
    if percent is None:
        return ()
    pairs = zip(result.joints, result.robot.shown_gains, strict=True)
    rms = tuple(x.heldout_rms / size for x, size in pairs if x.heldout_rms is not None)
    same = text.endswith(SAME_MOTION)
    name = f"{'the ' * same}{Path(text).name} (held out)"
    known = rms if len(rms) == len(result.joints) else ()
    return (Unseen(name, percent, known, same),)


# ---------------------------------------------------------------- beside the file
def _replay(path: Path, result: Identified) -> Unseen | None:
    """Return a replay; None where it was made with other parameters."""
    header = read_header(path)
    if header.get("of") != fingerprint(result):
        return None
    with reading(path):
        seen = Unseen(**header["unseen"])
        log = found_path(result, seen.log)
        return replace(seen, name=Path(log).name, rms=tuple(seen.rms), log=log)


def _gap(path: Path, result: Identified) -> GapRecord | None:
    """Return what a search found; None where it asked about other parameters."""
    if dict(read_header(path).get("record") or {}).get("of") != fingerprint(result):
        return None
    return with_paths(read_record(path), partial(found_path, result))


def with_paths(record: GapRecord, path_of: Callable[[str], str] = here) -> GapRecord:
    """Return what a search found with the paths that its recordings have now."""
    events = tuple(replace(event, log=path_of(event.log)) for event in record.events)
    return replace(record, events=events, logs=tuple(map(path_of, filter(None, record.logs))))
