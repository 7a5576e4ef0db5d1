"""The noise floor: from repeats of the same motion, or from the residual's high frequencies, which bound it from below.

The difference of two residuals of the same motion holds everything that does not repeat and nothing that does. Its
autoregressive model whitens the rows; without that, tests on robot residuals find effects in every clean log.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solve_toeplitz
from scipy.ndimage import convolve1d

from dynid.arrays import Floats, Mask
from dynid.estimation.least_squares import autocorrelation_time
from dynid.estimation.noise_floor import RepeatPair, difference, floor_from_spectrum
from dynid.estimation.tuning import SHORTEST_REPEAT_S
from dynid.gap import tuning
from dynid.gap.gap_rows import GapRows, accelerated
from dynid.signals.filters import Filter, acceleration_noise, encoder_noise

#: Order of the autoregressive model: the parallel filter and a slow coloured part.
ORDER = 4
#: Rows of a part of a log that has a spectrum.
SHORTEST = 16
#: Power below 0.8 Hz over that from 4 to 8 Hz that repeats of an undisturbed arm have; a drifting sensor gives 27 and
#: more.
DRIFT = 14.0
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
        disturbed: whether repeats show a drift, (n,); not without them.
        count: integrated autocorrelation time of what is not whitened, in rows, (n,); 1 where rows are whitened.
        repeats: seconds of repeated motion it comes from; 0 when it is a lower bound from high frequencies.
        cutoff: of the parallel filter, in turns per row.
    """

    ar: Floats
    sigma: Floats
    floor: Floats
    disturbed: Mask
    count: Floats
    repeats: float = 0.0
    cutoff: float = 0.25

    @classmethod
    def white(cls, sigma: Floats) -> NoiseModel:
        """Return noise that is not whitened, of given standard deviations, (n,)."""
        n = len(sigma)
        return cls(np.zeros((n, 0)), sigma, sigma, np.zeros(n, dtype=bool), np.ones(n))

    @property
    def unrepeatable(self) -> list[int]:
        """Joints with disturbances that do not repeat."""
        return np.flatnonzero(self.disturbed | (self.peak > tuning.RINGS)).tolist()

    @property
    def peak(self) -> Floats:
        """How far the highest peak of the noise's spectrum in the pass band stands out, in power, (n,).

        A spectrum that only rises or falls, as that of differentiated positions does, has no peak: 1.
        """
        lags = np.arange(1, self.ar.shape[1] + 1)
        z = np.exp(-2j * np.pi * self.cutoff * np.outer(np.linspace(0.08, 0.8, 60), lags))
        power = 1.0 / np.abs(1.0 - z @ self.ar.T) ** 2
        without_peaks = np.maximum(
            np.minimum.accumulate(power), np.minimum.accumulate(power[::-1])[::-1]
        )
        return np.max(power / without_peaks, axis=0)

    def counting(self, rows: GapRows, joint: int) -> Mask:
        """Return which rows count, (M,): whitening takes the first ones of each part."""
        return rows.use[:, joint] & (rows.at >= self.ar.shape[1])

    def whiten(self, rows: GapRows, joint: int, x: Floats) -> Floats:
        """Return filtered columns of one joint, (..., M), as whitened rows that count, (..., M_j)."""
        white = whitened(x, self.ar[joint])[..., self.counting(rows, joint)]
        return white / (self.sigma[joint] * self.count[joint] ** 0.5)


def measure_noise(rows: GapRows, residual: Floats, pairs: Sequence[RepeatPair]) -> NoiseModel:
    """Measure the noise.

    Args:
        rows: the rows; without repeats, only those that are searched say anything.
        residual: what the baseline model leaves of them, (M, n).
        pairs: repeats among them.
    """
    runs = [(rows.q[part], residual[part], rows.use[part]) for part in rows.parts]
    differences = [difference(runs[pair.first], runs[pair.second], pair.lag) for pair in pairs]
    seconds = sum(len(e) for e, _ in differences) / rows.rate
    if seconds >= SHORTEST_REPEAT_S:
        return _from_repeats(differences, rows, seconds)
    chosen = [np.flatnonzero(rows.train[part]) + part.start for part in rows.parts]
    parts = [(residual[k], rows.use[k]) for k in chosen if len(k) >= SHORTEST]
    return _from_spectrum(rows.logs[0].filter, parts)


def with_steps(noise: NoiseModel, rows: GapRows) -> NoiseModel:
    """Return the noise with what the steps in which torques and positions are recorded leave in the pass band.

    Steps much larger than the noise are an error that repeats with the motion, which no repeat shows; those of
    positions shake the inertias. A noise that comes from the residual has these already.

    Source: Widrow and Kollar 2008, "Quantization noise", for how noise makes the error of steps white.
    """
    filters, step = rows.logs[0].filter, np.max([x.torque_step for x in rows.logs], axis=0)
    white = min(1.0, 2.0 * filters.cutoff / filters.rate)
    spread = noise.floor / np.sqrt(white) / np.where(step > 0, step, 1.0)
    share = white + (1.0 - white) * np.exp(-2.0 * np.pi**2 * spread**2)
    power, motion = noise.floor**2 + share * step**2 / 12.0, rows.motions[0]
    if noise.repeats:
        level = encoder_noise(rows.logs[0].segments[0].raw_q)
        shaken = acceleration_noise(filters.cutoff, filters.rate) * level
        torques = accelerated(motion.reference, motion.q[::50], shaken)
        power = np.maximum(power, np.mean(torques**2, axis=1).sum(axis=0))
    more = np.sqrt(power) / noise.floor
    return replace(noise, sigma=more * noise.sigma, floor=more * noise.floor)


def _from_repeats(
    parts: Sequence[tuple[Floats, Mask]], rows: GapRows, seconds: float
) -> NoiseModel:
    joints = []
    for j in range(parts[0][0].shape[1]):
        own = [(e[:, j], use[:, j]) for e, use in parts]
        x = [np.where(use, e, 0.0) for e, use in own]
        covariance = np.array(
            [sum(float(e[lag:] @ e[: len(e) - lag]) for e in x) for lag in range(ORDER + 1)]
        )
        count, power = max(1, sum(use.sum() for _, use in own)), covariance[0]
        # Why white noise on top: the stop band of the filter holds almost none, and would be whitened by as much.
        covariance[0] *= 1.0 + tuning.STOP_BAND
        ar = yule_walker(covariance)
        white = (whitened(e, ar)[use] for e, use in own)
        sigma = np.sqrt(sum(float(w @ w) for w in white) / count)
        joints.append((ar, sigma, np.sqrt(power / count), _drift(x, rows.rate) > DRIFT))
    ar, sigma, floor, disturbed = map(np.array, zip(*joints, strict=True))
    sigma, floor = np.maximum(sigma, 1e-9), np.maximum(floor, 1e-9)
    turns = rows.logs[0].filter.cutoff / rows.rate
    return NoiseModel(ar, sigma, floor, disturbed, np.ones(len(ar)), seconds, turns)


def _drift(parts: Sequence[Floats], rate: float) -> float:
    low = high = 0.0
    for x in parts:
        f = np.fft.rfftfreq(len(x), 1 / rate)
        power = np.abs(np.fft.rfft(x * np.hanning(len(x)))) ** 2
        fast = (f > 4.0) & (f < 8.0) if (f > 8.0).any() else f > 0.5 * f[-1]
        low, high = low + float(np.mean(power[f < 0.8])), high + float(np.mean(power[fast]))
    return low / high if high else 0.0


def _from_spectrum(chosen: Filter, parts: Sequence[tuple[Floats, Mask]]) -> NoiseModel:
    """Take the noise as white before the filter."""
    kernel = chosen.second_kernel[0]
    shape = np.correlate(kernel, kernel, "full")[len(kernel) - 1 :: chosen.second_step]
    covariance = np.pad(shape, (0, ORDER))[: ORDER + 1]
    covariance[0] *= 1.0 + tuning.STOP_BAND
    ar, floor = yule_walker(covariance), floor_from_spectrum(parts, chosen)
    sigma = floor * np.sqrt(max(1e-30, 1.0 - ar @ covariance[1:] / covariance[0]))
    white = NoiseModel.white(np.maximum(floor, 1e-9))
    return replace(white, ar=np.tile(ar, (len(floor), 1)), sigma=np.maximum(sigma, 1e-9))


def with_misfit(noise: NoiseModel, rows: GapRows, residual: Floats, level: Floats) -> NoiseModel:
    """Return the noise where what a kept model could not explain when it was identified is larger than the floor.

    What was unexplained then and is unexplained now has not changed. It is not whitened: it follows the motion, and
    what whitens it takes away the slow part of a change, by which one is told from another. Each row counts
    less instead.

    Args:
        noise: the floor.
        rows: the rows.
        residual: what a refitted model leaves of them, (M, n): how long it goes on.
        level: rms of what the kept model left, (n,) [N m].
    """
    more = level > MORE_THAN_NOISE * noise.floor
    left, count = np.where(rows.use, residual, 0.0), np.ones(len(level))
    for j in np.flatnonzero(more).tolist():
        count[j] = autocorrelation_time([left[part, j] for part in rows.parts])
    return replace(
        noise,
        ar=np.where(more[:, None], 0.0, noise.ar),
        sigma=np.where(more, level, noise.sigma),
        floor=np.where(more, level, noise.floor),
        count=count,
    )


def yule_walker(covariance: Floats) -> Floats:
    """Return autoregressive coefficients, (ORDER,), from autocovariances at lags 0 to ORDER."""
    if covariance[0] <= 0:
        return np.zeros(ORDER)
    column = covariance[:ORDER] * np.where(np.arange(ORDER) == 0, 1 + 1e-6, 1.0)
    return solve_toeplitz(column, covariance[1:])


def whitened(x: Floats, ar: Floats) -> Floats:
    """Return what an autoregressive model, (k,), does not predict, (..., M); the first k rows lack what was before."""
    kernel = np.append(1.0, -ar)
    # Why not scipy.signal: it takes most of a second to import.
    return convolve1d(x, kernel, mode="constant", origin=-(len(kernel) // 2))
