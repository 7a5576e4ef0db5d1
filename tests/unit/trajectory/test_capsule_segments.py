"""Distances of segments are those that a dense search over both of them finds."""

import numpy as np
import pytest

from dynid.trajectory.scene import Box, box_distance, segment_to_box

GRID = np.linspace(0, 1, 401)


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
