"""The noise floor of torques: what no model could explain, from motions that were driven twice, else a lower bound."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from dynid.arrays import Floats, Mask
from dynid.estimation import tuning
from dynid.estimation.residual_model import ModelError, residuals
from dynid.estimation.rows import at_rows
from dynid.estimation.stack import Stack
from dynid.signals.filters import Filter
from dynid.signals.motion import squares_apart

#: Part of a log without gaps: positions, what the model leaves, and the rows that count, (M, n) each.
Part: TypeAlias = tuple[Floats, Floats, Mask]


def noise_floor(
    stack: Stack, theta: Floats, error: ModelError | None = None
) -> tuple[Floats, float] | None:
    """Return the noise of the torques of a stack; None where its rows are too few, or gone.

    Two runs of one motion differ by what does not repeat, which is noise and nothing else. Without such runs, noise is
    taken as white before the filter, as high as the upper part of the pass band of what the model leaves: slower
    noise is not seen, so that this is a lower bound.

    Args:
        stack: the stacked logs.
        theta: base parameters, (p,).
        error: the residual model, None without.

    Returns:
        The rms of the noise after the filter that the torques get, (n,) [N m or N]; the seconds of repeated motion that
        it comes from, 0 where it is a lower bound.
    """
    chosen = stack.logs[0].filter
    parts = list(_parts(stack, theta, error))
    pairs = find_repeats([q for q, _, _ in parts], chosen.kept_rate)
    differences = [difference(parts[pair.first], parts[pair.second], pair.lag) for pair in pairs]
    seconds = sum(len(residual) for residual, _ in differences) / chosen.kept_rate
    if seconds >= tuning.SHORTEST_REPEAT_S:
        return _rms(differences), seconds
    long = [part[1:] for part in parts if len(part[1]) >= tuning.SPECTRUM_ROWS]
    return (floor_from_spectrum(long, chosen), 0.0) if long else None


def _parts(stack: Stack, theta: Floats, error: ModelError | None) -> Iterator[Part]:
    """Yield the parts of the logs without gaps, no more than a few minutes of each: these say what hours do."""
    rows = stack.rows
    end = rows.t[np.searchsorted(rows.log, rows.log)] + tuning.NOISE_SECONDS
    early = stack.take(rows.t <= end)
    left = residuals(early, theta, error)
    q = early.along(lambda log, t: at_rows(log, lambda part: part.q.T, t))
    for run in early.rows.runs:
        yield q[run], left[run], early.rows.use[run]


@dataclass(frozen=True)
class RepeatPair:
    """Two parts of the same motion: row k of the first is row k + lag of the second."""

    first: int
    second: int
    lag: float


def find_repeats(parts: Sequence[Floats], rate: float) -> list[RepeatPair]:
    """Find parts, and periods within a part, that hold the same motion: positions, (M, n) each, at one rate [Hz]."""
    pairs, shortest = [], round(tuning.SHORTEST_REPEAT_S * rate)
    for a, one in enumerate(parts):
        for b in range(a, len(parts)):
            lag = lag_of(one, parts[b], shortest, shortest if a == b else None)
            if lag is not None:
                pairs.append(RepeatPair(a, b, lag))
    return pairs


def difference(one: Part, other: Part, lag: float) -> tuple[Floats, Mask]:
    """Return the difference of two runs of one motion over the root of two, (K, n), and which of its rows count.

    A trend and another friction in one of them are taken off: these are no noise.

    Args:
        one: the first run.
        other: the second one.
        lag: by how many rows the motion comes later in it.
    """
    from scipy.ndimage import shift  # here: its import takes as long as many logs

    (q, left, use), (_, other_left, other_use) = one, other
    whole = int(lag // 1)
    here = slice(max(0, -whole), min(len(left), len(other_left) - whole))
    there = slice(here.start + whole, here.stop + whole)
    e = (left[here] - shift(other_left, (whole - lag, 0), order=5)[there]) / np.sqrt(2.0)
    both = use[here] & other_use[there]
    both[:8] = both[-8:] = False
    v, line = np.gradient(q[here], axis=0), np.arange(len(e))
    for j, counts in enumerate(both.T):
        A = np.column_stack([np.ones_like(line), line, np.sign(v[:, j]), v[:, j]])
        e[:, j] -= A @ np.linalg.lstsq(A[counts], e[counts, j], rcond=None)[0]
    return e, both


def lag_of(one: Floats, other: Floats, shortest: int, least: int | None) -> float | None:
    """Return the lag at which two motions agree, in rows; None where they are not the same.

    Args:
        one: positions, (M, n) [rad or m].
        other: positions at the same rate, (N, n) [rad or m].
        shortest: rows that have to overlap.
        least: smallest lag, within one motion; None for any.
    """
    scale = one.std(axis=0)
    moves = scale > tuning.STILL_RAD
    if not moves.any() or min(len(one), len(other)) < shortest:
        return None
    x, y = ((q - one.mean(axis=0))[:, moves] / scale[moves] for q in (one, other))
    lags, squares, count = squares_apart(x, y)
    apart = squares.sum(axis=1)
    wrong = (count < shortest) | (False if least is None else lags < least)
    mean = np.where(wrong, np.inf, apart / count / moves.sum())
    best = int(np.argmin(mean))
    if mean[best] > tuning.REPEATED**2 or not 0 < best < len(lags) - 1:
        return None
    left, middle, right = apart[best - 1 : best + 2]
    bend = left - 2.0 * middle + right
    return float(lags[best] + (0.5 * (left - right) / bend if bend > 0.0 else 0.0))


def _rms(parts: Iterable[tuple[Floats, Mask]]) -> Floats:
    """Return the root mean square of each joint over the rows that count, (n,)."""
    squares = sum(np.sum(np.where(use, x, 0.0) ** 2, axis=0) for x, use in parts)
    return np.sqrt(squares / np.maximum(1, sum(use.sum(axis=0) for _, use in parts)))


def floor_from_spectrum(parts: Sequence[tuple[Floats, Mask]], chosen: Filter) -> Floats:
    """Return the rms that white noise has after the filter, which is as high as the upper part of its pass band, (n,).

    Args:
        parts: what a model leaves of rows without gaps, and the rows that count, (M, n) each.
        chosen: the filters that they went through.
    """
    kernel, step = chosen.second_kernel[0], chosen.second_step
    low, high = np.array(tuning.NOISE_BAND) * chosen.cutoff
    powers: list[Floats] = []
    for residual, _ in parts:
        f, window = (
            np.fft.rfftfreq(len(residual), 1.0 / chosen.kept_rate),
            np.hanning(len(residual)),
        )
        spectrum = np.fft.rfft((residual - residual.mean(axis=0)) * window[:, None], axis=0)
        inside = (f > low) & (f < high)
        turns = np.outer(f[inside] / (step * chosen.kept_rate), np.arange(len(kernel)))
        gain = np.abs(np.exp(-2j * np.pi * turns) @ kernel) ** 2 * np.sum(window**2)
        # Why the step: thinned rows spread the same power over a narrower band.
        powers.append(step * np.abs(spectrum[inside]) ** 2 / gain[:, None])
    # Why the median: a reversal of friction is a short burst of high frequencies, not noise.
    level = np.median(np.concatenate(powers), axis=0) / np.log(2.0)
    return np.minimum(np.sqrt(level * np.sum(kernel**2)), _rms(parts))
