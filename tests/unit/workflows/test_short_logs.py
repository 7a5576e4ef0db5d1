"""Several recordings, each too short for itself, count together; so does a short one that is held out."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import twolink
from dynid import identify, validate
from dynid.errors import LogTooShort
from dynid.signals.columns import take_samples


@pytest.fixture(scope="module")
def pieces():
    whole = twolink.log(1, draw=3)
    parts = [take_samples(whole, np.arange(k, k + 250)) for k in range(0, 2000, 250)]
    return [
        replace(part, t=part.t - part.t[0], source=Path(f"part{k}")) for k, part in enumerate(parts)
    ]


def test_one_alone_is_answered_with_wide_intervals_and_a_moment_is_refused(arm, pieces):
    """2.5 s: the prior carries what they leave open, and most true parameters lie inside their intervals."""
    found = identify(arm, pieces[0], holdout=None)
    assert found.in_force == "physical"
    assert "W313" in [finding["code"] for finding in found.header["log_findings"]]
    friction = dict(zip(("fv1", "fv2"), twolink.VISCOUS, strict=True))
    errors = dict(zip(found.names, found.std_error, strict=True))
    values = dict(zip(found.names, found.theta, strict=True))
    for name, true in friction.items():
        assert abs(values[name] - true) < 3 * errors[name]
    short = [take_samples(pieces[0], np.arange(n)) for n in (40, 160)]
    with pytest.raises(LogTooShort):
        identify(arm, short[0])
    assert identify(arm, short[1]).heldout_relative_error_percent is None, "nothing to hold out"


def test_together_they_are_enough_and_a_short_one_can_be_held_out(arm, pieces):
    found = identify(arm, pieces[:7], holdout=pieces[7])
    assert found.heldout == "part7"
    assert found.heldout_relative_error_percent < 2.0
    viscous = {row["name"]: row["value"] for row in found.parameter_rows()}
    assert viscous["fv1"] == pytest.approx(twolink.VISCOUS[0], rel=0.1)


def test_a_replay_at_rest_shows_nothing(result):
    log = twolink.log(2)
    with pytest.raises(LogTooShort, match="no sample in motion"):
        validate(result, log.with_columns({"q": 0.0 * log.q, "tau": log.tau}))
