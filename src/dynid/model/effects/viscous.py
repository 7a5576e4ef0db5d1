"""Viscous friction: fv qd."""

from __future__ import annotations

from dynid.model.effects.interface import Column


def viscous_column(joint: int, unit: str) -> Column:
    """Return the column of fv for one joint (0-based). Source: Paper Eq. 7."""
    return Column(f"fv{joint + 1}", unit, (joint,), lambda s: [s.qd[:, joint]], exact=lambda s: [s.qd[:, joint]])
