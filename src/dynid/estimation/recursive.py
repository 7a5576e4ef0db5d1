"""Add a log to an earlier result without the earlier log: recursive least squares on triangular factors.

A result keeps one factor of [W tau] a joint. Factors of old and new rows merged by one more QR are the factor of all
rows, so the parameters equal those of a fit on both logs to rounding. Single rows of the old log are gone: methods that
look at them cannot be updated, and the memory of the old residuals is taken over from the old covariance.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import WrongUsage
from dynid.estimation.result import StoredResult
from dynid.estimation.stack import Earlier, Stack

Floats = NDArray[np.float64]

#: Methods that need nothing but triangular factors.
UPDATABLE = ("wls", "ols", "ridge")


def with_earlier(stack: Stack, stored: StoredResult) -> Stack:
    """Return a stack of new logs that also holds what an earlier result was made from.

    Raises:
        WrongUsage: the earlier result has other base parameters, or keeps no factors.
    """
    found = stored.identification
    if found.names != stack.names:
        raise WrongUsage(
            f"{stored.path} has other base parameters than this log's model",
            fix="identify both with the same robot file",
        )
    if not found.factors.size:
        raise WrongUsage(f"{stored.path} holds no triangular factors", fix="identify the earlier log again")
    return replace(
        stack,
        factors=np.concatenate([found.factors[None], stack.factors]),
        counts=np.concatenate([found.counts[None], stack.counts]),
        log_of_block=np.concatenate([[-1], stack.log_of_block]),
        block=np.concatenate([[0], stack.block]),
        earlier=Earlier(found.factors, found.noise, found.covariance),
    )
