"""What does not repeat: short disturbances in what everything else leaves, by log, time, joint and size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.gap import tuning
from dynid.gap.known_errors import acceleration_torques, common_columns
from dynid.gap.segments import SegmentRows
from dynid.gap.selection import State
from dynid.gap.whitened_regression import Ints, filtered_columns
from dynid.model.effects.interface import Floats


@dataclass(frozen=True)
class Stray:
    """A disturbance that nothing explains and nothing repeats.

    Attributes:
        joint: 0-based.
        log: name of the log.
        start: when it begins, by the log's clock [s].
        end: when it ends [s].
        size: the largest torque that is left there, after the filter [N m or N].
        power: over the usual power of what is left.
    """

    joint: int
    log: str
    start: float
    end: float
    size: float
    power: float


def find_strays(state: State, shown: Sequence[int]) -> list[Stray]:
    """Return the loudest disturbance of each joint that has any.

    Args:
        state: everything that explains the rows.
        shown: joints on which repeats show that something does not repeat, and a weaker sign tells when.
    """
    regression, theta, p = (
        state.rows.regression,
        state.evidence.estimate,
        state.rows.regression.base,
    )
    left = []
    for s in regression.segments:
        errors = common_columns(s, acceleration_torques(s))
        shared = np.einsum("c,cnm->mn", theta[p : p + len(errors)], errors)
        left.append(s.tau - s.W @ theta[:p] - shared)
    for k, one in enumerate(state.named):
        place, size = one.place, theta[state.columns(k)]
        parts = filtered_columns(
            regression.segments, place.effect, place.joints, [one.shape], always=place.always
        )
        for j, part in parts.items():
            for rest, columns in zip(left, part, strict=True):
                rest[:, j] -= size @ columns[0]
    found = []
    for j, own in enumerate(regression.joints):
        if not len(own.y):
            continue
        w = state.evidence.rest_of(j)
        alone = [x[:, j] - w @ R for x, R in zip(left, state.rows.filtered[j], strict=True)]
        ends = np.cumsum([len(x) for x in alone])[:-1]
        # Why both: what the model lacks repeats, and a push is in one of the repeats alone.
        apart = np.split(state.rows.bands.unrepeated(j, np.concatenate(alone)), ends)
        rows = np.array([regression.whiten(j, x) for x in (alone, apart)])
        least = tuning.STRAY_SHOWN if j in shown else tuning.STRAY_POWER
        stray = _loudest(j, rows, own.index, regression.segments, regression.noise.floor[j], least)
        if stray is not None:
            found.append(stray)
    return found


def _loudest(
    joint: int,
    left: Floats,
    index: Ints,
    segments: Sequence[SegmentRows],
    floor: float,
    least: float,
) -> Stray | None:
    edges = np.cumsum([0, *map(len, segments)])
    rate = segments[0].rate
    block = index // max(1, round(tuning.STRAY_BLOCK_S * rate))
    names, place, count = np.unique(block, return_inverse=True, return_counts=True)
    power = np.min([np.bincount(place, x**2) / count for x in left], axis=0)
    full = count >= 0.5 * count.max()
    usual = float(np.median(power[full]))
    k = int(np.argmax(np.where(full, power, 0.0)))
    if usual <= 0 or power[k] < least * max(usual, 1.0):
        return None
    inside = np.flatnonzero(place == k)
    loud = (power > 0.25 * power[k]) & (
        np.abs(names - names[k]) <= np.abs(np.arange(len(names)) - k)
    )
    rows = np.flatnonzero(loud[place])
    segment = int(np.searchsorted(edges, index[inside[0]], side="right")) - 1
    rows = rows[(index[rows] >= edges[segment]) & (index[rows] < edges[segment + 1])]
    s = segments[segment]
    times = s.rows.t[index[rows] - edges[segment]]
    return Stray(
        joint,
        s.log.name,
        float(times.min()),
        float(times.max()) + 1.0 / rate,
        float(floor * np.sqrt(power[k])),
        float(power[k] / usual),
    )
