"""DIDIM: the torques of the arm simulated under its controller are fitted to the measured ones.

Measured positions take no part, so their noise cannot bias anything; wrong gains can. The simulated motion hardly
depends on the parameters, because the controller holds it to the command: each round is a linear fit.

Source: Gautier, Janot, Vandanjon 2013, "A new closed-loop output error method for parameter identification of robot
dynamics".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.hac import hac_covariance
from dynid.estimation.least_squares import weighted
from dynid.estimation.observation_rows import ObservationRows, RowWalk, joint_factors
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


def direct(simulate: Callable[[Floats], Iterable[ObservationRows]], start: Floats) -> DirectFit:
    """Fit the torques of the simulated motion until the motion no longer changes.

    Args:
        simulate: returns the logs simulated with given parameters, (p,).
        start: first parameters, (p,).
    """
    theta = start
    for _ in range(ROUNDS):
        rows = of_simulation(simulate(theta))
        before, fit = theta, weighted(*joint_factors(rows))
        theta, noise, robust = fit.theta, fit.noise, look_for_spikes(rows, fit.theta).found
        if robust:
            weighed = huber(rows, theta)
            theta, noise = weighed.theta, weighed.noise
        covariance = hac_covariance(rows, theta, noise, robust=robust).covariance
        if np.all(np.abs(theta - before) <= SETTLED * np.sqrt(np.diagonal(covariance))):
            break
    return DirectFit(theta, covariance, noise)


def of_simulation(rows: Iterable[ObservationRows]) -> RowWalk:
    """Return the rows with the regressor itself on the simulated motion."""
    return RowWalk(
        lambda: (replace(each, entries=each.command, command=None) for each in rows if each.command is not None)
    )
