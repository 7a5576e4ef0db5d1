"""IDIM-IV: instrumental variables from the arm simulated under its controller.

The simulated motion follows the measured one more closely than the command does, where friction or gravity make the
arm lag, and it knows as little of the encoders' noise. Wrong gains weaken the instruments and bias nothing.

Source: Janot, Vandanjon, Gautier 2014, "A generic instrumental variable approach for industrial robot identification".
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.instrumental import InstrumentalFit, instrumental
from dynid.estimation.observation_rows import ObservationRows

Floats = NDArray[np.float64]

#: Simulations at most; parameters that move by less than this many standard errors have settled.
ROUNDS, SETTLED = 4, 0.1


def simulated_instruments(
    simulate: Callable[[Floats], Iterable[ObservationRows]], start: InstrumentalFit
) -> InstrumentalFit:
    """Estimate with instruments on the simulated motion, and simulate again with the estimate.

    Args:
        simulate: returns the rows with the instruments of given parameters, (p,).
        start: a first estimate.
    """
    fit = start
    for _ in range(ROUNDS):
        before, fit = fit.theta, instrumental(simulate(fit.theta), robust=True)
        if np.all(np.abs(fit.theta - before) <= SETTLED * np.sqrt(np.diagonal(fit.covariance))):
            break
    return fit
