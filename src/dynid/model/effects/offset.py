"""Torque offset: a constant fo, from a sensor that was not zeroed or friction that differs with the direction."""

from __future__ import annotations

import numpy as np

from dynid.model.effects.interface import Column


def offset_column(joint: int, unit: str) -> Column:
    """Return the column of fo for one joint (0-based)."""
    return Column(
        f"fo{joint + 1}",
        unit,
        (joint,),
        lambda s: [np.ones(len(s.qd))],
        exact=lambda s: [np.ones_like(s.qd[:, 0])],
        pull=lambda *_: None,
    )
