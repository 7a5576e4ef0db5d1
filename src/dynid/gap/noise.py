"""The noise floor: from repeats of the same motion, or from the residual's high frequencies, which bound it from below.

The difference of two residuals of the same motion holds everything that does not repeat and nothing that does. Its
autoregressive model whitens the rows; without that, tests on robot residuals find effects in every clean log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.errors import LogTooShort
from dynid.estimation.covariance import autocorrelation_time
from dynid.estimation.noise_floor import lag_of, shifted
from dynid.estimation.tuning import SHORTEST_REPEAT_S
from dynid.gap import tuning
from dynid.gap.segments import Mask, SegmentRows
from dynid.model.effects.interface import Floats
from dynid.signals.filters import Filter

#: Order of the autoregressive model: the parallel filter and a slow coloured part.
ORDER = 4
#: Rows of a part of a log that has a spectrum.
SHORTEST = 16
#: Highest power of a block of 1 s over the median one, and power below 0.8 Hz over that from 4 to 8 Hz, that repeats of
#: an undisturbed arm have; a random contact gives 12 and more, a drifting sensor 27 and more.
BURST, DRIFT = 6.0, 14.0
#: A kept model left more than noise on a joint when it left more than this many times the floor, which is
#: itself known to about a tenth.
MORE_THAN_NOISE = 1.2


@dataclass(frozen=True)
class NoiseModel:
    """The noise of every joint after the parallel filter.

    Attributes:
        ar: coefficients of the autoregressive model of order k, (n, k).
        sigma: standard deviation of what it does not predict, (n,) [N m].
        floor: rms of the noise itself, (n,) [N m].
        repeats: seconds of repeated motion it comes from; 0 when it is a lower bound from high frequencies.
        burst: highest over median power of 1 s blocks, (n,); 0 without repeats.
        drift: power at low over high frequency, (n,); 0 without repeats.
        misfit: joints whose floor is what a kept model left unexplained when it was identified, which is more than
            noise.
        count: integrated autocorrelation time of what is not whitened, in rows, (n,); 1 where rows are whitened.
    """

    ar: Floats
    sigma: Floats
    floor: Floats
    repeats: float
    burst: Floats
    drift: Floats
    misfit: tuple[int, ...]
    count: Floats

    @classmethod
    def white(cls, sigma: Floats) -> NoiseModel:
        """Return noise that is not whitened, of given standard deviations, (n,)."""
        nothing = np.zeros(len(sigma))
        return cls(
            np.zeros((len(sigma), 0)), sigma, sigma, 0.0, nothing, nothing, (), np.ones(len(sigma))
        )

    @property
    def order(self) -> int:
        """Rows at the beginning of each segment that whitening takes."""
        return int(self.ar.shape[1])

    @property
    def unrepeatable(self) -> list[int]:
        """Joints with disturbances that do not repeat."""
        return np.flatnonzero(
            (self.burst > BURST) | (self.drift > DRIFT) | (self.peak > tuning.RINGS)
        ).tolist()

    @property
    def peak(self) -> Floats:
        """How far the highest peak of the noise's spectrum in the pass band stands out, in power, (n,).

        A spectrum that only rises or falls, as that of differentiated positions does, has no peak: 1.
        """
        # In turns per row: rows are kept at four times the cut-off.
        z = np.exp(-2j * np.pi * np.outer(np.linspace(0.02, 0.2, 60), np.arange(1, self.order + 1)))
        power = 1.0 / np.abs(1.0 - z @ self.ar.T) ** 2
        beside = np.maximum(np.minimum.accumulate(power), np.minimum.accumulate(power[::-1])[::-1])
        return np.asarray(np.max(power / beside, axis=0))


@dataclass(frozen=True)
class RepeatPair:
    """Two segments of the same motion: row k of the first is row k + lag of the second."""

    first: int
    second: int
    lag: float


def find_repeats(segments: Sequence[SegmentRows]) -> list[RepeatPair]:
    """Find segments, and periods within a segment, that hold the same motion."""
    pairs = []
    for a, one in enumerate(segments):
        shortest = round(SHORTEST_REPEAT_S * one.rate)
        for b in range(a, len(segments)):
            lag = lag_of(one.q, segments[b].q, shortest, shortest if a == b else None)
            if lag is not None:
                pairs.append(RepeatPair(a, b, lag))
    return pairs


def measure_noise(
    segments: Sequence[SegmentRows],
    residuals: Sequence[Floats],
    pairs: Sequence[RepeatPair],
    train: Sequence[Mask],
) -> NoiseModel:
    """Measure the noise.

    Args:
        segments: rows.
        residuals: what the baseline model leaves, one (M, n) per segment.
        pairs: repeats among them.
        train: rows that the baseline model was fitted to, one mask per segment; without repeats, others say nothing.

    Raises:
        LogTooShort: no part of the logs is long enough to have a spectrum.
    """
    parts = [_difference(segments, residuals, pair) for pair in pairs]
    seconds = sum(len(e) for e, _ in parts) / segments[0].rate
    if seconds >= SHORTEST_REPEAT_S:
        return _from_repeats(parts, segments[0].rate, seconds)
    parts = [(r[rows], s.use[rows]) for s, r, rows in zip(segments, residuals, train, strict=True)]
    parts = [(r, use) for r, use in parts if len(r) >= SHORTEST]
    if not parts:
        raise LogTooShort(
            f"no part of the logs has {SHORTEST} usable rows, without which noise cannot be told from what is missing",
            why="what is missing is judged against the noise",
        )
    return _from_spectrum(segments[0].log.filter, parts)


def with_steps(noise: NoiseModel, segments: Sequence[SegmentRows]) -> NoiseModel:
    """Return the noise with what steps of the torque's recording leave in the pass band.

    Steps much larger than the noise are an error that repeats with the motion, which no repeat shows.

    Source: Widrow and Kollar 2008, "Quantization noise", for how noise makes the error of steps white.

    Args:
        noise: of repeats or high frequencies.
        segments: rows.
    """
    known = [s.log.torque_step for s in segments if len(s.log.torque_step) == len(noise.floor)]
    if not known or not np.any(known):
        return noise
    chosen, step = segments[0].log.filter, np.max(known, axis=0)
    white = min(1.0, 2.0 * chosen.cutoff / chosen.rate)
    spread = noise.floor / np.sqrt(white) / np.where(step > 0, step, 1.0)
    share = white + (1.0 - white) * np.exp(-2.0 * np.pi**2 * spread**2)
    more = np.sqrt(1.0 + np.where(step > 0, share * step**2 / 12.0, 0.0) / noise.floor**2)
    return replace(noise, sigma=more * noise.sigma, floor=more * noise.floor)


def _difference(
    segments: Sequence[SegmentRows], residuals: Sequence[Floats], pair: RepeatPair
) -> tuple[Floats, Mask]:
    """Return what differs between two repeats, trends and friction changes taken off, and the rows that count."""
    one, other = segments[pair.first], segments[pair.second]
    whole = int(np.floor(pair.lag))
    start, end = max(0, -whole), min(len(one), len(other) - whole - 1)
    part = slice(start, end)
    moved = shifted(residuals[pair.second], pair.lag - whole)[start + whole : end + whole]
    e = (residuals[pair.first][part] - moved) / np.sqrt(2)
    use = one.use[part] & other.use[start + whole : end + whole]
    use[:8], use[-8:] = False, False
    for j in range(e.shape[1]):
        if use[:, j].sum() > 20:
            qd = one.qd[part, j]
            A = np.column_stack(
                [np.ones(len(e)), np.linspace(-1, 1, len(e)), np.tanh(qd / 0.01), qd]
            )
            e[:, j] -= A @ np.linalg.lstsq(A[use[:, j]], e[use[:, j], j], rcond=None)[0]
    return e, use


def _from_repeats(parts: Sequence[tuple[Floats, Mask]], rate: float, seconds: float) -> NoiseModel:
    n = parts[0][0].shape[1]
    ar, sigma, floor, burst, drift = (
        np.zeros((n, ORDER)),
        np.ones(n),
        np.ones(n),
        np.zeros(n),
        np.zeros(n),
    )
    for j in range(n):
        covariance = np.zeros(ORDER + 1)
        for e, use in parts:
            x = np.where(use[:, j], e[:, j], 0.0)
            covariance += [float(x[lag:] @ x[: len(x) - lag]) for lag in range(ORDER + 1)]
        # Why white noise on top: the stop band of the filter holds almost none, and would be whitened by as much.
        ar[j] = yule_walker(
            covariance * np.where(np.arange(ORDER + 1) == 0, 1.0 + tuning.STOP_BAND, 1.0)
        )
        white = [whitened(e[:, j], ar[j])[use[ORDER:, j]] for e, use in parts]
        count = max(1, sum(len(w) for w in white))
        sigma[j] = np.sqrt(sum(float(w @ w) for w in white) / count)
        floor[j] = np.sqrt(covariance[0] / max(1, sum(int(use[:, j].sum()) for _, use in parts)))
        burst[j] = _burst([np.where(use[:, j], e[:, j], 0.0) for e, use in parts], rate)
        drift[j] = _drift([np.where(use[:, j], e[:, j], 0.0) for e, use in parts], rate)
    return NoiseModel(
        ar, np.maximum(sigma, 1e-9), np.maximum(floor, 1e-9), seconds, burst, drift, (), np.ones(n)
    )


def _burst(parts: Sequence[Floats], rate: float) -> float:
    size = max(1, round(rate))
    powers = [
        np.mean(x[k : k + size] ** 2) for x in parts for k in range(0, len(x) - size + 1, size)
    ]
    powers = [p for p in powers if p > 0]
    return float(max(powers) / np.median(powers)) if powers else 0.0


def _drift(parts: Sequence[Floats], rate: float) -> float:
    low = high = 0.0
    for x in parts:
        f = np.fft.rfftfreq(len(x), 1 / rate)
        power = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
        low += float(np.mean(power[f < 0.8]))
        high += (
            float(np.mean(power[(f > 4.0) & (f < 8.0)]))
            if (f > 8.0).any()
            else float(np.mean(power[f > 0.5 * f[-1]]))
        )
    return low / high if high else 0.0


def _from_spectrum(chosen: Filter, parts: Sequence[tuple[Floats, Mask]]) -> NoiseModel:
    """Take the noise as white before the filter, its level from the upper part of the pass band of the residual."""
    kernel, step = chosen.second_kernel[0], chosen.second_step
    shape = np.correlate(kernel, kernel, "full")[len(kernel) - 1 :]
    covariance = np.array(
        [shape[lag * step] if lag * step < len(shape) else 0.0 for lag in range(ORDER + 1)]
    )
    covariance[0] *= 1.0 + tuning.STOP_BAND
    ar = yule_walker(covariance)
    n = parts[0][0].shape[1]
    level, left = np.zeros(n), np.full(n, np.inf)
    for j in range(n):
        powers, kept = [], []
        for r, use in parts:
            f = np.fft.rfftfreq(len(r) - ORDER, 1 / chosen.kept_rate)
            white = whitened(r[:, j], ar)
            kept.append(white[use[ORDER:, j]])
            power = np.abs(np.fft.rfft((white - white.mean()) * np.hanning(len(white)))) ** 2 / (
                0.375 * len(white)
            )
            inside = (f > 0.55 * chosen.cutoff) & (f < chosen.cutoff)
            # Why: of a part of few rows, no frequency may lie there.
            powers.append(
                power[inside if inside.any() else [np.argmin(np.abs(f - 0.775 * chosen.cutoff))]]
            )
        # Why the median: a reversal of friction is a short burst of high frequencies, not noise.
        level[j] = np.sqrt(np.median(np.concatenate(powers)) / np.log(2))
        # Why: rows that do not count, at rest or clipped, are in the spectrum; noise is no larger than what is left.
        white = np.concatenate(kept)
        if len(white):
            rows = np.concatenate([r[use[:, j], j] for r, use in parts])
            level[j], left[j] = min(level[j], np.sqrt(np.mean(white**2))), np.sqrt(np.mean(rows**2))
    scale = np.sqrt(covariance[0] / max(1e-30, covariance[0] - ar @ covariance[1:]))
    nothing = np.zeros(n)
    sigma = np.maximum(level, 1e-9)
    floor = np.maximum(np.minimum(sigma * scale, left), 1e-9)
    return NoiseModel(np.tile(ar, (n, 1)), sigma, floor, 0.0, nothing, nothing, (), np.ones(n))


def with_misfit(
    noise: NoiseModel, segments: Sequence[SegmentRows], residuals: Sequence[Floats], level: Floats
) -> NoiseModel:
    """Return the noise where what a kept model could not explain when it was identified is larger than the floor.

    What was unexplained then and is unexplained now has not changed. It is not whitened: it follows the motion, and
    what whitens it takes away the slow part of a change, by which one is told from another. Each row counts
    less instead.

    Args:
        noise: the floor.
        segments: rows.
        residuals: what a refitted model leaves of them, one (M, n) per segment: how long it goes on.
        level: rms of what the kept model left, (n,) [N m].
    """
    more = level > MORE_THAN_NOISE * noise.floor
    count = np.ones(len(level))
    for j in np.flatnonzero(more).tolist():
        count[j] = autocorrelation_time(
            [np.where(s.use[:, j], r[:, j], 0.0) for s, r in zip(segments, residuals, strict=True)]
        )
    return replace(
        noise,
        ar=np.where(more[:, None], 0.0, noise.ar),
        sigma=np.where(more, level, noise.sigma),
        floor=np.where(more, level, noise.floor),
        misfit=tuple(np.flatnonzero(more).tolist()),
        count=count,
    )


def yule_walker(covariance: Floats) -> Floats:
    """Return autoregressive coefficients, (ORDER,), from autocovariances at lags 0 to ORDER."""
    from scipy.linalg import solve_toeplitz

    if covariance[0] <= 0:
        return np.zeros(ORDER)
    column = covariance[:ORDER] * np.where(np.arange(ORDER) == 0, 1 + 1e-6, 1.0)
    return np.asarray(solve_toeplitz(column, covariance[1:]))


def whitened(x: Floats, ar: Floats) -> Floats:
    """Return what an autoregressive model, (k,), does not predict, along the last axis, (..., M) -> (..., M - k)."""
    order = len(ar)
    out = x[..., order:].copy()
    for lag, weight in enumerate(ar, start=1):
        out -= weight * x[..., order - lag : x.shape[-1] - lag]
    return out
