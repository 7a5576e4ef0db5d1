"""The load on the last link, against the body that was put into PyBullet."""

from dataclasses import replace

import numpy as np
import pytest
from loaded_arm import LOAD, recorded

from dynid.estimation.estimate import estimate
from dynid.estimation.payload import find_payload
from dynid.estimation.physical_constraints import is_consistent
from dynid.estimation.stack import stack
from dynid.model import build_model
from dynid.model.base_model import BaseModel
from dynid.model.reduce import reduce
from dynid.signals.conditioned_log import ConditionedLog
from dynid.signals.conditioning import choose_filter, condition


@pytest.fixture(scope="module")
def base():
    model = build_model(recorded(1, seconds=6.0)[0])
    return BaseModel(model, reduce(model))


def identified(base, log):
    chosen = choose_filter(log, base.robot, 6.0)
    source, observer = (
        ConditionedLog(condition(log, chosen, coulomb=base.robot.coulomb_shape), chosen, "log"),
        base.model.observer(base.reduction.base),
    )
    stacked = stack([source], observer, base.reduction.base_names, base.robot.joint_names)
    return estimate(stacked, base, method="wls", holdout=None, drop_weak=True)


@pytest.fixture(scope="module")
def unloaded(base):
    return identified(base, recorded(11)[1])


def test_mass_and_centre_of_mass_of_a_load_are_found_within_three_percent(base, unloaded):
    payload = find_payload(identified(base, recorded(12, LOAD)[1]), unloaded)
    assert payload.body.mass == pytest.approx(LOAD.mass, rel=0.03)
    assert np.linalg.norm(np.subtract(payload.body.com, LOAD.com)) < 0.03 * np.linalg.norm(LOAD.com)
    assert is_consistent(payload.body.parameters())
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
    vague = replace(unloaded, plain_covariance=100 * unloaded.plain_covariance)
    assert find_payload(loaded, vague).std_error[0] > 3 * sure.std_error[0]
