"""Arms with joints of more than a turn, guessed thickness and missing limits are planned for, and said."""

from dataclasses import replace

import numpy as np
import pytest

from dynid import PlanOptions, base_model, load_robot
from dynid.errors import LimitsAssumed
from dynid.files.trajectoryfile import StoredTrajectory
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.feasible import assumed_limits, position_range, unsafe_to_play
from dynid.trajectory.planning import planning_context, search_ranges, thickness
from dynid.workflows.options import RecordOptions
from dynid.workflows.record import require_usable
from motions import standing


def without(robot, **limits):
    return replace(
        robot, joints=tuple(replace(j, limits=replace(j.limits, **limits)) for j in robot.joints)
    )


def test_what_the_robot_file_leaves_out_is_said_with_what_stands_in_for_it():
    robot = load_robot("ur5e")
    assert assumed_limits(robot) == ()
    bare = without(robot, position=None, velocity=None, acceleration=None, torque=None)
    named = [text.split(" of all joints:")[0] for text in assumed_limits(bare)]
    assert named == ["position", "velocity", "acceleration"]
    assert (
        assumed_limits(without(robot, velocity=None))[0] == "velocity of all joints: 1 rad/s or m/s"
    )


@pytest.mark.parametrize(
    ("limits", "refused"), [({"velocity": None}, True), ({"position": None}, False)]
)
def test_record_refuses_assumed_rates_and_takes_a_joint_without_end(limits, refused):
    robot = without(load_robot("ur5e"), **limits)
    motion = standing(np.zeros(6))
    facts = {"assumed_limits": list(assumed_limits(robot))}
    planned = StoredTrajectory("ur5e", robot.joint_names, motion, 1.0, {}, motion.q, facts=facts)
    if refused:
        with pytest.raises(LimitsAssumed, match="velocity of all joints"):
            require_usable(robot, planned, RecordOptions())
    else:
        require_usable(robot, planned, RecordOptions())
        assert unsafe_to_play(facts["assumed_limits"]) == ()


def test_links_of_the_wrist_that_are_near_as_thick_cylinders_are_left_out_and_named():
    near = Capsules(load_robot("ur5e")).distances(np.zeros((1, 6)))
    assert "link 3 - link 5" in [d.pair for d in near if d.usual]
    assert "radius 0.06 m, a guess" in thickness(load_robot("ur5e"))


def test_links_left_out_are_still_watched_for_contact_deeper_than_in_usual_poses():
    robot = load_robot("franka_panda")
    capsules = Capsules(robot)
    lower, upper = position_range(robot)
    q = np.random.default_rng(3).uniform(lower, upper, (400, 7))
    near = [[c for c in capsules.distances(p[None]) if c.usual] for p in q]
    assert "link 5 - link 7" in [c.pair for c in near[0]]
    lack = [min(c.distance - c.wanted for c in each) for each in near]
    assert 0 < np.mean(np.array(lack) < 0) < 0.2


def test_a_slide_without_travel_is_assumed_short_and_its_plan_is_not_played():
    robot = load_robot("scara")
    bare = without(robot, position=None)
    assert assumed_limits(bare) == (
        "position of shoulder, elbow, tool: turning without end, two turns each way",
        "travel of slide: 0.1 m each way",
    )
    assert unsafe_to_play(assumed_limits(bare)) == ("travel of slide: 0.1 m each way",)


def test_an_arm_of_joints_without_end_is_searched_within_a_turn_where_half_the_poses_are_clear():
    robot = load_robot("kinova_gen3")
    context = planning_context(base_model(robot), PlanOptions())
    limits, _ = search_ranges(context.limits, context.capsules)
    assert np.all(limits.upper - limits.lower <= 2 * np.pi + 1e-9)
    poses = np.random.default_rng(9).uniform(limits.lower, limits.upper, (300, 7))
    assert np.mean(context.capsules.margin(poses) >= 0) > 0.4
