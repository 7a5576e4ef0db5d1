"""Rows of the two-link arm: signals are filtered as its torques are."""

import numpy as np


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
