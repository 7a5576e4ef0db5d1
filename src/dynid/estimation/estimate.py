"""Estimate the base parameters of a stack and say how good they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NothingChanged, WrongUsage
from dynid.estimation import tuning
from dynid.estimation.covariance import NOT_DETERMINED, judge
from dynid.estimation.estimators import METHODS, choose
from dynid.estimation.findings import excitation_findings, physics_findings, sensor_findings
from dynid.estimation.least_squares import Fit, joint_rms, nonnegative, relative_error, solvable
from dynid.estimation.posterior import (
    ExpectedError,
    Posterior,
    contradicts,
    expected_error,
    physical_posterior,
    uncertainty,
)
from dynid.estimation.residual_model import ModelError, squares
from dynid.estimation.result import Identification, JointQuality, Quality
from dynid.estimation.stack import Earlier, Stack
from dynid.longarrays import joined
from dynid.model.base_model import BaseModel
from dynid.model.parameters import prior_base_parameters
from dynid.robot import Controller
from dynid.signals.conditioned_log import ConditionedLog
from dynid.signals.motion import motion_numbers, sampled

Floats = NDArray[np.float64]

#: Kinds of parameters that no real arm has with a minus sign.
POSITIVE = ("m", "Im", "Imc", "fv", "fvc", "fc", "fcc")
#: Names of the parameter sets, by whether a set is physically possible.
SETS = {True: "physical", False: "plain"}
#: What a share of a fitted log is, compared with its other rows: no proof for another motion.
SAME_MOTION = "the same motion"
#: Methods that need nothing but triangular factors, and can add a log to an earlier result.
UPDATABLE = ("wls", "ols", "ridge")


@dataclass(frozen=True)
class HoldOut:
    """Rows that are kept back to judge the fit.

    Attributes:
        train: the rows that are fitted.
        test: the rows that judge.
        text: what they are, for people.
    """

    train: Stack
    test: Stack
    text: str


def last_share(stack: Stack, share: float) -> HoldOut:
    """Hold out the last share of each log, in whole blocks of time.

    Args:
        stack: the stacked logs.
        share: between 0 and 1.
    """
    train, judged = np.zeros(stack.blocks, dtype=bool), np.zeros(stack.blocks, dtype=bool)
    for log in sorted(set(stack.log_of_block.tolist())):
        blocks = np.flatnonzero(stack.log_of_block == log)
        if log < 0:
            train[blocks] = True
            continue
        cut = len(blocks) - max(1, round(share * len(blocks)))
        train[blocks[: max(1, cut)]] = True
        judged[blocks[cut:]] = True
    return HoldOut(stack.select(train), stack.select(judged), f"last {100 * share:.0f} % of each log, {SAME_MOTION}")


def last_motion(stack: Stack, share: float) -> HoldOut:
    """Hold out all logs of the last motion, or the last share of each log where all are of one motion.

    Args:
        stack: the stacked logs.
        share: of each log, between 0 and 1.
    """
    numbers = motion_numbers([log_motion(log) for log in stack.logs])
    last = [k for k, number in enumerate(numbers) if number == max(numbers)]
    judged = np.isin(stack.log_of_block, last)
    # Why the size: a motion that is most of the rows has to be fitted.
    if max(numbers, default=0) == 0 or stack.counts[judged].sum() > 0.5 * stack.counts.sum():
        return last_share(stack, share)
    names = ", ".join(stack.logs[k].name for k in last)
    return HoldOut(stack.select(~judged), stack.select(judged), f"another motion: {names}")


def log_motion(log: ConditionedLog) -> Floats:
    """Return the positions of a log at the rate at which motions are compared, (M, n) [rad or m]."""
    t, q = (joined(getattr(segment, name) for segment in log.segments) for name in ("t", "q"))
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
            f"{earlier.label} has other base parameters than this log's model",
            fix="identify both with the same robot file",
        )
    if not earlier.factors.size:
        raise WrongUsage(f"{earlier.label} holds no triangular factors", fix="identify the earlier log again")
    return Stack(
        base=base,
        factors=earlier.factors[None],
        counts=earlier.counts[None],
        log_of_block=np.full(1, -1),
        block=np.zeros(1, dtype=np.int64),
        rows=(),
        earlier=Earlier(earlier.factors, earlier.noise, earlier.plain_covariance),
    )


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
        feasible: put the physically possible set in force, or the plain estimate; None takes the physical one unless
            the data contradict every possible arm.
        residual_model: describe what the model lacks by random columns; None where the evidence wants it.
        size: sizes of the groups of these columns where they are known already.

    Raises:
        RankDeficient: the logs determine fewer base parameters than the structure has.
        PoorlyExcited: they determine all, but some only through what is left of noise.
        NothingChanged: the physical set in force is the prior although the torques say otherwise.
    """
    prior = prior_base_parameters(base.model, base.reduction)
    name, why = choose(stack) if method == "auto" else (method, "as asked")
    plain = METHODS[name](stack, prior, controller_of(base))
    post = physical_posterior(base, plain, stack, residual_model=residual_model, size=size)
    sets = _sets(base, plain, post)

    @cache
    def judged(key: str) -> tuple[Floats, float, ExpectedError]:
        theta, covariance, error = sets[key]
        rms, total = _of_squares(stack, squares(stack, theta, error))
        return rms, total, expected_error(base, stack, theta, covariance, error, rms)

    in_force, choice = SETS[bool(feasible)], "as asked"
    if feasible is None:
        in_force, choice = _in_force(stack, method, plain, post, judged)
    physical = in_force == "physical"
    # Why: where the prior carries what the rows leave open there is an answer, and the posterior says how little.
    cost = uncertainty(base, stack.observer, plain.covariance, post.theta)
    excitation = excitation_findings(stack, plain, cost, drop_weak=drop_weak or physical)
    if physical:
        _require_change(prior, plain=plain.theta, physical=post.theta)
    held = {} if holdout is None else _held_out(base, holdout, prior, name, post)
    theta, covariance, error = sets[in_force]
    unseen = held.get(in_force)
    rms, total, expected = judged(in_force)
    std_error, knowledge = _certainty(plain, theta, covariance, physical=physical)
    return Identification(
        robot=base.robot,
        reduction=base.reduction,
        fit=plain,
        quality=Quality(
            joints=_qualities(stack, rms, None if unseen is None else unseen[0]),
            relative_error_percent=total,
            heldout_relative_error_percent=None if unseen is None else unseen[1],
            heldout=holdout.text if holdout else "nothing held out",
            heldout_by_set={key: value[1] for key, value in held.items()},
            rank=plain.solution.rank,
            condition_number=plain.solution.condition_number,
            condition_number_scaled=plain.solution.condition_number_scaled,
            samples=stack.samples,
            expected=expected,
        ),
        why=why,
        theta=theta,
        covariance=covariance,
        std_error=std_error,
        knowledge=knowledge,
        prior=prior,
        physical=post.physical,
        in_force=in_force,
        choice=choice,
        model_error=error,
        findings=(
            *excitation,
            *sensor_findings(base),
            *physics_findings(
                base, stack.observer, plain, joint_rms(*stack.whole, post.alone), knowledge, in_force, error
            ),
        ),
        header=_header(base, stack),
        motions=tuple(log_motion(log)[: tuning.MOTION_SAMPLES] for log in stack.logs),
        rigid=base.model.rigid,
        stack=stack,
    )


def _header(base: BaseModel, stack: Stack) -> dict[str, Any]:
    """Return where a result comes from, for its file."""
    header = {
        "robot": base.robot.name,
        "key": base.robot.model_key,
        "log_sha256": [log.sha256 for log in stack.logs],
        "logs": [log.path or log.name for log in stack.logs],
        "log_findings": [asdict(finding) for log in stack.logs for finding in log.findings],
    }
    first = stack.logs[0] if stack.logs else None
    return header if first is None else {**header, "cutoff_hz": first.filter.cutoff, "delay_applied_s": first.delay}


def _of_squares(stack: Stack, left: Floats) -> tuple[Floats, float]:
    """Return the rms residual of each joint, (n,) [N m or N], and the total relative error [%], from squared sums."""
    factors, counts = stack.whole
    torque = max(float(np.linalg.norm(factors[:, :, -1])), 1e-300)
    return np.sqrt(left / np.maximum(counts, 1)), float(100.0 * np.sqrt(left.sum()) / torque)


def _sets(base: BaseModel, plain: Fit, post: Posterior) -> dict[str, tuple[Floats, Floats, ModelError | None]]:
    """Return base parameters (p,), their covariance (p, p) and the model error of both sets.

    No drive has negative friction or rotor inertia, whatever a log of one motion says, so the plain set that may be in
    force has none either.
    """
    table, reduction = base.model.parameters, base.reduction
    alone = [len(reduction.terms(i)) == 1 and table[k].kind in POSITIVE for i, k in enumerate(reduction.base)]
    theta = plain.theta
    if plain.solution.rank == len(theta):
        theta = nonnegative(plain.whitened, theta, np.array(alone, dtype=bool))
    return {"plain": (theta, plain.covariance, None), "physical": (post.theta, post.covariance, post.error)}


def _held_out(
    base: BaseModel, holdout: HoldOut, prior: Floats, method: str, post: Posterior
) -> dict[str, tuple[Floats, float]]:
    """Return the errors of each set on the held-out rows, fitted without them."""
    fit = METHODS[method](holdout.train, prior, controller_of(base), corrected=False)
    again = physical_posterior(base, fit, holdout.train, residual_model=post.error is not None, like=post.error)
    sets = _sets(base, fit, again)
    return {
        key: _of_squares(holdout.test, squares(holdout.test, theta, error)) for key, (theta, _, error) in sets.items()
    }


def _qualities(stack: Stack, rms: Floats, held: Floats | None) -> tuple[JointQuality, ...]:
    factors, counts = stack.whole
    size = np.sqrt(np.sum(factors[:, :, -1] ** 2, axis=1))
    return tuple(
        JointQuality(
            joint=joint,
            rms=float(rms[j]),
            relative_percent=float(100.0 * rms[j] * np.sqrt(counts[j]) / size[j]) if size[j] else 0.0,
            torque_rms=float(size[j] / np.sqrt(max(1, counts[j]))),
            heldout_rms=None if held is None else float(held[j]),
        )
        for j, joint in enumerate(stack.joints)
    )


def _certainty(plain: Fit, theta: Floats, covariance: Floats, *, physical: bool) -> tuple[Floats, tuple[str, ...]]:
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
        raise NothingChanged(f"nothing changed: the physical set equals the prior in {count} of {count} parameters")


def _in_force(
    stack: Stack, method: str, plain: Fit, post: Posterior, judged: Callable[[str], tuple[Floats, float, ExpectedError]]
) -> tuple[str, str]:
    """Decide which parameters are in force, and say why.

    The plain estimate describes the motion that it was fitted to best, and other motions badly; only where no possible
    arm comes near the data, and the log determines all parameters well, is something missing that it holds better.
    """
    if method != "auto":
        return "plain", "the estimator was chosen with --method"
    misfit, best = (relative_error(stack.whole[0], theta) for theta in (post.alone, plain.theta))
    explains = "a physically possible arm explains the torques"
    if post.error is not None and post.error.free.size:
        misfit = judged("physical")[1]
        names = ", ".join(stack.joints[j] for j in post.error.free)
        explains = (
            f"a physically possible arm explains all but a large torque of the position of {names}: try dynid gap"
        )
    figures = f"torque error {misfit:.2f} %, plain estimate {best:.2f} %"
    if not contradicts(misfit, best):
        return "physical", f"{explains} ({figures})"
    # Why: few rows that many parameters were fitted to contradict nothing.
    if plain.solution.condition_number_scaled > tuning.LARGE_CONDITION:
        return "physical", f"the log does not determine the plain estimate ({figures})"
    missing = f"no physically possible arm explains the torques ({figures}), so something is missing: try dynid gap"
    expected = {key: judged(key)[2].exciting_percent for key in SETS.values()}
    if expected["physical"] < tuning.CLEARLY_BETTER * expected["plain"]:
        return "physical", f"{missing}; on other motions the physical parameters should still be better"
    return "plain", missing


def controller_of(base: BaseModel) -> Controller | None:
    """Return the robot's controller where the base parameters are those of the whole arm that it moves."""
    return None if base.robot.links else base.robot.controller
