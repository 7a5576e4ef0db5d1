"""Counterbalances of heavy arms of a generator that shares no code with the search (Pinocchio, several kinds)."""

from dataclasses import replace

import heavy_arms as heavy
import numpy as np
import pytest
import yaml
from logs_of_arms import sources_of

import models
from dynid.diagnose.gravity import check_gravity
from dynid.errors import GravityRemoved
from dynid.files.robotfile import load_robot
from dynid.gap.analysis import on_one_clock
from dynid.gap.counterbalance import suspicions
from dynid.gap.problem import make_problem
from dynid.log import Log
from dynid.robot import Body, Prior

pytestmark = pytest.mark.slow


def suspected(tmp_path, seed, with_counterbalance):
    drawn = heavy.draw(seed, with_counterbalance)
    path = tmp_path / "heavy.yaml"
    path.write_text(yaml.safe_dump(heavy.robot_table(drawn)))
    base = models.base_of(load_robot(path))
    logs = heavy.simulate(drawn, seed)
    return suspicions(make_problem(on_one_clock(sources_of(logs, base.model)), base, None), [])


@pytest.mark.parametrize(("seed", "sure"), [(15, True), (13, False)])
def test_it_is_sure_where_the_first_axes_are_apart_and_likely_where_they_cross(
    tmp_path, seed, sure
):
    """Axis 1 of the first arm is 0.2 m before axis 2: the torques of the first tell what the second carries."""
    (one,) = suspected(tmp_path, seed, True)
    assert (one.joint, one.sure) == (1, sure)


@pytest.mark.parametrize("seed", [11, 15])
def test_an_arm_without_one_is_not_suspected_even_with_a_counterweight(tmp_path, seed):
    assert heavy.draw(seed, False).counterweight is (seed == 11)
    assert suspected(tmp_path, seed, False) == []


def test_a_weight_that_is_carried_wholly_is_no_gravity_that_was_removed(tmp_path):
    """The spring carries all that axis 2 would; that the other axes carry theirs shows that gravity is there."""
    drawn = heavy.draw(907, True)
    path = tmp_path / "heavy.yaml"
    path.write_text(yaml.safe_dump(heavy.robot_table(drawn)))
    bodies = [Body(m, tuple(c), tuple(i[np.triu_indices(3)])) for m, c, i in drawn.bodies]
    robot = replace(load_robot(path), prior=Prior(links=tuple(bodies)))
    t, q, tau = heavy.simulate(drawn, 907, trajectories=1)[0]
    check_gravity(Log(t, q, tau, robot.joint_names), robot)
    weight = drawn.arm.torque(q, 0 * q, 0 * q)
    weight[:, 1] -= drawn.assists(q)
    with pytest.raises(GravityRemoved):
        check_gravity(Log(t, q, tau - weight, robot.joint_names), robot)
