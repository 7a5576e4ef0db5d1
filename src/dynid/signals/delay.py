"""Torques moved back to the time of the positions that they belong to: of whole logs, and of conditioned segments."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from dynid.log import Log
from dynid.longarrays import empty, spans, taken
from dynid.signals.conditioning import GAP_SAMPLES, Segment, resampled


def without_delay(log: Log, delay: float) -> Log:
    """Return a prepared log whose torque at t is the measured one at t + delay.

    Args:
        log: a prepared log.
        delay: by how much the torques are late [s]; samples at the end without a torque are left out.
    """
    if delay == 0.0 or len(log) < 4:
        return log
    wanted = log.t + delay
    rows = np.flatnonzero((wanted >= log.t[0]) & (wanted <= log.t[-1]))
    right = np.clip(np.searchsorted(log.t, wanted[rows]), 1, len(log) - 1)
    # Why: a torque from the middle of a gap was never measured; its samples count as little as clipped ones.
    unknown = log.t[right] - log.t[right - 1] > (GAP_SAMPLES + 0.5) / log.rate

    def kept(value: Any) -> Any:  # noqa: ANN401
        return taken(value, rows) if isinstance(value, np.ndarray) and value.shape[:1] == log.t.shape else value

    extra = {key: kept(value) for key, value in log.extra.items()}
    clipped = log.extra.get("clipped")
    late = empty((len(right), log.n), bool)
    for part in spans(len(right)):
        late[part] = unknown[part, None]
        if clipped is not None:
            late[part] |= clipped[right[part]] | clipped[right[part] - 1]
    extra["clipped"] = late
    tau = resampled(log.t, log.tau, wanted[rows])
    return replace(log, t=log.t[rows], q=kept(log.q), qd=kept(log.qd), tau=tau, extra=extra)


def segment_without_delay(segment: Segment, delay: float) -> Segment:
    """Return a segment whose torque at t is the filtered one at t + delay; the end is not usable any more.

    Why a spline here: filtered torques are thinned, so that four samples no longer carry them, and a search over delays
    needs a torque that is smooth in the delay.

    Args:
        segment: the segment.
        delay: by how much the torques are late [s].
    """
    if not delay:
        return segment
    from scipy.interpolate import CubicSpline

    t = segment.t + delay
    inside = (t >= segment.t[0]) & (t <= segment.t[-1])
    wanted = np.clip(t, segment.t[0], segment.t[-1])
    tau = np.asarray(CubicSpline(segment.t, segment.tau, axis=0)(wanted))
    return replace(segment, tau=tau, usable=segment.usable & inside[:, None])
