"""A load on the last link and the gains of drives, against the body and the gains that were put into simulated logs."""

from dataclasses import replace

import numpy as np
import pytest
from loaded_arm import LOAD, recorded

from dynid import Identification
from dynid.estimation.drive_gains import find_gains, known_load
from dynid.estimation.estimate import estimate
from dynid.estimation.payload import find_payload
from dynid.estimation.possible_set import smallest_eigenvalues
from dynid.estimation.stack import stack_logs
from dynid.signals.conditioned_log import condition_log

slow = pytest.mark.slow
TRUE = LOAD.numbers
GAINS = np.array([11.0, 9.5, 8.0, 7.0, 3.5, 3.0, 2.4])


def stacked(lwr, log):
    return stack_logs([condition_log(log, lwr.model, cutoff=6.0)], lwr)


def identified(lwr, log, method="wls"):
    return estimate(stacked(lwr, log), method=method, holdout=None, drop_weak=True)


@pytest.fixture(scope="module")
def unloaded(lwr):
    return identified(lwr, recorded(11))


@pytest.fixture(scope="module")
def loaded(lwr):
    return identified(lwr, recorded(12, LOAD))


def test_mass_and_centre_of_mass_of_a_load_are_found_within_three_percent(lwr):
    full, empty = (identified(lwr, log, "auto") for log in (recorded(32, LOAD), recorded(31)))
    found = find_payload(full, empty)
    assert found.body.mass == pytest.approx(LOAD.mass, rel=0.03)
    assert np.linalg.norm(np.subtract(found.body.com, LOAD.com)) < 0.03 * np.linalg.norm(LOAD.com)
    assert np.mean(np.abs(found.body.numbers - TRUE) <= 1.96 * found.std_error) >= 0.8
    assert smallest_eigenvalues(found.body.parameters()).min() > 0.0
    assert not found.findings()


@slow
def test_the_error_bars_of_a_load_hold(lwr):
    """Nine of ten true numbers lie inside 95 % intervals of both logs' noise; 36 draws gave 92 %."""
    inside = []
    for seed in range(100, 108):
        empty, full = (identified(lwr, recorded(*x)) for x in ((seed,), (seed + 100, LOAD)))
        found = find_payload(full, empty)
        inside.append(np.abs(found.body.numbers - TRUE) <= 1.96 * found.std_error)
        assert not found.findings()
    assert np.mean(inside) >= 0.87


@slow
def test_an_arm_without_a_load_has_a_load_of_no_mass(lwr, unloaded):
    assert find_payload(identified(lwr, recorded(13)), unloaded).body.mass < 0.1


@slow
def test_an_uncertain_unloaded_result_makes_the_load_uncertain(unloaded, loaded):
    vague = replace(unloaded, covariance=100 * unloaded.covariance)
    sure, unsure = (find_payload(loaded, each).std_error[0] for each in (unloaded, vague))
    assert unsure > 3 * sure


@slow
def test_a_load_weighed_with_wrong_gains_lies_inside_the_intervals_that_know_of_it(lwr):
    """Gains of seven joints are wrong by up to 8 %, each its own or all alike; the robot file says 5 %.

    The torques of an arm do not tell their own scale, so an interval cannot be narrower than the scale is unknown.
    Where nothing is said, joints that disagree about the load tell of their own gains, and only of these.
    """
    inside, blind = [], []
    apart = 1.0 + np.random.default_rng(5).uniform(-0.08, 0.08, lwr.robot.n)
    for seed, gains in ((41, apart), (42, 1.08)):
        logs = (recorded(seed), recorded(seed + 20, LOAD))
        empty, full = (identified(lwr, replace(log, tau=log.tau * gains)) for log in logs)
        doubted = replace(full.robot, torque=replace(full.robot.torque, gain_error=0.05))
        found = find_payload(replace(full, robot=doubted), empty)
        low, high = found.intervals[:4].T
        inside += list((low <= TRUE[:4]) & (TRUE[:4] <= high))
        assert 1.96 * 0.05 * np.sqrt(0.75) < 1.02 * (high - low)[0] / 2 / found.body.mass < 0.2
        low, high = find_payload(full, empty).intervals[0]
        blind.append(low <= LOAD.mass <= high)
    assert np.mean(inside) >= 0.85
    assert blind == [True, False]


@slow
def test_a_result_from_its_file_finds_nearly_the_load_of_one_with_rows(tmp_path, lwr):
    """A residual model is there to lose: Stribeck friction was put into both logs."""
    results, read = [], []
    for log in (recorded(51), recorded(52, LOAD)):
        qd, size = np.gradient(log.q, log.t, axis=0), 0.05 * np.abs(log.tau).std(axis=0)
        hidden = size * (np.exp(-np.abs(qd) / 0.1) * np.sign(qd) + np.sin(3 * log.q))
        results.append(identified(lwr, replace(log, tau=log.tau + hidden), "auto"))
        read.append(Identification.load(results[-1].save(tmp_path / f"{len(read)}.npz")))
    empty, full = results
    assert empty.model_error is not None
    whole = find_payload(full, empty)
    assert find_payload(full, read[0]).body.numbers == pytest.approx(whole.body.numbers)
    again = find_payload(read[1], read[0])
    assert np.all(
        np.abs(again.body.numbers - whole.body.numbers) <= 2 * (again.std_error + whole.std_error)
    )
    assert whole.body.mass == pytest.approx(LOAD.mass, rel=0.05)


# ---------------------------------------------------------------- gains of the drives
def currents(lwr, *log):
    one = recorded(*log)
    return stacked(lwr, replace(one, tau=one.tau / GAINS, tau_unit="A"))


@pytest.fixture(scope="module")
def empty(lwr):
    return currents(lwr, 11)


def knowing(joint=0, gain=np.nan):
    return np.where(np.arange(7) == joint, gain, np.nan)


def test_a_load_that_is_known_by_its_mass_tells_them(lwr, empty):
    load = known_load(lwr, currents(lwr, 12, LOAD), LOAD.mass)
    assert find_gains(empty, knowing(), load).gain == pytest.approx(GAINS, rel=0.03)


def test_one_known_gain_tells_the_others_which_are_as_uncertain(empty):
    known = knowing(2, GAINS[2])
    sure, unsure = find_gains(empty, known), find_gains(empty, known, scale_error=0.05)
    assert sure.gain == pytest.approx(GAINS, rel=0.05)
    assert unsure.gain == pytest.approx(sure.gain)
    assert unsure.std_error[2] == pytest.approx(0.05 * GAINS[2])
    assert unsure.std_error**2 == pytest.approx(sure.std_error**2 + (0.05 * sure.gain) ** 2)


def test_without_any_size_the_ratios_are_found(empty):
    found = find_gains(empty, knowing())
    assert found.relative
    assert found.gain == pytest.approx(GAINS / np.exp(np.mean(np.log(GAINS))), rel=0.05)
    assert find_gains(empty, knowing(), scale_error=0.05).std_error == pytest.approx(
        found.std_error
    )
