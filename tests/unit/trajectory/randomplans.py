"""Random motions inside the limits, for tests."""

import numpy as np

from dynid.trajectory.basis import Quintic
from dynid.trajectory.feasible import bounds, coefficients, random_variables
from dynid.trajectory.plan import Trajectory


def random_trajectory(robot, seed, basis=None, margin=0.0, alpha=1.0):
    basis = basis or Quintic.even(6.0, 5)
    limits = bounds(robot, margin)
    x = random_variables(basis, limits, np.random.default_rng(seed))
    return Trajectory(basis, coefficients(basis, limits, x), alpha)
