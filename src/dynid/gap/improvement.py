"""The gap before and after what was found, on rows that were never fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.gap.known_errors import KnownErrors
from dynid.gap.possible_arm import near_possible
from dynid.gap.problem import GapProblem
from dynid.gap.regression import Regression
from dynid.gap.selected_effects import SelectedEffect, torque_in_rows, with_columns, with_selected
from dynid.model.effects.interface import Floats

#: Held-out residuals of a joint and the number of the block of time of each, (M,) and (M,).
HeldOutRows = tuple[Floats, NDArray[np.int64]]

#: Blocks of time that errors are taken from: longer than the memory of whitened residuals [s], and so many of them if
#: the rows last long enough.
SHORTEST_BLOCK, LONGEST_BLOCK, BLOCKS = 0.25, 1.0, 40
#: Fewest blocks of time whose spread says anything.
MIN_BLOCKS = 3
#: Draws of the block bootstrap: the ends of a 95 % interval come from the ten outermost on either side.
DRAWS = 400


@dataclass(frozen=True)
class HeldOutImprovement:
    """The gap before and after, on held-out rows; (n,) each.

    Attributes:
        before: rms without the effects [N m or N].
        after: rms with them [N m or N].
        ratio: lower and upper end of the 95 % interval of after / before, (n, 2).
        floor: the noise [N m or N].
        known: rms of what no effect has to explain, but for noise: what recorder, filter and reversals do, and base
            parameters that the searched rows leave unsure [N m or N].
    """

    before: Floats
    after: Floats
    ratio: Floats
    floor: Floats
    known: Floats

    @property
    def left(self) -> float:
        """Error of all joints together with the effects, in units of their noise."""
        return float(np.sqrt(np.mean((self.after / self.floor) ** 2)))


def held_out_improvement(
    first: GapProblem, problem: GapProblem, effects: Sequence[SelectedEffect], errors: KnownErrors
) -> HeldOutImprovement:
    """Return the gap on held-out rows before and after; both models are fitted to the training rows alone.

    Args:
        first: the problem before any delay was taken out.
        problem: the problem.
        effects: what was found.
        errors: what no effect has to explain.
    """
    # Why the same noise: it weighs the joints, and another weight is another fit.
    same = replace(first, noise=problem.noise, in_force=problem.in_force, arm=problem.arm)
    before, after = _held_residuals(same, []), _held_residuals(problem, with_columns(effects))
    bare, whole = (
        np.array([np.sqrt(np.mean(e**2)) if len(e) else 0.0 for e, _ in joints])
        for joints in (before, after)
    )
    ratio = [_ratio(b, a, j) for j, (b, a) in enumerate(zip(before, after, strict=True))]
    # Rms of what no effect has to explain on held-out rows, but for noise.
    rows = problem.rows.only(problem.rows.held)
    use = np.array([problem.noise.counting(rows, j) for j in range(len(bare))]).T
    power = np.sum(np.where(use, errors.power(rows), 0.0), axis=0)
    known = np.sqrt(power / np.maximum(use.sum(axis=0), 1))
    return HeldOutImprovement(bare, whole, np.array(ratio), problem.noise.floor, known)


def fitted_with(problem: GapProblem, selected: Sequence[SelectedEffect]) -> Regression:
    """Fit model and effects together to the training rows, without what is not judged.

    Effects that follow the model's torque follow that of the fit.
    """
    regression = with_selected(problem.regression(nuisance=False), selected)
    if not selected:
        return regression
    theta = regression.theta[: problem.base.rank]
    return with_selected(problem.regression(theta, nuisance=False), selected)


def _held_residuals(problem: GapProblem, selected: Sequence[SelectedEffect]) -> list[HeldOutRows]:
    """Return held-out torque residuals and blocks of time of each joint, {(M_j,), (M_j,)}."""
    problem = problem if problem.in_force is None else replace(problem, noise=problem.in_force)
    regression = fitted_with(problem, selected)
    if problem.in_force is not None:
        regression = near_possible(regression, problem.base, exactly=problem.arm)
    rows = problem.rows.only(problem.rows.held)
    left = rows.tau - rows.W @ regression.theta[: problem.base.rank]
    left -= torque_in_rows(regression.rows, selected, regression.amplitudes)
    # Why longer: what a joint leaves of a comparison with earlier logs goes on for longer.
    shortest = LONGEST_BLOCK if problem.since else SHORTEST_BLOCK
    seconds = float(rows.use.any(axis=1).sum()) / rows.rate
    length = min(LONGEST_BLOCK, max(shortest, seconds / BLOCKS))
    block = 1_000_000 * rows.part + rows.at // max(1, round(length * rows.rate))
    use = (problem.noise.counting(rows, j) for j in range(left.shape[1]))
    return [(e[chosen], block[chosen]) for e, chosen in zip(left.T, use, strict=True)]


def _ratio(before: HeldOutRows, after: HeldOutRows, seed: int) -> Floats:
    """Return the 95 % interval of the ratio of rms values, (2,), of blocks of time."""
    names, block = np.unique(before[1], return_inverse=True)
    if len(names) < MIN_BLOCKS or len(before[0]) != len(after[0]):
        return np.array([0.0, np.inf])
    sums = [np.bincount(block, x[0] ** 2, len(names)).astype(np.float64) for x in (before, after)]
    return ratio_interval(sums[0], sums[1], seed)


def ratio_interval(before: Floats, after: Floats, seed: int) -> Floats:
    """Return the 95 % interval of the ratio of rms values, from sums of squares of B blocks, (B,) each, as (2,)."""
    counts = np.random.default_rng(seed).multinomial(
        len(before), np.full(len(before), 1 / len(before)), DRAWS
    )
    ratios = np.sqrt(counts @ after / np.maximum(counts @ before, 1e-30))
    interval: Floats = np.quantile(ratios, [0.025, 0.975])
    return interval
