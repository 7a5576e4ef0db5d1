"""Zero-phase low-pass filters with finite memory, and decimation by them.

Symmetric windowed-sinc kernels delay nothing, and because their memory is finite a long log can be filtered piece by
piece with exactly the result of filtering it whole. The same kernel goes over the torques and over the columns of the
regressor (parallel filtering), so what it removes, it removes on both sides of tau = W theta.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

#: Kaiser window for 60 dB: what is left of the stop band is a thousandth, below the noise of any joint sensor.
KAISER_BETA = 5.65
KAISER_TAPS = 3.6
#: Outputs computed together as one matrix product; measured best for 50 to 500 taps.
_TOGETHER = 16


@lru_cache(maxsize=32)
def lowpass_kernel(cutoff: float, rate: float) -> Floats:
    """Return a symmetric low-pass kernel with sum 1, half of the amplitude at the cut-off, (odd,).

    Args:
        cutoff: [Hz]; the transition band reaches from half of it to one and a half.
        rate: sample rate [Hz].
    """
    if cutoff >= 0.5 * rate:
        return np.ones(1)
    half = max(1, math.ceil(0.5 * KAISER_TAPS * rate / cutoff))
    k = np.arange(-half, half + 1)
    kernel: Floats = np.sinc(2 * cutoff / rate * k) * np.kaiser(2 * half + 1, KAISER_BETA)
    kernel /= kernel.sum()
    kernel.setflags(write=False)
    return kernel


def pulse_width(cutoff: float) -> float:
    """Return half the length of the low-pass kernel [s]."""
    return 0.5 * KAISER_TAPS / cutoff


def pulse(lag: Floats, cutoff: float) -> Floats:
    """Return the low-pass kernel at any time: what the filter makes of an impulse, but for its size.

    Args:
        lag: time since the impulse, of any shape [s].
        cutoff: [Hz].
    """
    times, values, _ = _pulse_table()
    return np.interp(lag * cutoff, times, values, 0.0, 0.0)


def pulse_slope(lag: Floats, cutoff: float) -> Floats:
    """Return what the filter makes of the slope of an impulse, but for its size."""
    times, _, slopes = _pulse_table()
    return np.interp(lag * cutoff, times, slopes, 0.0, 0.0)


@lru_cache(maxsize=1)
def _pulse_table() -> tuple[Floats, Floats, Floats]:
    times = np.linspace(-0.5 * KAISER_TAPS, 0.5 * KAISER_TAPS, 4001)
    values = np.sinc(2 * times) * np.kaiser(len(times), KAISER_BETA)
    return times, values, np.gradient(values, times)


def derivative_kernels(kernel: Floats, rate: float) -> Floats:
    """Return the kernels that filter, filter and differentiate once, and twice, (3, taps + 4).

    Source: Paper Eq. 22 with its divisor doubled, here with five points: the error falls with the fourth power of the
        step, so that the filter and not the difference sets the accuracy.
    """
    first = np.array([-1.0, 8.0, 0.0, -8.0, 1.0]) * rate / 12.0
    second = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) * rate**2 / 12.0
    # Why reversed: the kernels are used as weights on x[i - half : i + half + 1], not in a convolution.
    return np.array([np.pad(kernel, 2), np.convolve(kernel, first)[::-1], np.convolve(kernel, second)])


def decimate(x: Floats, kernels: Floats, step: int) -> Floats:
    """Weight windows of x with kernels at every ``step``-th sample, without padding at the ends.

    Args:
        x: signals, (C, L).
        kernels: weights, (K, taps) with taps <= L.
        step: samples between outputs.

    Returns:
        (K, C, M) with M = (L - taps) // step + 1; output i is centred on sample i * step + (taps - 1) / 2.
    """
    count, taps = kernels.shape
    outputs = (x.shape[1] - taps) // step + 1
    if outputs <= 0:
        return np.empty((count, len(x), 0))
    if taps == 1 and step == 1:
        return np.ascontiguousarray(kernels[:, 0][:, None, None] * x)
    together = min(_TOGETHER, outputs)
    width = (together - 1) * step + taps
    weights = np.zeros((width, together * count))
    for i in range(together):
        weights[i * step : i * step + taps, i * count : (i + 1) * count] = kernels.T
    chunks = -(-outputs // together)
    missing = (chunks - 1) * together * step + width - x.shape[1]
    padded = np.pad(x, ((0, 0), (0, max(0, missing))))
    windows = np.lib.stride_tricks.sliding_window_view(padded, width, axis=1)[:, :: together * step][:, :chunks]
    product = np.ascontiguousarray(windows).reshape(-1, width) @ weights
    shaped = product.reshape(len(x), chunks * together, count)[:, :outputs]
    return np.ascontiguousarray(shaped.transpose(2, 0, 1))
