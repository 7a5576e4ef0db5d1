"""A notebook plans as the command does: options by name, objects in, a plan out that is saved and read again."""

import numpy as np
import pytest

import dynid
from dynid.errors import WrongUsage
from dynid.trajectory.scene import Box


@pytest.fixture(scope="module")
def lwr():
    return dynid.load_robot("kuka_lwr4plus")


@pytest.fixture(scope="module")
def plan(lwr):
    return dynid.plan_trajectory(lwr, duration=6.0, segments=4, optimise=False, alpha=1.0)


def test_a_plan_keeps_the_limits_of_the_robot_file_with_their_margin(lwr, plan):
    lower, upper = np.array([joint.limits.position for joint in lwr.joints]).T
    free = 0.05 * (upper - lower)
    assert np.all(plan.motion.q >= lower + free - 1e-9)
    assert np.all(plan.motion.q <= upper - free + 1e-9)
    assert np.all(
        np.abs(plan.motion.qd)
        <= 0.9 * np.array([joint.limits.velocity for joint in lwr.joints]) + 1e-9
    )
    assert plan.motion.t[-1] == pytest.approx(6.0)


def test_a_plan_goes_through_points_that_are_an_array(lwr):
    points = np.zeros((3, 7))
    points[1, :3] = 0.5, 0.3, -0.2
    plan = dynid.plan_trajectory(lwr, waypoints=points, alpha=1.0)
    assert np.abs(plan.motion.q - points[1]).max(axis=1).min() < 1e-3
    assert plan.search is None


def test_a_plan_says_in_words_what_a_person_wants_to_know(plan):
    labels = [label for label, _ in plan.lines()]
    assert {"plan", "limits", "collision", "excitation", "noise"} <= set(labels)
    assert all(joint in repr(plan) for joint in plan.robot.joint_names)


def test_options_are_read_alike_from_words_and_from_values():
    words = dynid.PlanOptions(
        weights="1,50",
        floor="none",
        obstacles=("box 0,0,0,1,1,1",),
        noise="0.1,0.2",
        margin="5%",
    )
    values = dynid.PlanOptions(
        weights=(1, 50),
        floor=None,
        obstacles=((1, 1, 1, 0, 0, 0),),
        noise=(0.1, 0.2),
        margin=0.05,
    )
    assert words == values
    assert words.scene.obstacles == (Box((0, 0, 0), (1, 1, 1)),)


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"duration": 0.5}, "--duration 0.5 is not possible"),
        ({"basis": "bezier"}, "--basis 'bezier' is not possible"),
        ({"workspace": (1, 2, 3)}, "is not 6 numbers"),
        ({"noise": (0.1, -0.1)}, "must be one positive number, or one per joint"),
        ({"noise": 1e-308}, "must be one positive number, or one per joint"),
        ({"weights": (0, 0)}, "are not weights"),
        ({"tool_speed": 1e-308}, "--tool-speed 1e-308 is not possible"),
        ({"seed": -1}, "--seed -1 is not possible: it must be from 0"),
        ({"seconds": np.inf}, "--seconds inf is not possible"),
        ({"alpha": np.nan}, "--alpha nan is not possible"),
    ],
)
def test_an_impossible_option_is_refused_when_it_is_made(options, says):
    with pytest.raises(WrongUsage, match=says):
        dynid.PlanOptions(**options)
