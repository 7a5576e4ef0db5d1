"""What is missing and has no name: smooth functions of place, speed and load, always and since the earlier logs.

Each kind has a size of its own, found with everything else (``evidence``): it stands for all that the catalogue lacks,
so that an effect has to explain the rows better than something without a name would. What is a function of the clock
alone has no columns: it is the power of each band (``bands``).

Source: Solin and Saerkkae 2020, "Hilbert space methods for reduced-rank Gaussian process regression", for the columns.
"""

from __future__ import annotations

import numpy as np

from dynid.arrays import Floats
from dynid.gap.gap_rows import GapRows
from dynid.model.effects.friction import sign_of
from dynid.model.effects.motion import ArmMotion

#: Columns of each kind, and its smoothness in half ranges of its variable.
PLACE, PLACE_SIGN, SPEED, LOAD, BESIDE = (12, 0.15), (8, 0.2), (10, 0.2), (5, 0.25), (4, 0.4)
#: Speed around which the scale of speeds turns from even to logarithmic [rad/s or m/s].
KNEE = 0.05
#: Range beyond that of the rows, so that no column ends at their edge.
WIDER = 1.25


def smooth(x: Floats, kind: tuple[int, float]) -> Floats:
    """Return columns of a smooth function of a variable, (m, N), weighted as its spectrum is."""
    count, length = kind
    low, high = x.min(), x.max()
    z = (x - 0.5 * (low + high)) / max(0.5 * (high - low), 1e-9)
    w = 0.5 * np.pi * np.arange(1, count + 1) / WIDER
    return np.exp(-0.25 * (w * length) ** 2)[:, None] * np.sin(w[:, None] * (z + WIDER))


def rest_columns(rows: GapRows, motion: ArmMotion, joint: int) -> dict[str, Floats]:
    """Return columns of all kinds of what is left of one joint, filtered, {kind: (m, M)}; ``motion`` of all parts."""
    q, qd, sign = motion.q.T, motion.qd.T, sign_of(motion, joint)
    carried = smooth(motion.rigid[:, joint], LOAD)
    kinds = {
        "place": smooth(q[joint], PLACE),
        "place_sign": smooth(q[joint], PLACE_SIGN) * sign,
        "speed": smooth(np.arcsinh(qd[joint] / KNEE), SPEED),
        "load": np.concatenate([carried, carried[:4] * sign, carried[:4] * qd[joint]]),
    }
    near = [k for k in (joint - 1, joint + 1) if 0 <= k < len(q)]
    if near and not rows.compared:
        # Why of friction alone: torques of their place, of a tilt or a cable, have names to be found by.
        columns = [smooth(x[k], BESIDE) for k in near for x in (q, qd)]
        kinds["beside"] = np.concatenate(columns) * sign
    ends = np.cumsum([len(part) for part in rows.motions])[:-1]
    filtered = {kind: rows.filtered(np.split(C, ends, axis=1)) for kind, C in kinds.items()}
    if rows.compared:
        every = np.concatenate([filtered[kind] for kind in ("place", "speed", "load")])
        filtered["new"] = every * rows.is_new
    return filtered
