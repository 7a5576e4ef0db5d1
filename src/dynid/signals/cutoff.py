"""Which cut-off a log is filtered at: from the band of its motion, lower where its positions are noisy.

Least squares takes the regressor for exact. White noise of the positions becomes, in the accelerations below a cut-off
f, noise that grows with f^2.5; it draws parameters towards zero by the square of its share, and no interval knows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding
from dynid.log import Log
from dynid.longarrays import median, spread
from dynid.robot import Robot
from dynid.signals.motion import MOVING_SPEED, bandwidth, per_joint

Floats = NDArray[np.float64]

#: The cut-off lies this many times above the band of the motion: Coriolis products double frequencies, and reversals
#: of friction add harmonics.
CUTOFF_OVER_MOTION = 5.0
#: Lowest cut-off chosen from the band alone [Hz]: slow motions have friction reversals as sharp as fast ones.
LOWEST_CUTOFF_HZ = 5.0
#: Noise of the positions that no cut-off is chosen for [rad, m]: finer encoders and slower arms are as they are.
POSITION_NOISE = (2e-4, 2e-5)
#: Share of noise in the accelerations of a joint up to which intervals hold: of LWR logs with 2e-3 rad (benchmarks/
#: odd_noise.md), 98 % of the true parameters lie within two standard errors at 0.15, 89 % at 0.3 and 83 % at 0.5.
MOST_SHARE = 0.12
#: Cut-offs that are tried [Hz]: lower ones would leave next to nothing of any motion.
LOWEST_HZ, STEP_HZ = 1.0, 0.25
#: What third differences make of white noise of unit variance: sqrt(1 + 9 + 9 + 1).
_THIRD = 20**0.5
#: The noise of positions, and the accelerations of a motion, need no more samples than this.
NOISE_SAMPLES = 1 << 18
#: Power of a Hann window.
_HANN = 0.375


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

    @property
    def harmless(self) -> bool:
        """Whether intervals hold at ``cutoff``."""
        return self.share <= MOST_SHARE


def usual_cutoff(log: Log, robot: Robot) -> float:
    """Return the cut-off that the band of a log's motion asks for [Hz]."""
    return max(LOWEST_CUTOFF_HZ, CUTOFF_OVER_MOTION * bandwidth(log, robot))


def choose_cutoff(logs: Sequence[Log], robot: Robot) -> float:
    """Return one cut-off for several logs [Hz]: what the fastest motion asks for and the noisiest positions allow."""
    noises = [position_noise(log, robot) for log in logs]
    allowed = [noise.cutoff for noise in noises if noise is not None]
    return min([max(usual_cutoff(log, robot) for log in logs), *allowed])


def check_position_noise(log: Log, robot: Robot) -> tuple[Finding, ...]:
    """Return finding W327 when positions scatter so much that the cut-off is chosen for it."""
    noise = position_noise(log, robot)
    if noise is None or (noise.harmless and noise.cutoff >= usual_cutoff(log, robot)):
        return ()
    joint = robot.joints[noise.joint]
    what = f"{joint.name} position scatters by {noise.level[noise.joint]:.1g} {'rad' if joint.revolute else 'm'}"
    if noise.harmless:
        text = f"{what}: everything is filtered at {noise.cutoff:.3g} Hz, below which it does not bias the parameters"
    else:
        text = (
            f"{what}: parameters are biased by it and their intervals are too narrow; record the commanded positions "
            "too (--method iv), or use a finer encoder"
        )
    evidence = {"noise": noise.level.tolist(), "cutoff_hz": noise.cutoff, "share_of_acceleration": noise.share}
    return (Finding("W327", "warning", text, evidence),)


def level_of(log: Log) -> Floats:
    """Return the noise of the positions from their third differences, in which motion vanishes, (n,) [rad or m]."""
    bends = [np.abs(np.diff(log.q[part], 3, axis=0)) for part in spread(len(log), NOISE_SAMPLES)]
    return np.asarray(median(np.concatenate(bends), axis=0) * 1.4826 / _THIRD)


def position_noise(log: Log, robot: Robot) -> Noise | None:
    """Return the noise of the positions where it is large enough for a cut-off of its own, else None.

    Instruments from commanded positions are not biased by it: None for logs that have those.
    """
    if "q_ref" in log.extra:
        return None
    level = level_of(log)
    if not np.any(level > per_joint(POSITION_NOISE, robot)):
        return None
    cutoffs = np.arange(LOWEST_HZ, max(0.45 * log.rate, LOWEST_HZ) + STEP_HZ / 2, STEP_HZ)
    share, moves = _shares(log, level, cutoffs), _moves(log, robot, level)
    if not moves.any():
        return None
    worst = np.where(moves, share, 0.0).max(axis=1)
    quiet = np.flatnonzero(worst <= MOST_SHARE)
    best = int(quiet[-1]) if len(quiet) else int(np.argmin(worst))
    joint = int(np.argmax(np.where(moves, share[best], 0.0)))
    return Noise(level, joint, float(cutoffs[best]), float(worst[best]))


def _shares(log: Log, level: Floats, cutoffs: Floats) -> Floats:
    """Return the share of noise in what the accelerations below each cut-off are, (C, n)."""
    power: Floats = np.zeros((len(cutoffs), log.n))
    parts = spread(len(log), NOISE_SAMPLES)
    for part in parts:
        q = log.q[part] - log.q[part].mean(axis=0)
        f = np.fft.rfftfreq(len(q), 1 / log.rate)
        spectrum = np.abs(np.fft.rfft(q * np.hanning(len(q))[:, None], axis=0)) ** 2 * 2 / (_HANN * len(q) ** 2)
        below = np.cumsum((2 * np.pi * f[:, None]) ** 4 * spectrum, axis=0)
        power += below[np.searchsorted(f, cutoffs) - 1] / len(parts)
    noise = np.outer((2 * np.pi) ** 2 * cutoffs**2.5 * np.sqrt(2 / (5 * log.rate)), level)
    return np.asarray(noise / np.sqrt(np.maximum(power, noise**2)))


def _moves(log: Log, robot: Robot, level: Floats) -> NDArray[np.bool_]:
    """Return the joints that move by more than their noise, (n,)."""
    span = np.ptp(log.q, axis=0)
    return np.asarray((span > per_joint(MOVING_SPEED, robot) * np.ptp(log.t)) | (span > 20 * level))
