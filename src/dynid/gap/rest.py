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

#: Columns of each kind, and its smoothness in half ranges of its variable.
PLACE, PLACE_SIGN, SPEED, LOAD = (12, 0.15), (8, 0.2), (10, 0.2), (5, 0.25)
#: Speed around which the scale of speeds turns from even to logarithmic [rad/s or m/s].
KNEE = 0.05
#: Range beyond that of the rows, so that no column ends at their edge.
WIDER = 1.25


def smooth(x: Floats, low: float, high: float, kind: tuple[int, float]) -> Floats:
    """Return columns of a smooth function of a variable, (m, N), weighted as its spectrum is."""
    count, length = kind
    z = (x - 0.5 * (low + high)) / max(0.5 * (high - low), 1e-9)
    w = 0.5 * np.pi * np.arange(1, count + 1) / WIDER
    return np.exp(-0.25 * (w * length) ** 2)[:, None] * np.sin(w[:, None] * (z + WIDER))


def rest_columns(rows: GapRows, joint: int) -> dict[str, Floats]:
    """Return columns of all kinds of what is left of one joint, filtered, {kind: (m, M)}."""
    q, qd, load = (
        np.concatenate([getattr(motion, name)[:, joint] for motion in rows.motions])
        for name in ("q", "qd", "rigid")
    )
    top = np.arcsinh(np.array([qd.min(), qd.max()]) / KNEE)
    parts = []
    for motion in rows.motions:
        own, speed, sign = motion.q[:, joint], motion.qd[:, joint], sign_of(motion, joint)
        carried = smooth(motion.rigid[:, joint], load.min(), load.max(), LOAD)
        parts.append(
            {
                "place": smooth(own, q.min(), q.max(), PLACE),
                "place_sign": smooth(own, q.min(), q.max(), PLACE_SIGN) * sign,
                "speed": smooth(np.arcsinh(speed / KNEE), top[0], top[1], SPEED),
                "load": np.concatenate([carried, carried[:4] * sign, carried[:4] * speed]),
            }
        )
    columns_of_kind = {kind: rows.filtered([part[kind] for part in parts]) for kind in parts[0]}
    if rows.compared:
        every = np.concatenate([columns_of_kind[kind] for kind in ("place", "speed", "load")])
        columns_of_kind["new"] = every * rows.is_new
    return columns_of_kind
