"""Distances of segments are those that a dense search over both of them finds."""

import numpy as np
import pytest

from dynid.trajectory.scene import Box, box_distance, nearest_of_segments, segment_to_box

GRID = np.linspace(0, 1, 401)


def test_nearest_points_of_two_segments_are_those_of_a_grid():
    rng = np.random.default_rng(0)
    p, d, q, e = rng.uniform(-1, 1, (4, 60, 3))
    d[:10] = e[:10] * rng.uniform(-2, 2, (10, 1))  # parallel ones
    s, t = nearest_of_segments(p, d, q, e)
    found = np.linalg.norm(p + s[:, None] * d - q - t[:, None] * e, axis=1)
    for k in range(60):
        apart = (p[k] + GRID[:, None] * d[k])[:, None] - (q[k] + GRID[:, None] * e[k])[None]
        assert found[k] == pytest.approx(np.linalg.norm(apart, axis=2).min(), abs=5e-3)
        assert found[k] <= np.linalg.norm(apart, axis=2).min() + 1e-12


def test_least_distance_of_a_segment_to_a_box_is_that_of_a_grid_and_negative_inside():
    rng = np.random.default_rng(1)
    box = Box((-0.3, -0.2, -0.4), (0.3, 0.2, 0.4))
    p, d = rng.uniform(-0.6, 0.6, (2, 80, 3))
    distance, nearest, out = segment_to_box(p, d, box)
    dense = box_distance(p[:, None] + GRID[None, :, None] * d[:, None], box)[0].min(axis=1)
    assert np.all(distance <= dense + 1e-7)
    assert distance == pytest.approx(dense, abs=5e-3)
    assert (distance < 0).sum() > 5
    assert np.all(np.linalg.norm(out, axis=1) <= 1 + 1e-9)
    assert box_distance(nearest, box)[0] == pytest.approx(distance, abs=1e-12)
