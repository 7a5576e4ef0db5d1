"""Measurement points are few, and tell nearly as much as the whole path."""

import numpy as np
from randomplans import random_trajectory

from dynid.trajectory.cost import Cost, figures
from dynid.trajectory.selection import select


def test_few_chosen_samples_are_as_well_conditioned_as_the_whole_path(lwr):
    motion = random_trajectory(lwr.robot, 1).sampled(100)
    W = lwr.model.observer(lwr.reduction.base).dense(motion.q, motion.qd, motion.qdd)
    chosen = select(W, 0.02)
    all_rows, rows = W.reshape(-1, 62), W[chosen].reshape(-1, 62)
    assert 18 <= len(chosen) < len(W) / 3
    assert np.all(np.diff(chosen) > 0)
    assert figures(rows.T @ rows).condition < 1.5 * figures(all_rows.T @ all_rows).condition


def test_a_higher_threshold_keeps_fewer_samples(gen2):
    motion = random_trajectory(gen2.robot, 2).sampled(50)
    W = gen2.model.observer(gen2.reduction.base).dense(motion.q, motion.qd, motion.qdd)
    assert len(select(W, 0.2, Cost("condition"))) <= len(select(W, 0.005, Cost("condition")))
