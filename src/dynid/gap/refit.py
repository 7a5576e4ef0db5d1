"""From selected effects to numbers: shapes and amplitudes fitted together, errors from left-out blocks, held-out rows.

The columns that the search did not judge are gone here: with them the height of a Stribeck hump comes out wrong by
tens of percent while its name is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.possible_set import pseudo_inertia
from dynid.gap.known_errors import KnownErrors
from dynid.gap.noise import NoiseModel
from dynid.gap.problem import GapProblem, at_possible, near_possible
from dynid.gap.search import EffectSearch
from dynid.gap.segments import LONGEST_BLOCK, SHORTEST_BLOCK, cut, jackknife_blocks
from dynid.gap.selected_effects import SelectedEffect, at_sizes, torque_in_rows, with_selected
from dynid.gap.significance import SignificanceTest, significance_test, whitened_columns
from dynid.gap.whitened_regression import EffectColumns, WhitenedRegression
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Floats
from dynid.model.parameters import BODY_PARAMETERS

#: Held-out residuals of a joint and the number of the block of time of each, (M,) and (M,).
HeldOutRows = tuple[Floats, NDArray[np.int64]]

#: Fits until columns that scale with the model, or change with their own size, fit each other, and the share by which
#: the last of them may still change a size.
ROUNDS, SETTLED = 6, 5e-4
#: Relative step of a shape parameter for its slope.
STEP = 1e-3
#: Steps towards the best shapes, gain of the last one, and damping: the first, and the one at which none helps.
SHAPE_STEPS, SHAPE_SETTLED, DAMPING, DAMPING_END = 40, 1e-3, 1e-4, 1e4
#: Standard errors from its null that an amplitude or shape has to be to count as determined. Two would let one in
#: twenty pass, and there are several shapes and joints.
SURE_Z = 3.0
#: A joint is worse when the lower end of the interval of its error over the one before is above 1 and it has grown by
#: this factor: the interval alone would reject true names, there are many joints.
GROWN = 1.02
#: Chance below which a joint counts as worse in a comparison with earlier logs.
CHANCE = 0.025
#: Fewest short blocks of time whose spread says anything, and fewest long ones.
MIN_BLOCKS = 3
MIN_LONG_BLOCKS = 4
#: The same on joints that no effect acts on, and where links that no arm has are given up for possible ones: they
#: fitted every joint a little too well.
GROWN_ARM = 1.05
#: A simple value as large as this stands for infinity.
FAR = 1e5
#: How far below zero the smallest second moment of a load's mass may be, as a share of the largest: it is hardly ever
#: known as well.
BODY = 0.1
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
        chance: of such growth where there is none, in a comparison with earlier logs.
    """

    before: Floats
    after: Floats
    ratio: Floats
    floor: Floats
    known: Floats
    chance: Floats | None = None

    def worse(self, allowed: Floats | float = GROWN) -> list[int]:
        """Return joints whose error has grown beyond noise: surely, and by more than is of any account."""
        # Why the number of joints: many have nothing to do with an effect but that the arm's parameters move with it.
        sure = (
            self.ratio[:, 0] > 1.0
            if self.chance is None
            else self.chance < CHANCE / len(self.chance)
        )
        return np.flatnonzero((self.after > allowed * self.before) & sure).tolist()


def with_columns(effects: Sequence[SelectedEffect]) -> list[SelectedEffect]:
    """Return the effects that have columns: all but a delay, which is taken out of the logs."""
    return [one for one in effects if one.name != "torque_delay"]


def refit(search: EffectSearch) -> tuple[list[SelectedEffect], WhitenedRegression]:
    """Fit selected effects and the model together, without nuisance columns.

    A shape parameter that the rows do not determine is held at its simple value, where that is as likely.
    """
    problem, selected = search.problem, list(search.selected)
    regression = problem.regression(nuisance=False)
    before = np.zeros(0)
    for _ in range(ROUNDS):
        theta = regression.fit.theta[: problem.base.reduction.rank]
        regression = with_selected(problem.regression(theta, nuisance=False), selected)
        selected, sizes = at_sizes(selected, regression.amplitudes), regression.amplitudes
        if len(before) and np.allclose(sizes, before, rtol=SETTLED, atol=0.0):
            break
        before = sizes
    while True:
        selected = with_best_shapes(regression.with_effects([]), selected)
        regression = with_selected(regression, selected)
        found = [_with_numbers(regression, selected, k) for k in range(len(selected))]
        simpler = [_held(one) for one in found]
        if not any(simpler):
            break
        selected = [new or old for new, old in zip(simpler, selected, strict=True)]
    return with_delay(search, found), regression


def with_delay(search: EffectSearch, effects: Sequence[SelectedEffect]) -> list[SelectedEffect]:
    """Return effects and the delay that was taken out of the logs, if any."""
    late = [] if search.delay_test is None else [_delay(search.delay, search.delay_test)]
    return [*effects, *late]


def _delay(seconds: float, test: SignificanceTest) -> SelectedEffect:
    name, error = "torque_delay", float(np.sqrt(test.covariance[0, 0]))
    size = float(test.visible_rms)
    return SelectedEffect(
        CATALOGUE[name], (), {}, test, size, (), {"delay": seconds}, {"delay": error}
    )


def _held(one: SelectedEffect) -> SelectedEffect | None:
    """Return an effect with a shape parameter held that the rows do not determine; None where there is none.

    Of a load that no body can have, mass and centre of mass alone are kept.
    """
    if not possible(one):
        return replace(one, shape=one.shape | {"form": 4.0})
    for name in one.free_shape:
        simple, error = one.effect.simple.get(name), one.std_errors[name]
        if simple is not None and one.shape_z(name) < SURE_Z:
            near = error if one.effect.steps[name][0] == "plus" or simple < FAR else np.inf
            if abs(one.values[name] - simple) < SURE_Z * near:
                errors = one.std_errors | {name: float("inf")}
                return replace(one, shape=one.shape | {name: simple}, std_errors=errors)
    return None


def possible(one: SelectedEffect) -> bool:
    """Return whether there can be such a body, put on or taken off; True for what is no body."""
    if one.name != "payload":
        return True
    parameters = [one.values.get(name, 0.0) for name in BODY_PARAMETERS]
    if one.values["form"] < len(parameters):
        return True
    sign = np.sign(parameters[0])
    P = sign * pseudo_inertia(np.array(parameters))
    spread = (
        np.linalg.eigvalsh(P[:3, :3] - np.outer(P[:3, 3], P[:3, 3]) / P[3, 3])
        if P[3, 3] > 0
        else np.array([-1.0])
    )
    return bool(spread[0] >= -BODY * spread[-1])


# ---------------------------------------------------------------- shapes
def with_best_shapes(
    regression: WhitenedRegression, selected: Sequence[SelectedEffect]
) -> list[SelectedEffect]:
    """Return effects with the shapes, all fitted together, that leave least: Levenberg and Marquardt's steps.

    Args:
        regression: rows and baseline, without effects.
        selected: effects with the shapes to begin with.
    """
    here = list(selected)
    if not any(one.free_shape for one in here):
        return here
    damping, fit = DAMPING, _shape_fit(regression, here)
    for _ in range(SHAPE_STEPS):
        moved = _moved(here, fit.step(damping))
        after = _shape_fit(regression, moved)
        gained = after.gain - fit.gain
        if gained <= 0:
            damping *= 8.0
            if damping > DAMPING_END:
                break
            continue
        here, fit, damping = moved, after, max(damping / 8.0, DAMPING)
        if gained < SHAPE_SETTLED:
            break
    return here


@dataclass(frozen=True)
class _ShapeFit:
    """Effects linearised in their shapes: normal equations of K amplitudes and S shape parameters.

    Attributes:
        gain: drop of the whitened sum of squares by the effects.
        gram: of the columns jointly with the baseline, (K + S, K + S).
        right: products with the residual of the baseline, (K + S,).
        beta: best amplitudes, (K,).
    """

    gain: float
    gram: Floats
    right: Floats
    beta: Floats

    def step(self, damping: float) -> Floats:
        """Return the step of all shape parameters, (S,), in logarithms or in the unit of each."""
        k, size = len(self.beta), np.sqrt(np.maximum(np.diag(self.gram), 1e-300))
        rest = self.right - self.gram[:, :k] @ self.beta
        G = self.gram / np.outer(size, size)
        G[k:, k:] += damping * np.eye(len(size) - k)
        return np.asarray(np.linalg.lstsq(G, rest / size, rcond=1e-12)[0] / size)[k:]


def _shape_fit(regression: WhitenedRegression, selected: Sequence[SelectedEffect]) -> _ShapeFit:
    """Fit amplitudes jointly with the baseline, and linearise in the shapes."""
    blocks: list[dict[int, Floats]] = []
    for one in selected:
        shapes = [one.shape, *(_stepped_shape(one, name, STEP) for name in one.free_shape)]
        tried = whitened_columns(regression, one.effect, one.joints, shapes)
        blocks.append(tried)
    columns = [{j: C[0] for j, C in tried.items()} for tried in blocks]
    gram, right = _products(regression, columns)
    beta = np.asarray(np.linalg.lstsq(gram, right, rcond=1e-12)[0], dtype=np.float64)
    at, slopes = 0, []
    for one, tried in zip(selected, blocks, strict=True):
        count = len(next(iter(tried.values()))[0])
        own = beta[at : at + count]
        at += count
        slopes += [
            {j: (own @ (C[1 + s] - C[0]) / STEP)[None] for j, C in tried.items()}
            for s in range(len(one.free_shape))
        ]
    wide, product = _products(regression, [*columns, *slopes])
    return _ShapeFit(float(right @ beta), wide, product, beta)


def _products(
    regression: WhitenedRegression, columns: Sequence[EffectColumns]
) -> tuple[Floats, Floats]:
    """Return Gram matrix and products with the residual of columns jointly with the baseline, (K, K) and (K,)."""
    counts = [len(next(iter(one.values()))) for one in columns]
    edges = np.cumsum([0, *counts])
    fit, total = regression.fit, int(edges[-1])
    gram, right = np.zeros((total, total)), np.zeros(total)
    for j in sorted({joint for one in columns for joint in one}):
        here = [k for k, one in enumerate(columns) if j in one]
        rows = np.concatenate([np.arange(edges[k], edges[k + 1]) for k in here])
        C = np.concatenate([columns[k][j] for k in here])
        gram[np.ix_(rows, rows)] += C @ C.T
        right[rows] += C @ fit.e[j]
    P = np.concatenate([regression.products(one) for one in columns]) @ fit.root
    return gram - P @ P.T, right


def _stepped_shape(one: SelectedEffect, name: str, step: float) -> dict[str, float]:
    """Return the shape with one parameter moved, in its logarithm where it is refined by factors."""
    value = one.shape[name]
    return one.shape | {
        name: value * np.exp(step) if one.effect.steps[name][0] == "times" else value + step
    }


def _moved(selected: Sequence[SelectedEffect], step: Floats) -> list[SelectedEffect]:
    """Return effects with their shape parameters moved, none further than two first steps of the search."""
    found, at = [], 0
    for one in selected:
        for name in one.free_shape:
            kind, size = one.effect.steps[name]
            most = 2 * (np.log(size) if kind == "times" else size)
            one = replace(
                one, shape=_stepped_shape(one, name, float(np.clip(step[at], -most, most)))
            )
            at += 1
        found.append(one)
    return found


def _with_numbers(
    regression: WhitenedRegression, selected: Sequence[SelectedEffect], k: int
) -> SelectedEffect:
    """Return one effect with amplitudes and shape; its slopes join its columns, so that errors know of each other."""
    one = selected[k]
    others = with_selected(regression, [other for other in selected if other is not one])
    units = one.effect.amplitudes(one.shape)
    start = sum(len(other.effect.amplitudes(other.shape)) for other in selected[:k])
    beta = regression.amplitudes[start : start + len(units)]
    columns = _linearised(regression, one, beta)
    base = {j: C[: len(units)] for j, C in columns.items()}
    test = significance_test(others, columns)
    # Why: blocks of time say nothing of how far the links may be from what the prior takes them for.
    covariance = test.covariance + test.open if regression.link_prior else test.covariance
    sizes = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    return replace(
        one,
        test=replace(significance_test(others, base), amplitudes=beta),
        values=dict(zip(units, beta.tolist(), strict=True)) | dict(one.shape),
        std_errors={name: float("inf") for name in one.effect.steps}
        | dict(zip([*units, *one.free_shape], sizes.tolist(), strict=True)),
        z=_distance(beta, covariance[: len(beta), : len(beta)]),
    )


def _linearised(regression: WhitenedRegression, one: SelectedEffect, beta: Floats) -> EffectColumns:
    """Return whitened columns of an effect, and slopes of its torque in its free shape, {joint: (k, M)}."""
    columns = {
        j: C[0]
        for j, C in whitened_columns(regression, one.effect, one.joints, [one.shape]).items()
    }
    base = dict(columns)
    for name in one.free_shape:
        step = STEP * max(abs(one.shape[name]), 1e-3)
        shape = one.shape | {name: one.shape[name] + step}
        near = whitened_columns(regression, one.effect, one.joints, [shape])
        for j in base:
            columns[j] = np.vstack([columns[j], (beta @ (near[j][0] - base[j]) / step)[None]])
    return columns


def unsure_of_reversals(
    search: EffectSearch, effects: Sequence[SelectedEffect]
) -> list[SelectedEffect]:
    """Return effects whose errors also count what another shape of reversals would change of them.

    Numbers are fitted with the model's own sign of friction. Where columns of other widths with it move them by more
    than these columns' own noise does, they depend on what nobody knows.

    Source: Hausman 1978, "Specification tests in econometrics", for the variance of the difference.

    Args:
        search: the search.
        effects: what it found, with numbers.
    """
    problem, shown = search.problem, with_columns(effects)
    if problem.arm is not None:
        return list(effects)
    bare, judged = problem.regression(nuisance=False), problem.regression()
    found = []
    for one in effects:
        if one not in shown:
            found.append(one)
            continue
        others = [other for other in shown if other is not one]
        columns = _linearised(bare, one, np.array([one.values[name] for name in one.amplitudes]))
        own, wide = (
            significance_test(with_selected(rows, others), columns) for rows in (bare, judged)
        )
        noise = np.maximum(np.diag(wide.covariance) - np.diag(own.covariance), 0.0)
        more = np.maximum((wide.amplitudes - own.amplitudes) ** 2 - noise, 0.0)
        names = [*one.amplitudes, *one.free_shape]
        errors = {
            name: float(np.hypot(one.std_errors[name], x))
            for name, x in zip(names, more**0.5, strict=True)
        }
        found.append(replace(one, std_errors=one.std_errors | errors))
    return found


def lead_over_always(
    regression: WhitenedRegression, selected: Sequence[SelectedEffect], k: int
) -> tuple[float, float]:
    """Return by how much more an effect explains when it acts since the earlier logs than when it always did, twice.

    Args:
        regression: rows of earlier and new logs, with the selected effects.
        selected: these effects.
        k: which of them.

    Returns:
        Difference of the gains, and its spread over blocks of time.
    """
    one = selected[k]
    others = with_selected(regression, [other for other in selected if other is not one])
    every = replace(others, segments=[replace(s, is_new=True) for s in others.segments])
    gains = []
    for rows in (others, every):
        columns = whitened_columns(rows, one.effect, one.joints, [one.shape])
        gains.append(significance_test(others, {j: C[0] for j, C in columns.items()}).gains)
    difference = gains[0] - gains[1]
    return float(difference.sum()), float(np.std(difference) * np.sqrt(len(difference)))


def _distance(beta: Floats, covariance: Floats) -> float:
    """Return how unlikely it is that amplitudes are zero, as the standard errors of a single one that is as unlikely.

    Args:
        beta: amplitudes, (k,).
        covariance: of them, (k, k).
    """
    from scipy import special

    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    whole = covariance / np.outer(size, size)
    square = float(beta / size @ np.linalg.lstsq(whole, beta / size, rcond=1e-12)[0])
    chance = float(special.chdtrc(len(beta), max(square, 0.0)))
    return float(-special.ndtri(chance / 2)) if chance > 1e-300 else float(np.sqrt(square))


def held_out_improvement(
    first: GapProblem, search: EffectSearch, effects: Sequence[SelectedEffect]
) -> HeldOutImprovement:
    """Return the gap on held-out rows before and after; both models are fitted to the training rows alone.

    Args:
        first: the problem before any delay was taken out.
        search: the search.
        effects: what it found.
    """
    # Why the same noise: it weighs the joints, and another weight is another fit.
    before = _held_residuals(
        replace(first, noise=search.problem.noise), [], search.problem.in_force
    )
    after = _held_residuals(search.problem, with_columns(effects), search.problem.in_force)
    rms = np.array(
        [
            [np.sqrt(np.mean(e**2)) if len(e) else 0.0 for e, _ in joints]
            for joints in (before, after)
        ]
    )
    pairs = list(zip(before, after, strict=True))
    ratio = np.array([_ratio(b, a, j, few=first.since) for j, (b, a) in enumerate(pairs)])
    # Why another test: few blocks of time are held out there, and their ratio says too little.
    chance = np.array([chance_of_growth(b, a) for b, a in pairs]) if first.since else None
    known = _held_known_errors(search.problem, search.errors)
    return HeldOutImprovement(rms[0], rms[1], ratio, search.problem.noise.floor, known, chance)


def _held_known_errors(problem: GapProblem, errors: KnownErrors) -> Floats:
    """Return the rms of what no effect has to explain on held-out rows, but for noise, (n,) [N m or N]."""
    first, n = problem.noise.order, problem.base.robot.n
    power, count = np.zeros(n), np.zeros(n)
    for s in cut(problem.segments, problem.held):
        use = s.use[first:]
        if use.any():
            power += np.sum(np.where(use, errors.power(s)[first:], 0.0), axis=0)
            count += use.sum(axis=0)
    return np.sqrt(power / np.maximum(count, 1))


def chance_of_growth(before: HeldOutRows, after: HeldOutRows) -> float:
    """Return the chance of so much larger residuals when they are no larger in truth, of Student's t over blocks.

    Args:
        before: residuals and numbers of their blocks of time, (M,) each.
        after: others of the same rows; of other rows, or of too few blocks, the chance is 1.
    """
    from scipy import special

    names, index = np.unique(before[1], return_inverse=True)
    if len(names) < MIN_LONG_BLOCKS or len(before[0]) != len(after[0]):
        return 1.0
    more = np.bincount(index, after[0] ** 2 - before[0] ** 2, len(names))
    error = max(float(more.std(ddof=1)) / np.sqrt(len(names)), 1e-300)
    return float(special.stdtr(len(names) - 1, -float(more.mean()) / error))


def fitted_with(problem: GapProblem, selected: Sequence[SelectedEffect]) -> WhitenedRegression:
    """Fit model and effects together to the training rows, without what is not judged.

    Effects that follow the model's torque follow that of the fit.
    """
    regression = with_selected(problem.regression(nuisance=False), selected)
    if not selected:
        return regression
    theta = regression.fit.theta[: problem.base.reduction.rank]
    return with_selected(problem.regression(theta, nuisance=False), selected)


def _held_residuals(
    problem: GapProblem, selected: Sequence[SelectedEffect], in_force: NoiseModel | None
) -> list[HeldOutRows]:
    """Return held-out torque residuals and blocks of time of each joint, {(M_j,), (M_j,)}.

    Args:
        problem: the problem.
        selected: effects that are fitted with the model.
        in_force: noise of the rows jointly with the best possible arm; None to fit the model without bounds.
    """
    problem = problem if in_force is None else replace(problem, noise=in_force)
    regression = fitted_with(problem, selected)
    if in_force is not None:
        regression = near_possible(problem, regression)
    elif problem.arm is not None:
        # Why not as it is searched: the parabola is wide, and lets links be what no arm has.
        regression = at_possible(problem, regression)
    held = cut(problem.segments, problem.held)
    theta = regression.fit.theta[: held[0].W.shape[2]]
    torques = [torque_in_rows(s, selected, regression.amplitudes) for s in regression.segments]
    # Why longer: what a joint leaves of a comparison with earlier logs is not whitened, and goes on for longer.
    times = jackknife_blocks(held, LONGEST_BLOCK if problem.since else SHORTEST_BLOCK)
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


def _ratio(before: HeldOutRows, after: HeldOutRows, seed: int, *, few: bool) -> Floats:
    """Return the 95 % interval of the ratio of rms values, (2,), of few long blocks of time or of many short ones."""
    names, block = np.unique(before[1], return_inverse=True)
    if len(names) < (MIN_LONG_BLOCKS if few else MIN_BLOCKS) or len(before[0]) != len(after[0]):
        return np.array([0.0, np.inf])
    sums = [np.bincount(block, x[0] ** 2, len(names)).astype(np.float64) for x in (before, after)]
    return few_blocks_interval(*sums) if few else ratio_interval(sums[0], sums[1], seed)


def few_blocks_interval(before: Floats, after: Floats) -> Floats:
    """Return the 95 % interval of the ratio of rms values, from sums of squares of few blocks, (B,) each, as (2,).

    Blocks that are drawn with replacement say too little of what a few of them may be off by: Student's t, and the
    error of a ratio to first order.
    """
    from scipy import special

    count, total = len(before), max(float(before.sum()), 1e-300)
    share = float(after.sum()) / total
    error = np.sqrt(count / (count - 1) * np.sum((after - share * before) ** 2)) / total
    reach = float(special.stdtrit(count - 1, 0.975)) * error
    return np.sqrt(np.maximum([share - reach, share + reach], 0.0))


def ratio_interval(before: Floats, after: Floats, seed: int) -> Floats:
    """Return the 95 % interval of the ratio of rms values, from sums of squares of B blocks, (B,) each, as (2,)."""
    counts = np.random.default_rng(seed).multinomial(
        len(before), np.full(len(before), 1 / len(before)), DRAWS
    )
    ratios = np.sqrt(counts @ after / np.maximum(counts @ before, 1e-30))
    interval: Floats = np.quantile(ratios, [0.025, 0.975])
    return interval
