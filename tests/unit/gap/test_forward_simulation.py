"""What is replayed is an arm that can exist."""

import numpy as np
import pytest

import models
import twolink
from dynid.gap.forward_simulation import least_inertia, load_parameters, nearest_possible
from dynid.gap.selected_effects import SelectedEffect
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.parameters import columns_of
from dynid.model.regressor import prior_vector


@pytest.fixture(scope="module")
def arm():
    """Return the model, and base parameters of an arm that is heavier than its prior says."""
    base = models.shipped("kuka_lwr4plus")
    x, parameters = 1.3 * prior_vector(base.model), base.model.parameters
    x[columns_of(parameters, "Im")] = 0.05
    x[columns_of(parameters, "fv", "fc", "fo")] = 1.0
    return base, base.reduction.K @ x


def test_fitted_parameters_of_no_arm_are_replaced_by_those_of_the_next_one(arm):
    base, truth = arm
    q = np.random.default_rng(0).uniform(-1, 1, (40, 7))
    weak = base.names.index(next(n for n in base.names if n.startswith("Izz7")))
    sigma = 1e-3 * (1 + np.abs(truth))
    sigma[weak] = 0.5
    wrong = truth.copy()
    wrong[weak] -= 0.3
    assert least_inertia(base.torques(wrong), q) < 0
    found = nearest_possible(base, wrong, np.diag(sigma**2))
    assert least_inertia(base.torques(found), q) > 0
    others = np.arange(len(truth)) != weak
    assert np.all(np.abs(found - truth)[others] < 5 * sigma[others])


def test_fitted_parameters_of_an_arm_stay(arm):
    base, truth = arm
    sigma = 1e-4 * (1 + np.abs(truth))
    found = nearest_possible(base, truth, np.diag(sigma**2))
    assert np.abs((found - truth) / sigma).max() < 0.5


def test_a_load_is_carried_by_the_arm_as_the_textbook_has_a_heavier_second_link(
    twolinks, monkeypatch
):
    """A mass in a point beyond the tip of the forearm, whose frame is at the tip: 0.3 m from the elbow."""
    m, beyond = 0.7, 0.05
    _, q, qd, qdd = twolink.motion(1, 2.0)
    bare = twolink.torque(q, qd, qdd)
    (m1, m2), (r1, r2), (i1, i2) = twolink.MASS, twolink.COM, twolink.INERTIA
    at, both = 0.3 + beyond, m2 + m
    r = (m2 * r2 + m * at) / both
    monkeypatch.setattr(twolink, "MASS", (m1, both))
    monkeypatch.setattr(twolink, "COM", (r1, r))
    monkeypatch.setattr(twolink, "INERTIA", (i1, i2 + m2 * (r2 - r) ** 2 + m * (at - r) ** 2))
    load = SelectedEffect(
        CATALOGUE["payload"],
        (),
        {"form": 4.0},
        1,
        1.0,
        9.0,
        0.0,
        values={"m": m, "mcx": m * beyond, "mcy": 0.0, "mcz": 0.0},
    )
    base = twolinks.base
    W = base.observer.dense(q, qd, qdd)
    assert W @ load_parameters(base, load) == pytest.approx(
        twolink.torque(q, qd, qdd) - bare, abs=1e-9
    )
