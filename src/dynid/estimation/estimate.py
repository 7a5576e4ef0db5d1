"""Estimate the base parameters of a stack and say how good they are."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from dynid.answer import picked
from dynid.arrays import Floats, Mask
from dynid.errors import (
    Finding,
    NothingChanged,
    PoorlyExcited,
    RankDeficient,
    WeakInstruments,
)
from dynid.estimation import tuning
from dynid.estimation.estimators import choose, fitted
from dynid.estimation.identified import SAME_MOTION, JointQuality, torque_units
from dynid.estimation.least_squares import (
    NOT_DETERMINED,
    Fit,
    joint_rms,
    judge,
    relative_error,
    solvable,
)
from dynid.estimation.posterior import (
    Posterior,
    contradicts,
    expected_error,
    physical_posterior,
    uncertainty,
)
from dynid.estimation.residual_model import ModelError, squares
from dynid.estimation.result import Identification
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel
from dynid.model.regressor import indefinite_share, random_poses
from dynid.signals.conditioned_log import ConditionedLog
from dynid.signals.motion import motion_numbers, sampled

#: Methods that need nothing but triangular factors, and can add a log to an earlier result.
UPDATABLE = ("wls", "ols", "ridge")


#: Rows that are fitted, rows that judge the fit, and what those are, for people.
HoldOut: TypeAlias = tuple[Stack, Stack, str]


def last_share(stack: Stack, share: float) -> HoldOut | None:
    """Hold out the last share of each log; None where all are too short.

    Args:
        stack: the stacked logs.
        share: between 0 and 1.
    """
    rows, what = stack.rows, f"last {100 * share:.0f} % of each log, {SAME_MOTION}"
    shortest = tuning.SHORTEST_SPLIT_S * stack.logs[0].filter.kept_rate
    long = np.bincount(rows.log)[rows.log] >= shortest
    return _split(stack, long & (rows.progress >= 1.0 - share), what)


def _split(stack: Stack, held: Mask, what: str) -> HoldOut | None:
    """Return rows to fit, those that judge, (M,), and what these are; None without any."""
    train, test = stack.take(~held), replace(stack.take(held), earlier=None)
    return (train, test, what) if held.any() else None


def last_motion(stack: Stack, share: float) -> HoldOut | None:
    """Hold out all logs of the last motion, or the last share of each log where all are of one motion.

    Args:
        stack: the stacked logs.
        share: of each log, between 0 and 1.
    """
    numbers = motion_numbers([log_motion(log) for log in stack.logs])
    last = [k for k, number in enumerate(numbers) if number == max(numbers)]
    held = np.isin(stack.rows.log, last)
    # Why the size: a motion that is most of the rows has to be fitted.
    if max(numbers) == 0 or stack.rows.use[held].sum() > 0.5 * stack.counts.sum():
        return last_share(stack, share)
    return _split(stack, held, f"another motion: {', '.join(stack.logs[k].name for k in last)}")


def log_motion(log: ConditionedLog) -> Floats:
    """Return the positions of a log at the rate at which motions are compared, (M, n) [rad or m]."""
    t, q = (np.concatenate([getattr(s, name) for s in log.segments]) for name in ("t", "q"))
    return sampled(t, q)


def updated(stack: Stack, earlier: Identification) -> Stack:
    """Return a stack to which what an earlier result was made from is added: recursive least squares.

    A result keeps one factor of [W tau] per joint. Factors of old and new rows merged by one more QR are the factor of
    all rows, so the parameters equal those of a fit on all logs to rounding. Single rows of the old logs are gone:
    methods that look at them cannot be used, and the memory of the old residuals is that of the old covariance.

    Args:
        stack: the new logs.
        earlier: the result.

    Raises:
        WrongUsage: the earlier result has other base parameters.
    """
    earlier.require(stack.base)
    return replace(stack, earlier=earlier.fit)


@solvable()
def estimate(
    stack: Stack,
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
        method: an estimator of ``fitted``, or ``"auto"``.
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
    base = stack.base
    prior = base.prior()
    name, why = choose(stack) if method == "auto" else (method, "as asked")
    plain = fitted(stack, name)
    if name == "iv":
        _require_followed(stack, plain)
    physical = method == "auto" if feasible is None else feasible
    used = post = physical_posterior(plain, stack, residual_model=residual_model, size=size)
    if not physical:
        none = post.changes[:, :0]
        used = replace(post, **picked(plain, "theta", "covariance"), error=None, changes=none)
    # Why: where the prior carries what the rows leave open there is an answer, and the posterior says how little.
    cost = uncertainty(base, plain.covariance, post.theta)
    excitation = excitation_findings(stack, plain, cost, drop_weak=drop_weak or physical)
    if physical:
        _require_change(prior, plain=plain.theta, physical=post.theta)
    held_rms, held_percent, held_out = np.zeros(len(stack.joints)), None, "nothing held out"
    if holdout is not None:
        train, test, held_out = holdout
        again, error = fitted(train, name), used.error
        theta = again.theta
        if physical:
            found = physical_posterior(again, train, residual_model=error is not None, like=error)
            theta, error = found.theta, found.error
        held_rms, held_percent = _errors(test, theta, error)
    rms, total = _errors(stack, used.theta, used.error)
    std_error, knowledge = _certainty(plain, used, physical=physical)
    findings = physics_findings(plain, stack, post.alone, knowledge, used.error, physical)
    apart = apart_findings(stack.joints, used.error)
    return Identification(
        **picked(base, "robot", "reduction"),
        **picked(plain.solution, "rank", "condition_number", "condition_number_scaled"),
        **picked(used, "theta", "covariance", "physical", model_error="error"),
        fit=plain,
        joints=_qualities(stack, rms, held_rms),
        relative_error_percent=total,
        heldout_relative_error_percent=held_percent,
        heldout=held_out,
        samples=stack.samples,
        expected=expected_error(stack, used, rms),
        why=why,
        std_error=std_error,
        knowledge=knowledge,
        prior=prior,
        in_force="physical" if physical else "plain",
        findings=(*excitation, *sensor_findings(base), *findings, *apart),
        motions=tuple(log_motion(log)[: tuning.MOTION_SAMPLES] for log in stack.logs),
        rigid=base.model.rigid,
        stack=stack,
    )


def _errors(stack: Stack, theta: Floats, error: ModelError | None) -> tuple[Floats, float]:
    """Return the rms residual of each joint on any rows, (n,) [N m or N], and the total relative error [%]."""
    left = squares(stack, theta, error)
    torque = max(float(np.linalg.norm(stack.factors[:, :, -1])), 1e-300)
    return np.sqrt(left / np.maximum(stack.counts, 1)), float(100.0 * np.sqrt(left.sum()) / torque)


def _qualities(stack: Stack, rms: Floats, held: Floats) -> tuple[JointQuality, ...]:
    """Return how well each joint is fitted; of one without rows that were held out, nothing is known of them."""
    torque = joint_rms(stack.factors, stack.counts, np.zeros(len(stack.names)))
    percent = 100 * rms / np.where(torque > 0, torque, np.inf)
    known = [each or None for each in held.tolist()]
    rows = zip(stack.joints, rms.tolist(), percent.tolist(), torque.tolist(), known, strict=True)
    return tuple(JointQuality(*row) for row in rows)


def _certainty(
    plain: Fit, used: Posterior | Fit, *, physical: bool
) -> tuple[Floats, tuple[str, ...]]:
    """Return standard errors and how well each parameter is known.

    Directions that the log leaves open are infinite for the plain estimate; for the physical set they are as wide as
    the prior, and not determined all the same.
    """
    std_error = np.sqrt(np.maximum(np.diag(used.covariance), 0.0))
    if not physical:
        std_error[plain.open] = np.inf
    words = np.array(judge(used.theta, std_error, plain.effect))
    return std_error, tuple(np.where(plain.open, NOT_DETERMINED, words).tolist())


def _require_change(prior: Floats, *, plain: Floats, physical: Floats) -> None:
    """Refuse a physical set that is still where its search began; a log of the prior itself moves nothing either.

    Raises:
        NothingChanged: with the number of parameters.
    """
    known = np.isfinite(prior)
    moved, moved_plain = (
        ~np.isclose(theta, prior, rtol=tuning.PRIOR_UNCHANGED, atol=1e-12)[known]
        for theta in (physical, plain)
    )
    if moved_plain.any() and not moved.any():
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
        relative_error(stack.factors, theta) for theta in (fit.theta, stack.first_fit.theta)
    )
    if contradicts(left, least):
        raise WeakInstruments(f"iv leaves {left:.3g} % of the torque, wls {least:.3g} %")


# ---------------------------------------------------------------- what logs and fits are worth, as findings
def weakly_excited(stack: Stack) -> list[Finding]:
    """Return finding W402, which names the base parameters that the logs do not determine, the worst first."""
    fit = fitted(stack, "wls")
    error, words = _certainty(fit, fit, physical=False)
    worst = np.argsort(-error / np.maximum(np.abs(fit.theta), np.finfo(float).tiny))
    weak = [stack.names[k] for k in worst if words[k] == NOT_DETERMINED]
    if not weak:
        return []
    more = len(weak) - tuning.FINDINGS_WORDED
    named = ", ".join(weak[: tuning.FINDINGS_WORDED]) + f" and {more} more" * (more > 0)
    return [Finding("W402", "warning", f"poorly excited: {named}", {"parameters": weak})]


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
        weak = np.abs(plain.solution.weak).max(axis=1)
        names = ", ".join(stack.names[k] for k in np.flatnonzero(weak > 1e-3 * weak.max()))
        text = (
            f"this log determines {rank} of {size} base parameters; it does not separate: {names}"
        )
        if not drop_weak:
            fix = "record a motion in which every joint moves on its own, or continue with --drop-weak"
            raise RankDeficient(text, fix=fix)
        return (Finding("W403", "warning", text, {"rank": rank, "structural_rank": size}),)
    if cost <= tuning.POORLY_EXCITED_PERCENT:
        return ()
    condition = plain.solution.condition_number_scaled
    text = (
        f"this log determines some parameters badly: least squares would have a torque error of {cost:.3g} % on "
        f"an exciting motion; condition number {condition:.0f} (good: below 100)"
    )
    if not drop_weak:
        fix = (
            "plan a better motion: dynid trajectory ROBOT --optimise; or continue with --drop-weak"
        )
        raise PoorlyExcited(text, fix=fix)
    evidence = {"expected_percent": cost, "condition_number_scaled": condition}
    return (Finding("W402", "warning", text, evidence),)


def sensor_findings(base: BaseModel) -> Iterator[Finding]:
    """Say what a torque sensor between gear and link cannot see."""
    parameters = zip(base.names, base.reduction.base, strict=True)
    rotors = [name for name, k in parameters if base.model.parameters[k].kind == "Im"]
    source, named = base.robot.torque.source, ", ".join(rotors)
    if source not in ("joint_sensor", "unknown") or not rotors:
        return
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
    yield Finding("W410", "info", text, {"parameters": rotors})


def apart_findings(joints: Sequence[str], error: ModelError | None) -> Iterator[Finding]:
    """Say which joints have torques that contradict those of the others, of the model error in force."""
    if error is None or not error.apart.any():
        return
    names = [joints[j] for j in error.joints_apart]
    text = (
        f"the torques of {', '.join(names)} contradict those of the other joints: another scale or sign, a part of "
        "it, a stuck reading, or what the model lacks. They have parameters of their own in predictions and no say in "
        "those of the arm"
    )
    yield Finding("W413", "warning", text, {"joints": names})


def physics_findings(
    plain: Fit,
    stack: Stack,
    alone: Floats,
    knowledge: tuple[str, ...],
    error: ModelError | None,
    physical: bool,
) -> Iterator[Finding]:
    """Say when the plain numbers belong to no arm, when no arm comes near them, and when the log says little.

    Args:
        plain: the plain estimate.
        stack: the fitted rows.
        alone: the best possible parameters without a residual model, (p,).
        knowledge: how well each parameter is known, (p,).
        error: the model error in force, None without.
        physical: whether the possible parameters are.
    """
    base, count = stack.base, knowledge.count(NOT_DETERMINED)
    many_open = count / len(knowledge) > tuning.MANY_OPEN
    poses = random_poses(base.robot, tuning.ALARM_POSES)
    share = indefinite_share(
        lambda q, qd, qdd: base.observer.torque(plain.theta, q, qd, qdd), poses
    )
    if share:
        level = "info" if physical or many_open else "warning"
        text = (
            f"the mass matrix of least squares is not positive definite in {100 * share:.0f} % of poses: too little "
            "motion, or a wrong sign or offset of a joint under `driver:` in the robot file"
        )
        yield Finding("W405", level, text, {"share": share})
    yield from unexplained(base, plain, joint_rms(stack.factors, stack.counts, alone), error)
    if many_open:
        consequence = (
            "their values come mostly from the prior"
            if physical
            else "least squares hold for motions like this one only; for others use --feasible"
        )
        text = (
            f"{count} of {len(knowledge)} base parameters are not determined by this log: "
            f"{consequence}"
        )
        yield Finding("W406", "warning", text, {"share": count / len(knowledge)})


def unexplained(
    base: BaseModel, plain: Fit, rms: Floats, error: ModelError | None
) -> Iterator[Finding]:
    """Say which joints have torques that no possible parameters make, whose residual is rms, (n,) [N m or N]."""
    growth, texts = rms / np.maximum(plain.rms, 1e-12), {}
    worst = int(np.argmax(growth))
    if error is not None and len(error.free):
        texts = dict.fromkeys(
            error.free.tolist(),
            "{} has a large torque that depends on its position and that links cannot make (a spring, a "
            "counterbalance?): the residual model predicts it, the parameters do not; dynid gap may name it",
        )
    elif contradicts(rms[worst], plain.rms[worst]) and (error is None or not error.apart.any()):
        unit, size = torque_units(base.robot)[worst], base.robot.shown_gains[worst]
        left, least = rms[worst] / size, plain.rms[worst] / size
        texts[worst] = (
            f"physically consistent parameters fit {{}} worse than least squares: torque error {left:.3g} "
            f"instead of {least:.3g} {unit}; look for a missing effect (dynid gap), units, signs, payload"
        )
    for j, text in texts.items():
        joint = base.robot.joint_names[j]
        facts = {"joint": joint, "growth": float(growth[j])}
        yield Finding("W404", "warning", text.format(joint), facts)
