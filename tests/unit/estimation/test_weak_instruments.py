"""Commands that an arm does not follow are no instruments; those that it follows are."""

from dataclasses import replace

import numpy as np
import pytest
from loaded_arm import recorded

from dynid import identify, validate
from dynid.errors import WeakInstruments


def commanded(log, share):
    """Return the log with commands that the arm misses by a share of its motion, at frequencies of its own."""
    rng, t = np.random.default_rng(0), log.t[:, None, None]
    f, phase = rng.uniform(0.05, 0.8, (2, 4, log.q.shape[1]))
    away = np.sum(np.sin(2 * np.pi * (f * t + phase)), axis=1)
    away *= share * np.std(log.q, axis=0) / np.std(away, axis=0)
    return replace(log, extra={**log.extra, "q_ref": log.q + away})


@pytest.fixture(scope="module")
def log():
    return recorded(5, seconds=12.0)


def test_commands_that_the_arm_follows_are_instruments(log):
    robot, one = log
    result = identify(robot, commanded(one, 0.002), holdout=None)
    assert result.method == "iv"
    assert "W412" not in [finding.code for finding in result.findings]


def test_commands_that_it_misses_are_not_and_that_is_said(log):
    robot, one = log
    result, without = (identify(robot, each, holdout=None) for each in (commanded(one, 0.8), one))
    assert result.method in ("wls", "irls")
    (finding,) = [finding for finding in result.findings if finding.code == "W412"]
    assert finding.evidence["first_stage_f"] < 10.0
    other = recorded(6, seconds=12.0)[1]
    errors = [validate(each, other).relative_error_percent for each in (result, without)]
    assert errors[0] < 1.1 * errors[1]


def test_weak_instruments_that_were_asked_for_are_refused_where_they_explain_far_less(log):
    robot, one = log
    with pytest.raises(WeakInstruments, match="first-stage F"):
        identify(robot, commanded(one, 0.8), method="iv", holdout=None)


@pytest.mark.parametrize("method", ["ols", "wls", "irls"])
def test_least_squares_is_as_certain_with_commands_in_the_log_as_without(log, method):
    robot, one = log
    found = [
        identify(robot, each, method=method, holdout=None) for each in (commanded(one, 0.8), one)
    ]
    assert found[0].plain_covariance == pytest.approx(found[1].plain_covariance, rel=1e-9)
