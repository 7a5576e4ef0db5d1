"""Estimate the base parameters of a stack and say how good they are."""

from __future__ import annotations

from dataclasses import asdict, replace
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from dynid.errors import (
    Finding,
    NothingChanged,
    PoorlyExcited,
    RankDeficient,
    WeakInstruments,
    WrongUsage,
)
from dynid.estimation import tuning
from dynid.estimation.covariance import NOT_DETERMINED, judge
from dynid.estimation.estimators import METHODS, choose, wls
from dynid.estimation.identified import SAME_MOTION, JointQuality
from dynid.estimation.least_squares import (
    Fit,
    condition_number,
    joint_rms,
    relative_error,
    solvable,
)
from dynid.estimation.payload import friction
from dynid.estimation.posterior import (
    Refit,
    contradicts,
    expected_error,
    physical_posterior,
    uncertainty,
)
from dynid.estimation.residual_model import ModelError, squares
from dynid.estimation.result import Identification
from dynid.estimation.rows import Rows
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel, prior_base_parameters
from dynid.model.regressor import indefinite_share, random_poses
from dynid.signals.conditioned_log import ConditionedLog
from dynid.signals.filters import decimate
from dynid.signals.motion import motion_numbers, sampled

Floats = NDArray[np.float64]

#: Methods that need nothing but triangular factors, and can add a log to an earlier result.
UPDATABLE = ("wls", "ols", "ridge")


#: Rows that are fitted, rows that judge the fit, and what those are, for people.
HoldOut: TypeAlias = tuple[Stack, Stack, str]


def last_share(stack: Stack, share: float) -> HoldOut | None:
    """Hold out the last share of each log, in whole blocks of time; None where no log has two.

    Args:
        stack: the stacked logs.
        share: between 0 and 1.
    """
    rows, judged = stack.rows, np.zeros(len(stack.rows.t), dtype=bool)
    for log in np.unique(rows.log):
        blocks = np.unique(rows.block[rows.log == log])
        cut = max(1, len(blocks) - max(1, round(share * len(blocks))))
        judged |= np.isin(rows.block, blocks[cut:])
    return _split(stack, judged, f"last {100 * share:.0f} % of each log, {SAME_MOTION}")


def _split(stack: Stack, judged: NDArray[np.bool_], what: str) -> HoldOut | None:
    """Return rows to fit, those that judge, (M,), and what these are; None without any."""
    train, test = stack.take(~judged), replace(stack.take(judged), earlier=None)
    return (train, test, what) if judged.any() else None


def last_motion(stack: Stack, share: float) -> HoldOut | None:
    """Hold out all logs of the last motion, or the last share of each log where all are of one motion.

    Args:
        stack: the stacked logs.
        share: of each log, between 0 and 1.
    """
    numbers = motion_numbers([log_motion(log) for log in stack.logs])
    last = [k for k, number in enumerate(numbers) if number == max(numbers)]
    rows = stack.rows
    judged = np.isin(rows.log, last)
    # Why the size: a motion that is most of the rows has to be fitted.
    if max(numbers, default=0) == 0 or rows.use[judged].sum() > 0.5 * stack.whole[1].sum():
        return last_share(stack, share)
    return _split(stack, judged, f"another motion: {', '.join(stack.logs[k].name for k in last)}")


def log_motion(log: ConditionedLog) -> Floats:
    """Return the positions of a log at the rate at which motions are compared, (M, n) [rad or m]."""
    t, q = (np.concatenate([getattr(s, name) for s in log.segments]) for name in ("t", "q"))
    return sampled(t, q)


def stack_of_result(earlier: Identification, base: BaseModel) -> Stack:
    """Return what an earlier result was made from as a stack, to which new logs are added: recursive least squares.

    A result keeps one factor of [W tau] per joint. Factors of old and new rows merged by one more QR are the factor of
    all rows, so the parameters equal those of a fit on all logs to rounding. Single rows of the old logs are gone:
    methods that look at them cannot be used, and the memory of the old residuals is that of the old covariance.

    Args:
        earlier: the result.
        base: model and base parameters of the new logs.

    Raises:
        WrongUsage: the earlier result has other base parameters, or keeps no factors.
    """
    if earlier.names != base.names or earlier.robot.joint_names != base.robot.joint_names:
        raise WrongUsage(
            f"{earlier.label} has different base parameters from this log's model",
            fix="identify both with the same robot file",
        )
    if not earlier.factors.size:
        raise WrongUsage(
            f"{earlier.label} holds no triangular factors", fix="identify the earlier log again"
        )
    n, p = base.robot.n, len(base.names)
    return Stack(base, (), Rows.of(np.zeros((0, n, p)), np.zeros((0, n))), earlier.fit)


@solvable()
def estimate(
    stack: Stack,
    base: BaseModel,
    *,
    method: str = "auto",
    holdout: HoldOut | None,
    drop_weak: bool = False,
    feasible: bool | None = None,
    residual_model: bool | None = None,
    size: Floats | None = None,
) -> Identification:
    """Fit the base parameters, with robust error bars and a held-out figure.

    The parameters come from all rows; the held-out figure comes from a second fit without the rows that are held out.

    Args:
        stack: the stacked logs.
        base: model and base parameters.
        method: a name in ``METHODS``, or ``"auto"``.
        holdout: what is held out, None for nothing.
        drop_weak: go on when the logs do not determine all base parameters.
        feasible: predict with the possible parameters, or with the plain estimate; None takes the possible ones unless
            an estimator was asked for.
        residual_model: fit a residual model to what the parameters leave unexplained; None where the data support it.
        size: sizes of the groups of these columns where they are known already.

    Raises:
        RankDeficient: the logs determine fewer base parameters than the structure has.
        PoorlyExcited: they determine all, but some only through what is left of noise.
        NothingChanged: the physical set in force is the prior although the torques say otherwise.
    """
    prior = prior_base_parameters(base.model, base.reduction)
    name, why = choose(stack) if method == "auto" else (method, "as asked")
    plain = METHODS[name](stack, prior)
    if name == "iv":
        _require_followed(stack, plain)

    def refit(part: Stack) -> Fit:
        # Why also where one was asked for: joints that are left out leave parameters open.
        chosen = choose(part)[0] if method == "auto" or part.first_fit.leaves_open else method
        return METHODS[chosen](part, prior)

    post = physical_posterior(
        base, plain, stack, refit=refit, residual_model=residual_model, size=size
    )
    physical = method == "auto" if feasible is None else feasible
    theta, covariance, error, changes = (
        (post.theta, post.covariance, post.error, post.changes)
        if physical
        else (plain.theta, plain.covariance, None, None)
    )
    # Why: where the prior carries what the rows leave open there is an answer, and the posterior says how little.
    cost = uncertainty(base, plain.covariance, post.theta)
    excitation = excitation_findings(stack, plain, cost, drop_weak=drop_weak or physical)
    if physical:
        _require_change(prior, plain=plain.theta, physical=post.theta)
    unseen = None
    if holdout is not None:
        like = post.error if physical else None
        unseen = _held_out(base, holdout, prior, name, refit, physical=physical, like=like)
    rms, total = _of_squares(stack, squares(stack, theta, error))
    expected = expected_error(base, stack, theta, covariance, error, rms, changes)
    std_error, knowledge = _certainty(plain, theta, covariance, physical=physical)
    return Identification(
        robot=base.robot,
        reduction=base.reduction,
        fit=plain,
        joints=_qualities(stack, rms, None if unseen is None else unseen[0]),
        relative_error_percent=total,
        heldout_relative_error_percent=None if unseen is None else unseen[1],
        heldout=holdout[2] if holdout else "nothing held out",
        rank=plain.solution.rank,
        condition_number=condition_number(plain.whitened, plain.solution.rank),
        condition_number_scaled=plain.solution.condition_number_scaled,
        samples=stack.samples,
        expected=expected,
        why=why,
        theta=theta,
        covariance=covariance,
        std_error=std_error,
        knowledge=knowledge,
        prior=prior,
        physical=post.physical,
        in_force="physical" if physical else "plain",
        model_error=error,
        findings=(
            *excitation,
            *sensor_findings(base),
            *physics_findings(
                base,
                plain,
                joint_rms(*stack.whole, post.alone),
                knowledge,
                error,
                physical=physical,
            ),
            *apart_findings(base, stack, theta, error),
        ),
        header=_header(base, stack),
        motions=tuple(log_motion(log)[: tuning.MOTION_SAMPLES] for log in stack.logs),
        rigid=base.model.rigid,
        stack=stack,
    )


def _header(base: BaseModel, stack: Stack) -> dict[str, Any]:
    """Return where a result comes from, for its file."""
    header: dict[str, Any] = {
        "robot": base.robot.name,
        "key": base.robot.model_key,
        "log_sha256": [log.sha256 for log in stack.logs],
        "logs": [log.path or log.name for log in stack.logs],
        "log_findings": [asdict(finding) for log in stack.logs for finding in log.findings],
    }
    if stack.logs:
        first = stack.logs[0]
        header |= {"cutoff_hz": first.filter.cutoff, "delay_applied_s": first.delay}
    return header


def _of_squares(stack: Stack, left: Floats) -> tuple[Floats, float]:
    """Return the rms residual of each joint, (n,) [N m or N], and the total relative error [%], from squared sums."""
    factors, counts = stack.whole
    torque = max(float(np.linalg.norm(factors[:, :, -1])), 1e-300)
    return np.sqrt(left / np.maximum(counts, 1)), float(100.0 * np.sqrt(left.sum()) / torque)


def _held_out(
    base: BaseModel,
    holdout: HoldOut,
    prior: Floats,
    method: str,
    refit: Refit,
    *,
    physical: bool,
    like: ModelError | None,
) -> tuple[Floats, float]:
    """Return the errors on the held-out rows of what is fitted without them, as ``_of_squares`` does.

    Args:
        base: model and base parameters.
        holdout: rows that are fitted, and those that judge.
        prior: prior base parameters, (p,).
        method: the estimator.
        refit: makes such an estimate of some joints.
        physical: whether possible parameters predict.
        like: model error whose sizes and joints apart are taken; None for none.
    """
    train, test, _ = holdout
    fit = METHODS[method](train, prior)
    if not physical:
        return _of_squares(test, squares(test, fit.theta, None))
    again = physical_posterior(
        base, fit, train, refit=refit, residual_model=like is not None, like=like
    )
    return _of_squares(test, squares(test, again.theta, again.error))


def _qualities(stack: Stack, rms: Floats, held: Floats | None) -> tuple[JointQuality, ...]:
    factors, counts = stack.whole
    torque = np.sqrt(np.sum(factors[:, :, -1] ** 2, axis=1) / np.maximum(counts, 1))
    percent = 100.0 * rms / np.where(torque > 0.0, torque, np.inf)
    return tuple(
        JointQuality(
            joint=joint,
            rms=float(rms[j]),
            relative_percent=float(percent[j]),
            torque_rms=float(torque[j]),
            heldout_rms=None if held is None else float(held[j]),
        )
        for j, joint in enumerate(stack.joints)
    )


def _certainty(
    plain: Fit, theta: Floats, covariance: Floats, *, physical: bool
) -> tuple[Floats, tuple[str, ...]]:
    """Return standard errors and how well each parameter is known.

    Directions that the log leaves open are infinite for the plain estimate; for the physical set they are as wide as
    the prior, and not determined all the same.
    """
    std_error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    open_ = np.abs(plain.solution.weak).max(axis=1, initial=0.0) > 1e-9
    if not physical:
        std_error[open_] = np.inf
    effect = np.linalg.norm(plain.whitened[:, :-1], axis=0) / np.sqrt(max(1, plain.counts.sum()))
    judged = judge(theta, std_error, effect)
    words = (NOT_DETERMINED if o else word for word, o in zip(judged, open_, strict=True))
    return std_error, tuple(words)


def _require_change(prior: Floats, *, plain: Floats, physical: Floats) -> None:
    """Refuse a physical set that is still where its search began; a log of the prior itself moves nothing either.

    Raises:
        NothingChanged: with the number of parameters.
    """
    known = np.isfinite(prior)

    def same(theta: Floats) -> NDArray[np.bool_]:
        return np.asarray(np.isclose(theta, prior, rtol=tuning.PRIOR_UNCHANGED, atol=1e-12)[known])

    if known.any() and same(physical).all() and not same(plain).all():
        count = int(known.sum())
        raise NothingChanged(
            f"nothing changed: the physical parameters equal the prior in {count} of {count}"
        )


def _require_followed(stack: Stack, fit: Fit) -> None:
    """Refuse instruments that explain the rows far worse than least squares.

    Raises:
        WeakInstruments: with the torque error of both.
    """
    left, least = (
        relative_error(stack.whole[0], theta) for theta in (fit.theta, stack.first_fit.theta)
    )
    if contradicts(left, least):
        raise WeakInstruments(f"iv leaves {left:.3g} % of the torque, wls {least:.3g} %")


# ---------------------------------------------------------------- what logs and fits are worth, as findings
def weakly_excited(base: BaseModel, stack: Stack, prior: Floats) -> list[Finding]:
    """Name the base parameters that this log leaves uncertain, why, and what would help.

    A parameter's error falls in proportion to the size of its column: for an inertia that is the acceleration, for
    viscous friction the speed. It falls with the root of the length of the log.

    Args:
        base: model and base parameters.
        stack: the stacked logs.
        prior: prior base parameters, NaN where nothing is known, (p,).

    Returns:
        Finding W402, which names the worst.
    """
    fit = wls(stack, prior)
    error = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    error[np.abs(fit.solution.weak).max(axis=1, initial=0.0) > 1e-9] = np.inf
    size = np.maximum(np.abs(fit.theta), np.abs(np.nan_to_num(prior)))
    rows = max(1, int(stack.whole[1].sum()))
    harmless = (
        error * np.linalg.norm(fit.whitened[:, :-1], axis=0) / np.sqrt(rows)
        <= tuning.HARMLESS_TORQUE
    )
    relative = error / np.maximum(size, np.finfo(float).tiny)
    order = np.argsort(-relative).tolist()
    weak = [k for k in order if relative[k] > tuning.ROUGH_ERROR and not harmless[k]]
    if not weak:
        return []
    told = []
    for k in weak[: tuning.FINDINGS_WORDED]:
        much = f"{100 * relative[k]:.0f} % error" if np.isfinite(relative[k]) else "no trace"
        told.append(f"{stack.names[k]} ({much}: {_reason(base, stack, k)})")
    names, more = [stack.names[k] for k in weak], len(weak) - len(told)
    text = "poorly excited: " + ", ".join(told) + f" and {more} more" * (more > 0)
    return [Finding("W402", "warning", text, {"parameters": names})]


def _reason(base: BaseModel, stack: Stack, k: int) -> str:
    """Say which signal shows a base parameter and how small it is in these logs."""
    parameter = base.model.parameters[base.reduction.base[k]]
    kind, j = parameter.kind, parameter.number - 1
    joint = base.robot.joints[j]
    unit = "rad" if joint.revolute else "m"
    segments = [segment for log in stack.logs for segment in log.segments]
    if kind.startswith("I"):
        # Why filtered once more: behind the position filter alone, encoder noise still looks like acceleration.
        largest = max(
            float(
                np.abs(decimate(s.qdd[:, j][None, :], log.filter.second_kernel, 1)).max(initial=0.0)
            )
            for log in stack.logs
            for s in log.segments
        )
        return f"{joint.name} never accelerates beyond {largest:.2g} {unit}/s^2"
    if kind in ("fv", "fvc"):
        largest = max(float(np.abs(s.qd[:, j]).max()) for s in segments)
        return f"{joint.name} never moves faster than {largest:.2g} {unit}/s"
    if kind in ("fc", "fo", "fcc"):
        reversals = sum(int(np.sum(np.diff(np.sign(s.qd[:, j])) != 0)) for s in segments)
        return f"{joint.name} reverses only {reversals} times"
    spans = [float(np.ptp(s.q[:, j])) for s in segments]
    return f"{joint.name} covers only {max(spans):.2g} {unit}: gravity and speed change little"


def excitation_findings(
    stack: Stack, plain: Fit, cost: float, *, drop_weak: bool
) -> tuple[Finding, ...]:
    """Say when the logs do not determine all base parameters, or some only through what is left of noise.

    Args:
        stack: the stacked logs.
        plain: their fit.
        cost: torque error on an exciting motion that its uncertain parameters cost [%].
        drop_weak: go on nevertheless.

    Raises:
        RankDeficient: the logs determine fewer base parameters than the structure has.
        PoorlyExcited: they determine all, but some only through what is left of noise.
    """
    rank, size = plain.solution.rank, len(plain.theta)
    if rank < size:
        open_ = np.abs(plain.solution.weak).max(axis=1)
        names = ", ".join(stack.names[k] for k in np.flatnonzero(open_ > 1e-3 * open_.max()))
        text = (
            f"this log determines {rank} of {size} base parameters; it does not separate: {names}"
        )
        if not drop_weak:
            fix = "record a motion in which every joint moves on its own, or continue with --drop-weak"
            raise RankDeficient(text, fix=fix)
        return (Finding("W403", "warning", text, {"rank": rank, "structural_rank": size}),)
    condition = plain.solution.condition_number_scaled
    if cost > tuning.POORLY_EXCITED_PERCENT:
        text = (
            f"this log determines some parameters badly: least squares would have a torque error of {cost:.3g} % on "
            f"an exciting motion; condition number {condition:.0f} (good: below 100)"
        )
        if not drop_weak:
            fix = "plan a better motion: dynid trajectory ROBOT --optimise; or continue with --drop-weak"
            raise PoorlyExcited(text, fix=fix)
        evidence = {"expected_percent": cost, "condition_number_scaled": condition}
        return (Finding("W402", "warning", text, evidence),)
    return ()


def sensor_findings(base: BaseModel) -> list[Finding]:
    """Say what a torque sensor between gear and link cannot see."""
    reduction, table = base.reduction, base.model.parameters
    rotors = [
        name
        for name, k in zip(reduction.base_names, reduction.base, strict=True)
        if table[k].kind == "Im"
    ]
    source, named = base.robot.torque.source, ", ".join(rotors)
    if source not in ("joint_sensor", "unknown") or not rotors:
        return []
    text = (
        f"torques come from joint sensors after the gears: {named} and friction describe the link side of "
        "the sensor only; rotor inertia and motor friction are largely invisible"
    )
    if source == "unknown":
        text = (
            f"the robot file does not say what the effort column is: behind joint sensors, {named} and "
            "friction would describe the link side only; write `torque: {source: joint_sensor}`, motor_torque or "
            "motor_current"
        )
    return [Finding("W410", "info", text, {"parameters": rotors})]


def apart_findings(
    base: BaseModel, stack: Stack, theta: Floats, error: ModelError | None
) -> list[Finding]:
    """Say which joints have torques that contradict those of the others, and by which factor where it is only one.

    Args:
        base: model and base parameters.
        stack: the fitted rows.
        theta: base parameters in force, (p,).
        error: the model error in force, None without.
    """
    apart = () if error is None else error.joints_apart
    if error is None or not len(apart):
        return []
    names = [base.robot.joint_names[j] for j in apart]
    scales = {
        name: scale_of(base, stack, theta, error, int(j))
        for name, j in zip(names, apart, strict=True)
    }
    told = [
        f"{name} has {scale:.2f} times what they ask for"
        for name, scale in scales.items()
        if scale is not None
    ]
    cause = (
        "; ".join(told)
        or "another scale or sign, a part of it, a stuck reading, or what the model lacks"
    )
    text = (
        f"the torques of {', '.join(names)} contradict those of the other joints: {cause}. They have parameters of "
        "their own in predictions and no say in those of the arm"
    )
    return [Finding("W413", "warning", text, {"joints": names, "scales": scales})]


def scale_of(
    base: BaseModel, stack: Stack, theta: Floats, error: ModelError, joint: int
) -> float | None:
    """Return how many times the torque that the other joints ask for a joint has; None where it is not only a scale.

    Friction is left out: no other joint tells it.

    Args:
        base: model and base parameters.
        stack: the fitted rows.
        theta: base parameters of the arm, (p,).
        error: the model error, in which the joint is apart.
        joint: its number.
    """
    W = stack.whole[0][joint][:, :-1]
    rubs = friction(base)
    Q = np.linalg.qr(W[:, rubs & W.any(axis=0)])[0]
    asked, more = ((W[:, ~rubs] @ each[~rubs]) for each in (theta, error.own[joint]))
    asked, more = (each - Q @ (Q.T @ each) for each in (asked, more))
    scale = 1.0 + float(asked @ more) / max(float(asked @ asked), 1e-300)
    rest = np.linalg.norm(more - (scale - 1.0) * asked)
    return scale if rest < tuning.SCALE_REST * np.linalg.norm(more) else None


def physics_findings(
    base: BaseModel,
    plain: Fit,
    rms: Floats,
    knowledge: tuple[str, ...],
    error: ModelError | None,
    *,
    physical: bool,
) -> list[Finding]:
    """Say when the plain numbers belong to no arm, when no arm comes near them, and when the log says little.

    Args:
        base: model and base parameters.
        plain: the plain estimate.
        rms: residual of the physical set at each joint, (n,) [N m or N].
        knowledge: how well each parameter is known, (p,).
        error: the model error in force, None without.
        physical: whether the possible parameters are.
    """
    found = []
    open_ = sum(word == NOT_DETERMINED for word in knowledge) / len(knowledge)
    poses = random_poses(base.robot, tuning.ALARM_POSES)
    share = indefinite_share(
        lambda q, qd, qdd: base.observer.torque(plain.theta, q, qd, qdd), poses
    )
    if share:
        cause = (
            "too little motion, or a wrong sign or offset under `driver:`"
            if open_ > tuning.MANY_OPEN
            else "check sign and offset of each joint under `driver:` in the robot file"
        )
        level = "info" if physical or open_ > tuning.MANY_OPEN else "warning"
        text = f"the mass matrix of least squares is not positive definite in {100 * share:.0f} % of poses: {cause}"
        found.append(Finding("W405", level, text, {"share": share}))
    growth = rms / np.maximum(plain.rms, 1e-12)
    worst = int(np.argmax(growth))
    large = () if error is None else error.free
    apart = () if error is None else error.joints_apart
    for j in large:
        joint = base.robot.joint_names[j]
        text = (
            f"{joint} has a large torque that depends on its position and that links cannot make (a spring, a "
            "counterbalance?): the residual model predicts it, the parameters do not; dynid gap may name it"
        )
        found.append(Finding("W404", "warning", text, {"joint": joint, "growth": float(growth[j])}))
    unexplained = growth[worst] > tuning.CONTRADICTION and rms[worst] > plain.rms[worst] + 1e-6
    if unexplained and not len(large) and not len(apart):
        joint = base.robot.joint_names[worst]
        text = (
            f"physically consistent parameters fit {joint} worse than least squares: torque error {rms[worst]:.3g} "
            f"instead of {plain.rms[worst]:.3g} N m; look for a missing effect (dynid gap), units, signs, payload"
        )
        found.append(
            Finding("W404", "warning", text, {"joint": joint, "growth": float(growth[worst])})
        )
    if open_ > tuning.MANY_OPEN:
        count = f"{sum(word == NOT_DETERMINED for word in knowledge)} of {len(knowledge)} base parameters"
        plain_text = "least squares hold for motions like this one only; for others use --feasible"
        consequence = "their values come mostly from the prior" if physical else plain_text
        text = f"{count} are not determined by this log: {consequence}"
        found.append(Finding("W406", "warning", text, {"share": open_}))
    return found
