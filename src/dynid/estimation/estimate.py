"""Estimate the base parameters of a stack and say how good they are."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NothingChanged, WrongUsage
from dynid.estimation.covariance import NOT_DETERMINED, judge
from dynid.estimation.estimators import METHODS, choose
from dynid.estimation.findings import excitation_findings, physics_findings, sensor_findings
from dynid.estimation.least_squares import Fit, joint_rms, relative_error
from dynid.estimation.physical_parameters import PhysicalParameters, physical_parameters
from dynid.estimation.result import Identification, JointQuality
from dynid.estimation.stack import Earlier, Stack
from dynid.model.base_model import BaseModel
from dynid.model.prior import prior_base_parameters
from dynid.robot import Controller

Floats = NDArray[np.float64]

#: A parameter that differs from its prior by less than this share has not moved.
UNCHANGED = 1e-9
#: A physical set may be this much worse on held-out rows and still be preferred: it can be simulated and extrapolates.
NEARLY_AS_GOOD = 1.05
#: Names of the parameter sets, by whether a set is physically possible.
SETS = {True: "physical", False: "plain"}
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
    for log in np.unique(stack.log_of_block):
        blocks = np.flatnonzero(stack.log_of_block == log)
        if log < 0:
            train[blocks] = True
            continue
        cut = len(blocks) - max(1, round(share * len(blocks)))
        train[blocks[: max(1, cut)]] = True
        judged[blocks[cut:]] = True
    return HoldOut(stack.select(train), stack.select(judged), f"last {100 * share:.0f} % of each log")


def with_earlier(stack: Stack, earlier: Identification) -> Stack:
    """Return a stack of new logs that also holds what an earlier result was made from: recursive least squares.

    A result keeps one factor of [W tau] per joint. Factors of old and new rows merged by one more QR are the factor of
    all rows, so the parameters equal those of a fit on all logs to rounding. Single rows of the old logs are gone:
    methods that look at them cannot be used, and the memory of the old residuals is that of the old covariance.

    Args:
        stack: the new logs.
        earlier: a result with the same base parameters.

    Raises:
        WrongUsage: the earlier result has other base parameters, or keeps no factors.
    """
    if earlier.names != stack.names:
        raise WrongUsage(
            f"{earlier.label} has other base parameters than this log's model",
            fix="identify both with the same robot file",
        )
    if not earlier.factors.size:
        raise WrongUsage(f"{earlier.label} holds no triangular factors", fix="identify the earlier log again")
    return replace(
        stack,
        factors=np.concatenate([earlier.factors[None], stack.factors]),
        counts=np.concatenate([earlier.counts[None], stack.counts]),
        log_of_block=np.concatenate([[-1], stack.log_of_block]),
        block=np.concatenate([[0], stack.block]),
        earlier=Earlier(earlier.factors, earlier.noise, earlier.covariance),
    )


def estimate(
    stack: Stack,
    base: BaseModel,
    *,
    method: str = "auto",
    holdout: HoldOut | None,
    drop_weak: bool = False,
    feasible: bool | None = None,
) -> Identification:
    """Fit the base parameters, with robust error bars and a held-out figure.

    The parameters come from all rows; the held-out figure comes from a second fit without the rows that are held out.

    Args:
        stack: the stacked logs.
        base: model and base parameters.
        method: a name in ``METHODS``, or ``"auto"``.
        holdout: what is held out, None for nothing.
        drop_weak: go on when the logs do not determine all base parameters.
        feasible: put the physically possible set in force, or the plain estimate; None to decide by what is there.

    Raises:
        RankDeficient: the logs determine fewer base parameters than the structure has.
        PoorlyExcited: they determine all, but some only through what is left of noise.
        NothingChanged: the physical set in force is the prior although the torques say otherwise.
    """
    prior = prior_base_parameters(base.model, base.reduction)
    name, why = choose(stack) if method == "auto" else (method, "as asked")
    plain = METHODS[name](stack, prior, controller_of(base))
    excitation = excitation_findings(stack, plain, drop_weak=drop_weak)
    physical, sets = _sets(base, plain)
    held = {} if holdout is None else _held_out(base, holdout, prior, name)
    in_force, choice = _in_force(base, method, held) if feasible is None else (SETS[feasible], "as asked")
    if in_force == "physical":
        _require_change(prior, **sets)
    theta, judged = sets[in_force], held.get(in_force)
    rms, total = errors(stack, theta)
    std_error, knowledge = _certainty(plain, theta)
    return Identification(
        robot=base.robot,
        reduction=base.reduction,
        method=name,
        why=why,
        theta=theta,
        plain=plain.theta,
        covariance=plain.covariance,
        std_error=std_error,
        knowledge=knowledge,
        prior=prior,
        noise=plain.noise,
        joints=_qualities(stack, rms, None if judged is None else judged[0]),
        relative_error_percent=total,
        heldout_relative_error_percent=None if judged is None else judged[1],
        heldout_by_set={key: value[1] for key, value in held.items()},
        heldout=holdout.text if holdout else "nothing held out",
        rank=plain.solution.rank,
        condition_number=plain.solution.condition_number,
        condition_number_scaled=plain.solution.condition_number_scaled,
        samples=stack.samples,
        physical=physical,
        in_force=in_force,
        choice=choice,
        factors=plain.factors,
        counts=plain.counts,
        findings=(
            *excitation,
            *sensor_findings(base),
            *physics_findings(base, plain, errors(stack, sets["physical"])[0], knowledge, in_force),
        ),
        cutoff=stack.logs[0].filter.cutoff if stack.logs else 0.0,
        delay=stack.logs[0].delay if stack.logs else 0.0,
        log_sha256=tuple(log.sha256 for log in stack.logs),
        header={
            "robot": base.robot.name,
            "key": base.robot.model_key,
            "logs": [log.path or log.name for log in stack.logs],
            "log_findings": [asdict(finding) for log in stack.logs for finding in log.findings],
        },
        rigid=base.model.rigid,
        stack=stack,
    )


def errors(stack: Stack, theta: Floats) -> tuple[Floats, float]:
    """Return the rms residual of each joint, (n,) [N m or N], and the total relative error of base parameters [%].

    Args:
        stack: the rows that judge.
        theta: base parameters, (p,).
    """
    factors, counts = stack.whole
    return joint_rms(factors, counts, theta), relative_error(factors, theta)


def _sets(base: BaseModel, plain: Fit) -> tuple[PhysicalParameters, dict[str, Floats]]:
    """Return the physical parameters beside a fit, and the base parameters that either set stands for, (p,)."""
    physical = physical_parameters(base, plain)
    return physical, {"plain": plain.theta, "physical": base.reduction.K @ physical.x}


def _held_out(base: BaseModel, holdout: HoldOut, prior: Floats, method: str) -> dict[str, tuple[Floats, float]]:
    """Return the errors of each set on the held-out rows, fitted without them."""
    sets = _sets(base, METHODS[method](holdout.train, prior, controller_of(base)))[1]
    return {key: errors(holdout.test, theta) for key, theta in sets.items()}


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


def _certainty(plain: Fit, theta: Floats) -> tuple[Floats, tuple[str, ...]]:
    """Return standard errors and how well each parameter is known; directions that the log leaves open are infinite.

    A prior may be wrong, so as far as it has moved a parameter away from the plain estimate, as far it may err: the
    mean square error of a shrunken estimate is its variance and its bias squared.
    """
    std_error = np.sqrt(np.maximum(np.diag(plain.covariance), 0.0) + (theta - plain.theta) ** 2)
    open_ = np.abs(plain.solution.weak).max(axis=1, initial=0.0) > 1e-9
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
        return np.asarray(np.isclose(theta, prior, rtol=UNCHANGED, atol=1e-12)[known])

    if known.any() and same(physical).all() and not same(plain).all():
        count = int(known.sum())
        raise NothingChanged(f"nothing changed: the physical set equals the prior in {count} of {count} parameters")


def _in_force(base: BaseModel, method: str, held: dict[str, tuple[Floats, float]]) -> tuple[str, str]:
    """Decide which parameters are in force, and say why.

    A table of link inertias is knowledge, and a log of one motion must not overrule it. Cylinders are only a shape:
    they rescue a poor log, but a good one knows better; rows that were not fitted decide.
    """
    if method != "auto":
        return "plain", "the estimator was chosen by hand"
    if base.robot.prior is not None and base.robot.prior.links:
        return "physical", "the robot file has a table of link inertias as prior"
    if not held:
        return "physical", "nothing was held out to compare with"
    plain, physical = held["plain"][1], held["physical"][1]
    figures = f"held-out error {physical:.2f} % against {plain:.2f} %"
    if physical <= NEARLY_AS_GOOD * plain:
        return "physical", f"it predicts the held-out rows at least nearly as well as the plain estimate ({figures})"
    return "plain", f"the physical set predicts the held-out rows worse ({figures})"


def controller_of(base: BaseModel) -> Controller | None:
    """Return the robot's controller where the base parameters are those of the whole arm that it moves."""
    return None if base.robot.links else base.robot.controller
