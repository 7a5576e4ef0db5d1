"""From logs to parameters with error bars (Paper Eq. 24), what is asked of such a result, and how it is kept."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.answer import Answer, Facts, Part
from dynid.arguments import public
from dynid.diagnose import tuning as mapping
from dynid.diagnose.gravity import check_gravity
from dynid.disk import sha256, write_text
from dynid.errors import DynidError, Finding, GravityRemoved, LogNotFound, WrongUsage
from dynid.estimation import payload, prediction
from dynid.estimation.drive_gains import Gains
from dynid.estimation.estimate import (
    UPDATABLE,
    HoldOut,
    estimate,
    last_motion,
    last_share,
    updated,
)
from dynid.estimation.noise_floor import noise_floor
from dynid.estimation.payload import IdentifiedPayload
from dynid.estimation.result import Identification
from dynid.estimation.stack import Stack, scaled, stack_logs
from dynid.files import robotfile
from dynid.loading import (
    LogsLike,
    ResultLike,
    RobotLike,
    as_result,
    as_robot,
    diagnose_logs,
    load_log,
    load_run,
    read_log,
)
from dynid.model.attached import attached
from dynid.model.base_model import BaseModel
from dynid.options import LogOptions
from dynid.progress import Progress, notice, stage
from dynid.robot import Known, Prior, Robot
from dynid.runs import RunFolder
from dynid.signals.conditioned_log import condition_logs
from dynid.table import Table
from dynid.text import yaml_text
from dynid.workflows.model import base_model
from dynid.workflows.options import IdentifyOptions, IdentifyRunOptions
from dynid.workflows.parameters import (
    Observations,
    gain_facts,
    gains_of,
    load_observations,
    log_inputs,
    observe,
    stored_key,
    write_robot,
)

#: What the estimators are, for people.
METHOD_TEXT = {
    "wls": "weighted least squares, one noise level per joint",
    "ols": "ordinary least squares",
    "irls": "weighted least squares that gives spikes little weight (Huber)",
    "iv": "instrumental variables from the commanded motion",
    "ridge": "weighted least squares pulled towards the prior",
}
#: Share of each log that is held out where all logs are of one motion.
AUTO_SHARE = 0.2


# ---------------------------------------------------------------- what is known besides the logs
def resolved(
    robot: Robot, options: IdentifyOptions, earlier: Identification | None = None
) -> tuple[Robot, IdentifyOptions]:
    """Return the arm with the prior and bounds that are asked for, and options with nothing left to look up.

    Args:
        robot: the arm.
        options: how it is identified; bounds go before those of the robot file.
        earlier: a result whose signals are treated alike, where nothing else was asked for.

    Raises:
        WrongUsage: a bound names a link that the arm does not have.
        JointCountDiffers: the result is of another arm.
        LogNotFound: the file of the prior is not there.
    """
    if earlier is not None:
        robot.require_joints(earlier.robot.joint_names, earlier.label)
        cutoff = earlier.cutoff if options.cutoff is None else options.cutoff
        delay = earlier.delay if options.delay is None else options.delay
        options = replace(options, cutoff=cutoff, delay=delay)
        robot = replace(robot, estimated_coulomb=earlier.robot.estimated_coulomb)
    if isinstance(options.prior, Path):
        options = replace(options, prior=_read_prior(options.prior, robot))
    for name, bounds in (("--link-mass", options.link_mass), ("--com-box", options.com_box)):
        for link, _ in bounds:
            if link > robot.n:
                fix = f"a number from 1 to {robot.n}"
                raise WrongUsage(f"{name}: there is no link {link}", fix=fix)
    known = Known(
        options.total_mass or robot.known.total_mass,
        tuple((dict(robot.known.link_mass) | dict(options.link_mass)).items()),
        tuple((dict(robot.known.com_box) | dict(options.com_box)).items()),
    )
    prior = options.prior if isinstance(options.prior, Prior) else robot.prior
    return replace(robot, prior=prior, known=known), options


def _read_prior(path: Path, robot: Robot) -> Prior:
    """Read link bodies from a YAML file, or from a URDF whose frames are found by comparing poses."""
    if not path.is_file():
        fix = "--prior FILE.yaml or --prior FILE.urdf"
        raise LogNotFound(f"no such file {path}", where=path, fix=fix)
    if path.suffix in (".yaml", ".yml"):
        return robotfile.read_prior(path, robot)
    return attached(path, robot).prior()


# ---------------------------------------------------------------- identify
@public
def identify(
    robot: RobotLike,
    logs: LogsLike | Observations,
    options: IdentifyOptions = IdentifyOptions(),
    *,
    base: BaseModel | None = None,
    update: ResultLike | None = None,
    like: ResultLike | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Identification:
    """Identify the base parameters of an arm, with robust error bars and a held-out figure.

    Args:
        robot: the arm, its name, or the path of its file.
        logs: one or several logs, or their paths; or what ``observe`` made of them.
        options: estimator, hold-out, prior, filter.
        base: the arm's base model, where it is there already.
        update: an earlier result whose logs are added to these, without reading them again.
        like: a result of the same arm whose residual model is as large.
        progress: reports how far the work is.
        changes: single options by name, such as ``method="wls"``; see ``dynid.IdentifyOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).
        DynidError: a log is unfit, or determines fewer parameters than the arm has (E301 to E406).

    Example:
        dynid.identify("kuka_lwr4plus", "run1.bag", holdout="run2.bag")
    """
    update = None if update is None else as_result(update, "update")
    robot, options = resolved(as_robot(robot), options, update)
    error = None if like is None else as_result(like, "like").model_error
    if robot.torque.relative and options.feasible is None:
        # Why: a prior in kg cannot be put beside parameters whose size is unknown.
        options = replace(options, feasible=False)
    seen = (
        logs
        if isinstance(logs, Observations)
        else observe(robot, logs, options, base=base, drop_weak=options.drop_weak)
    )
    robot = replace(robot, estimated_coulomb=seen.base.robot.estimated_coulomb)
    base = replace(seen.base, model=replace(seen.base.model, robot=robot))
    stack, header = replace(seen.stack, base=base), seen.header()
    if update is not None:
        header |= _both_logs(header, update, options)
        stack = updated(stack, update)
    holdout = _held_out(seen, stack, options)
    try:
        result = estimate(
            stack,
            method=options.method,
            holdout=holdout,
            # Why: where the bodies are known, what the log leaves open has an answer.
            drop_weak=options.drop_weak or options.given,
            feasible=options.feasible,
            residual_model=options.residual_model,
            size=None if error is None else error.size,
        )
    except DynidError:
        _diagnosed(seen, robot, options)
        raise
    if robot.torque.relative:
        # Why: it is in kg, and the values are in amperes.
        result = replace(result, prior=result.prior * np.nan)
    if _poor(result, seen, robot):
        result = replace(result, findings=(*_diagnosed(seen, robot, options), *result.findings))
    return _reported(replace(result, header=header))


def _reported(result: Identification) -> Identification:
    """Return a result whose header tells its noise, after its fit was reported."""
    assert result.stack is not None
    if noise := noise_floor(result.stack, result.theta, result.model_error):
        rms, repeats = noise
        facts = {"noise_floor_nm": rms.tolist(), "noise_repeats_s": repeats}
        result = replace(result, header=result.header | facts)
    stage("estimate", f"{METHOD_TEXT[result.method]}; {result.why}")
    stage("", f"{len(result.names)} base parameters; held out: {result.heldout}")
    notice(result.findings)
    return result


# ---------------------------------------------------------------- what is fitted, and what is held out
def _both_logs(header: Facts, earlier: Identification, options: IdentifyOptions) -> Facts:
    """Return logs and hashes of an earlier result and of new logs.

    Raises:
        WrongUsage: the estimator needs the earlier rows, or the earlier result holds this log already.
    """
    if options.method not in ("auto", *UPDATABLE):
        raise WrongUsage(
            f"--method {options.method} needs the single rows of the earlier log, which a result does not keep",
            fix=f"one of {', '.join(UPDATABLE)}; or identify from all logs at once",
        )
    if set(header["log_sha256"]) & set(earlier.log_sha256):
        raise WrongUsage(
            f"{earlier.label} was made from this log already",
            fix="give a log that it does not hold yet",
        )
    return {key: [*earlier.header.get(key, []), *header[key]] for key in ("log_sha256", "logs")}


def _held_out(seen: Observations, stack: Stack, options: IdentifyOptions) -> HoldOut | None:
    """Return the rows that are kept back to judge the fit of a stack, which may hold more than was observed."""
    kept, base = options.holdout, seen.base
    if kept is None:
        return None
    if kept == "auto":
        return last_motion(stack, AUTO_SHARE)
    if isinstance(kept, float):
        return last_share(stack, kept)
    same = replace(options, cutoff=seen.cutoff, delay=seen.applied_delay, exclude=())
    log = load_log(kept, base.robot, same, identify=False)
    name = str(log.source or "log")
    if log.sha256 and log.sha256 in [one.sha256 for one in stack.logs]:
        raise WrongUsage(f"--holdout {name}: the fit has this log", fix="--holdout 20%")
    conditioned = condition_logs([log], base.model, same)
    test = stack_logs(scaled(conditioned, base, stack.first_fit.theta), base)
    return stack, test, name


@public
def find_payload(loaded: ResultLike, unloaded: ResultLike) -> IdentifiedPayload:
    """Return the body that the loaded arm has in addition on its last link.

    Args:
        loaded: identified from a log with the body.
        unloaded: identified without it, with the same base parameters.

    Raises:
        WrongUsage: the results are of different arms, or the last link is not identified.

    Example:
        dynid.find_payload("out/loaded", "out/empty")
    """
    return payload.find_payload(as_result(loaded, "loaded"), as_result(unloaded, "unloaded"))


def _diagnosed(seen: Observations, robot: Robot, options: LogOptions) -> tuple[Finding, ...]:
    """Ask whether the robot file is wrong, by checked logs or what is still there of stored ones."""
    paths = [Path(log.path) for log in seen.stack.logs if log.path and Path(log.path).exists()]
    logs = seen.checked or [load_log(path, robot, options, identify=False) for path in paths]
    return diagnose_logs(logs, robot, options)


def _poor(result: Identification, seen: Observations, robot: Robot) -> bool:
    """Return whether a fit leaves much of a joint's torque, or fits what no arm with weight would make.

    The plain estimate is judged, without a residual model: it leaves least, and random columns take in mistakes.
    """
    left = np.linalg.norm(result.factors @ np.append(result.plain, -1.0), axis=1)
    size = np.linalg.norm(result.factors[:, :, -1], axis=1)
    suspicious = {"W404", "W405", "W413"} & {finding.code for finding in result.findings}
    if np.any(left >= mapping.UNEXPLAINED * size) or suspicious:
        return True
    try:
        for log in seen.checked:
            check_gravity(log, robot)
    except GravityRemoved:
        return True
    return False


# ---------------------------------------------------------------- what is drawn, written and answered
def save_result(folder: Path, result: Identification, facts: Facts | None = None) -> list[Path]:
    """Write parameters.npz, parameters.yaml, parameters.csv and estimatedmotion.npz of a new result.

    Args:
        folder: where to.
        result: what ``identify`` returned.
        facts: further facts for the headers, such as the inputs that they depend on.
    """
    facts, logs = dict(facts or {}), result.header.get("logs", [])
    # Why both: a log is found from any working folder, and where the folders were moved together.
    if all(path and Path(path).exists() for path in logs):
        facts["logs_from_here"] = [os.path.relpath(path, folder) for path in logs]
    there, joints = RunFolder(folder), result.robot.joint_names
    header = {**facts, **result.header, "joints": joints, "torque_from": "identified"}
    assert result.stack is not None, "a result that was read from a file has no rows"
    motion = prediction.predict(result.stack, result.theta, result.model_error)
    prediction.save(there.motion, motion, header)
    # Why last: parameters.npz is what later commands look for, so it appears only when everything else is there.
    return [
        there.motion,
        result.save_yaml(folder / "parameters.yaml"),
        result.save_csv(folder / "parameters.csv"),
        result.save(there.parameters, facts),
    ]


# ---------------------------------------------------------------- all that the command does in a folder
#: Options of reading and filtering: without logs they are those of the stored observations.
READING = ("cutoff", "velocity", "exclude", "delay", "topic", "rate", "sort_time")


def identify_run(
    robot: Robot,
    paths: Sequence[Path],
    options: IdentifyRunOptions,
    folder: Path,
    *,
    models: Path,
    may_write: Callable[[Path, Mapping[str, str]], bool],
    header: Callable[[Mapping[str, str]], Facts],
) -> Answer:
    """Identify in a folder, or with equal inputs take the result that is there.

    Args:
        robot: the arm.
        paths: recordings; () for the observations that ``dynid parameters`` wrote.
        options: how to identify, and what is asked besides.
        folder: of the results.
        models: where the model is kept.
        may_write: tells whether a file may be written, given what it is made from; False keeps the one that is there.
        header: makes the facts of every header from the inputs.

    Raises:
        WrongUsage: an option needs a log, or a load is given for logs that need none.
        DynidError: a log is unfit, or determines fewer parameters than the arm has.
    """
    unloaded = load_run(options.payload_from) if options.payload_from else None
    earlier = load_run(options.update) if options.update else None
    arm, known = resolved(robot, options, unloaded or earlier)
    # Why not all of it: a result is made from the file of the prior, which may change.
    options = replace(options, cutoff=known.cutoff, delay=known.delay)
    stage("read")
    logs = [read_log(path, arm, options) for path in paths]
    wrote, robot, gains = list[Path](), arm, gains_of(arm, logs, options, models)
    if gains is not None:
        written, robot = write_robot(folder, arm, gains)
        wrote.append(written)
    inputs = _inputs(robot, folder, paths, options, earlier)
    base, path = base_model(robot, models), RunFolder(folder).parameters
    updated = earlier is not None and path.exists() and path.samefile(earlier.path)
    reused = not updated and not may_write(path, inputs)
    if reused and unloaded is None:
        result = load_run(path)
        noticed = (Finding(**each) for each in result.header.get("log_findings", []))
        notice((*noticed, *result.findings))
    else:
        if paths:
            seen = observe(robot, logs, options, base=base, drop_weak=options.drop_weak)
        else:
            seen = load_observations(RunFolder(folder).stack, base)
        result = identify(robot, seen, options, update=earlier)
        rows = "robot", "anyway", *READING
        own = {k: v for k, v in inputs.items() if k in rows or k.startswith("log ")}
        if paths and not reused:
            wrote.append(seen.save_stack(folder, header(own)))
        if not reused:
            wrote += save_result(folder, result, header(inputs))
    payload = None if unloaded is None else find_payload(result, unloaded)
    if payload is not None:
        wrote.insert(0, _write_payload(folder, payload))
    return _answer(replace(result, path=path), inputs, gains, payload, wrote)


def _answer(
    result: Identification,
    inputs: dict[str, str],
    gains: Gains | None,
    payload: IdentifiedPayload | None,
    wrote: Sequence[Path],
) -> Answer:
    """Return what ``dynid identify`` answers: gains of the drives where they were found, the arm, and its load."""
    parts, notes = list[Part](), list[tuple[str, str]]()
    delays = ("delay_s", "delay_std_error_s", "delay_applied_s")
    answer = result.answer()
    facts = {**answer.facts, **{key: result.header.get(key) for key in delays}}
    facts |= {"folder": result.path.parent, "inputs": inputs}
    if gains is not None:
        facts |= gain_facts(result.robot, gains)
        named = "joint", "gain" if gains.relative else "gain [N m/A]", "std_error"
        parts.append(Table([dict(zip(named, x.values(), strict=True)) for x in facts["gains"]]))
        if gains.relative:
            notes = [
                ("amperes", "the size of the gains is unknown, so results are in A; see --loaded")
            ]
    parts += answer.parts
    if payload is not None:
        facts["payload"] = payload.facts()
        facts["findings"] = [*facts["findings"], *map(asdict, payload.findings())]
        names = ("mass", "com x", "com y", "com z", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
        units = ("kg", *("m",) * 3, *("kg m^2",) * 6)
        heads = ("load", "value", "2.5 %", "97.5 %", "unit")
        numbers = zip(names, payload.body.numbers, *payload.intervals.T, units, strict=True)
        rows = [dict(zip(heads, row, strict=True)) for row in numbers]
        title = "load on the last link, in its frame (inertia about the centre of mass)"
        parts += [*payload.findings(), "", title, Table(rows)]
    return replace(answer, facts=facts, parts=parts, notes=notes, wrote=wrote)


def _inputs(
    robot: Robot,
    folder: Path,
    logs: Sequence[Path],
    options: IdentifyRunOptions,
    earlier: Identification | None,
) -> dict[str, str]:
    """Return what an identification depends on; without logs, on the observations that are in its folder.

    Raises:
        WrongUsage: the stored observations were read with other options.
    """
    texts = options.texts()
    for key in ("prior", "payload_from"):
        texts.pop(key, None)
    files = {
        "loaded": options.loaded,
        "prior_file": options.prior,
        "holdout": options.holdout,
        "update": earlier and earlier.path,
    }
    hashed = {
        key: sha256(path) for key, path in files.items() if isinstance(path, Path) and path.exists()
    }
    if logs:
        return log_inputs(robot, logs) | texts | hashed
    path, default = RunFolder(folder).stack, IdentifyOptions().texts()
    inputs = dict(stored_key(path, robot).get("inputs", {}))
    for name in READING:
        if texts.pop(name, None) != default.get(name):
            raise WrongUsage(
                f"{name} is given without a log",
                why=f"without logs, {path}, which dynid parameters wrote, is used as it is",
                fix=f"name the logs: dynid identify {robot.word} LOG",
            )
    return inputs | texts | hashed


def _write_payload(folder: Path, payload: IdentifiedPayload) -> Path:
    """Write what `tool:` of a robot file holds."""
    body = {"mass": payload.body.mass, "com": list(payload.body.com)}
    body["inertia_com"] = payload.facts()["inertia_com_kg_m2"]
    write_text(folder / "payload.yaml", yaml_text({"tool": body}))
    return folder / "payload.yaml"
