"""What a log tells and what it does not, in words that a person planning the next motion can act on."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding
from dynid.estimation.covariance import HARMLESS, ROUGHLY, WELL
from dynid.estimation.estimators import wls
from dynid.estimation.stack import Stack
from dynid.model.base_model import BaseModel
from dynid.signals.filters import decimate

Floats = NDArray[np.float64]

#: Findings that are worded one by one; the rest are counted.
SPOKEN = 8
#: Beyond this factor a number would only pretend that faster motion of the same kind could help.
MOST_SENSIBLE = 30.0


def weakly_excited(base: BaseModel, stack: Stack, prior: Floats) -> list[Finding]:
    """Name the base parameters that this log leaves uncertain, why, and what would help.

    A parameter's error falls in proportion to the size of its column: for an inertia that is the acceleration, for
    viscous friction the speed. It falls with the root of the length of the log.

    Args:
        base: model and base parameters.
        stack: the stacked logs.
        prior: prior base parameters, NaN where nothing is believed, (p,).

    Returns:
        Findings W402, the worst first.
    """
    fit = wls(stack, prior)
    error = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    error[np.abs(fit.solution.weak).max(axis=1, initial=0.0) > 1e-9] = np.inf
    size = np.maximum(np.abs(fit.theta), np.abs(np.nan_to_num(prior)))
    rows = max(1, int(stack.whole[1].sum()))
    harmless = error * np.linalg.norm(fit.whitened[:, :-1], axis=0) / np.sqrt(rows) <= HARMLESS
    relative = error / np.maximum(size, np.finfo(float).tiny)
    weak = [k for k in np.argsort(-relative) if relative[k] > ROUGHLY and not harmless[k]]
    findings = [_finding(base, stack, int(k), float(relative[k])) for k in weak[:SPOKEN]]
    if len(weak) > SPOKEN:
        rest = ", ".join(stack.names[k] for k in weak[SPOKEN:])
        findings.append(Finding("W402", "warning", f"also hardly excited: {rest}", {"parameters": rest.split(", ")}))
    return findings


def _finding(base: BaseModel, stack: Stack, k: int, relative: float) -> Finding:
    name = stack.names[k]
    evidence = {"parameter": name, "relative_error": relative if np.isfinite(relative) else None}
    if not np.isfinite(relative):
        return Finding("W402", "warning", f"{name} leaves no trace in this log: {_reason(base, stack, k)}", evidence)
    factor = relative / WELL
    more = f"{factor:.0f} times more" if factor < MOST_SENSIBLE else "far more"
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
        turns = sum(int(np.sum(np.diff(np.sign(s.qd[:, j])) != 0)) for s in segments)
        return f"{joint.name} reverses {turns} times only"
    spans = [float(np.ptp(s.q[:, j])) for s in segments]
    return f"{joint.name} covers {max(spans):.2g} {unit} only, so gravity and speed change little"
