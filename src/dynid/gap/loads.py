"""A load that a search has named, as heavy as the whole posterior of the arm without it says.

The search fits the load with errors that it takes to be noise. What the arm's residual model may explain, what its
friction may have changed by, and gains that are wrong in both logs alike are not noise, and they are larger.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.estimation.payload import IdentifiedPayload
from dynid.gap.analysis import GapAnalysis
from dynid.gap.selected_effects import SelectedEffect
from dynid.model.parameters import BODY_PARAMETERS

#: Parameters of a load that are told at least: its mass and its first moments.
LEAST_FORM = 4


def named_load(analysis: GapAnalysis) -> SelectedEffect | None:
    """Return the load that is named, None where none is."""
    return next((one for one in analysis.verdict.named if one.name == "payload"), None)


def with_reestimated_payload(
    analysis: GapAnalysis, load: SelectedEffect, payload: IdentifiedPayload
) -> GapAnalysis:
    """Return an analysis whose load has other numbers.

    Args:
        analysis: the analysis.
        load: the load that it names.
        payload: the load as it was weighed; of one that was taken off, the same body that hung there before.
    """
    form = max(LEAST_FORM, round(load.values["form"]))
    sign = 1.0 if load.values["m"] >= 0.0 else -1.0
    values, errors = sign * payload.body.parameters(), np.sqrt(np.diagonal(payload.covariance))
    new = replace(
        load,
        shape=load.shape | {"form": float(form)},
        values=dict(zip(BODY_PARAMETERS[:form], values.tolist(), strict=False))
        | {"form": float(form)},
        std_errors=load.std_errors
        | dict(zip(BODY_PARAMETERS[:form], errors.tolist(), strict=False)),
    )

    verdict = replace(
        analysis.verdict,
        named=tuple(new if one is load else one for one in analysis.verdict.named),
    )
    return replace(analysis, verdict=verdict)
