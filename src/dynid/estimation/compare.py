"""Two results of one arm: which parameters differ more than their errors allow, which numbers left a tolerance."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.estimation import tuning
from dynid.estimation.identified import Identified
from dynid.estimation.least_squares import NOT_DETERMINED
from dynid.judgement.evidence import Change


@dataclass(frozen=True)
class Comparison:
    """A result beside its baseline.

    Attributes:
        changes: every parameter.
        figures: every figure of merit.
        p_value: chance of the most striking change among all parameters by noise alone; 1 when none can be tested.
    """

    changes: tuple[Change, ...]
    figures: tuple[Change, ...]
    p_value: float

    @property
    def drifted(self) -> tuple[Change, ...]:
        """Parameters that changed more than their errors allow, the most certain first."""
        certain = (each for each in self.changes if each.significant)
        return tuple(sorted(certain, key=lambda each: each.p_value or 0.0))

    def beyond(self, tolerance: float) -> tuple[Change, ...]:
        """Return the numbers that moved by more than a share, the largest move first."""
        moved = [x for x in (*self.figures, *self.changes) if not abs(x.percent) <= 100 * tolerance]
        return tuple(sorted(moved, key=lambda each: -abs(each.percent)))


def compare(baseline: Identified, other: Identified) -> Comparison:
    """Compare two results with the same base parameters.

    Args:
        baseline: what is compared with.
        other: what is compared.

    Source: the tests treat both estimates as independent and normal with covariances that allow for coloured
        residuals; Holm 1979 for many tests at once.
    """
    from scipy.special import ndtr  # here: its import takes longer than the comparison

    # Why the plain estimates: what the physical sets take from their common prior would hide a change.
    variance = np.diag(baseline.plain_covariance) + np.diag(other.plain_covariance)
    tested = variance > 0
    for result in (baseline, other):
        tested &= np.isfinite(result.std_error) & (np.array(result.knowledge) != NOT_DETERMINED)
    z = np.abs(other.plain - baseline.plain) / np.sqrt(np.where(tested, variance, 1.0))
    p_values = np.where(tested, 2.0 * ndtr(-z), np.nan)
    order, count = np.argsort(p_values), int(tested.sum())
    holm = tuning.CHANGE_FALSE_ALARM / np.arange(count, 0, -1)
    significant = np.zeros(len(z), dtype=bool)
    significant[order[:count]] = np.logical_and.accumulate(p_values[order[:count]] <= holm)
    error = np.where(np.isfinite(baseline.std_error), baseline.std_error, 0.0)
    scale = np.maximum(np.abs(baseline.theta), tuning.CHANGE_FLOOR_ERRORS * error)
    columns = [x.tolist() for x in (baseline.theta, other.theta, scale, p_values, significant)]
    changes = tuple(
        Change(
            name=name,
            before=before,
            after=after,
            percent=_percent(before, after, size),
            p_value=p_value if p_value == p_value else None,
            significant=sure,
        )
        for name, before, after, size, p_value, sure in zip(baseline.names, *columns, strict=True)
    )
    before, after = _figures(baseline), _figures(other)
    figures = tuple(
        Change(name, x, after[name], _percent(x, after[name], abs(x)))
        for name, x in before.items()
        if name in after
    )
    # Why no joint Wald test: with 69 parameters a HAC covariance inverted tells two logs of one arm apart (1e-43).
    return Comparison(changes, figures, float(np.nanmin(count * p_values, initial=1.0)))


def _percent(before: float, after: float, scale: float) -> float:
    if before == after:
        return 0.0
    return 100.0 * (after - before) / scale if scale else float("inf")


def _figures(result: Identified) -> dict[str, float]:
    """Return the figures of merit that a result has, by name."""
    figures = {
        "relative_error_percent": result.relative_error_percent,
        "heldout_relative_error_percent": result.heldout_relative_error_percent,
    }
    for joint in result.joints:
        name = joint.joint
        figures |= {f"{name} rms_nm": joint.rms, f"{name} torque_rms_nm": joint.torque_rms}
    return {name: float(value) for name, value in figures.items() if value is not None}
