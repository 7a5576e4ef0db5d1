"""Drift is found where it is, and not where only noise is."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dynid.estimation import tuning
from dynid.estimation.compare import compare, same_parameters
from dynid.estimation.identified import JointQuality

JOINTS = (
    JointQuality("joint_1", 0.1, 1.0, 10.0, 0.12),
    JointQuality("joint_2", 0.2, 2.0, 10.0, 0.2),
)


def result(theta, std_error, joints=JOINTS, plain=None):
    """What is compared of a result, with independent errors."""
    theta, error = np.asarray(theta, dtype=float), np.asarray(std_error, dtype=float)
    return SimpleNamespace(
        names=tuple(f"p{k}" for k in range(len(error))),
        theta=theta,
        plain=theta if plain is None else plain,
        plain_covariance=np.diag(error**2),
        std_error=error,
        knowledge=("well",) * len(error),
        joints=joints,
        relative_error_percent=1.5,
        heldout_relative_error_percent=1.6,
    )


def test_noise_alone_is_called_drift_as_rarely_as_promised():
    """2000 pairs of results of 40 unchanged parameters: about one percent of pairs name any."""
    rng = np.random.default_rng(0)
    truth, error = rng.normal(size=40), rng.uniform(0.01, 0.1, 40)
    alarms = 0
    for _ in range(2000):
        one, other = (result(truth + error * rng.normal(size=40), error) for _ in range(2))
        alarms += bool(compare(one, other).drifted)
    assert 0.3 * tuning.CHANGE_FALSE_ALARM < alarms / 2000 < 2 * tuning.CHANGE_FALSE_ALARM


def test_the_parameter_that_changed_is_named_and_no_other():
    """A change of eight standard errors in one of 40."""
    rng = np.random.default_rng(1)
    truth, error = rng.normal(size=40), np.full(40, 0.05)
    one, other = (result(truth + error * rng.normal(size=40), error) for _ in range(2))
    moved = other.plain + np.where(np.arange(40) == 17, 8 * np.sqrt(2) * 0.05, 0)
    changed = result(other.theta, error, plain=moved)
    assert [change.name for change in compare(one, changed).drifted] == ["p17"]


def test_parameters_that_a_log_does_not_determine_are_not_tested():
    """An infinite error makes no p-value and no alarm."""
    one, other = result([1.0, 2.0], [0.1, np.inf]), result([1.0, 200.0], [0.1, 0.1])
    comparison = compare(one, other)
    assert not comparison.drifted
    assert np.isnan(comparison.changes[1].p_value)


def test_well_known_parameters_are_measured_against_themselves_others_against_their_error():
    """2 % of a parameter known to 1 %; a change of one standard error is 10 % where nothing better is known."""
    one = result([1.0, 0.0], [0.01, 0.2])
    other = result([1.02, 0.2], [0.01, 0.2])
    first, second = compare(one, other).changes
    assert first.percent == pytest.approx(2.0)
    assert second.percent == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("tolerance", "beyond"), [(0.05, []), (0.019, ["p0"]), (0.001, ["p0", "joint_2 rms_nm"])]
)
def test_numbers_beyond_a_tolerance_are_listed_the_largest_move_first(tolerance, beyond):
    """Parameters and figures alike."""
    one = result([1.0, 2.0], [0.01, 0.01])
    joints = (one.joints[0], replace(one.joints[1], rms=0.202))
    other = result([1.02, 2.0], [0.01, 0.01], joints=joints)
    assert [each.name for each in compare(one, other).beyond(tolerance)] == beyond


def test_equal_results_differ_nowhere():
    """Not even where a value is zero."""
    one = result([0.0, 2.0], [0.0, 0.01])
    comparison = compare(one, one)
    assert not comparison.beyond(1e-12)
    assert comparison.p_value == 1.0


def test_results_of_other_robots_are_not_the_same():
    """Other names or other joints."""
    one = result([1.0, 2.0], [0.1, 0.1])
    assert same_parameters(one, one)
    assert not same_parameters(one, result([1.0, 2.0, 3.0], [0.1, 0.1, 0.1]))
    assert not same_parameters(one, result([1.0, 2.0], [0.1, 0.1], joints=JOINTS[:1]))
