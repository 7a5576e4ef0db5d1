"""Zero-phase low-pass filters with finite memory, and decimation by them.

Symmetric windowed-sinc kernels delay nothing, and because their memory is finite a long log can be filtered part by
part with exactly the result of filtering it whole. The same kernel goes over the torques and over the columns of the
regressor (parallel filtering), so what it removes, it removes on both sides of tau = W theta. Before them, torque
samples that no arm can have produced are replaced: a filter would smear a spike over its whole length.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dynid.arrays import Floats
from dynid.drivers.interface import driver_of
from dynid.errors import Finding, RateTooLow
from dynid.log import Log
from dynid.robot import Coulomb, Robot
from dynid.signals import tuning
from dynid.signals.motion import bandwidth, per_joint

#: Power of a Hann window.
_HANN = 0.375


@lru_cache(maxsize=32)
def lowpass_kernel(cutoff: float, rate: float) -> Floats:
    """Return a symmetric low-pass kernel with sum 1, half of the amplitude at the cut-off, (odd,).

    Args:
        cutoff: [Hz]; the transition band reaches from half of it to one and a half.
        rate: sample rate [Hz].
    """
    if cutoff >= 0.5 * rate:
        return np.ones(1)
    half = max(1, math.ceil(0.5 * tuning.KAISER_TAPS * rate / cutoff))
    k = np.arange(-half, half + 1)
    kernel: Floats = np.sinc(2 * cutoff / rate * k) * np.kaiser(2 * half + 1, tuning.KAISER_BETA)
    kernel /= kernel.sum()
    kernel.setflags(write=False)
    return kernel


def derivative_kernels(kernel: Floats, rate: float) -> Floats:
    """Return the kernels that filter, filter and differentiate once, and twice, (3, taps + 4) [1, 1/s, 1/s^2].

    Args:
        kernel: symmetric low-pass, (taps,).
        rate: sample rate [Hz].

    Source: Paper Eq. 22 with its divisor doubled, here with five points: the error falls with the fourth power of the
        step, so that the filter and not the difference sets the accuracy.
    """
    first = np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) * rate / 12.0
    second = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) * rate**2 / 12.0
    # Why reversed: the kernels are used as weights on x[i - half : i + half + 1], not in a convolution.
    return np.array(
        [np.pad(kernel, 2), np.convolve(kernel, first)[::-1], np.convolve(kernel, second)]
    )


def decimate(x: Floats, kernels: Floats, step: int) -> Floats:
    """Weight windows of x with kernels at every ``step``-th sample, without padding at the ends.

    Args:
        x: signals of any unit, (C, L).
        kernels: weights, (K, taps) with taps <= L.
        step: samples between outputs.

    Returns:
        (K, C, M) with M = (L - taps) // step + 1; output i is centred on sample i * step + (taps - 1) / 2.
    """
    taps = kernels.shape[1]
    if x.shape[1] < taps:
        return np.empty((len(kernels), len(x), 0))
    windows = sliding_window_view(np.ascontiguousarray(x, dtype=float), taps, axis=1)
    # Why not scipy.signal: it takes longer, and half a second to import.
    return np.einsum("cmt,kt->kcm", windows[:, ::step], kernels)


def despiked(log: Log, cutoff: float) -> tuple[Log, tuple[Finding, ...]]:
    """Replace spikes of the torques by the median around them; a log without spikes comes back as it is.

    Source: Hampel 1974 (identifier by median and median deviation).

    Args:
        log: a prepared log.
        cutoff: of the filter over the torques [Hz].
    """
    if (2 * tuning.SPIKE_REACH + 1) * cutoff > tuning.SPIKE_OF_PERIOD * log.rate:
        return log, ()
    from scipy.ndimage import median_filter  # here: its import takes as long as many logs

    medians = median_filter(log.tau, (2 * tuning.SPIKE_REACH + 1, 1), mode="nearest")
    away, span = np.abs(log.tau - medians), np.ptp(log.tau, axis=0)
    usual = tuning.SPIKE_DEVIATIONS * 1.4826 * np.median(away, axis=0)
    spikes = away > np.maximum(tuning.SPIKE_OF_RANGE * span, usual)
    # Why: where many samples look like it, they are no accidents.
    spikes &= spikes.mean(axis=0) <= tuning.SPIKE_MOST
    count = spikes.sum(axis=0).tolist()
    counts = ", ".join(f"{name} {n}" for name, n in zip(log.names, count, strict=True) if n)
    if not counts:
        return log, ()
    text = f"{log.name}: torque spikes were replaced by the median of their neighbours: {counts} of {len(log)} samples"
    tau = np.where(spikes, medians, log.tau)
    return replace(log, tau=tau), (Finding("W324", "warning", text, {"samples": count}),)


@dataclass(frozen=True)
class Noise:
    """Noise of the positions of a log.

    Attributes:
        level: standard deviation, (n,) [rad or m].
        joint: the joint that it troubles most.
        cutoff: highest cut-off at which it does no harm, or the one where it does least [Hz].
        share: of noise in the accelerations of that joint, at ``cutoff``.
    """

    level: Floats
    joint: int
    cutoff: float
    share: float


def usual_cutoff(band: float) -> float:
    """Return the cut-off that a motion of some band asks for [Hz]."""
    return max(tuning.LOWEST_CUTOFF_HZ, tuning.CUTOFF_OVER_MOTION * band)


def choose_cutoff(logs: Sequence[Log], robot: Robot) -> float:
    """Return one cut-off for several logs [Hz]: what the fastest motion asks for and the noisiest positions allow."""
    allowed = [position_noise(log, robot).cutoff for log in logs]
    return min([usual_cutoff(max(bandwidth(log, robot) for log in logs)), *allowed])


def check_rate(log: Log, robot: Robot) -> None:
    """Raise when samples arrive too rarely for the motion.

    Raises:
        RateTooLow: its fix says how the driver publishes faster.
    """
    fastest = bandwidth(log, robot)
    cutoff = usual_cutoff(fastest)
    # Why: what the steps of the encoder hide is filtered away, and needs no samples.
    if log.rate < tuning.SAMPLES_PER_CUTOFF * cutoff:
        cutoff = min(cutoff, position_noise(log, robot, encoder_noise(log.q)).cutoff)
    needed = max(tuning.LEAST_RATE_HZ, tuning.SAMPLES_PER_CUTOFF * cutoff)
    if fastest and log.rate < needed:
        if fastest > tuning.JUMPS * log.rate:
            raise RateTooLow(
                "positions jump between samples: the motion from pose to pose is missing",
                fix="record the arm while it moves, too",
            )
        raise RateTooLow(
            f"joint states arrive at {log.rate:.1f} Hz; "
            f"the fastest motion, {fastest:.1f} Hz, needs >= {max(tuning.GOOD_RATE_HZ, needed):.0f} Hz",
            fix=driver_of(robot).rate_fix,
        )


def check_position_noise(log: Log, robot: Robot) -> Iterator[Finding]:
    """Yield finding W327 when positions scatter so much that the cut-off is below that of a slow motion."""
    noise = position_noise(log, robot)
    if noise.cutoff >= tuning.LOWEST_CUTOFF_HZ:
        return
    joint = robot.joints[noise.joint]
    scatter = f"{noise.level[noise.joint]:.1g} {'rad' if joint.revolute else 'm'}"
    effect = (
        "parameters are biased by it and their intervals are too narrow; record the commanded positions "
        "too (--method iv), or use a finer encoder"
    )
    if noise.share <= tuning.NOISE_SHARE:
        effect = (
            f"everything is filtered at {noise.cutoff:.3g} Hz, where it is still {100 * noise.share:.2g} % of "
            "the accelerations. Intervals of physically consistent parameters allow for that; those of least squares "
            "may be too narrow. Commanded positions in the log (--method iv) avoid it"
        )
    text, level = f"{joint.name} position scatters by {scatter}: {effect}", noise.level.tolist()
    facts = {"noise": level, "cutoff_hz": noise.cutoff, "share_of_acceleration": noise.share}
    yield Finding("W327", "warning", text, facts)


def encoder_noise(q: Floats) -> Floats:
    """Return the noise that rounding to the steps of an encoder makes of positions q, (N, n), (n,) [rad or m]."""
    # Why one by one: of an hour at 1 kHz the differences of all joints are several copies of the log.
    changes = (np.abs(np.diff(x)) for x in q.T)
    step = [np.min(each[each > 0.0], initial=np.inf) for each in changes]
    return np.nan_to_num(step, posinf=0.0) / 12**0.5


def position_noise(log: Log, robot: Robot, level: Floats | None = None) -> Noise:
    """Return the noise of the positions, and the cut-off that it allows to joints that move.

    Args:
        log: a prepared log.
        robot: its robot.
        level: standard deviation of the noise, (n,) [rad or m]; when None what is measured, or the steps of the encoder
            where it often rests on one of them.
    """
    if level is None:
        level = white_noise(log.q)
    lowest, step = tuning.LOWEST_TRIED_HZ, tuning.TRIED_STEP_HZ
    cutoffs = np.arange(lowest, max(lowest, 0.45 * log.rate) + step / 2, step)
    far = per_joint(tuning.MOVING_SPEED, robot) * log.duration
    moves = np.ptp(log.q, axis=0) > np.minimum(far, 20 * level)
    share = np.where(moves, _shares(log, level, cutoffs), 0.0)
    worst = share.max(axis=1)
    quiet = np.flatnonzero(worst <= tuning.NOISE_SHARE)
    best = quiet[-1] if len(quiet) else np.argmin(worst)
    return Noise(level, int(np.argmax(share[best])), float(cutoffs[best]), float(worst[best]))


def _shares(log: Log, level: Floats, cutoffs: Floats) -> Floats:
    """Return the share of noise in what the accelerations below each cut-off are, (C, n)."""
    q = log.q - log.q.mean(axis=0)
    f = np.fft.rfftfreq(len(q), 1 / log.rate)
    waves = np.abs(np.fft.rfft(q * np.hanning(len(q))[:, None], axis=0))
    below = np.cumsum((2 * np.pi * f[:, None]) ** 4 * waves**2, axis=0)
    power = 2 / (_HANN * len(q) ** 2) * below[np.searchsorted(f, cutoffs) - 1]
    noise = np.outer(acceleration_noise(cutoffs, log.rate), level)
    return noise / np.sqrt(np.maximum(power, np.maximum(noise**2, 1e-300)))


def acceleration_noise(cutoff: Floats | float, rate: float) -> Floats:
    """Return the noise of accelerations below cut-offs [Hz] over that of positions, which is white [1/s^2]."""
    return np.asarray((2 * np.pi) ** 2 * cutoff**2.5 * np.sqrt(2 / (5 * rate)))


def white_noise(x: Floats) -> Floats:
    """Return the standard deviation of the white noise in slow signals x, (N, n), on an even grid, (n,) [unit of x].

    At least that of the steps in which they come: of a joint that rests or creeps most samples equal those before.
    """
    some = x[: tuning.ENOUGH_SAMPLES]
    if len(some) <= tuning.NOISE_ORDER:
        return np.zeros(x.shape[1])
    gain = math.comb(2 * tuning.NOISE_ORDER, tuning.NOISE_ORDER) ** 0.5
    middle = np.median(np.abs(np.diff(some, tuning.NOISE_ORDER, axis=0)), axis=0) / gain
    return np.maximum(1.4826 * middle, encoder_noise(x))


def under(kernel: Floats, x: Floats) -> Floats:
    """Return a signal under a kernel, as long as it was, (N,); reflected in its end points it goes on as it was."""
    half = min(len(kernel) // 2, len(x) - 1)
    padded = np.pad(x, half, mode="reflect", reflect_type="odd")
    return decimate(padded[None], kernel[None], 1)[0, 0]


def choose_sign_cutoffs(
    x: Floats, coulomb: Coulomb, rate: float, lowest: float, *, measured: bool
) -> Floats:
    """Return for each joint the highest cut-off whose velocity noise is small against that of the Coulomb sign [Hz].

    Args:
        x: positions [rad or m], or measured velocities [rad/s or m/s], (N, n).
        coulomb: shape of the sign.
        rate: sample rate [Hz].
        lowest: cut-off that is tried first, and taken where the noise allows none [Hz].
        measured: whether x are velocities.
    """
    gain = float(np.linalg.norm(velocity_kernel(lowest, rate, measured=measured)))
    allowed = tuning.NOISE_OVER_COULOMB * np.array(coulomb.velocity) / gain
    # White noise below a cut-off grows with its root, that of its derivative with the power 3/2.
    ratio = np.log(tuning.SIGN_RATIO)
    noise = np.maximum(white_noise(x), np.finfo(float).tiny)
    sharpest = max(lowest, min(tuning.SHARPEST_HZ, tuning.SIGN_OF_RATE * rate))
    steps = np.log(allowed / noise) / ((0.5 if measured else 1.5) * ratio)
    most = np.log(sharpest / lowest) / ratio
    return lowest * tuning.SIGN_RATIO ** np.clip(np.floor(steps), 0, np.floor(most))


def velocity_kernel(cutoff: float, rate: float, *, measured: bool) -> Floats:
    """Return what makes a velocity below a cut-off [Hz] of positions, or of measured velocities, (taps,)."""
    lowpass = lowpass_kernel(cutoff, rate)
    return lowpass if measured else derivative_kernels(lowpass, rate)[1]


@dataclass(frozen=True)
class Filter:
    """How a log was filtered.

    Attributes:
        rate: sample rate of the log [Hz].
        cutoff: cut-off of the parallel filter over torque and columns [Hz].
        first_step: thinning after the position filter.
        second_step: thinning after the parallel filter.
        measured_velocity: whether the velocities of the driver are taken where there are any, and only these are
            differentiated.
    """

    rate: float
    cutoff: float
    first_step: int
    second_step: int
    measured_velocity: bool = False

    @property
    def position_cutoff(self) -> float:
        """Cut-off of the position filter [Hz]."""
        return tuning.POSITION_OVER_PARALLEL * self.cutoff

    @property
    def kept_rate(self) -> float:
        """Rate of the rows that are fitted [Hz]."""
        return self.rate / (self.first_step * self.second_step)

    @property
    def first_kernels(self) -> Floats:
        """Kernels for q, qd and qdd, (3, taps)."""
        return derivative_kernels(lowpass_kernel(self.position_cutoff, self.rate), self.rate)

    @property
    def second_kernel(self) -> Floats:
        """Kernel of the parallel filter, (1, taps)."""
        return lowpass_kernel(self.cutoff, self.rate / self.first_step)[None, :]


def grid_rate(t: Floats) -> float:
    """Return the rate of the even grid that samples are put on [Hz]; logs of one recorder get the same.

    Args:
        t: increasing time stamps, (N,) [s].
    """
    close = np.diff(t)
    usual = float(np.median(close))
    close = close[close < tuning.GAP_SAMPLES * usual]
    share = float(np.abs(close / usual - np.round(close / usual)).max(initial=0.0))
    if share < tuning.EVEN_STEP:
        # Why: stamps in seconds since 1970 give rates such as 199.99999.
        return float(f"{1 / usual:.6g}")
    # Why not the median, and why round: uneven steps leave it open, and repeats on different grids would be no repeats.
    blocks = np.add.reduceat(close, np.arange(0, len(close), tuning.RATE_STEPS))
    for _ in range(2):
        usual = float(blocks.sum() / max(1.0, np.round(blocks / usual).sum()))
    return float(f"{1 / usual:.3g}")


def choose_filter(log: Log, cutoff: float, *, measured_velocity: bool = False) -> Filter:
    """Choose the filters for a log.

    Args:
        log: a prepared log.
        cutoff: cut-off of the parallel filter [Hz], such as that of ``choose_cutoff``.
        measured_velocity: whether the velocities of the driver are taken where there are any.
    """
    cutoff = min(cutoff, 0.45 * log.rate)
    rate = grid_rate(log.t)
    # How much both filters together thin a log, and the first one at most.
    both = max(1, int(rate / (tuning.KEPT_PER_CUTOFF * cutoff)))
    most = max(1, int(rate / (tuning.EVALUATED_PER_CUTOFF * cutoff)))
    first = max(k for k in range(1, most + 1) if both <= tuning.KEPT_MORE * k * (both // k))
    return Filter(rate, cutoff, first, both // first, measured_velocity)
