"""The objective's gradient is that of differences, penalties and earlier logs included."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.trajectory.basis import Quintic
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.cost import Cost
from dynid.trajectory.feasible import bounds, random_variables
from dynid.trajectory.objective import ExcitationObjective, PlanProblem, information
from dynid.trajectory.scene import Box, Scene


def problem(base, **changes):
    facts = {
        "basis": Quintic.even(5.0, 4),
        "cost": Cost("condition"),
        "limits": bounds(base.robot),
        "samples": 60,
    }
    return PlanProblem(base.model, base.reduction.base, **(facts | changes))


def slope_error(objective, seed=7):
    rng = np.random.default_rng(seed)
    x = random_variables(objective.problem.basis, objective.problem.limits, rng)
    direction = rng.standard_normal(len(x))
    slope = objective(x).gradient @ direction
    h = 1e-6
    numeric = (objective(x + h * direction).value - objective(x - h * direction).value) / (2 * h)
    return abs(slope - numeric) / abs(numeric)


@pytest.mark.parametrize(
    "cost", [Cost("condition"), Cost("condition", True), Cost("paper"), Cost("d")]
)
def test_gradient_along_the_path_is_that_of_differences(lwr, cost):
    assert slope_error(ExcitationObjective(problem(lwr, cost=cost))) < 1e-4


def test_gradient_with_floor_boxes_torque_and_earlier_logs_is_that_of_differences(gen2):
    obstacle, inside = Box((0.2, -0.5, 0.0), (0.6, 0.5, 0.6)), Box((-1, -1, 0), (1, 0.2, 1))
    scene = Scene(floor=0.1, obstacles=(obstacle,), workspace=inside)
    p = gen2.reduction.rank
    wide = bounds(gen2.robot)
    changes = {
        "basis": Quintic.even(5.0, 3, smooth=True),
        "cost": Cost("i", V=np.eye(p)),
        "capsules": Capsules(gen2.robot, scene),
        "torque": gen2.prior(unknown=0.0),
        "limits": replace(wide, torque=0.03 * wide.torque),
        "known": 10 * np.eye(p),
        "noise": np.linspace(0.1, 0.4, 7),
    }
    assert slope_error(ExcitationObjective(problem(gen2, **changes))) < 1e-4


def test_information_is_that_of_a_log_at_its_rate(lwr):
    here = problem(lwr, noise=np.full(7, 0.5), rate=200.0)
    W = np.random.default_rng(0).standard_normal((60, 7, 62))
    rows = W.reshape(-1, 62)
    assert np.allclose(information(here, W), rows.T @ rows / 0.25 * (5.0 * 200.0 / 60))
