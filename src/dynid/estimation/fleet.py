"""Parameters of many arms over many runs: which changed, and which arm differs from others of its model.

A run's parameter differs from the next by its standard error and by what differs between days: temperature, load
history, the person who mounted the arm. That drift is not in the covariance of any run; it is estimated from how runs
of one arm follow each other, and each arm's variance is steadied by what the other arms do. A change is a step that
neither explains. False alarms are controlled over all arms and parameters.

Source: Hampel 1974 (outlying runs); Smyth 2004 (moderated t); Simes 1986, Benjamini, Hochberg 1995, Benjamini,
Bogomolov 2014 (arms first, then their parameters).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]

#: Expected share of false ones among the arms that are called changed, or different from others of their model.
FALSE_SHARE = 0.05
#: Runs of an arm below which nothing is said about a change, and arms from which on a fleet knows what is usual.
FEWEST_RUNS, FLEET = 3, 8
#: A run is off when it is this many standard deviations from the median of so many runs around it.
OFF, WINDOW = 5.0, 5
#: Runs on either side of a change: one that is off is no change, and a change is called from the third run on.
SIDE = 2
#: Longer histories are averaged to so many points, so that the work grows with their length and not with its cube.
LONGEST = 64
#: Arms that are worked on together.
TOGETHER = 1024
#: How long drift lasts, in days; the shortest stands for days that know nothing of each other.
MEMORIES = (0.05, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 32.0)
#: Lags from which the drift is estimated, and the share of the most restless arms that is left out.
LAGS, RESTLESS = 8, 0.1
#: A series whose change is this unlikely by chance does not take part when the usual drift is estimated.
SUSPECT = 1e-3


@dataclass(frozen=True)
class History:
    """Parameters of A arms of one type in up to N runs each; runs in order of time, missing ones NaN.

    Attributes:
        arms: names, (A,).
        names: parameters, (P,).
        t: when, (A, N) [days].
        value: (A, N, P), each in its unit.
        std_error: of each, (A, N, P); infinite or NaN where a run does not determine it.
    """

    arms: tuple[str, ...]
    names: tuple[str, ...]
    t: Floats
    value: NDArray[np.floating]
    std_error: NDArray[np.floating]


@dataclass(frozen=True)
class Change:
    """A parameter of an arm that changed.

    Attributes:
        arm: its name.
        parameter: name.
        since: time of the first run after it [days].
        before: mean of the runs before.
        after: mean of the runs after.
        std_error: of the difference, drift included.
        p_value: chance of such a step anywhere in this series when nothing changed.
    """

    arm: str
    parameter: str
    since: float
    before: float
    after: float
    std_error: float
    p_value: float


@dataclass(frozen=True)
class Outlier:
    """A parameter in which an arm differs from arms of its type.

    Attributes:
        arm: its name.
        parameter: name.
        value: its level.
        usual: that of the others: their median, or that of the one it is compared with.
        spread: standard deviation between arms, errors included.
        p_value: chance of such a difference between equal arms.
        other: the arm that it is compared with; "" for the fleet.
    """

    arm: str
    parameter: str
    value: float
    usual: float
    spread: float
    p_value: float
    other: str = ""


@dataclass(frozen=True)
class Usual:
    """What is usual for a parameter.

    Attributes:
        parameter: name.
        level: median of the arms.
        std_error: median of the runs' standard errors.
        between_runs: standard deviation of the drift of an arm.
        memory: how long it lasts [days].
        common: standard deviation of what all arms have in common from day to day.
        scale: variance of what is left against errors and drift; 1 where both are right.
        freedom: degrees of freedom that the other arms add to an arm's own.
    """

    parameter: str
    level: float
    std_error: float
    between_runs: float
    memory: float
    common: float
    scale: float
    freedom: float


@dataclass(frozen=True)
class FleetFindings:
    """What the histories of arms of one type say.

    Attributes:
        history: what was looked at.
        changes: what changed, the most certain first.
        outliers: where an arm differs from others of its model, the most certain first.
        usual: what is usual for each parameter, (P,).
        p_values: chance of each series when nothing changed, (A, P); NaN where it was not tested.
        off: number of runs of each arm whose parameters were left out as off, (A,).
    """

    history: History
    changes: tuple[Change, ...]
    outliers: tuple[Outlier, ...]
    usual: tuple[Usual, ...]
    p_values: Floats
    off: NDArray[np.int64]


@dataclass(frozen=True)
class _Steps:
    """The best step of each series, (A,) each.

    Attributes:
        power: sum of squares that it takes away, in units of the run's variance.
        firm: what it takes away when the run that speaks most for it is left out.
        firm_rest: what is left then.
        rss: sum of squares without it.
        count: number of runs.
        split: the first run after it.
        before: mean before.
        after: mean after.
        variance: of their difference.
        level: mean of the series.
        level_variance: its variance.
    """

    power: Floats
    firm: Floats
    firm_rest: Floats
    rss: Floats
    count: NDArray[np.int64]
    split: NDArray[np.int64]
    before: Floats
    after: Floats
    variance: Floats
    level: Floats
    level_variance: Floats


@dataclass(frozen=True)
class _Tested:
    """The series of one parameter after the test, (A,) each."""

    p_value: Floats
    split: NDArray[np.int64]
    before: Floats
    after: Floats
    std_error: Floats
    level: Floats
    level_error: Floats
    off: Mask
    usual: Usual


def look_at(history: History, false_share: float = FALSE_SHARE) -> FleetFindings:
    """Find what changed in the histories of arms of one type, and which arms are unlike the others.

    Args:
        history: parameters over time.
        false_share: expected share of false ones among the arms that are named.
    """
    short = shortened(history)
    tested = [_test(short, k) for k in range(len(history.names))]
    p_values = np.column_stack([each.p_value for each in tested])
    named = _selected(p_values, false_share)
    changes = [
        Change(
            arm=history.arms[a],
            parameter=history.names[k],
            since=float(short.t[a, tested[k].split[a]]),
            before=float(tested[k].before[a]),
            after=float(tested[k].after[a]),
            std_error=float(tested[k].std_error[a]),
            p_value=float(p_values[a, k]),
        )
        for a, k in np.argwhere(named)
    ]
    off = np.any([each.off for each in tested], axis=0).sum(axis=1)
    return FleetFindings(
        history=history,
        changes=tuple(sorted(changes, key=lambda each: (each.p_value, each.arm, each.parameter))),
        outliers=_outliers(short, tested, named, false_share),
        usual=tuple(each.usual for each in tested),
        p_values=p_values,
        off=np.asarray(off, dtype=np.int64),
    )


# ---------------------------------------------------------------- one parameter of all arms
def shortened(history: History) -> History:
    """Return a history of at most ``LONGEST`` points an arm: where there are more, neighbours are averaged."""
    runs = history.t.shape[1]
    if runs <= LONGEST:
        return history
    weight = (
        np.where(_known(history.value, history.std_error), 1.0, 0.0)
        / np.maximum(history.std_error, 1e-300) ** 2
    )
    weight = np.where(np.isfinite(weight), weight, 0.0)
    edges = np.linspace(0, runs, LONGEST + 1).astype(int)[:-1]
    total = np.add.reduceat(weight, edges, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        value = (
            np.add.reduceat(np.where(weight > 0, weight * history.value, 0.0), edges, axis=1)
            / total
        )
        counts = np.add.reduceat(np.isfinite(history.t).astype(float), edges, axis=1)
        t = (
            np.add.reduceat(np.where(np.isfinite(history.t), history.t, 0.0), edges, axis=1)
            / counts
        )
        return History(history.arms, history.names, t, value, 1.0 / np.sqrt(total))


def _known(value: NDArray[np.floating], std_error: NDArray[np.floating]) -> Mask:
    return np.asarray(np.isfinite(value) & np.isfinite(std_error) & (std_error > 0))


def _test(history: History, k: int) -> _Tested:
    """Test the series of one parameter for a step."""
    t = np.asarray(history.t, dtype=float)
    y, s = (np.asarray(x[:, :, k], dtype=float) for x in (history.value, history.std_error))
    known = _known(y, s) & np.isfinite(t)
    y, common = _without_common(t, y, known)
    every = np.ones(len(t), dtype=bool)
    good = known & ~_off(y, s, known, _drift(t, y, s, known, every, RESTLESS)[0])
    usual, left_out = every, RESTLESS
    for _ in range(2):
        omega2, memory = _drift(t, y, s, good, usual, left_out)
        parts = [
            _steps(t[part], y[part], s[part], good[part], omega2, memory)
            for part in (slice(first, first + TOGETHER) for first in range(0, len(t), TOGETHER))
        ]
        found = _Steps(
            *(
                np.concatenate(each)
                for each in zip(*(vars(part).values() for part in parts), strict=True)
            )
        )
        p_value, scale, freedom = _judged(found)
        # Why twice: the most restless arms were left out for the sake of those that changed, which are known now.
        usual, left_out = ~(p_value < SUSPECT), 0.0
    own = _moderated(found.rss - found.power, found.count - 2, scale, freedom)
    table = Usual(
        parameter=history.names[k],
        level=_median(found.level[found.count > 0]),
        std_error=_median(s[known]),
        between_runs=float(np.sqrt(omega2 * scale)),
        memory=memory,
        common=common,
        scale=scale,
        freedom=freedom,
    )
    errors = (np.sqrt(variance * own) for variance in (found.variance, found.level_variance))
    return _Tested(
        p_value,
        found.split,
        found.before,
        found.after,
        next(errors),
        found.level,
        next(errors),
        known & ~good,
        table,
    )


def _judged(found: _Steps) -> tuple[Floats, float, float]:
    """Return the chance of each series, (A,), what is usual for its variance, and how much knowing that is worth."""
    enough = found.count >= FEWEST_RUNS
    usual = enough.copy()
    p_value, scale, freedom = np.full(len(enough), np.nan), 1.0, 0.0
    for _ in range(3):
        scale, freedom = _usual_variance(
            found.rss[usual] / (found.count[usual] - 1), found.count[usual] - 1
        )
        p_value = np.where(enough, _chance(found, scale, freedom), np.nan)
        usual = enough & ~(p_value < SUSPECT)
    return p_value, scale, freedom


def _median(x: Floats) -> float:
    return float(np.median(x)) if len(x) else float("nan")


def _without_common(t: Floats, y: Floats, known: Mask) -> tuple[Floats, float]:
    """Return the series without what all arms have in common on a day (A, N), and how large that is."""
    if len(y) < FLEET or not known.any():
        return y, 0.0
    apart = np.where(known, y, np.nan)
    with np.errstate(all="ignore"):
        apart = apart - _nanmedian(apart, axis=1)[:, None]
    day = np.where(known, np.floor(t), np.nan)
    values, which = np.unique(day[known], return_inverse=True)
    deviations = apart[known]
    order = np.argsort(which, kind="stable")
    edges = np.searchsorted(which[order], np.arange(len(values) + 1))
    shift = np.array(
        [
            np.median(deviations[order[a:b]]) if b - a >= FLEET else 0.0
            for a, b in pairwise(edges.tolist())
        ]
    )
    shift -= np.median(shift)
    found = y.copy()
    found[known] -= shift[which]
    return found, float(np.std(shift))


def _nanmedian(x: Floats, axis: int) -> Floats:
    import warnings

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.asarray(np.nanmedian(x, axis=axis))


def _drift(
    t: Floats, y: Floats, s: Floats, known: Mask, arms: Mask, left_out: float
) -> tuple[float, float]:
    """Return the variance of the drift between runs, and how long it lasts [days].

    Half the mean square difference of runs that are apart by a time; what is more than their errors is drift. Steps
    count in few differences only, and a share of the most restless arms is left out.
    """
    t, y, s, known = t[arms], y[arms], s[arms], known[arms]
    lags, gaps, excess = [], [], []
    for lag in range(1, min(LAGS, t.shape[1] - 1) + 1):
        both = known[:, lag:] & known[:, :-lag]
        pairs = both.sum(axis=1)
        if not pairs.any():
            continue
        half = (
            np.where(
                both, (y[:, lag:] - y[:, :-lag]) ** 2 - s[:, lag:] ** 2 - s[:, :-lag] ** 2, 0.0
            ).sum(axis=1)
            / 2
        )
        gap = np.where(both, t[:, lag:] - t[:, :-lag], 0.0).sum(axis=1)
        each = np.sort(half[pairs > 0] / pairs[pairs > 0])
        lags.append(float(lag))
        gaps.append(gap.sum() / pairs.sum())
        excess.append(float(np.mean(each[: max(1, round((1 - left_out) * len(each)))])))
    if not excess:
        return 0.0, MEMORIES[0]
    weight = 1.0 / np.array(lags)
    best = (np.inf, 0.0, MEMORIES[0])
    for memory in MEMORIES:
        shape = 1.0 - np.exp(-np.array(gaps) / memory)
        size = max(
            0.0,
            float((weight * shape) @ np.array(excess))
            / max(float((weight * shape) @ shape), 1e-300),
        )
        misfit = float(weight @ (np.array(excess) - size * shape) ** 2)
        if misfit < best[0] * (1 - 1e-9):
            best = (misfit, size, memory)
    return best[1], best[2]


def _off(y: Floats, s: Floats, known: Mask, omega2: float) -> Mask:
    """Return which runs are far from the median of the runs around them, (A, N)."""
    runs = y.shape[1]
    if runs < WINDOW:
        return np.zeros(y.shape, dtype=bool)
    # Why first in a row: missing runs would otherwise take the place of neighbours.
    order = np.argsort(~known, axis=1, kind="stable")
    row = np.arange(len(y))[:, None]
    dense, count = np.where(known, y, np.nan)[row, order], known.sum(axis=1)
    spread = np.sqrt(np.where(known, s, 0.0)[row, order] ** 2 + omega2)
    first = np.clip(np.arange(runs)[None] - WINDOW // 2, 0, np.maximum(count - WINDOW, 0)[:, None])
    around = np.stack([dense[row, np.minimum(first + j, runs - 1)] for j in range(WINDOW)], axis=2)
    far = np.abs(dense - _nanmedian(around, axis=2)) > OFF * spread
    far &= (count >= WINDOW)[:, None] & np.isfinite(dense)
    found = np.zeros(y.shape, dtype=bool)
    found[row, order] = far
    return found


def _steps(t: Floats, y: Floats, s: Floats, good: Mask, omega2: float, memory: float) -> _Steps:
    """Fit the best step to each series of runs, (A, N), by generalised least squares."""
    A, N = y.shape
    count = good.sum(axis=1)
    # Why a unit of its own: what is missing weighs nothing next to it, whatever the parameter's unit is.
    unit = np.sqrt(np.median(s[good] ** 2) + omega2) if good.any() else 1.0
    time = np.where(np.isfinite(t), t, 0.0)
    C = omega2 / unit**2 * np.exp(-np.abs(time[:, :, None] - time[:, None, :]) / memory)
    C *= good[:, :, None] & good[:, None, :]
    C[:, np.arange(N), np.arange(N)] += np.where(good, (s / unit) ** 2, 1.0)
    lower = np.linalg.inv(np.linalg.cholesky(C))
    after = (np.arange(N)[:, None] >= np.arange(1, N)[None]).astype(float)
    columns = np.concatenate(
        [
            np.where(good, y / unit, 0.0)[:, :, None],
            good[:, :, None].astype(float),
            after[None] * good[:, :, None],
        ],
        axis=2,
    )
    white = lower @ columns
    one = white[:, :, 1]
    weight = np.maximum(np.einsum("an,an->a", one, one), 1e-300)
    level = np.einsum("an,an->a", one, white[:, :, 0]) / weight
    rest = white[:, :, 0] - level[:, None] * one
    share = np.einsum("an,ank->ak", one, white[:, :, 2:]) / weight[:, None]
    steps = white[:, :, 2:] - share[:, None, :] * one[:, :, None]
    power = np.einsum("ank,ank->ak", steps, steps)
    behind = np.cumsum(good[:, ::-1], axis=1)[:, ::-1][:, 1:]
    side = np.where(count >= 2 * SIDE + 1, SIDE, 1)[:, None]
    possible = good[:, 1:] & (behind >= side) & (count[:, None] - behind >= side) & (power > 1e-12)
    size = np.einsum("ank,an->ak", steps, rest) / np.where(possible, power, 1.0)
    num2 = np.where(possible, size**2 * power, 0.0)
    best = np.argmax(num2, axis=1)
    a = np.arange(A)
    before = level - size[a, best] * share[a, best]
    step = np.where(possible[a, best][:, None], steps[a, :, best], 0.0)
    firm, firm_rest = _firm(step, rest, one, weight, lower, good)
    return _Steps(
        power=num2[a, best],
        firm=firm,
        firm_rest=firm_rest,
        rss=np.einsum("an,an->a", rest, rest),
        count=count,
        split=best + 1,
        before=before * unit,
        after=(before + size[a, best]) * unit,
        variance=unit**2 / np.where(power[a, best] > 1e-12, power[a, best], np.inf),
        level=level * unit,
        level_variance=unit**2 / weight,
    )


def _firm(
    step: Floats, rest: Floats, one: Floats, weight: Floats, lower: Floats, good: Mask
) -> tuple[Floats, Floats]:
    """Return what a step takes away, (A,), without the run that speaks most for it, and what is left then.

    Args:
        step: whitened step without its mean, (A, N).
        rest: whitened series without its mean, (A, N).
        one: whitened constant, (A, N).
        weight: its square, (A,).
        lower: what whitens, (A, N, N); its columns stand for single runs.
        good: runs that count, (A, N).
    """
    run = (
        lower
        - (np.einsum("an,ank->ak", one, lower) / weight[:, None])[:, None, :] * one[:, :, None]
    )
    uu, ur, rr = (
        np.einsum("an,an->a", x, y)[:, None] for x, y in ((step, step), (step, rest), (rest, rest))
    )
    vv = np.einsum("ank,ank->ak", run, run)
    uv, vr = (np.einsum("an,ank->ak", x, run) for x in (step, rest))
    left = np.where(good & (vv > 1e-12), uu - uv**2 / np.where(vv > 1e-12, vv, 1.0), 0.0)
    size = ur - uv * vr / np.where(vv > 1e-12, vv, 1.0)
    # Why the sign: a step that turns round without one run was that run.
    power = np.where(
        (left > 1e-9 * uu) & (size * ur > 0), size**2 / np.where(left > 0, left, 1.0), 0.0
    )
    power = np.where(good, power, np.inf)
    least = np.argmin(power, axis=1)
    a = np.arange(len(step))
    found = np.where(np.isfinite(power[a, least]), power[a, least], 0.0)
    return found, np.maximum(
        rr[:, 0] - (vr**2 / np.where(vv > 1e-12, vv, 1.0))[a, least] - found, 0.0
    )


def _chance(found: _Steps, scale: float, prior: float) -> Floats:
    """Return the chance of the best step of each series when nothing changed: Student's t, at most so many places."""
    from scipy import special

    freedom = np.maximum(found.count - 3, 0)
    own = _moderated(found.firm_rest, freedom, scale, prior)
    t = np.sqrt(found.firm / np.maximum(own, 1e-300))
    tail = 2.0 * special.stdtr(np.maximum(np.minimum(prior, 1e9) + freedom, 1.0), -t)
    side = np.where(found.count >= 2 * SIDE + 1, SIDE, 1)
    return np.asarray(np.minimum(1.0, np.maximum(found.count + 1 - 2 * side, 1) * tail))


# ---------------------------------------------------------------- arms of one model
def _outliers(
    history: History, tested: Sequence[_Tested], changed: Mask, share: float
) -> tuple[Outlier, ...]:
    """Return arms that are unlike the others; what has changed is not asked again."""
    from scipy import special

    level = np.column_stack([each.level for each in tested])
    error = np.column_stack([each.level_error for each in tested])
    p_value = np.column_stack([each.p_value for each in tested])
    known = np.isfinite(level) & np.isfinite(error) & (error > 0) & ~np.isnan(p_value) & ~changed
    level, error = np.where(known, level, np.nan), np.where(known, error, np.nan)
    arms = len(history.arms)
    found: list[Outlier] = []
    if arms >= FLEET:
        usual = _nanmedian(level, axis=0)
        # Why at least the error: of arms that are equal but for noise, the errors are all that is between them.
        between = 1.4826 * _nanmedian(np.abs(level - usual), axis=0)
        common = _nanmedian(error, axis=0) ** 2
        spread = np.sqrt(np.maximum(between**2, common) + np.maximum(error**2 - common, 0))
        p_values = 2.0 * special.stdtr(max(arms - 1, 1), -np.abs(level - usual) / spread)
        for a, k in np.argwhere(_selected(p_values, share)):
            found.append(
                Outlier(
                    history.arms[a],
                    history.names[k],
                    float(level[a, k]),
                    float(usual[k]),
                    float(spread[a, k]),
                    float(p_values[a, k]),
                )
            )
        return tuple(sorted(found, key=lambda each: each.p_value))
    pairs = [(a, b) for a in range(arms) for b in range(a + 1, arms)]
    if not pairs:
        return ()
    first, second = (np.array(each) for each in zip(*pairs, strict=True))
    runs = np.array([np.sum(np.isfinite(history.t), axis=1)]).ravel()
    spread = np.sqrt(error[first] ** 2 + error[second] ** 2)
    prior = np.array([min(each.usual.freedom, 1e9) for each in tested])
    freedom = np.maximum(prior[None] + (runs[first] + runs[second] - 2)[:, None], 1.0)
    p_values = 2.0 * special.stdtr(freedom, -np.abs(level[first] - level[second]) / spread)
    for row, k in np.argwhere(_selected(p_values, share)):
        a, b = pairs[row]
        found.append(
            Outlier(
                history.arms[b],
                history.names[k],
                float(level[b, k]),
                float(level[a, k]),
                float(spread[row, k]),
                float(p_values[row, k]),
                history.arms[a],
            )
        )
    return tuple(sorted(found, key=lambda each: each.p_value))


# ---------------------------------------------------------------- variances of small samples, and many tests
def _moderated(rss: Floats, freedom: NDArray[np.int64], scale: float, prior: float) -> Floats:
    """Return each series' variance, its own steadied by that of the others, (A,).

    Args:
        rss: sum of squares that each leaves, (A,).
        freedom: its degrees of freedom, (A,).
        scale: what is usual, from ``_usual_variance``.
        prior: how many degrees of freedom knowing that is worth.
    """
    if np.isinf(prior):
        return np.full(len(rss), scale)
    return np.asarray(
        (prior * scale + np.maximum(rss, 0.0)) / np.maximum(prior + np.maximum(freedom, 0), 1.0)
    )


def _usual_variance(variances: Floats, freedom: NDArray[np.int64]) -> tuple[float, float]:
    """Return what is usual among variances of small samples, and how many degrees of freedom knowing it is worth.

    Source: Smyth 2004, section 6.2: moments of the logarithms.
    """
    from scipy import optimize, special

    use = variances > 0
    if use.sum() < 2:
        return max(1.0, float(np.mean(variances)) if len(variances) else 1.0), 0.0
    d = freedom[use].astype(float)
    e = np.log(variances[use]) - special.digamma(d / 2) + np.log(d / 2)
    excess = float(np.var(e, ddof=1) - np.mean(special.polygamma(1, d / 2)))
    if excess <= 0:
        return float(np.exp(np.mean(e))), float("inf")
    half = optimize.brentq(lambda y: special.polygamma(1, y) - excess, 1e-6, 1e9)
    return float(np.exp(np.mean(e) + special.digamma(half) - np.log(half))), 2.0 * half


def _selected(p_values: Floats, share: float) -> Mask:
    """Return which parameters of which arms are named, (A, P).

    Arms are selected first, so that the share of false ones holds for arms; the parameters of each are then tested as
    strictly as the number of selected arms asks for.
    """
    known = np.sum(~np.isnan(p_values), axis=1)
    ordered = np.sort(np.where(np.isnan(p_values), 2.0, p_values), axis=1)
    simes = np.min(ordered / np.arange(1, p_values.shape[1] + 1), axis=1) * known
    arms = _holding(np.where(known > 0, np.minimum(simes, 1.0), np.nan), share)
    inside = share * arms.sum() / max(1, int(np.sum(known > 0)))
    found = np.zeros(p_values.shape, dtype=bool)
    for a in np.flatnonzero(arms):
        found[a] = _holding(p_values[a], inside)
    return found


def _holding(p_values: Floats, share: float) -> Mask:
    """Return which tests hold when an expected share of those that hold may be false; NaN never holds."""
    from scipy.stats import false_discovery_control

    known = ~np.isnan(p_values)
    found = np.zeros(p_values.shape, dtype=bool)
    if known.any():
        found[known] = false_discovery_control(p_values[known]) <= share
    return found
