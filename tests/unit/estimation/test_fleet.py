"""Changes in a fleet are found, and few are named that are none; the simulated fleets share nothing with the test."""

import numpy as np
import pytest

from dynid.estimation.fleet import History, look_at

#: Names, typical values and standard errors of a run: two inertial parameters, two of friction.
NAMES = ("mcz2", "Iyy2", "fv1", "fc1")
LEVEL = np.array([1.2, 0.4, 1.0, 1.3])
ERROR = np.array([2e-3, 1e-3, 5e-3, 3e-3])
#: What a kelvin does to each, as a share.
THERMAL = np.array([0.0, 0.0, -0.012, -0.004])


def simulated(seed, arms=200, days=30, changed=0, size=0.1, off=0.005):
    """A fleet whose arms differ, whose hall and motors get warm and cold, and of which some change on some day."""
    rng = np.random.default_rng(seed)
    true = LEVEL * (1 + 0.05 * rng.standard_normal((arms, 4)))
    kelvin = np.zeros((arms, days))
    hall, own = 0.0, np.zeros(arms)
    restless = np.exp(0.3 * rng.standard_normal(arms))
    for day in range(days):
        hall = 0.8 * hall + rng.standard_normal()
        own = 0.7 * own + 0.7 * rng.standard_normal(arms)
        kelvin[:, day] = hall + own * restless
    value = true[:, None] * (1 + kelvin[:, :, None] * THERMAL)
    truth = {}
    for arm in rng.choice(arms, changed, replace=False):
        day, k = int(rng.integers(5, days - 5)), int(rng.integers(4))
        value[arm, day:, k] *= 1 + size
        truth[f"arm{arm}"] = (NAMES[k], day)
    mixed = np.linalg.cholesky(0.5 * np.eye(4) + 0.5)
    value += ERROR * (
        rng.standard_normal(value.shape) @ mixed.T + 0.5 * rng.standard_normal(value.shape)
    )
    bad = rng.random((arms, days)) < off
    value += bad[:, :, None] * 8 * ERROR * rng.standard_normal(value.shape)
    t = np.arange(days) + 0.3 * rng.random((arms, days))
    names = tuple(f"arm{k}" for k in range(arms))
    return History(names, NAMES, t, value, np.broadcast_to(ERROR, value.shape).copy()), truth


def test_changes_are_found_with_day_and_size_and_few_are_named_that_are_none():
    named = right = there = 0
    for seed in range(3):
        history, truth = simulated(seed, changed=20)
        found = look_at(history)
        arms = {change.arm for change in found.changes}
        named, right, there = (
            named + len(arms),
            right + len(arms & truth.keys()),
            there + len(truth),
        )
        for change in found.changes:
            if change.arm in truth and change.parameter == truth[change.arm][0]:
                assert abs(change.since - truth[change.arm][1]) < 3
                assert abs(change.after / change.before - 1.1) < 0.06
    assert right >= 0.9 * there, "of changes by a tenth"
    assert named - right <= 0.1 * named, (
        "5 % were asked for; 60 arms tell that from 15 % and not from 8 %"
    )


def test_fleets_in_which_nothing_changed_are_left_alone():
    """Warm and cold days, days off and arms that differ are no changes; one fleet in twenty may have a false one."""
    named = [
        len({change.arm for change in look_at(simulated(seed)[0]).changes}) for seed in range(8)
    ]
    assert sum(count > 0 for count in named) <= 1


def test_neither_units_nor_the_order_of_arms_matter():
    history, _ = simulated(5, arms=40, changed=4)
    found = look_at(history)
    scale = np.array([1e-6, 1e3, 1.0, 1e-3])
    turned = History(
        history.arms[::-1],
        history.names,
        history.t[::-1],
        history.value[::-1] * scale,
        history.std_error[::-1] * scale,
    )
    again = look_at(turned)
    np.testing.assert_allclose(again.p_values[::-1], found.p_values, rtol=1e-4, atol=1e-12)


def test_runs_that_are_missing_or_do_not_determine_a_parameter_take_no_part():
    history, _ = simulated(6, arms=30, days=20)
    value, error = history.value.copy(), history.std_error.copy()
    value[3, 5:9] = np.nan
    error[4, :, 1] = np.inf
    value[4, :, 1] = 1e6
    value[7, 2:] = np.nan
    found = look_at(History(history.arms, history.names, history.t, value, error))
    assert np.isnan(found.p_values[4, 1])
    assert np.isnan(found.p_values[7]).all(), "two runs are too few"
    assert np.isfinite(found.p_values[3]).all()
    assert {change.arm for change in found.changes} <= {"arm3"}


@pytest.mark.parametrize("day", [0, 10, 19])
def test_one_run_that_is_off_is_no_change(day):
    history, _ = simulated(7, arms=30, days=20, off=0.0)
    value = history.value.copy()
    value[2, day] += 30 * ERROR
    found = look_at(History(history.arms, history.names, history.t, value, history.std_error))
    assert found.changes == ()
    assert found.off[2] >= 1


def test_an_arm_that_differs_from_its_model_is_named_in_a_fleet_and_between_two():
    history, _ = simulated(8, arms=40)
    value = history.value.copy()
    value[11, :, 0] *= 1.6
    found = look_at(History(history.arms, history.names, history.t, value, history.std_error))
    assert {(odd.arm, odd.parameter) for odd in found.outliers} == {("arm11", "mcz2")}
    two = History(
        history.arms[10:12], history.names, history.t[10:12], value[10:12], history.std_error[10:12]
    )
    assert ("arm11", "mcz2") in {(odd.arm, odd.parameter) for odd in look_at(two).outliers}


def test_a_long_history_is_averaged_and_its_change_found():
    history, _ = simulated(9, arms=10, days=400, off=0.0)
    value = history.value.copy()
    value[4, 250:, 1] *= 1.05
    found = look_at(History(history.arms, history.names, history.t, value, history.std_error))
    assert {(change.arm, change.parameter) for change in found.changes} == {("arm4", "Iyy2")}
    assert found.changes[0].since == pytest.approx(250, abs=8)


def test_a_single_arm_is_judged_by_its_own_history():
    history, _ = simulated(10, arms=1, days=25, off=0.0)
    value = history.value.copy()
    value[0, 12:, 0] *= 1.03
    found = look_at(History(history.arms, history.names, history.t, value, history.std_error))
    assert "mcz2" in {change.parameter for change in found.changes}
