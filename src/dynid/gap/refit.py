"""From selected effects to numbers: shapes and amplitudes fitted together, errors from left-out blocks, held-out rows.

The columns that the search did not judge are gone here: with them the height of a Stribeck hump comes out wrong by
tens of percent while its name is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.gap.problem import GapProblem
from dynid.gap.search import EffectSearch
from dynid.gap.segments import cut, jackknife_blocks
from dynid.gap.selected_effects import SelectedEffect, effect_torque, stepped, with_selected
from dynid.gap.significance import SignificanceTest, significance_test, whitened_columns
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Floats

#: Rounds of refining all shapes together, each with a smaller step.
STEPS = (0.5, 0.25, 0.12, 0.06)
#: Relative step of a shape parameter for its error.
STEP = 1e-3
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
    """

    before: Floats
    after: Floats
    ratio: Floats
    floor: Floats


def with_columns(effects: Sequence[SelectedEffect]) -> list[SelectedEffect]:
    """Return the effects that have columns: all but a delay, which is taken out of the logs."""
    return [one for one in effects if one.name != "torque_delay"]


def refit(search: EffectSearch) -> tuple[list[SelectedEffect], WhitenedRegression]:
    """Fit selected effects and the model together, without nuisance columns."""
    problem, selected = search.problem, list(search.selected)
    regression = problem.regression(nuisance=False)
    for _ in range(2):
        theta = regression.fit.theta[: problem.base.reduction.rank]
        regression = with_selected(problem.regression(theta, nuisance=False), selected)
    for share in STEPS if any(one.effect.steps for one in selected) else ():
        selected = _refined(regression, selected, share)
    regression = with_selected(regression, selected)
    found = [_with_numbers(regression, selected, k) for k in range(len(selected))]
    if search.delay_test is not None:
        found.append(_delay(search.delay, search.delay_test))
    return found, regression


def _delay(seconds: float, test: SignificanceTest) -> SelectedEffect:
    name, error = "torque_delay", float(np.sqrt(test.covariance[0, 0]))
    size = float(test.visible_rms)
    return SelectedEffect(CATALOGUE[name], (), {}, test, size, (), {"delay": seconds}, {"delay": error})


def _refined(regression: WhitenedRegression, selected: list[SelectedEffect], share: float) -> list[SelectedEffect]:
    """Return the effects with each shape parameter a step further where that leaves less."""
    least = with_selected(regression, selected).squares
    for k, one in enumerate(selected):
        for name, (kind, size) in one.effect.steps.items():
            for sign in (-1.0, 1.0):
                shape = selected[k].shape
                moved = replace(one, shape=shape | {name: stepped(shape[name], kind, size, sign * share)})
                tried = [*selected[:k], moved, *selected[k + 1 :]]
                squares = with_selected(regression, tried).squares
                if squares < least:
                    least, selected = squares, tried
    return selected


def _with_numbers(regression: WhitenedRegression, selected: Sequence[SelectedEffect], k: int) -> SelectedEffect:
    """Return one effect with amplitudes and shape; its slopes join its columns, so that errors know of each other."""
    one = selected[k]
    others = with_selected(regression, [other for other in selected if other is not one])
    base = {j: C[0] for j, C in whitened_columns(regression, one.effect, one.joints, [one.shape]).items()}
    units = one.effect.amplitudes(one.shape)
    start = sum(len(other.effect.amplitudes(other.shape)) for other in selected[:k])
    beta = regression.amplitudes[start : start + len(units)]
    columns = dict(base)
    for name in one.effect.steps:
        step = STEP * max(abs(one.shape[name]), 1e-3)
        shape = one.shape | {name: one.shape[name] + step}
        near = whitened_columns(regression, one.effect, one.joints, [shape])
        for j in base:
            columns[j] = np.vstack([columns[j], (beta @ (near[j][0] - base[j]) / step)[None]])
    sizes = np.sqrt(np.maximum(np.diag(significance_test(others, columns).covariance), 0.0))
    return replace(
        one,
        test=replace(significance_test(others, base), amplitudes=beta),
        values=dict(zip(units, beta.tolist(), strict=True)) | dict(one.shape),
        std_errors=dict(zip([*units, *one.effect.steps], sizes.tolist(), strict=True)),
    )


def held_out_improvement(
    first: GapProblem, search: EffectSearch, effects: Sequence[SelectedEffect]
) -> HeldOutImprovement:
    """Return the gap on held-out rows before and after; both models are fitted to the training rows alone.

    Args:
        first: the problem before any delay was taken out.
        search: the search.
        effects: what it found.
    """
    before = _held_residuals(first, [])
    after = _held_residuals(search.problem, with_columns(effects))
    rms = np.array([[np.sqrt(np.mean(e**2)) if len(e) else 0.0 for e, _ in joints] for joints in (before, after)])
    ratio = np.array([_ratio(b, a, j) for j, (b, a) in enumerate(zip(before, after, strict=True))])
    return HeldOutImprovement(rms[0], rms[1], ratio, search.problem.noise.floor)


def _held_residuals(problem: GapProblem, selected: Sequence[SelectedEffect]) -> list[tuple[Floats, NDArray[np.int64]]]:
    """Return held-out torque residuals and blocks of time of each joint, {(M_j,), (M_j,)}."""
    p = problem.base.reduction.rank
    regression = with_selected(problem.regression(nuisance=False), selected)
    if selected:
        regression = with_selected(problem.regression(regression.fit.theta[:p], nuisance=False), selected)
    theta = regression.fit.theta[:p]
    held = cut(problem.segments, problem.held)
    torques = [s.filtered(effect_torque(s.motion, selected, regression.amplitudes)) for s in regression.segments]
    times = jackknife_blocks(held)
    found = []
    for j in range(held[0].motion.n):
        parts, blocks = [], []
        for s, torque, time in zip(held, torques, times, strict=True):
            use = s.use[:, j].copy()
            use[: problem.noise.order] = False
            parts.append((s.tau[:, j] - s.W[:, j] @ theta - torque[j])[use])
            blocks.append(time[use])
        found.append((np.concatenate(parts), np.concatenate(blocks)))
    return found


def _ratio(before: tuple[Floats, NDArray[np.int64]], after: tuple[Floats, NDArray[np.int64]], seed: int) -> Floats:
    """Return the 95 % interval of the ratio of rms values over blocks of time drawn with replacement, (2,)."""
    names, block = np.unique(before[1], return_inverse=True)
    if len(names) < 3 or len(before[0]) != len(after[0]):
        return np.array([0.0, np.inf])
    sums = np.array([np.bincount(block, x[0] ** 2, len(names)) for x in (before, after)])
    counts = np.random.default_rng(seed).multinomial(len(names), np.full(len(names), 1 / len(names)), DRAWS)
    b, a = counts @ sums[0], counts @ sums[1]
    interval: Floats = np.quantile(np.sqrt(a / np.maximum(b, 1e-30)), [0.025, 0.975])
    return interval
