"""What of recording can be tested without ROS: how options are read, and who may move an arm."""

import numpy as np
import pytest

import dynid
from dynid.cli.record import command
from dynid.errors import Declined, WrongUsage
from dynid.workflows.options import RecordOptions
from dynid.workflows.record import record, require_confirmed
from dynid.workflows.simulate import start_pose


class Nobody:
    """An operator who is never there: whatever is asked is an error."""

    def may_replace(self, path):
        raise AssertionError("asked to overwrite")

    def confirm_motion(self, robot):
        raise AssertionError("asked to move")

    def stop_pressed(self):
        raise AssertionError("asked to stop")


@pytest.fixture(scope="module")
def arm():
    return dynid.load_robot("kinova_gen2")


@pytest.mark.parametrize(
    ("given", "speed", "deviation", "timeout"),
    [
        (("50%", "0.1rad", "0.5s"), 0.5, 0.1, 0.5),
        ((0.5, 0.1, 0.5), 0.5, 0.1, 0.5),
        (("100 %", "0.1", "2"), 1, 0.1, 2),
    ],
)
def test_quantities_are_read_with_and_without_their_units(given, speed, deviation, timeout):
    options = RecordOptions(speed=given[0], max_deviation=given[1], timeout=given[2])
    assert (options.speed, options.max_deviation, options.timeout) == pytest.approx(
        (speed, deviation, timeout)
    )


def test_without_a_trajectory_nothing_is_asked_and_nothing_is_looked_for(arm, tmp_path):
    with pytest.raises(WrongUsage, match="no trajectory given"):
        record(arm, None, RecordOptions(), Nobody(), tmp_path)
    with pytest.raises(WrongUsage, match="--listen-only sends nothing"):
        record(arm, None, RecordOptions(listen_only=True, go_to_start=True), Nobody(), tmp_path)


@pytest.mark.parametrize("answer", [False, None, "yes", 1])
def test_only_a_plain_true_lets_an_arm_move(arm, answer):
    class Careless(Nobody):
        def confirm_motion(self, robot):
            return answer

    with pytest.raises(Declined, match="nobody confirmed that kinova_gen2 may move"):
        require_confirmed(Careless(), arm)


def test_what_moves_an_arm_can_be_given_on_the_command_line_only():
    moving = {"move", "accept_unreviewed", "go_to_start", "zero_torques"}
    options = {param.name: param for param in command.params}
    assert moving <= set(options)
    assert not any(options[name].allow_from_autoenv or options[name].envvar for name in moving)


def test_a_simulated_arm_stands_where_it_is_put_and_a_kinova_upright_otherwise(arm):
    upright = start_pose(arm, None)
    endless = [joint.limits.position is None for joint in arm.joints]
    assert np.allclose(upright[endless], np.pi)
    assert np.array_equal(start_pose(arm, "0,1,2,3,4,5,6"), np.arange(7.0))
    with pytest.raises(WrongUsage, match="--pose 0,1 is no file"):
        start_pose(arm, "0,1")
