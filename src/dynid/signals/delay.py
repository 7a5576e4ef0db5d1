"""Torques moved to the time of the positions that they belong to."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dynid.log import Log
from dynid.signals.conditioning import GAP_SAMPLES, resampled


def without_delay(log: Log, delay: float) -> Log:
    """Return a prepared log whose torque at t is the measured one at t + delay.

    Args:
        log: a prepared log.
        delay: by how much the torques are late [s]; samples at the end without a torque are left out.
    """
    if delay == 0.0 or len(log) < 4:
        return log
    wanted = log.t + delay
    inside = (wanted >= log.t[0]) & (wanted <= log.t[-1])
    right = np.clip(np.searchsorted(log.t, wanted[inside]), 1, len(log) - 1)
    # Why: a torque from the middle of a gap was never measured; its samples count as little as clipped ones.
    unknown = log.t[right] - log.t[right - 1] > (GAP_SAMPLES + 0.5) / log.rate

    def kept(value: Any) -> Any:  # noqa: ANN401
        return value[inside] if isinstance(value, np.ndarray) and value.shape[:1] == log.t.shape else value

    extra = {key: kept(value) for key, value in log.extra.items()}
    clipped = log.extra.get("clipped")
    before = np.zeros((len(right), log.n), dtype=bool)
    if clipped is not None:
        before = clipped[right] | clipped[right - 1]
    extra["clipped"] = before | unknown[:, None]
    tau = resampled(log.t, log.tau, wanted[inside])
    return replace(log, t=log.t[inside], q=kept(log.q), qd=kept(log.qd), tau=tau, extra=extra)
