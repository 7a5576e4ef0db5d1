"""Rows of the two-link arm: what they hold, which count, and how time is cut into blocks."""

import numpy as np

import twolink


def test_rows_hold_the_law_of_the_arm(clean, twolinks):
    """Base columns times the base parameters of the true arm are the torques, but for the noise."""
    base = twolinks.base
    truth = dict.fromkeys(base.reduction.names, 0.0)
    # Why less the lengths: bodies sit behind their frames in the standard convention.
    for j, (m, r, i) in enumerate(
        zip(twolink.MASS, twolink.COM, twolink.INERTIA, strict=True), start=1
    ):
        away = r - (0.4, 0.3)[j - 1]
        truth |= {f"m{j}": m, f"mcx{j}": m * away, f"Izz{j}": i + m * away**2}
        truth |= {f"fv{j}": twolink.VISCOUS[j - 1], f"fc{j}": twolink.COULOMB[j - 1]}
    theta = base.reduction.K @ np.array([truth[name] for name in base.reduction.names])
    rows = clean.rows
    left = rows.tau - rows.W @ theta
    for part in rows.parts:
        assert np.sqrt(np.mean(left[part][rows.use[part].all(axis=1)] ** 2)) < 0.06


def test_signals_are_filtered_as_the_torques_are(clean):
    """A constant stays, and what is far above the cut-off of 10 Hz goes."""
    rows, signals = clean.rows, []
    for motion in rows.motions:
        t = motion.t
        slow, fast = (np.sin(2 * np.pi * f * t) for f in (0.5, 40))
        signals.append(np.stack([np.ones(len(t)), slow, fast]))
    one, slow, fast = rows.filtered(signals)
    np.testing.assert_allclose(one, 1.0, atol=1e-9)
    np.testing.assert_allclose(slow, np.sin(2 * np.pi * 0.5 * rows.t), atol=0.01)
    assert np.abs(fast).max() < 0.05
    assert len(one) == len(rows)
