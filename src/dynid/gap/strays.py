"""What does not repeat: short disturbances in what everything else leaves, by log, time, joint and size."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import label

from dynid.arrays import Floats, Ints
from dynid.gap import tuning
from dynid.gap.gap_rows import GapRows
from dynid.gap.search import State
from dynid.judgement.gap import Event
from dynid.robot import Joint, Robot


def find_strays(state: State, robot: Robot) -> tuple[Event, ...]:
    """Return the loudest disturbance of each joint that has any, the loudest first.

    Args:
        state: everything that explains the rows.
        robot: the arm.
    """
    bands, evidence, rows = state.rows.bands, state.evidence, state.rows.rows
    noise, theta = bands.noise, evidence.estimate
    left = (rows.tau - rows.W @ theta[: rows.W.shape[2]]).T - state.rows.common_torque(evidence)
    events = []
    for k, one in enumerate(state.named):
        place, size = one.place, theta[state.columns(k)]
        columns = rows.columns(place.effect, place.joints, [one.shape], always=place.always)
        for j, C in columns.items():
            left[j] -= size @ C[0]
    for j, rest in enumerate(state.rows.filtered):
        index = np.flatnonzero(noise.counting(rows, j))
        if len(index):
            alone = left[j] - evidence.rest_of(j) @ rest
            # Why both: what the model lacks repeats, and a push is in one of the repeats alone.
            both = np.array([alone, bands.unrepeated(j, alone)])
            if event := _loudest(
                robot.joints[j], noise.whiten(rows, j, both), index, rows, noise.floor[j]
            ):
                events.append(event)
    return tuple(sorted(events, key=lambda event: -event.power))


def _loudest(joint: Joint, left: Floats, index: Ints, rows: GapRows, floor: float) -> Event | None:
    block = index // max(1, round(tuning.STRAY_BLOCK_S * rows.rate))
    names, place, count = np.unique(block, return_inverse=True, return_counts=True)
    power = np.min([np.bincount(place, x**2) / count for x in left], axis=0)
    full = count >= 0.5 * count.max()
    usual = float(np.median(power[full]))
    k = int(np.argmax(np.where(full, power, 0.0)))
    if usual <= 0 or power[k] < tuning.STRAY_POWER * max(usual, 1.0):
        return None
    # Blocks without a gap between them that are loud, too: what goes on is one disturbance.
    run = label(np.bincount(names, power > 0.25 * power[k]) > 0)[0][block]
    first = np.argmax(place == k)
    part = rows.part[index[first]]
    times = rows.stamp[index[(run == run[first]) & (rows.part[index] == part)]]
    log = rows.logs[part]
    return Event(
        log=log.path or log.name,
        joint=joint.name,
        start=float(times.min()),
        end=float(times.max()) + 1.0 / rows.rate,
        size=float(floor * np.sqrt(power[k])),
        unit=joint.torque_unit,
        power=float(power[k] / usual),
    )
