"""What is missing and has no name: smooth functions of place, speed, load and time, what repeats, what does not.

Each kind has a size of its own, found with everything else (``evidence``): it stands for all that the catalogue lacks,
so that an effect has to explain the rows better than something without a name would.

Source: Solin and Saerkkae 2020, "Hilbert space methods for reduced-rank Gaussian process regression", for the columns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.gap import tuning
from dynid.gap.noise import RepeatPair
from dynid.gap.segments import SegmentRows
from dynid.model.effects.friction import sign_of
from dynid.model.effects.interface import Floats

#: Columns of each kind, and its smoothness in half ranges of its variable.
PLACE, PLACE_SIGN, SPEED, LOAD, TIME = (12, 0.15), (8, 0.2), (10, 0.2), (5, 0.25), (8, 0.2)
#: Speed around which the scale of speeds turns from even to logarithmic [rad/s or m/s].
KNEE = 0.05
#: Seconds between columns of what repeats with the motion, and of what does not.
LOCKED_S, STRAY_S = 0.6, 2.0
#: Share of a stretch in all that is driven of it from which it is driven once.
ONCE = 0.7
#: Range beyond that of the rows, so that no column ends at their edge.
WIDER = 1.25
#: Kinds that stand for something that is missing; the others are errors that every log has.
MISSING = ("place", "place_sign", "speed", "load", "time", "locked", "stray", "new")


def smooth(x: Floats, low: float, high: float, kind: tuple[int, float]) -> Floats:
    """Return columns of a smooth function of a variable, (m, N), weighted as its spectrum is."""
    count, length = kind
    z = (x - 0.5 * (low + high)) / max(0.5 * (high - low), 1e-9)
    w = 0.5 * np.pi * np.arange(1, count + 1) / WIDER
    return np.asarray(np.exp(-0.25 * (w * length) ** 2)[:, None] * np.sin(w[:, None] * (z + WIDER)))


def phases(
    segments: Sequence[SegmentRows], repeats: Sequence[RepeatPair]
) -> tuple[list[int], list[Floats]]:
    """Return which motion each segment drives, and where in it each row is, (M,) [s]."""
    motion = list(range(len(segments)))
    phase = [np.arange(len(s)) / s.rate for s in segments]
    period: dict[int, float] = {}
    for pair in repeats:
        lag = pair.lag / segments[pair.first].rate
        if pair.first == pair.second:
            period[pair.first] = lag
        elif motion[pair.second] == pair.second:
            motion[pair.second] = motion[pair.first]
            phase[pair.second] = phase[pair.second] - lag + phase[pair.first][0]
    return motion, [x % period[k] if (k := motion[i]) in period else x for i, x in enumerate(phase)]


def bumps(x: Floats, spacing: float) -> Floats:
    """Return bells over a variable, so far apart or further where they would be too many, (m, N)."""
    low, high = float(x.min()), float(x.max())
    spacing = max(spacing, (high - low) / tuning.MOST_COLUMNS)
    centres = np.arange(low, high + spacing, spacing)
    return np.exp(-0.5 * ((x - centres[:, None]) / (0.65 * spacing)) ** 2)


def rest_columns(
    segments: Sequence[SegmentRows], repeats: Sequence[RepeatPair], joint: int
) -> dict[str, list[Floats]]:
    """Return columns of all kinds of what is left of one joint, filtered, {kind: one (m, M) per segment}."""
    q, qd, load = (
        np.concatenate([getattr(s.motion, name)[:, joint] for s in segments])
        for name in ("q", "qd", "rigid")
    )
    found: dict[str, list[Floats]] = {}
    for s in segments:
        motion, sign = s.motion, sign_of(s.motion, joint)
        own, speed = motion.q[:, joint], np.arcsinh(motion.qd[:, joint] / KNEE)
        top = np.arcsinh(np.array([qd.min(), qd.max()]) / KNEE)
        carried = smooth(motion.rigid[:, joint], load.min(), load.max(), LOAD)
        parts = {
            "place": smooth(own, q.min(), q.max(), PLACE),
            "place_sign": smooth(own, q.min(), q.max(), PLACE_SIGN) * sign,
            "speed": smooth(speed, top[0], top[1], SPEED),
            "load": np.concatenate(
                [carried, carried[:4] * sign, carried[:4] * motion.qd[:, joint]]
            ),
        }
        edges = np.cumsum([0, *map(len, parts.values())])
        kept = s.filtered(np.concatenate(list(parts.values())))
        for (name, _), a, b in zip(parts.items(), edges[:-1], edges[1:], strict=True):
            found.setdefault(name, []).append(kept[a:b])
    if not all(s.is_new for s in segments):
        every = [
            np.concatenate([found[name][k] for name in ("place", "speed", "load")])
            for k in range(len(segments))
        ]
        found["new"] = [x * s.is_new for x, s in zip(every, segments, strict=True)]
    return found | _in_time(segments, repeats, joint)


def _in_time(
    segments: Sequence[SegmentRows], repeats: Sequence[RepeatPair], joint: int
) -> dict[str, list[Floats]]:
    """Return columns of time: slow drift, what repeats with the phase of a motion, what does not, and reversals."""
    t = [s.t for s in segments]
    ends = min(x[0] for x in t), max(x[-1] for x in t)
    motion, phase = phases(segments, repeats)
    # Why not beside earlier logs: a slow function of time steps between old and new ones, as any change does.
    slow = all(s.is_new for s in segments)
    found = {"time": [smooth(x, *ends, TIME) for x in t]} if slow else {}
    seen, clock = sorted(set(motion)), 0.0
    every = np.concatenate(phase)
    number = np.repeat(motion, [len(x) for x in phase])
    for m in seen:
        own = every[number == m]
        every[number == m] += clock - own.min()
        clock += float(own.max() - own.min()) + 4 * STRAY_S
    ends_of_parts = np.cumsum([len(x) for x in phase])[:-1]
    found["locked"] = np.split(_present(bumps(every, LOCKED_S)), ends_of_parts, axis=1)
    starts = np.cumsum([0.0, *(x[-1] - x[0] + 4 * STRAY_S for x in t)])
    alone = np.concatenate([x - x[0] + start for x, start in zip(t, starts, strict=False)])
    stray = np.array([_unrepeated(x, every) for x in _present(bumps(alone, STRAY_S))])
    found["stray"] = np.split(stray, ends_of_parts, axis=1)
    return found | {"reversals": _reversals(segments, joint)}


def _present(columns: Floats) -> Floats:
    """Return bells that some row is near, (m, M)."""
    return np.asarray(columns[columns.max(axis=1) > 0.5])


def _unrepeated(bell: Floats, phase: Floats) -> Floats:
    """Return a bell less what repeats of it: its mean over all times that the motion is driven, (M,).

    Args:
        bell: over the time of one recording, (M,).
        phase: of all motions, one after the other [s], (M,).
    """
    here = np.flatnonzero(bell > 1e-3)
    here = here[np.argsort(phase[here])]
    again = np.interp(phase, phase[here], bell[here], left=0.0, right=0.0)
    share = float(bell.sum() / max(again.sum(), 1e-300))
    return bell - share * again if share < ONCE else bell


def _reversals(segments: Sequence[SegmentRows], joint: int) -> list[Floats]:
    """Return a short bell at each reversal; of very many, some share one, (m, M) each."""
    turns = [np.flatnonzero(np.diff(np.sign(s.qd[:, joint])) != 0) for s in segments]
    count = min(max(sum(map(len, turns)), 1), tuning.MOST_COLUMNS)
    found, at = [], 0
    for s, rows in zip(segments, turns, strict=True):
        columns = np.zeros((count, len(s)))
        width = tuning.REVERSAL_S * s.rate
        for k, row in enumerate(rows.tolist()):
            columns[(at + k) % count] += np.exp(
                -0.5 * ((np.arange(len(s)) - row - 0.5) / width) ** 2
            )
        at += len(rows)
        found.append(columns)
    return found
