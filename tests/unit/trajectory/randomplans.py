"""Random motions inside the limits, for tests."""

import numpy as np

from dynid.trajectory.basis import Quintic
from dynid.trajectory.feasible import Shaping, bounds
from dynid.trajectory.plan import Trajectory


def random_trajectory(robot, seed, basis=None, margin=0.0, alpha=1.0):
    basis = basis or Quintic.even(6.0, 5)
    shaping = Shaping(basis, bounds(robot, margin), np.zeros(1))
    return Trajectory(
        basis, shaping.coefficients(shaping.random(np.random.default_rng(seed))), alpha
    )
