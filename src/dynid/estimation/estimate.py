"""Estimate the base parameters of a stack and say how good they are."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, NothingChanged, PoorlyExcited, RankDeficient, WrongUsage
from dynid.estimation.covariance import NOT_DETERMINED, judge
from dynid.estimation.estimators import METHODS, choose
from dynid.estimation.least_squares import Fit, joint_rms, relative_error
from dynid.estimation.physical_parameters import physical_parameters
from dynid.estimation.result import Identification, JointQuality
from dynid.estimation.stack import Earlier, Stack
from dynid.model.base_model import BaseModel
from dynid.model.mass_matrix import random_poses, sign_alarm
from dynid.model.prior import prior_base_parameters
from dynid.robot import Controller

Floats = NDArray[np.float64]

#: Beyond this condition number with normalised columns, a percent of noise becomes tens of percent of parameter.
LARGE_CONDITION = 1000.0
#: A parameter that differs from its prior by less than this share has not moved.
UNCHANGED = 1e-9
#: A physical set that explains the torques worse than the plain fit by more than this factor contradicts the data.
CONTRADICTION = 1.5
#: A physical set may be this much worse on held-out rows and still be preferred: it can be simulated and extrapolates.
NEARLY_AS_GOOD = 1.05
#: Share of open parameters beyond which a log is called poor.
MANY_OPEN = 0.2
#: Methods that need nothing but triangular factors, and can add a log to an earlier result.
UPDATABLE = ("wls", "ols", "ridge")
#: Poses in which the mass matrix is tested.
POSES = 500


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
    """Fit the base parameters, with honest errors and a held-out figure.

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
    plain = replace(METHODS[name](stack, prior, controller_of(base)), why=why)
    findings = _excitation_findings(stack, plain, drop_weak)
    physical = physical_parameters(base, plain)
    possible = base.reduction.K @ physical.x
    held = {} if holdout is None else _held_out(base, holdout, name, prior)
    if feasible is None:
        feasible, choice = _physical_wins(base, method, held)
    else:
        choice = "as asked"
    if feasible:
        _require_change(prior, plain.theta, possible)
    theta = possible if feasible else plain.theta
    factors, rows = stack.whole
    rms = joint_rms(factors, rows, theta)
    size = np.sqrt(np.sum(factors[:, :, -1] ** 2, axis=1))
    judged = held.get("physical" if feasible else "plain")
    std_error, knowledge = _certainty(plain, theta, rows)
    joints = tuple(
        JointQuality(
            joint=joint,
            rms=float(rms[j]),
            relative_percent=float(100.0 * rms[j] * np.sqrt(rows[j]) / size[j]) if size[j] else 0.0,
            torque_rms=float(size[j] / np.sqrt(max(1, rows[j]))),
            heldout_rms=None if judged is None else float(judged[0][j]),
        )
        for j, joint in enumerate(stack.joints)
    )
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
        joints=joints,
        relative_error_percent=relative_error(factors, theta),
        heldout_relative_error_percent=None if judged is None else judged[1],
        heldout_by_set={key: value[1] for key, value in held.items()},
        heldout=holdout.text if holdout else "nothing held out",
        rank=plain.solution.rank,
        condition_number=plain.solution.condition_number,
        condition_number_scaled=plain.solution.condition_number_scaled,
        samples=stack.samples,
        physical=physical,
        in_force="physical" if feasible else "plain",
        choice=choice,
        factors=factors,
        counts=rows,
        findings=(
            *findings,
            *_sensor_findings(base),
            *_physics_findings(base, plain, joint_rms(factors, rows, possible), knowledge, feasible),
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


def _certainty(plain: Fit, theta: Floats, rows: NDArray[np.int64]) -> tuple[Floats, tuple[str, ...]]:
    """Return standard errors and how well each parameter is known; directions that the log leaves open are infinite.

    A prior may be wrong, so as far as it has pulled a parameter away from the plain estimate, as far it may err: the
    mean square error of a shrunken estimate is its variance and its bias squared.
    """
    std_error = np.sqrt(np.maximum(np.diag(plain.covariance), 0.0) + (theta - plain.theta) ** 2)
    open_ = np.abs(plain.solution.weak).max(axis=1, initial=0.0) > 1e-9
    std_error[open_] = np.inf
    effect = np.linalg.norm(plain.whitened[:, :-1], axis=0) / np.sqrt(max(1, rows.sum()))
    judged = judge(theta, std_error, effect)
    words = (NOT_DETERMINED if o else word for word, o in zip(judged, open_, strict=True))
    return std_error, tuple(words)


def _excitation_findings(stack: Stack, plain: Fit, drop_weak: bool) -> tuple[Finding, ...]:
    rank, size = plain.solution.rank, len(plain.theta)
    if rank < size:
        open_ = np.abs(plain.solution.weak).max(axis=1)
        names = ", ".join(stack.names[k] for k in np.flatnonzero(open_ > 1e-3 * open_.max()))
        text = f"this log determines {rank} of {size} base parameters; it cannot tell apart: {names}"
        if not drop_weak:
            fix = "record a motion in which every joint moves on its own, or continue with --drop-weak"
            raise RankDeficient(text, fix=fix)
        return (Finding("W403", "warning", text, {"rank": rank, "structural_rank": size}),)
    condition = plain.solution.condition_number_scaled
    if condition > LARGE_CONDITION:
        text = f"condition number {condition:.0f} (good: below 100): parameters are {condition / 100:.0f} x noisier"
        if not drop_weak:
            fix = "plan a motion that tells more: dynid trajectory ROBOT --optimise; or continue with --drop-weak"
            raise PoorlyExcited(text, fix=fix)
        return (Finding("W402", "warning", text, {"condition_number_scaled": condition}),)
    return ()


def _require_change(prior: Floats, plain: Floats, physical: Floats) -> None:
    """Refuse a physical set that is still where its search began; a log of the prior itself moves nothing either.

    Raises:
        NothingChanged: with the number of parameters.
    """
    believed = np.isfinite(prior)

    def same(theta: Floats) -> NDArray[np.bool_]:
        return np.asarray(np.isclose(theta, prior, rtol=UNCHANGED, atol=1e-12)[believed])

    if believed.any() and same(physical).all() and not same(plain).all():
        count = int(believed.sum())
        raise NothingChanged(f"nothing changed: the physical set equals the prior in {count} of {count} parameters")


def _sensor_findings(base: BaseModel) -> list[Finding]:
    """Say what a torque sensor between gear and link cannot see."""
    rotors = [name for name in base.reduction.base_names if name.startswith("Im")]
    if base.robot.torque.source != "joint_sensor" or not rotors:
        return []
    text = (
        f"torques come from joint sensors after the gears: {', '.join(rotors)} and the friction here are what lies "
        "behind the sensor; rotor inertia and motor friction before it are largely invisible"
    )
    return [Finding("W410", "info", text, {"parameters": rotors})]


def _physical_wins(base: BaseModel, method: str, held: dict[str, tuple[Floats, float]]) -> tuple[bool, str]:
    """Decide which parameters are in force, and say why.

    A table of link inertias is knowledge, and a log of one motion must not overrule it. Cylinders are only a shape:
    they rescue a poor log, but a good one knows better; rows that were not fitted tell which of the two it is.
    """
    if method != "auto":
        return False, "the estimator was chosen by hand"
    if base.robot.prior is not None and base.robot.prior.links:
        return True, "the robot file has a table of link inertias as prior"
    if not held:
        return True, "nothing was held out to compare with"
    plain, physical = held["plain"][1], held["physical"][1]
    figures = f"held-out error {physical:.2f} % against {plain:.2f} %"
    if physical <= NEARLY_AS_GOOD * plain:
        return True, f"it predicts the held-out rows at least nearly as well as the plain estimate ({figures})"
    return False, f"the physical set predicts the held-out rows worse ({figures})"


def _physics_findings(
    base: BaseModel, plain: Fit, rms: Floats, knowledge: tuple[str, ...], feasible: bool
) -> list[Finding]:
    """Say when the plain numbers belong to no arm, when no arm comes near them, and when the log says little."""
    found = []
    open_ = sum(word == "not determined" for word in knowledge) / len(knowledge)
    observer = base.model.observer(base.reduction.base)
    alarm = sign_alarm(lambda q, qd, qdd: observer.torque(plain.theta, q, qd, qdd), random_poses(base.robot, POSES))
    if alarm.raised:
        cause = (
            "too little motion to tell, or a wrong sign or offset under `driver:`"
            if open_ > MANY_OPEN
            else "check sign and offset of each joint under `driver:` in the robot file"
        )
        text = f"the plain fit has no positive mass matrix in {100 * alarm.share:.0f} % of random poses: {cause}"
        found.append(Finding("W405", "info" if open_ > MANY_OPEN else "warning", text, {"share": alarm.share}))
    growth = rms / np.maximum(plain.rms, 1e-12)
    worst = int(np.argmax(growth))
    if growth[worst] > CONTRADICTION and rms[worst] > plain.rms[worst] + 1e-6:
        joint = base.robot.joint_names[worst]
        text = (
            f"the physical set explains {joint} worse than the plain fit: its torque error grows from "
            f"{plain.rms[worst]:.3g} to {rms[worst]:.3g} N m; a missing effect (dynid gap), or units, signs, payload"
        )
        found.append(Finding("W404", "warning", text, {"joint": joint, "growth": float(growth[worst])}))
    if open_ > MANY_OPEN:
        count = f"{sum(word == 'not determined' for word in knowledge)} of {len(knowledge)} base parameters"
        plain_text = "the plain estimate holds for motions like this one only; for others use --feasible"
        consequence = "their values come mostly from the prior" if feasible else plain_text
        text = f"{count} are not determined by this log: {consequence}"
        found.append(Finding("W406", "warning", text, {"share": open_}))
    return found


def _held_out(base: BaseModel, holdout: HoldOut, method: str, prior: Floats) -> dict[str, tuple[Floats, float]]:
    """Return rms of each joint and total relative error on the held-out rows, for the plain and the physical set."""
    fitted = METHODS[method](holdout.train, prior, controller_of(base))
    factors, rows = holdout.test.whole
    sets = {"plain": fitted.theta, "physical": base.reduction.K @ physical_parameters(base, fitted).x}
    return {key: (joint_rms(factors, rows, theta), relative_error(factors, theta)) for key, theta in sets.items()}


def controller_of(base: BaseModel) -> Controller | None:
    """Return the robot's controller where the base parameters are those of the whole arm that it moves."""
    return None if base.robot.links else base.robot.controller
