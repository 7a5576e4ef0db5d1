"""Torque samples that no arm can have produced: single ones far from their neighbours on both sides.

Filters smear a spike over their whole length, where no robust fit can tell it from the rest; before the filter it is
one sample. Reads raw torques; writes torques in which spikes are replaced by the median of their neighbours.
Source: Hampel 1974 (identifier by median and median deviation).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding
from dynid.log import Log

Floats = NDArray[np.float64]

#: Samples on either side that a sample is compared with.
REACH = 2
#: A spike is this many standard deviations of such differences away from the median, and this share of the joint's
#: range: noise is not the first, what is not the second does no harm.
DEVIATIONS, OF_RANGE = 8.0, 0.05
#: Where more samples than this share look like it, they are no accidents.
MOST = 0.03
#: The window is at most this share of the period of the cut-off: a slower log may show a motion in five samples.
OF_PERIOD = 0.25


def despiked(log: Log, cutoff: float) -> tuple[Log, tuple[Finding, ...]]:
    """Replace spikes of the torques by the median around them; a log without spikes comes back as it is.

    Args:
        log: a prepared log.
        cutoff: of the filter over the torques [Hz].
    """
    if len(log) <= 2 * REACH or (2 * REACH + 1) * cutoff > OF_PERIOD * log.rate:
        return log, ()
    tau, count = None, np.zeros(log.tau.shape[1], dtype=int)
    for j, x in enumerate(log.tau.T):
        medians = _median(x)
        away = np.abs(x - medians)
        spikes = (away > DEVIATIONS * 1.4826 * np.median(away)) & (away > OF_RANGE * np.ptp(x))
        if spikes.any() and np.mean(spikes) <= MOST:
            tau = log.tau.copy() if tau is None else tau
            tau[spikes, j], count[j] = medians[spikes], np.sum(spikes)
    if tau is None:
        return log, ()
    counts = ", ".join(f"{name} {n}" for name, n in zip(log.names, count, strict=True) if n)
    text = f"torque spikes were replaced by the median of their neighbours: {counts} of {len(log)} samples"
    return replace(log, tau=tau), (Finding("W324", "warning", text, {"samples": count.tolist()}),)


def _median(x: Floats) -> Floats:
    """Return the running median of five samples, (N,)."""
    a, b, e, c, d = np.lib.stride_tricks.sliding_window_view(np.pad(x, REACH, mode="edge"), 2 * REACH + 1).T
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    # Why: of five, the median is that of the fifth and what two pairs have in the middle.
    return np.asarray(np.maximum(np.minimum(low, high), np.minimum(np.maximum(low, high), e)))
