"""The same motion before and now: what a kept model lacked then and lacks now cancels, what has changed is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.estimation.noise_floor import lag_of, shifted
from dynid.estimation.tuning import SHORTEST_REPEAT_S
from dynid.gap.segments import SegmentRows
from dynid.model.effects.interface import Floats

#: Share of the rows that must have been driven before; the others are left out.
MOST = 0.8


def subtract_matched_motion(
    segments: Sequence[SegmentRows], earlier: Sequence[SegmentRows], theta: Floats
) -> tuple[list[SegmentRows], float] | None:
    """Take from torques what the kept model left of the same motion in earlier logs.

    Args:
        segments: rows of the new logs.
        earlier: rows of the logs that the model was identified from.
        theta: base parameters of the kept model, (p,).

    Returns:
        The segments with the rest of the torques, rows that were not driven before not counting, and how many earlier
        rows each is compared with; None where the motion is another one.
    """
    left = [s.tau - s.W @ theta for s in earlier]
    found, rows, count = [], 0, 0
    for s in segments:
        total, matched = np.zeros(s.tau.shape), np.zeros(s.tau.shape)
        for then, r in zip(earlier, left, strict=True):
            _add(s, then, r, total, matched)
        use = s.use & (matched > 0)
        found.append(
            replace(s, rows=replace(s.rows, tau=s.tau - total / np.maximum(matched, 1.0)), use=use)
        )
        rows, count = rows + int(use.sum()), count + int(matched[use].sum())
    if rows < MOST * sum(int(s.use.sum()) for s in segments):
        return None
    return found, count / max(rows, 1)


def _add(now: SegmentRows, then: SegmentRows, left: Floats, total: Floats, matched: Floats) -> None:
    """Add what was left then to the rows of the same motion now; row k now is row k + lag then."""
    lag = lag_of(now.q, then.q, round(SHORTEST_REPEAT_S * now.rate), None)
    if lag is None:
        return
    whole = int(np.floor(lag))
    start, end = max(0, -whole), min(len(now), len(then) - whole - 1)
    part = slice(start + whole, end + whole)
    use = then.use[part] & then.use[part.start + 1 : part.stop + 1]
    total[start:end] += np.where(use, shifted(left, lag - whole)[part], 0.0)
    matched[start:end] += use
