"""What does not repeat: short disturbances in what everything else leaves, by log, time, joint and size."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.gap import tuning
from dynid.gap.evidence import Evidence, EvidenceRows, back
from dynid.gap.segments import SegmentRows
from dynid.gap.whitened_regression import EffectColumns, Ints
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


def find_strays(
    evidence: Evidence, rows: EvidenceRows, added: Sequence[EffectColumns], shown: Sequence[int]
) -> list[Stray]:
    """Return the loudest disturbance of each joint that has any.

    Args:
        evidence: everything that explains the rows.
        rows: whitened columns.
        added: columns of names, one effect after the other.
        shown: joints on which repeats show that something does not repeat, and a weaker sign tells when.
    """
    regression, theta = rows.regression, evidence.estimate
    found = []
    for j, own in enumerate(regression.joints):
        if not len(own.y):
            continue
        part, t0 = evidence.parts[j], rows.T[j].shape[1]
        w = back(part.root, part.towards @ np.append(-theta, 1.0))
        # Why kept: a bell of a few seconds that takes up a contact would hide it.
        for name, columns in evidence.joints[j].kinds:
            if name == "stray":
                w[columns] = 0.0
        left = own.y - rows.T[j] @ theta[:t0] - rows.R[j] @ w
        at = t0
        for one in added:
            count = len(next(iter(one.values())))
            if j in one:
                left = left - theta[at : at + count] @ one[j]
            at += count
        least = tuning.STRAY_SHOWN if j in shown else tuning.STRAY_POWER
        stray = _loudest(j, left, own.index, regression.segments, regression.noise.floor[j], least)
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
    power = np.bincount(place, left**2) / count
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
