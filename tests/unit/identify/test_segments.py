"""Segments walked from a stack carry the same rows as its triangular factors."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynid.identify.segments import Segment, StackSegments, joint_factors, robust_noise, root_mean_square
from dynid.identify.stack import Rows


def pieces():
    rng = np.random.default_rng(0)
    for k, starts in enumerate((True, False, True)):
        W, t = rng.standard_normal((40, 2, 3)), np.arange(40) / 100 + k
        usable = rng.random((40, 2)) > 0.1
        yield Rows(t, W, np.where(usable, W @ [1.0, 2.0, 3.0] + [0.0, 1.0], 1e9), usable, k, starts)


def test_rows_of_a_stack_can_be_walked_twice():
    stack = SimpleNamespace(sources=("one log", "another"), rows_of_log=lambda log: pieces())
    segments = StackSegments(stack)
    first, second = joint_factors(segments), joint_factors(segments)
    assert np.array_equal(first[0], second[0])
    assert [segment.follows for segment in segments] == [False, True, False] * 2
    assert list(first[1]) == [2 * sum(int(part.usable[:, j].sum()) for part in pieces()) for j in range(2)]


def test_rows_that_do_not_count_leave_no_trace():
    segments = [Segment(part.W, part.tau, usable=part.usable) for part in pieces()]
    theta = np.array([1.0, 2.0, 3.0])
    assert root_mean_square(segments, theta) == pytest.approx([0.0, 1.0], abs=1e-2)
    assert robust_noise(segments, theta) == pytest.approx([0.0, 1.4826], abs=1e-6)
