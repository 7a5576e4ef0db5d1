"""DIDIM: the torques of the arm simulated under its controller are fitted to the measured ones.

Measured positions take no part, so their noise cannot bias anything; wrong gains can. The simulated motion hardly
depends on the parameters, because the controller holds it to the command: each round is a linear fit.

Source: Gautier, Janot, Vandanjon 2013, "A new closed-loop output error method for parameter identification of robot
dynamics".
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.closed_loop import Simulated
from dynid.estimation.hac import hac_covariance
from dynid.estimation.least_squares import weighted
from dynid.estimation.observation_rows import Rows, joint_factors
from dynid.estimation.robust import huber, look_for_spikes

Floats = NDArray[np.float64]

#: Simulations at most; parameters that move by less than this many standard errors have settled.
ROUNDS, SETTLED = 8, 0.05


@dataclass(frozen=True)
class DirectFit:
    """A fit of simulated torques.

    Attributes:
        theta: parameters, (p,).
        covariance: HAC covariance, (p, p).
        noise: standard deviation of each joint's residual, (n,) [N m].
    """

    theta: Floats
    covariance: Floats
    noise: Floats


@dataclass(frozen=True)
class _OfSimulation:
    rows: Simulated

    def __iter__(self) -> Iterator[Rows]:
        return self.rows.of_simulation()


def direct(simulate: Callable[[Floats], Simulated], start: Floats) -> DirectFit:
    """Fit the torques of the simulated motion until the motion no longer changes.

    Args:
        simulate: returns the logs simulated with given parameters, (p,).
        start: first parameters, (p,).
    """
    theta = start
    for _ in range(ROUNDS):
        rows = _OfSimulation(simulate(theta))
        before, fit = theta, weighted(*joint_factors(rows))
        theta, noise, robust = fit.theta, fit.noise, look_for_spikes(rows, fit.theta).found
        if robust:
            weighed = huber(rows, theta)
            theta, noise = weighed.theta, weighed.noise
        covariance = hac_covariance(rows, theta, noise, robust=robust).covariance
        if np.all(np.abs(theta - before) <= SETTLED * np.sqrt(np.diagonal(covariance))):
            break
    return DirectFit(theta, covariance, noise)
