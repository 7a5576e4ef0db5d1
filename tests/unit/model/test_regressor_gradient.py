"""The reverse sweep gives the derivatives that central differences of the forward program give."""

from dataclasses import replace

import numpy as np
import pytest

from arms import random_robot
from dynid import load_robot
from dynid.model.regressor import build_model
from dynid.model.regressor_gradient import RegressorGradient
from dynid.robot import Coulomb, Coupling

LWR = load_robot("kuka_lwr4plus")
#: Three turning joints and one that slides, turned, with a wide change of friction's sign.
MIXED = replace(
    random_robot(np.random.default_rng(6), 4, "modified"), coulomb=Coulomb("smooth", (0.2,) * 4)
)
COUPLING = Coupling(((100.0, 0, 0, 0), (0, 80, 0, 0), (0, 0, 50, 0), (0, 0, 30, 40)))
ARMS = {
    "lwr": LWR,
    "gen2, wide Coulomb": replace(load_robot("kinova_gen2"), coulomb=Coulomb("smooth", (0.3,) * 7)),
    "threshold": replace(LWR, coulomb=Coulomb("threshold", (0.05,) * 7)),
    "mixed": MIXED,
    "coupled": replace(MIXED, coupling=COUPLING),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ARMS)
def test_gradient_is_that_of_central_differences_in_every_direction(name):
    robot = ARMS[name]
    model = build_model(robot)
    rng = np.random.default_rng(1)
    columns = rng.permutation(model.size)[: model.size - 3]
    state = [rng.uniform(-1.5, 1.5, (5, robot.n)) for _ in range(3)]
    regressor = RegressorGradient(model, columns, 5)
    weights = rng.standard_normal((5, *regressor.shape))
    regressor.dense(*state)
    gradient = regressor.gradient(weights)
    observer = model.observer(columns)
    direction = [rng.standard_normal((5, robot.n)) for _ in range(3)]
    h = 1e-6
    moved = [[x + s * h * d for x, d in zip(state, direction, strict=True)] for s in (1, -1)]
    up, down = (np.sum(weights * observer.dense(*there)) for there in moved)
    slope = sum(np.sum(g * d) for g, d in zip(gradient, direction, strict=True))
    assert slope == pytest.approx((up - down) / (2 * h), rel=1e-5)


def test_entries_are_those_of_the_observer():
    model = build_model(LWR)
    rng = np.random.default_rng(2)
    q, qd, qdd = rng.standard_normal((3, 40, 7))
    columns = rng.permutation(model.size)
    expected = model.observer(columns).dense(q, qd, qdd)
    assert np.abs(RegressorGradient(model, columns, 40).dense(q, qd, qdd) - expected).max() < 1e-12
