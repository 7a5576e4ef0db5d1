"""Estimate the base parameters of a stack and say how good they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, RankDeficient
from dynid.identify.least_squares import Fit, joint_rms, ordinary, relative_error, weighted
from dynid.identify.result import Identification, JointQuality
from dynid.identify.stack import Stack
from dynid.identify.uncertainty import Knowledge, automatic_lags, judge, long_run_variance, sandwich, scores
from dynid.model.prior import prior_parameters
from dynid.model.store import BaseModel

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

METHODS: dict[str, Callable[[Floats, NDArray[np.int64]], Fit]] = {"ols": ordinary, "wls": weighted}
#: Beyond this condition number with normalised columns, a percent of noise becomes tens of percent of parameter.
LARGE_CONDITION = 1000.0


@dataclass(frozen=True)
class HoldOut:
    """Rows that are kept back to judge the fit.

    Attributes:
        train: blocks of the training stack that are fitted, (B,).
        test: the stack that is judged on.
        judged: blocks of it that count, (B',).
        text: what it is, for people.
    """

    train: Mask
    test: Stack
    judged: Mask
    text: str


def last_share(stack: Stack, share: float) -> HoldOut:
    """Hold out the last share of each log; one block of time between the parts belongs to neither.

    Args:
        stack: the stacked logs.
        share: between 0 and 1.
    """
    train, judged = np.zeros(stack.blocks, dtype=bool), np.zeros(stack.blocks, dtype=bool)
    for log in np.unique(stack.logs):
        blocks = np.flatnonzero(stack.logs == log)
        cut = len(blocks) - max(1, round(share * len(blocks)))
        train[blocks[: max(1, cut)]] = True
        judged[blocks[cut:]] = True
    return HoldOut(train, stack, judged, f"last {100 * share:.0f} % of each log")


def estimate(
    stack: Stack, base: BaseModel, *, method: str, holdout: HoldOut | None, drop_weak: bool = False
) -> Identification:
    """Fit the base parameters, with honest errors and a held-out figure.

    The parameters come from all rows; the held-out figure comes from a second fit without the rows that are held out.

    Args:
        stack: the stacked logs.
        base: model and base parameters.
        method: ``"ols"`` or ``"wls"``.
        holdout: what is held out, None for nothing.
        drop_weak: go on when the logs do not determine all base parameters.

    Raises:
        RankDeficient: the logs determine fewer base parameters than the structure has.
    """
    factors, rows = stack.whole
    fit = METHODS[method](factors, rows)
    findings = _excitation_findings(stack, fit, drop_weak)
    covariance = _covariance(stack, fit, rows)
    std_error = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    open_ = np.abs(fit.solution.weak).max(axis=1, initial=0.0) > 1e-9
    std_error[open_] = np.inf
    size = np.sqrt(np.sum(factors[:, :, -1] ** 2, axis=1))
    norm = np.linalg.norm(factors @ np.append(fit.theta, -1.0), axis=1)
    held = _held_out(stack, holdout, method)
    effect = np.linalg.norm(fit.whitened[:, :-1], axis=0) / np.sqrt(max(1, rows.sum()))
    knowledge = judge(fit.theta, std_error, effect)
    joints = tuple(
        JointQuality(
            joint=joint,
            rms=float(fit.rms[j]),
            relative_percent=float(100.0 * norm[j] / size[j]) if size[j] else 0.0,
            torque_rms=float(size[j] / np.sqrt(max(1, rows[j]))),
            heldout_rms=None if held is None else float(held[0][j]),
        )
        for j, joint in enumerate(stack.joints)
    )
    return Identification(
        method=method,
        names=stack.names,
        theta=fit.theta,
        covariance=covariance,
        std_error=std_error,
        knowledge=tuple(
            k.value if not o else Knowledge.NOT_DETERMINED.value for k, o in zip(knowledge, open_, strict=True)
        ),
        prior=prior_base(base),
        noise=fit.noise,
        joints=joints,
        relative_error_percent=relative_error(factors, fit.theta),
        heldout_relative_error_percent=None if held is None else held[1],
        heldout=holdout.text if holdout else "nothing held out",
        rank=fit.solution.rank,
        condition_number=fit.solution.condition_number,
        condition_number_scaled=fit.solution.condition_number_scaled,
        samples=stack.samples,
        findings=findings,
    )


def _excitation_findings(stack: Stack, fit: Fit, drop_weak: bool) -> tuple[Finding, ...]:
    rank, size = fit.solution.rank, len(fit.theta)
    if rank < size:
        open_ = np.abs(fit.solution.weak).max(axis=1)
        names = ", ".join(stack.names[k] for k in np.flatnonzero(open_ > 1e-3 * open_.max()))
        text = f"this log determines {rank} of {size} base parameters; it cannot tell apart: {names}"
        if not drop_weak:
            raise RankDeficient(
                text, fix="record a motion in which every joint moves on its own, or continue with --drop-weak"
            )
        return (Finding("W403", "warning", text, {"rank": rank, "structural_rank": size}),)
    condition = fit.solution.condition_number_scaled
    if condition > LARGE_CONDITION:
        text = f"condition number {condition:.0f} (good: below 100): plan a motion that tells more: dynid trajectory"
        return (Finding("W402", "warning", text, {"condition_number_scaled": condition}),)
    return ()


def _covariance(stack: Stack, fit: Fit, rows: NDArray[np.int64]) -> Floats:
    """Return the covariance that stands for residuals that are alike over a good part of a second (Newey-West)."""
    if stack.observer is None:
        return fit.covariance
    series: list[Floats] = []
    for number in range(len(stack.sources)):
        for part in stack.rows_of_log(number):
            residual = np.where(part.usable, part.tau - part.W @ fit.theta, 0.0)
            score = scores(part.W, residual, fit.noise)
            if part.starts_segment or not series:
                series.append(score)
            else:
                series[-1] = np.concatenate([series[-1], score])
    scale = np.sqrt(np.diag(fit.covariance))
    scaled = [one * scale for one in series]
    return sandwich(fit.covariance, long_run_variance(series, automatic_lags(scaled)), int(rows.sum()))


def _held_out(stack: Stack, holdout: HoldOut | None, method: str) -> tuple[Floats, float] | None:
    if holdout is None:
        return None
    theta = METHODS[method](*stack.joint_factors(holdout.train)).theta
    factors, rows = holdout.test.joint_factors(holdout.judged)
    return joint_rms(factors, rows, theta), relative_error(factors, theta)


def prior_base(base: BaseModel) -> Floats:
    """Return the base parameters of the prior bodies, NaN where the prior says nothing (friction), (p,).

    Rotor inertias are not in the prior; they count as zero in a combination and as unknown alone.
    """
    names, reduction = base.reduction.names, base.reduction
    links = prior_parameters(base.robot).reshape(-1, 10)
    gamma = np.full(len(names), np.nan)
    for k, column in enumerate(base.model.link_columns):
        link, p = divmod(int(column), 11)
        gamma[k] = links[link, p] if p < 10 else 0.0
    values = reduction.K @ np.nan_to_num(gamma)
    alone_unknown = [
        np.isnan(gamma[b]) or (names[b].startswith("Im") and len(reduction.terms(i)) == 1)
        for i, b in enumerate(reduction.base)
    ]
    return np.where(alone_unknown, np.nan, values)
