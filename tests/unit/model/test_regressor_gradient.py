"""The reverse sweep gives the derivatives that central differences of the forward program give."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynid import Robot, load_robot
from dynid.model.regressor import build_model
from dynid.model.regressor_gradient import RegressorGradient
from dynid.robot import Coulomb, Coupling, Joint

ROBOTS = Path(__file__).parents[3] / "robots"


def scara():
    joints = (
        Joint("a", a=0.3, twist=0.2),
        Joint("b", a=0.25, twist=np.pi, theta_offset=0.4),
        Joint("c", type="prismatic", twist=0.3, theta_offset=0.7),
        Joint("d", d=0.1),
    )
    wide = Coulomb("smooth", (0.2,) * 4)
    return Robot("scara", "modified", joints, gravity=(0.3, 0.1, -9.7), coulomb=wide)


def coupled():
    return replace(
        scara(), coupling=Coupling(((100.0, 0, 0, 0), (0, 80, 0, 0), (0, 0, 50, 0), (0, 0, 30, 40)))
    )


def arms():
    lwr = load_robot(ROBOTS / "kuka_lwr4plus.yaml")
    return {
        "lwr": lwr,
        "gen2, wide Coulomb": replace(
            load_robot(ROBOTS / "kinova_gen2.yaml"), coulomb=Coulomb("smooth", (0.3,) * 7)
        ),
        "threshold": replace(lwr, coulomb=Coulomb("threshold", (0.05,) * 7)),
        "scara": scara(),
        "coupled": coupled(),
    }


@pytest.mark.slow
@pytest.mark.parametrize("name", arms())
def test_gradient_is_that_of_central_differences_in_every_direction(name):
    robot = arms()[name]
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
    model = build_model(load_robot(ROBOTS / "kuka_lwr4plus.yaml"))
    rng = np.random.default_rng(2)
    q, qd, qdd = rng.standard_normal((3, 40, 7))
    columns = rng.permutation(model.size)
    expected = model.observer(columns).dense(q, qd, qdd)
    assert np.abs(RegressorGradient(model, columns, 40).dense(q, qd, qdd) - expected).max() < 1e-12
