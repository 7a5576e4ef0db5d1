"""What logs and fits are worth, as findings that the person who plans the next motion can act on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, PoorlyExcited, RankDeficient
from dynid.estimation import tuning
from dynid.estimation.covariance import NOT_DETERMINED
from dynid.estimation.estimators import wls
from dynid.estimation.least_squares import Fit
from dynid.estimation.residual_model import ModelError
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel
from dynid.model.regressor import Observer, indefinite_share, random_poses
from dynid.signals.filters import decimate

Floats = NDArray[np.float64]


def weakly_excited(base: BaseModel, stack: Stack, prior: Floats) -> list[Finding]:
    """Name the base parameters that this log leaves uncertain, why, and what would help.

    A parameter's error falls in proportion to the size of its column: for an inertia that is the acceleration, for
    viscous friction the speed. It falls with the root of the length of the log.

    Args:
        base: model and base parameters.
        stack: the stacked logs.
        prior: prior base parameters, NaN where nothing is known, (p,).

    Returns:
        Findings W402, the worst first.
    """
    fit = wls(stack, prior)
    error = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    error[np.abs(fit.solution.weak).max(axis=1, initial=0.0) > 1e-9] = np.inf
    size = np.maximum(np.abs(fit.theta), np.abs(np.nan_to_num(prior)))
    rows = max(1, int(stack.whole[1].sum()))
    harmless = error * np.linalg.norm(fit.whitened[:, :-1], axis=0) / np.sqrt(rows) <= tuning.HARMLESS_TORQUE
    relative = error / np.maximum(size, np.finfo(float).tiny)
    weak = [k for k in np.argsort(-relative) if relative[k] > tuning.ROUGH_ERROR and not harmless[k]]
    findings = [_finding(base, stack, int(k), float(relative[k])) for k in weak[: tuning.FINDINGS_WORDED]]
    if len(weak) > tuning.FINDINGS_WORDED:
        rest = ", ".join(stack.names[k] for k in weak[tuning.FINDINGS_WORDED :])
        findings.append(Finding("W402", "warning", f"also hardly excited: {rest}", {"parameters": rest.split(", ")}))
    return findings


def _finding(base: BaseModel, stack: Stack, k: int, relative: float) -> Finding:
    name = stack.names[k]
    evidence = {"parameter": name, "relative_error": relative if np.isfinite(relative) else None}
    if not np.isfinite(relative):
        return Finding("W402", "warning", f"{name} leaves no trace in this log: {_reason(base, stack, k)}", evidence)
    factor = relative / tuning.WELL_ERROR
    more = f"{factor:.0f} times more" if factor < tuning.MOST_SENSIBLE else "far more"
    why = f"{name} hardly excited (error {100 * relative:.0f} %): {_reason(base, stack, k)}"
    text = f"{why}; {more} would bring its error under 10 %"
    return Finding("W402", "warning", text, {**evidence, "factor": factor})


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
            float(np.abs(decimate(s.qdd[:, j][None, :], log.filter.second_kernel, 1)).max(initial=0.0))
            for log in stack.logs
            for s in log.segments
        )
        return f"{joint.name} never accelerates beyond {largest:.2g} {unit}/s^2"
    if kind in ("fv", "fvc"):
        largest = max(float(np.abs(s.qd[:, j]).max()) for s in segments)
        return f"{joint.name} never moves faster than {largest:.2g} {unit}/s"
    if kind in ("fc", "fo", "fcc"):
        reversals = sum(int(np.sum(np.diff(np.sign(s.qd[:, j])) != 0)) for s in segments)
        return f"{joint.name} reverses {reversals} times only"
    spans = [float(np.ptp(s.q[:, j])) for s in segments]
    return f"{joint.name} covers {max(spans):.2g} {unit} only, so gravity and speed change little"


def excitation_findings(stack: Stack, plain: Fit, cost: float, *, drop_weak: bool) -> tuple[Finding, ...]:
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
        text = f"this log determines {rank} of {size} base parameters; it cannot tell apart: {names}"
        if not drop_weak:
            fix = "record a motion in which every joint moves on its own, or continue with --drop-weak"
            raise RankDeficient(text, fix=fix)
        return (Finding("W403", "warning", text, {"rank": rank, "structural_rank": size}),)
    condition = plain.solution.condition_number_scaled
    if cost > tuning.POORLY_EXCITED_PERCENT:
        text = (
            f"what this log hardly tells of the parameters costs the plain estimate {cost:.3g} % of the torque of an "
            f"exciting motion; condition number {condition:.0f} (good: below 100)"
        )
        if not drop_weak:
            fix = "plan a motion that tells more: dynid trajectory ROBOT --optimise; or continue with --drop-weak"
            raise PoorlyExcited(text, fix=fix)
        evidence = {"expected_percent": cost, "condition_number_scaled": condition}
        return (Finding("W402", "warning", text, evidence),)
    return ()


def sensor_findings(base: BaseModel) -> list[Finding]:
    """Say what a torque sensor between gear and link cannot see."""
    reduction, table = base.reduction, base.model.parameters
    rotors = [name for name, k in zip(reduction.base_names, reduction.base, strict=True) if table[k].kind == "Im"]
    if base.robot.torque.source != "joint_sensor" or not rotors:
        return []
    text = (
        f"torques come from joint sensors after the gears: {', '.join(rotors)} and the friction here are what lies "
        "behind the sensor; rotor inertia and motor friction before it are largely invisible"
    )
    return [Finding("W410", "info", text, {"parameters": rotors})]


def physics_findings(
    base: BaseModel,
    observer: Observer,
    plain: Fit,
    rms: Floats,
    knowledge: tuple[str, ...],
    in_force: str,
    error: ModelError | None,
) -> list[Finding]:
    """Say when the plain numbers belong to no arm, when no arm comes near them, and when the log says little.

    Args:
        base: model and base parameters.
        observer: evaluator of the base columns.
        plain: the plain estimate.
        rms: residual of the physical set at each joint, (n,) [N m or N].
        knowledge: how well each parameter is known, (p,).
        in_force: which set is.
        error: the model error in force, None without.
    """
    found = []
    open_ = sum(word == NOT_DETERMINED for word in knowledge) / len(knowledge)
    poses = random_poses(base.robot, tuning.ALARM_POSES)
    share = indefinite_share(lambda q, qd, qdd: observer.torque(plain.theta, q, qd, qdd), poses)
    if share:
        cause = (
            "too little motion to tell, or a wrong sign or offset under `driver:`"
            if open_ > tuning.MANY_OPEN
            else "check sign and offset of each joint under `driver:` in the robot file"
        )
        level = "info" if in_force == "physical" or open_ > tuning.MANY_OPEN else "warning"
        text = f"the plain fit has no positive mass matrix in {100 * share:.0f} % of random poses: {cause}"
        found.append(Finding("W405", level, text, {"share": share}))
    growth = rms / np.maximum(plain.rms, 1e-12)
    worst = int(np.argmax(growth))
    large = () if error is None else error.free
    for j in large:
        joint = base.robot.joint_names[j]
        text = (
            f"{joint} has a large torque of its position that no possible arm has (a spring, a counterbalance?): it is "
            "in the residual model, with which predictions hold, and not in the parameters; dynid gap may name it"
        )
        found.append(Finding("W404", "warning", text, {"joint": joint, "growth": float(growth[j])}))
    if not len(large) and growth[worst] > tuning.CONTRADICTION and rms[worst] > plain.rms[worst] + 1e-6:
        joint = base.robot.joint_names[worst]
        text = (
            f"the physical set explains {joint} worse than the plain fit: its torque error grows from "
            f"{plain.rms[worst]:.3g} to {rms[worst]:.3g} N m; a missing effect (dynid gap), or units, signs, payload"
        )
        found.append(Finding("W404", "warning", text, {"joint": joint, "growth": float(growth[worst])}))
    if open_ > tuning.MANY_OPEN:
        count = f"{sum(word == NOT_DETERMINED for word in knowledge)} of {len(knowledge)} base parameters"
        plain_text = "the plain estimate holds for motions like this one only; for others use --feasible"
        consequence = "their values come mostly from the prior" if in_force == "physical" else plain_text
        text = f"{count} are not determined by this log: {consequence}"
        found.append(Finding("W406", "warning", text, {"share": open_}))
    return found
