"""The sign of each joint's velocity, taken before a filter smears its reversals.

Coulomb friction is a step in time. Torques pass the position filter as they are, so the column has to as well: the sign
is taken of a velocity as sharp as the encoder's noise allows, and then filtered, F sign(v), where sign(F v) would be
late: friction makes an arm brake harder than it starts, and a filter moves the zero of such a velocity.
Reads positions or velocities; writes signs. Docs: docs/explanation/estimators.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.longarrays import median
from dynid.model.effects.friction import coulomb_sign
from dynid.robot import Coulomb
from dynid.signals.filters import decimate, derivative_kernels, lowpass_kernel

Floats = NDArray[np.float64]

#: Noise of the velocity over the velocity of the Coulomb sign: less and it hardly blurs the step.
NOISE_OVER_COULOMB = 0.25
#: Sharper than this nothing is gained [Hz]: a reversal lasts a few milliseconds.
SHARPEST_HZ = 100.0
#: Highest cut-off over the sample rate, and the ratio of two cut-offs that are tried.
MOST_OF_RATE, RATIO = 0.4, 2.0**0.5
#: Differences of this order see encoder noise and nothing of the motion.
ORDER = 6
#: Samples that the noise is estimated from.
NOISE_SAMPLES = 1 << 16


def white_noise(x: Floats) -> Floats:
    """Return the standard deviation of the white noise in slow signals x, (N, n), on an even grid, (n,) [unit of x]."""
    some = x[:NOISE_SAMPLES]
    if len(some) <= ORDER:
        return np.zeros(x.shape[1])
    gain = math.comb(2 * ORDER, ORDER) ** 0.5
    return np.asarray(1.4826 * median(np.abs(np.diff(some, ORDER, axis=0)), axis=0) / gain)


@dataclass(frozen=True)
class VelocitySign:
    """How the sign of the velocity is taken: under which low-pass, for each joint.

    Attributes:
        coulomb: shape of the sign.
        cutoffs: cut-off of each joint's velocity, (n,) [Hz].
        rate: sample rate [Hz].
        measured: whether it is taken of velocities, and not of positions.
    """

    coulomb: Coulomb
    cutoffs: tuple[float, ...]
    rate: float
    measured: bool

    @property
    def margin(self) -> int:
        """Samples on either side that a sign depends on."""
        return max(len(self._kernel(cutoff)) for cutoff in self.cutoffs) // 2

    def _kernel(self, cutoff: float) -> Floats:
        return _kernel(cutoff, self.rate, self.measured)

    def coulomb_sign(self, x: Floats) -> Floats:
        """Return the Coulomb signs, (N, n), of positions [rad or m], or velocities [rad/s or m/s], on an even grid."""
        found = np.empty_like(x)
        for j, cutoff in enumerate(self.cutoffs):
            kernel = self._kernel(cutoff)
            half = min(len(kernel) // 2, len(x) - 1)
            # Why: reflected in its end points a motion goes on as fast as it was.
            padded = np.pad(x[:, j], half, mode="reflect", reflect_type="odd")
            found[:, j] = coulomb_sign(decimate(padded[None], kernel[None], 1)[0, 0], self.coulomb, j)
        return found


def choose_velocity_sign(x: Floats, coulomb: Coulomb, rate: float, lowest: float, *, measured: bool) -> VelocitySign:
    """Choose for each joint the highest cut-off whose velocity noise is small beside the velocity of the Coulomb sign.

    Args:
        x: positions [rad or m], or measured velocities [rad/s or m/s], (N, n).
        coulomb: shape of the sign.
        rate: sample rate [Hz].
        lowest: cut-off that is tried first, and taken where the noise allows none [Hz].
        measured: whether x are velocities.
    """
    trials = [lowest]
    while (trial := trials[-1] * RATIO) <= min(SHARPEST_HZ, MOST_OF_RATE * rate):
        trials.append(trial)
    gains = [float(np.linalg.norm(_kernel(trial, rate, measured))) for trial in trials]
    chosen = []
    for noise, velocity in zip(white_noise(x), coulomb.velocity, strict=True):
        good = [f for f, gain in zip(trials, gains, strict=True) if gain * noise <= NOISE_OVER_COULOMB * velocity]
        chosen.append(max(good, default=lowest))
    return VelocitySign(coulomb, tuple(chosen), rate, measured)


def _kernel(cutoff: float, rate: float, measured: bool) -> Floats:
    lowpass = lowpass_kernel(cutoff, rate)
    return lowpass if measured else np.asarray(derivative_kernels(lowpass, rate)[1])
