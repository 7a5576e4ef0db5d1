"""What logs and fits are worth, as findings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.arrays import Floats
from dynid.errors import Finding, PoorlyExcited, RankDeficient
from dynid.estimation import tuning
from dynid.estimation.covariance import NOT_DETERMINED, judge
from dynid.estimation.estimators import fitted
from dynid.estimation.least_squares import Fit, joint_rms
from dynid.estimation.residual_model import ModelError
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel
from dynid.model.regressor import indefinite_share, random_poses


def weakly_excited(stack: Stack) -> list[Finding]:
    """Return finding W402, which names the base parameters that the logs do not determine, the worst first."""
    fit = fitted(stack, "wls")
    error = np.where(fit.open, np.inf, np.sqrt(np.maximum(np.diag(fit.covariance), 0.0)))
    words = judge(fit.theta, error, fit.effect)
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


def sensor_findings(base: BaseModel) -> list[Finding]:
    """Say what a torque sensor between gear and link cannot see."""
    parameters = zip(base.reduction.base_names, base.reduction.base, strict=True)
    rotors = [name for name, k in parameters if base.model.parameters[k].kind == "Im"]
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


def apart_findings(joints: Sequence[str], error: ModelError | None) -> list[Finding]:
    """Say which joints have torques that contradict those of the others, of the model error in force."""
    if error is None or not error.apart.any():
        return []
    names = [joints[j] for j in error.joints_apart]
    text = (
        f"the torques of {', '.join(names)} contradict those of the other joints: another scale or sign, a part of "
        "it, a stuck reading, or what the model lacks. They have parameters of their own in predictions and no say in "
        "those of the arm"
    )
    return [Finding("W413", "warning", text, {"joints": names})]


def physics_findings(
    plain: Fit,
    stack: Stack,
    alone: Floats,
    knowledge: tuple[str, ...],
    error: ModelError | None,
    physical: bool,
) -> list[Finding]:
    """Say when the plain numbers belong to no arm, when no arm comes near them, and when the log says little.

    Args:
        plain: the plain estimate.
        stack: the fitted rows.
        alone: the best possible parameters without a residual model, (p,).
        knowledge: how well each parameter is known, (p,).
        error: the model error in force, None without.
        physical: whether the possible parameters are.
    """
    findings, base = [], stack.base
    count = knowledge.count(NOT_DETERMINED)
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
        findings.append(Finding("W405", level, text, {"share": share}))
    findings += _unexplained(base, plain, joint_rms(stack.factors, stack.counts, alone), error)
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
        findings.append(Finding("W406", "warning", text, {"share": count / len(knowledge)}))
    return findings


def _unexplained(
    base: BaseModel, plain: Fit, rms: Floats, error: ModelError | None
) -> list[Finding]:
    """Say which joints have torques that no possible parameters make, whose residual is rms, (n,) [N m or N]."""
    growth = rms / np.maximum(plain.rms, 1e-12)
    worst = int(np.argmax(growth))
    unexplained = growth[worst] > tuning.CONTRADICTION and rms[worst] > plain.rms[worst] + 1e-6
    findings, texts = [], {}
    if error is not None and len(error.free):
        texts = dict.fromkeys(
            error.free.tolist(),
            "{} has a large torque that depends on its position and that links cannot make (a spring, a "
            "counterbalance?): the residual model predicts it, the parameters do not; dynid gap may name it",
        )
    elif unexplained and (error is None or not error.apart.any()):
        texts[worst] = (
            f"physically consistent parameters fit {{}} worse than least squares: torque error {rms[worst]:.3g} "
            f"instead of {plain.rms[worst]:.3g} N m; look for a missing effect (dynid gap), units, signs, payload"
        )
    for j, text in texts.items():
        joint = base.robot.joint_names[j]
        facts = {"joint": joint, "growth": float(growth[j])}
        findings.append(Finding("W404", "warning", text.format(joint), facts))
    return findings
