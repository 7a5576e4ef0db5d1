"""Two results of one arm: which parameters differ more than their errors allow, which numbers left a tolerance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.estimation import tuning
from dynid.estimation.covariance import NOT_DETERMINED
from dynid.estimation.identified import Identified

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Change:
    """One parameter in two results.

    Attributes:
        name: base parameter.
        before: value in the baseline.
        after: value in the other.
        percent: change against the value, or against ten standard errors where that is more [%].
        p_value: chance of such a change by noise alone; NaN where a result does not determine the parameter.
        significant: whether it stands out among all parameters (Holm).
    """

    name: str
    before: float
    after: float
    percent: float
    p_value: float
    significant: bool


@dataclass(frozen=True)
class FigureOfMerit:
    """One figure of merit in two results.

    Attributes:
        name: key of the JSON answer, a joint's figure with the joint in front.
        before: in the baseline.
        after: in the other.
        percent: change [%].
    """

    name: str
    before: float
    after: float
    percent: float


@dataclass(frozen=True)
class Comparison:
    """A result beside its baseline.

    Attributes:
        changes: every parameter.
        figures: every figure of merit.
        p_value: chance of the most striking change among all parameters by noise alone; 1 when none can be tested.
    """

    changes: tuple[Change, ...]
    figures: tuple[FigureOfMerit, ...]
    p_value: float

    @property
    def drifted(self) -> tuple[Change, ...]:
        """Parameters that changed more than their errors allow, the most certain first."""
        return tuple(sorted((c for c in self.changes if c.significant), key=lambda c: c.p_value))

    def beyond(self, tolerance: float) -> tuple[Change | FigureOfMerit, ...]:
        """Return the numbers that moved by more than a share, the largest move first."""
        every: list[Change | FigureOfMerit] = [*self.figures, *self.changes]
        moved = [each for each in every if not abs(each.percent) <= 100 * tolerance]
        return tuple(sorted(moved, key=lambda each: -abs(each.percent)))


def same_parameters(one: Identified, other: Identified) -> bool:
    """Return whether two results have the same base parameters and joints, so that they can be compared."""
    return one.names == other.names and [j.joint for j in one.joints] == [
        j.joint for j in other.joints
    ]


def compare(baseline: Identified, other: Identified) -> Comparison:
    """Compare two results with the same base parameters.

    Args:
        baseline: what is compared with.
        other: what is compared.

    Source: the tests treat both estimates as independent and normal with covariances that allow for coloured
        residuals; Holm 1979 for many tests at once.
    """
    # Why the plain estimates: what the physical sets take from their common prior would hide a change.
    difference = other.plain - baseline.plain
    variance = np.diag(baseline.plain_covariance) + np.diag(other.plain_covariance)
    tested = _determined(baseline) & _determined(other) & (variance > 0)
    p_values = np.full(len(difference), np.nan)
    sigma = np.sqrt(variance[tested])
    p_values[tested] = _two_sided(difference[tested] / sigma)
    significant = _holm(p_values)
    error = np.where(np.isfinite(baseline.std_error), baseline.std_error, 0.0)
    scale = np.maximum(np.abs(baseline.theta), tuning.CHANGE_FLOOR_ERRORS * error)
    changes = tuple(
        Change(
            name,
            float(before),
            float(after),
            _percent(float(before), float(after), float(size)),
            float(p),
            bool(sure),
        )
        for name, before, after, size, p, sure in zip(
            baseline.names, baseline.theta, other.theta, scale, p_values, significant, strict=True
        )
    )
    # Why no joint Wald test: with 69 parameters a HAC covariance inverted tells two logs of one arm apart (1e-43).
    smallest = min(1.0, float(np.nanmin(p_values)) * int(tested.sum())) if tested.any() else 1.0
    return Comparison(changes, _figures(baseline, other), smallest)


def _determined(result: Identified) -> NDArray[np.bool_]:
    known = np.array([known != NOT_DETERMINED for known in result.knowledge])
    return known & np.isfinite(result.std_error)


def _two_sided(z: Floats) -> Floats:
    from scipy.special import ndtr

    return np.asarray(2 * ndtr(-np.abs(z)))


def _holm(p_values: Floats) -> NDArray[np.bool_]:
    """Return which tests hold at a false-alarm chance for all of them together."""
    found = np.zeros(len(p_values), dtype=bool)
    order = [k for k in np.argsort(p_values) if np.isfinite(p_values[k])]
    for rank, k in enumerate(order):
        if p_values[k] > tuning.CHANGE_FALSE_ALARM / (len(order) - rank):
            break
        found[k] = True
    return found


def _percent(before: float, after: float, scale: float) -> float:
    if before == after:
        return 0.0
    return 100.0 * (after - before) / scale if scale else float("inf")


def _figures(baseline: Identified, other: Identified) -> tuple[FigureOfMerit, ...]:
    pairs: list[tuple[str, float | None, float | None]] = [
        ("relative_error_percent", baseline.relative_error_percent, other.relative_error_percent),
        (
            "heldout_relative_error_percent",
            baseline.heldout_relative_error_percent,
            other.heldout_relative_error_percent,
        ),
    ]
    for one, two in zip(baseline.joints, other.joints, strict=True):
        pairs += [
            (f"{one.joint} rms_nm", one.rms, two.rms),
            (f"{one.joint} torque_rms_nm", one.torque_rms, two.torque_rms),
        ]
    found = [(name, float(a), float(b)) for name, a, b in pairs if a is not None and b is not None]
    return tuple(FigureOfMerit(name, a, b, _percent(a, b, abs(a))) for name, a, b in found)
