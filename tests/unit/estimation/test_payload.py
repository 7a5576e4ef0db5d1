"""The load on the last link, against the body that was put into PyBullet."""

from dataclasses import replace

import numpy as np
import pytest
from loaded_arm import LOAD, recorded

import models
from dynid.estimation.estimate import estimate
from dynid.estimation.payload import find_payload
from dynid.estimation.possible_set import smallest_eigenvalues
from dynid.estimation.stack import stack_logs
from dynid.signals.conditioned_log import condition_log

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def base():
    return models.shipped("kuka_lwr4plus")


def identified(base, log, method="wls"):
    source = condition_log(log, base.model, cutoff=6.0)
    return estimate(stack_logs([source], base), method=method, holdout=None, drop_weak=True)


@pytest.fixture(scope="module")
def unloaded(base):
    return identified(base, recorded(11)[1])


def test_mass_and_centre_of_mass_of_a_load_are_found_within_three_percent(base, unloaded):
    payload = find_payload(identified(base, recorded(12, LOAD)[1]), unloaded)
    assert payload.body.mass == pytest.approx(LOAD.mass, rel=0.03)
    assert np.linalg.norm(np.subtract(payload.body.com, LOAD.com)) < 0.03 * np.linalg.norm(LOAD.com)
    assert smallest_eigenvalues(payload.body.parameters()).min() > 0.0
    assert not payload.findings()


def test_the_error_bars_of_a_load_hold(base):
    """Nine of ten true numbers lie inside 95 % intervals of both logs' noise; 36 draws gave 92 %."""
    truth = np.array([LOAD.mass, *LOAD.com, *LOAD.inertia_com])
    inside = []
    for seed in range(100, 108):
        empty = identified(base, recorded(seed)[1])
        payload = find_payload(identified(base, recorded(seed + 100, LOAD)[1]), empty)
        found = np.array([payload.body.mass, *payload.body.com, *payload.body.inertia_com])
        inside.append(np.abs(found - truth) <= 1.96 * payload.std_error)
        assert not payload.findings()
    assert np.mean(inside) >= 0.87


def test_an_arm_without_a_load_has_a_load_of_no_mass(base, unloaded):
    payload = find_payload(identified(base, recorded(13)[1]), unloaded)
    assert payload.body.mass < 0.1


def test_an_uncertain_unloaded_result_makes_the_load_uncertain(base, unloaded):
    loaded = identified(base, recorded(21, LOAD)[1])
    sure = find_payload(loaded, unloaded)
    vague = replace(unloaded, covariance=100 * unloaded.covariance)
    assert find_payload(loaded, vague).std_error[0] > 3 * sure.std_error[0]


def test_a_load_weighed_with_wrong_gains_lies_inside_the_intervals_that_know_of_it(base):
    """Gains of seven joints are wrong by up to 8 %, each its own or all alike; the robot file says 5 %.

    The torques of an arm do not tell their own scale, so an interval cannot be narrower than the scale is unknown.
    Where nothing is said, joints that disagree about the load tell of their own gains, and only of these.
    """
    rng = np.random.default_rng(5)
    inside, blind = [], []
    for seed, alike in ((41, False), (42, True)):
        gains = (
            np.full(base.robot.n, 1.08) if alike else 1.0 + rng.uniform(-0.08, 0.08, base.robot.n)
        )
        empty, full = (
            identified(base, replace(log, tau=log.tau * gains))
            for log in (recorded(seed)[1], recorded(seed + 20, LOAD)[1])
        )
        doubted = replace(full.robot, torque=replace(full.robot.torque, gain_error=0.05))
        found = find_payload(replace(full, robot=doubted), empty)
        low, high = found.intervals[:4].T
        truth = np.array([LOAD.mass, *LOAD.com])
        inside += list((low <= truth) & (truth <= high))
        assert 1.96 * 0.05 * np.sqrt(0.75) < 1.02 * (high - low)[0] / 2 / found.body.mass < 0.2
        low, high = find_payload(full, empty).intervals[0]
        blind.append(low <= LOAD.mass <= high)
    assert np.mean(inside) >= 0.85
    assert blind == [True, False]


def test_a_result_from_its_file_finds_nearly_the_load_of_one_with_rows(tmp_path, base):
    """A residual model is there to lose: Stribeck friction was put into both logs."""
    from dynid.estimation.result import Identification

    def sticky(log):
        qd = np.gradient(log.q, log.t, axis=0)
        size = 0.05 * np.abs(log.tau).std(axis=0)
        return replace(
            log,
            tau=log.tau + size * np.exp(-np.abs(qd) / 0.1) * np.sign(qd) + size * np.sin(3 * log.q),
        )

    kept, loaded = (
        identified(base, sticky(log), "auto") for log in (recorded(51)[1], recorded(52, LOAD)[1])
    )
    assert kept.model_error is not None
    whole = find_payload(loaded, kept)
    kept.save(tmp_path / "kept.npz")
    loaded.save(tmp_path / "loaded.npz")
    again = find_payload(loaded, Identification.load(tmp_path / "kept.npz"))
    assert again.numbers == pytest.approx(whole.numbers)
    read = find_payload(
        Identification.load(tmp_path / "loaded.npz"), Identification.load(tmp_path / "kept.npz")
    )
    assert np.all(np.abs(read.numbers - whole.numbers) <= 2 * (read.std_error + whole.std_error))
    assert whole.body.mass == pytest.approx(LOAD.mass, rel=0.05)
