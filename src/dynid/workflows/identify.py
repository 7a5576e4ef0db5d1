"""From logs to parameters with error bars (Paper Eq. 24), and what is asked of such a result beside them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from dynid import arguments
from dynid.arguments import public
from dynid.diagnose import tuning as mapping
from dynid.errors import DynidError, LogNotFound, WrongUsage
from dynid.estimation import payload
from dynid.estimation.estimate import (
    UPDATABLE,
    HoldOut,
    estimate,
    last_motion,
    last_share,
    stack_of_result,
)
from dynid.estimation.estimators import wls
from dynid.estimation.least_squares import relative_error
from dynid.estimation.noise_floor import noise_floor
from dynid.estimation.payload import IdentifiedPayload
from dynid.estimation.result import Identification
from dynid.estimation.stack import Stack, scaled
from dynid.estimation.stack import stack_logs as folded
from dynid.exporters.user_urdf import attached
from dynid.files import packaged, robotfile
from dynid.files.robotfile import load_robot
from dynid.judgement import tuning
from dynid.loading import (
    LogsLike,
    ResultLike,
    RobotLike,
    as_base_model,
    as_log,
    as_logs,
    as_result,
    as_robot,
    checked_log,
    load_log,
)
from dynid.log import Log
from dynid.model.base_model import BaseModel, in_memory, prior_base_parameters
from dynid.model.numeric_regressor import expected_torque
from dynid.options import LogOptions
from dynid.progress import SILENT, Progress
from dynid.robot import Known, Prior, Robot
from dynid.signals.conditioned_log import condition_logs as filtered
from dynid.workflows.logs import condition_logs, diagnose_logs
from dynid.workflows.options import IdentifyOptions, PriorOptions
from dynid.workflows.parameters import Observations, observe
from dynid.workflows.results import torque_figure

#: What the estimators are, for people.
METHOD_TEXT = {
    "wls": "weighted least squares, one noise level per joint",
    "ols": "ordinary least squares",
    "irls": "weighted least squares that gives spikes little weight (Huber)",
    "iv": "instrumental variables from the commanded motion",
    "ridge": "weighted least squares with a penalty on the distance from the prior's base parameters",
}
#: Share of each log that is held out where all logs are of one motion.
AUTO_SHARE = 0.2


# ---------------------------------------------------------------- what is known besides the logs


def with_prior(robot: Robot, options: PriorOptions) -> Robot:
    """Return the robot with the prior and the bounds of the options, which go before those of the robot file.

    Raises:
        WrongUsage: a bound names a link that the arm does not have.
        LogNotFound: the file of the prior is not there.
    """
    prior = options.prior
    if prior is not None:
        robot = replace(
            robot, prior=prior if isinstance(prior, Prior) else read_prior(prior, robot)
        )
    for name, bounds in (("--link-mass", options.link_mass), ("--com-box", options.com_box)):
        for link, _ in bounds:
            if link > robot.n:
                raise WrongUsage(
                    f"{name}: there is no link {link}", fix=f"a number from 1 to {robot.n}"
                )
    known = robot.known
    return replace(
        robot,
        known=Known(
            options.total_mass or known.total_mass,
            tuple({**dict(known.link_mass), **dict(options.link_mass)}.items()),
            tuple({**dict(known.com_box), **dict(options.com_box)}.items()),
        ),
    )


def read_prior(path: Path, robot: Robot) -> Prior:
    """Read link bodies from a YAML file, or from a URDF whose frames are found by comparing poses.

    Raises:
        LogNotFound: the file is not there.
    """
    if not path.is_file():
        raise LogNotFound(
            f"no such file {path}", where=str(path), fix="--prior FILE.yaml or --prior FILE.urdf"
        )
    if path.suffix in (".yaml", ".yml"):
        return robotfile.read_prior(path, robot)
    return attached(path, robot).prior()


# ---------------------------------------------------------------- identify


@public
def identify(
    robot: RobotLike,
    logs: LogsLike | Observations,
    options: IdentifyOptions | None = None,
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
    options, progress = (
        arguments.options(IdentifyOptions, options, changes),
        arguments.progress(progress),
    )
    update = None if update is None else as_result(update, "update")
    robot, options = resolved(as_robot(robot), options, update)
    base = as_base_model(base)
    like = None if like is None else as_result(like, "like")
    if robot.torque.relative and options.feasible is None:
        # Why: a prior in kg cannot be put beside parameters whose size is unknown.
        options = replace(options, feasible=False)
    if isinstance(logs, Observations):
        seen = logs
    else:
        recordings = as_logs(logs, robot, options)
        seen = observe(robot, recordings, options, base=base, progress=progress)
    robot = replace(robot, estimated_coulomb=seen.base.robot.estimated_coulomb)
    base, stack, header = (
        replace(seen.base, model=replace(seen.base.model, robot=robot)),
        seen.stack,
        seen.header(),
    )
    if update is not None:
        stack, header = updated(stack, header, update, options)
    found = identified(
        partial(
            estimate,
            stack,
            base,
            method=options.method,
            holdout=held_out(seen, stack, options, progress),
            # Why: where the bodies are known, what the log leaves open has an answer.
            drop_weak=options.drop_weak or options.given,
            feasible=options.feasible,
            residual_model=options.residual_model,
            size=None if like is None or like.model_error is None else like.model_error.size,
        ),
        base,
        seen,
        options,
    )
    header |= noise_facts(found)
    if other := other_arm(replace(found, header=header), seen.checked, progress):
        header["other_arm"] = other
    progress.stage("estimate", f"{METHOD_TEXT[found.method]}; {found.why}")
    progress.stage("", f"{len(found.names)} base parameters; held out: {found.heldout}")
    scaled, raw = found.condition_number_scaled, found.condition_number
    progress.stage(
        "excited", f"condition number {scaled:.3g} with normalised columns ({raw:.3g} without)"
    )
    progress.findings(found.findings)
    return replace(
        found,
        header=header,
        draw=torque_figure,
    )


def noise_facts(found: Identification) -> dict[str, Any]:
    """Return what the header of a new result says of the noise of its torques."""
    assert found.stack is not None
    noise = noise_floor(found.stack, found.theta, found.model_error)
    if noise is None:
        return {}
    return {"noise_floor_nm": noise.rms.tolist(), "noise_repeats_s": noise.repeats}


# ---------------------------------------------------------------- is it another arm?
def other_arm(
    found: Identification, logs: Sequence[Log], progress: Progress = SILENT
) -> dict[str, Any] | None:
    """Return the shipped arm whose link lengths explain logs far better: name, and both errors [%]; None for none.

    Args:
        found: a result.
        logs: the checked logs that it was made from.
        progress: reports that other arms are tried.
    """
    noise = found.header.get("noise_floor_nm")
    if not logs or not noise or not all(noise):
        return None
    # Why not by the light, which lets an error pass that matters to nobody: wrong lengths leave little in slow torques.
    if (
        median(joint.rms / floor for joint, floor in zip(found.joints, noise, strict=True))
        <= tuning.OTHER_ARM
    ):
        return None
    progress.stage(
        "arm",
        "most joints miss several times their noise: the link lengths of other arms are tried",
    )
    own = _unexplained(found.robot, logs, found.cutoff)
    tried = [
        (_unexplained(arm, logs, found.cutoff), name) for name, arm in _other_lengths(found.robot)
    ]
    percent, name = min(tried, default=(own, ""))
    return (
        {"name": name, "percent": percent, "own": own}
        if percent < tuning.OTHER_ARM_GAIN * own
        else None
    )


def _other_lengths(robot: Robot) -> Iterator[tuple[str, Robot]]:
    """Yield shipped arms of the same kind: their lengths and twists on the joints of the robot file."""
    for path in sorted(Path(packaged("robots")).glob("*.yaml")):
        other = load_robot(path)
        if other.n != robot.n or other.convention != robot.convention:
            continue
        joints = tuple(
            replace(
                own, a=one.a, d=one.d, twist=one.twist, theta_offset=one.theta_offset, type=one.type
            )
            for own, one in zip(robot.joints, other.joints, strict=True)
        )
        if joints != robot.joints:
            yield path.stem, replace(robot, joints=joints, prior=None, effects=())


def _unexplained(robot: Robot, logs: Sequence[Log], cutoff: float) -> float:
    """Return what is unexplained of logs with the links of an arm [%]."""
    base = in_memory(replace(robot, prior=None, estimated_coulomb=None))
    stack = folded(filtered(logs, base.model, cutoff=cutoff or None), base)
    fit = wls(stack, prior_base_parameters(base.model, base.reduction))
    return relative_error(stack.whole[0], fit.theta)


# ---------------------------------------------------------------- what is fitted, and what is held out
def resolved(
    robot: Robot, options: IdentifyOptions, earlier: Identification | None = None
) -> tuple[Robot, IdentifyOptions]:
    """Return the arm with the prior that is asked for, and options that name nothing that still has to be looked up.

    Args:
        robot: the arm.
        options: how it is identified.
        earlier: a result whose signals are treated alike, where nothing else was asked for.

    Raises:
        WrongUsage: a bound names a link that the arm does not have.
        LogNotFound: the file of the prior is not there.
    """
    if earlier is not None:
        cutoff = earlier.cutoff if options.cutoff is None else options.cutoff
        options = replace(
            options, cutoff=cutoff, delay=earlier.delay if options.delay is None else options.delay
        )
        robot = replace(robot, estimated_coulomb=earlier.robot.estimated_coulomb)
    robot = with_prior(robot, options)
    return robot, options if options.prior is None else replace(options, prior=robot.prior)


def updated(
    stack: Stack, header: dict[str, Any], earlier: Identification, options: IdentifyOptions
) -> tuple[Stack, dict[str, Any]]:
    """Return the new logs' stack and header with what an earlier result was made from.

    Raises:
        WrongUsage: the estimator needs the earlier rows, or the earlier result holds this log already.
    """
    if options.method not in ("auto", *UPDATABLE):
        raise WrongUsage(
            f"--method {options.method} needs the single rows of the earlier log, which a result does not keep",
            fix=f"one of {', '.join(UPDATABLE)}; or identify from all logs at once",
        )
    again = set(header["log_sha256"]) & set(earlier.log_sha256)
    if again:
        raise WrongUsage(
            f"{earlier.label} was made from this log already",
            fix="give a log that it does not hold yet",
        )
    both = {key: [*earlier.header.get(key, []), *header[key]] for key in ("log_sha256", "logs")}
    return stack_of_result(earlier, stack.base) + stack, {**header, **both}


def held_out(
    seen: Observations, stack: Stack, options: IdentifyOptions, progress: Progress = SILENT
) -> HoldOut | None:
    """Return the rows that are kept back to judge the fit of a stack, which may hold more than was observed."""
    kept, base = options.holdout, seen.base
    if kept is None:
        return None
    if kept == "auto":
        return last_motion(stack, AUTO_SHARE)
    if isinstance(kept, float):
        return last_share(stack, kept)
    same = replace(options, cutoff=seen.cutoff, delay=seen.applied_delay, exclude=())
    kept = as_log(kept, base.robot, same, "holdout")
    conditioned = condition_logs(
        [checked_log(kept, base.robot, same, alone=False)], base.model, same, progress
    )
    test = folded(scaled(conditioned, base, stack.first_fit.theta), base, progress)
    return stack, test, str(kept.source or "log")


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


def identified(
    fit: Callable[[], Identification], base: BaseModel, seen: Observations, options: LogOptions
) -> Identification:
    """Return what a fit gives; where it is poor or not possible, ask first whether the robot file is wrong.

    Args:
        fit: makes the result.
        base: the arm's base model.
        seen: what is fitted.
        options: how its logs are read; whether a wrong mapping is only a finding of the result (W329).

    Raises:
        GravityRemoved: the torques do not change with the weight of the arm (E317).
        WrongMapping: the robot file is wrong (E324).
        DynidError: the fit is not possible for another reason.
    """
    try:
        found = fit()
    except DynidError:
        diagnose_logs(_logs_of(seen, base.robot, options), base.robot, anyway=options.anyway)
        raise
    if not poor(found, base):
        return found
    mistakes = diagnose_logs(_logs_of(seen, base.robot, options), base.robot, anyway=options.anyway)
    return replace(found, findings=(*mistakes, *found.findings))


def _logs_of(seen: Observations, robot: Robot, options: LogOptions) -> Sequence[Log]:
    """Return the checked logs of observations; of stored ones, and of those made elsewhere, what is still there."""
    if seen.checked:
        return seen.checked
    there = [path for path in map(Path, seen.logs) if path.exists() and path.name]
    return [load_log(path, robot, options, identify=False) for path in there]


def poor(found: Identification, base: BaseModel) -> bool:
    """Return whether a fit leaves much of a joint's torque, or fits what no arm with weight would make.

    The plain estimate is judged, without a residual model: it leaves least, and random columns take in mistakes.
    """
    factors = found.factors
    left = np.linalg.norm(factors @ np.append(found.plain, -1.0), axis=1)
    size = np.linalg.norm(factors[:, :, -1], axis=1)
    suspicious = {"W404", "W405", "W413"} & {finding.code for finding in found.findings}
    if np.any(left >= mapping.UNEXPLAINED * size) or suspicious:
        return True
    if found.stack is None or base.robot.torque.source == "gravity_free":
        return False
    q = np.concatenate([segment.q for log in found.stack.logs for segment in log.segments])
    q = q[:: max(1, len(q) // mapping.POSES_OF_WEIGHT)]
    weight = base.model.observer(base.reduction.base).torque(found.plain, q, 0.0 * q, 0.0 * q)
    expected = np.std(expected_torque(q, base.robot), axis=0)
    heaviest = int(np.argmax(expected))
    return bool(np.std(weight[:, heaviest]) < mapping.WEIGHT * expected[heaviest])
