"""From logs to parameters with error bars (Paper Eq. 24), and what is asked of such a result beside them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from dynid.errors import LogNotFound, WrongUsage
from dynid.log import Log
from dynid.options import Options, option, share
from dynid.progress import SILENT, Progress
from dynid.robot import Known, Prior
from dynid.text import whole_number
from dynid.workflows import arguments
from dynid.workflows.arguments import public
from dynid.workflows.logs import LogOptions, checked_log, condition_logs, identified
from dynid.workflows.parameters import Observations, observe, observed, stack_logs
from dynid.workflows.results import base_model_of, torque_figure

if TYPE_CHECKING:
    from dynid.estimation.estimate import HoldOut
    from dynid.estimation.payload import IdentifiedPayload
    from dynid.estimation.result import Identification
    from dynid.estimation.stack import Stack
    from dynid.model.base_model import BaseModel
    from dynid.robot import Robot
    from dynid.workflows.arguments import LogsLike, ResultLike, RobotLike

METHODS = ("auto", "wls", "ols", "irls", "iv", "ridge")
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
#: Cut-offs that ``sensitivity`` tries, times the chosen one.
CUTOFFS = (0.5, 2.0)
#: A change by more standard errors than this is more than noise explains.
BEYOND = 2.0


def _holdout(value: Any, name: str) -> Any:  # noqa: ANN401
    """Return a share, ``auto``, None for ``none``, or a log (its path until it is read)."""
    if value is None or value == "none":
        return None
    if value == "auto":
        return "auto"
    if isinstance(value, (Log, Path)):
        return value
    if not isinstance(value, (str, float)):
        raise TypeError("it is neither a share nor a log")
    text = str(value)
    digits = text.removesuffix("%").replace(".", "", 1)
    return share(value, name) if digits.isdigit() else Path(text)


# ---------------------------------------------------------------- what is known besides the logs
Range = tuple[float, float]
Corner = tuple[float, float, float]
#: What each option is given.
SUCH_AS = {
    "--total-mass": "15:17",
    "--link-mass": "2=3.5:4.5",
    "--com-box": "7=-0.1,-0.1,0:0.1,0.1,0.2",
}


def _range(value: Any, name: str) -> Range | None:  # noqa: ANN401
    if value is None:
        return None
    low, high = (
        _two(value, name, 1) if isinstance(value, str) else ((float(value[0]),), (float(value[1]),))
    )
    if not low[0] < high[0]:
        raise WrongUsage(f"{name} '{value}': the first number must be the smaller one")
    return low[0], high[0]


def _ranges(value: Any, name: str) -> tuple[tuple[int, Range], ...]:  # noqa: ANN401
    found = []
    for item in value:
        link, rest = _link(item, name)
        bounds = _range(rest, name)
        assert bounds is not None
        found.append((link, bounds))
    return tuple(found)


def _boxes(value: Any, name: str) -> tuple[tuple[int, tuple[Corner, Corner]], ...]:  # noqa: ANN401
    found = []
    for item in value:
        link, rest = _link(item, name)
        low, high = _two(rest, name, 3) if isinstance(rest, str) else rest
        (a, b, c), (x, y, z) = low, high
        if not (a < x and b < y and c < z):
            raise WrongUsage(f"{name} '{rest}': the first corner must be the lower one")
        found.append((link, ((a, b, c), (x, y, z))))
    return tuple(found)


def _link(item: Any, name: str) -> tuple[int, Any]:  # noqa: ANN401
    if not isinstance(item, str):
        return int(item[0]), item[1]
    number, equals, rest = item.partition("=")
    if not equals or whole_number(number.strip()) < 1:
        raise WrongUsage(f"{name} '{item}' does not begin with LINK=, the number of a link")
    return int(number), rest


def _two(text: str, name: str, count: int) -> tuple[Sequence[float], Sequence[float]]:
    try:
        parts = [[float(word) for word in part.split(",")] for part in text.split(":")]
    except ValueError:
        parts = []
    if len(parts) != 2 or any(len(part) != count for part in parts):
        raise WrongUsage(f"{name} '{text}' is not LOW:HIGH", fix=f"such as {name} {SUCH_AS[name]}")
    return parts[0], parts[1]


def _prior(value: Any, name: str) -> Path | Prior | None:  # noqa: ANN401
    if value is None or isinstance(value, (Path, Prior)):
        return value
    if not isinstance(value, str):
        raise WrongUsage(f"{name} {value!r:.60} is no file", fix=f"such as {name} prior.yaml")
    return Path(value)


@dataclass(frozen=True)
class PriorOptions(Options):
    """What is known about the bodies of an arm before anything is measured."""

    prior: Path | Prior | None = option(
        None,
        "Link inertias that are known before measuring: a YAML file with `links:` or `cylinders:`, or a URDF of this "
        "arm (default: those of the robot file).",
        metavar="FILE",
        kind="file",
        read=_prior,
    )
    total_mass: Range | None = option(
        None,
        "Smallest and largest mass of all identified links together [kg].",
        metavar="LOW:HIGH",
        read=_range,
    )
    link_mass: tuple[tuple[int, Range], ...] = option(
        (),
        "Smallest and largest mass of one link [kg]; may be repeated.",
        metavar="LINK=LOW:HIGH",
        repeatable=True,
        read=_ranges,
    )
    com_box: tuple[tuple[int, tuple[Corner, Corner]], ...] = option(
        (),
        "Corners of the box around a link's centre of mass, in its DH frame [m]; may be repeated.",
        metavar="LINK=X,Y,Z:X,Y,Z",
        repeatable=True,
        read=_boxes,
    )

    @property
    def given(self) -> bool:
        """Whether any option says what is known of the bodies."""
        return (
            self.prior is not None
            or self.total_mass is not None
            or bool(self.link_mass or self.com_box)
        )


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
    from dynid.exporters.user_urdf import attached
    from dynid.files import robotfile

    if not path.is_file():
        raise LogNotFound(
            f"no such file {path}", where=str(path), fix="--prior FILE.yaml or --prior FILE.urdf"
        )
    if path.suffix in (".yaml", ".yml"):
        return robotfile.read_prior(path, robot)
    return attached(path, robot).prior()


# ---------------------------------------------------------------- identify
@dataclass(frozen=True)
class IdentifyOptions(PriorOptions, LogOptions):
    """How parameters are identified."""

    method: str = option(
        "auto",
        "Estimator; auto takes the one that the log allows and reports why.",
        choices=METHODS,
        shown="",
    )
    feasible: bool | None = option(
        None,
        "Predict with the physically possible parameters, or with the plain estimate (default: the physically possible "
        "ones, unless --method names an estimator).",
        pair=True,
    )
    residual_model: bool | None = option(
        None,
        "Fit a residual model to what rigid bodies and friction leave unexplained, and use it in predictions (default: "
        "when the data support it).",
        pair=True,
    )
    holdout: float | str | Path | Log | None = option(
        "auto",
        "Data kept back to judge the fit: a share at the end of each log, another log, or nothing; auto keeps back the "
        "last motion if the logs hold several, else the last 20 % of each log.",
        metavar="auto|SHARE|LOG|none",
        shown="auto",
        read=_holdout,
    )
    drop_weak: bool = option(
        False, "Continue when the log does not determine all parameters, or only badly."
    )


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
    from dynid.estimation.estimate import estimate

    options, progress = (
        arguments.options(IdentifyOptions, options, changes),
        arguments.progress(progress),
    )
    update = None if update is None else arguments.result(update, "update")
    robot, options = resolved(arguments.robot(robot), options, update)
    base = arguments.base_model(base)
    like = None if like is None else arguments.result(like, "like")
    if robot.torque.relative and options.feasible is None:
        # Why: a prior in kg cannot be put beside parameters whose size is unknown.
        options = replace(options, feasible=False)
    if isinstance(logs, Observations):
        seen = logs
    else:
        recordings = arguments.logs(logs, robot, options)
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
    from dynid.estimation.noise_floor import noise_floor

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
    from dynid.judgement import tuning

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
    from dynid.files import packaged
    from dynid.files.robotfile import load_robot

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
    from dynid.estimation.estimators import wls
    from dynid.estimation.least_squares import relative_error
    from dynid.estimation.stack import stack_logs
    from dynid.model.base_model import in_memory
    from dynid.model.parameters import prior_base_parameters
    from dynid.signals.conditioned_log import condition_logs

    base = in_memory(replace(robot, prior=None, estimated_coulomb=None))
    stack = stack_logs(condition_logs(logs, base.model, cutoff=cutoff or None), base)
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
    from dynid.estimation.estimate import UPDATABLE, stack_of_result

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
    from dynid.estimation.estimate import last_motion, last_share
    from dynid.estimation.stack import scaled
    from dynid.estimation.stack import stack_logs as folded

    kept, base = options.holdout, seen.base
    if kept is None:
        return None
    if kept == "auto":
        return last_motion(stack, AUTO_SHARE)
    if isinstance(kept, float):
        return last_share(stack, kept)
    same = replace(options, cutoff=seen.cutoff, delay=seen.applied_delay, exclude=())
    kept = arguments.log(kept, base.robot, same, "holdout")
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
    from dynid.estimation import payload

    return payload.find_payload(
        arguments.result(loaded, "loaded"), arguments.result(unloaded, "unloaded")
    )


@public
def sensitivity(
    result: ResultLike,
    logs: LogsLike,
    options: IdentifyOptions | None = None,
    *,
    base: BaseModel | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> list[dict[str, Any]]:
    """Identify again with other cut-offs and another delay, and return how far the parameters move.

    Args:
        result: what is compared with, its folder or its file.
        logs: the logs it was made from, or their paths.
        options: those of the result.
        base: its base model, where it is there already.
        progress: reports which variants are not possible.
        changes: single options by name, such as ``exclude="3.2-3.4"``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).

    Example:
        dynid.sensitivity("out/kuka_lwr4plus", "run1.bag")
    """
    import numpy as np

    from dynid.errors import DynidError
    from dynid.estimation.estimate import estimate, last_share

    options, progress = (
        arguments.options(IdentifyOptions, options, changes),
        arguments.progress(progress),
    )
    result = arguments.result(result)
    base = arguments.base_model(base) or base_model_of(result)
    checked = [
        checked_log(log, base.robot, options) for log in arguments.logs(logs, base.robot, options)
    ]
    sure = np.isfinite(result.std_error) & (result.std_error > 0)
    rows: list[dict[str, Any]] = []
    for name, cutoff, delay in _variants(result):
        try:
            again = replace(options, cutoff=cutoff, delay=delay)
            stack = observed(stack_logs(checked, base, again), again).stack
            feasible, error = result.in_force == "physical", result.model_error is not None
            other = estimate(
                stack,
                base,
                method=result.method,
                holdout=last_share(stack, 0.2),
                drop_weak=True,
                feasible=feasible,
                residual_model=error,
            )
        except DynidError as error:
            progress.stage("explain", f"{name}: {error}")
            continue
        change = np.zeros(len(result.names))
        change[sure] = (other.theta - result.theta)[sure] / result.std_error[sure]
        worst = int(np.argmax(np.abs(change)))
        rows.append(
            {
                "variant": name,
                "cutoff_hz": cutoff,
                "delay_s": delay,
                "relative_error_percent": other.relative_error_percent,
                "heldout_relative_error_percent": other.heldout_relative_error_percent,
                "beyond_two_std_errors": int(np.sum(np.abs(change) > BEYOND)),
                "most_changed": result.names[worst],
                "before": float(result.theta[worst]),
                "after": float(other.theta[worst]),
                "std_errors": float(change[worst]),
            }
        )
    return rows


def _variants(result: Identification) -> list[tuple[str, float, float]]:
    """Return what is tried: its name, cut-off [Hz], delay [s]."""
    applied = result.delay
    other = 0.0 if applied else float(result.header.get("delay_s") or 0.0)
    tried = [
        (f"cut-off {factor * result.cutoff:.3g} Hz", factor * result.cutoff, applied)
        for factor in CUTOFFS
    ]
    return (
        tried
        if other == applied
        else [*tried, (f"delay {1e3 * other:.1f} ms", result.cutoff, other)]
    )
