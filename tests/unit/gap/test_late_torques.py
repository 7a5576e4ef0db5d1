"""Torques that come late by much more than their slope can say."""

from dataclasses import replace

import numpy as np
import pytest

import twolink
from dynid.gap.analysis import analyse_gap
from dynid.gap.candidates import SelectionOptions
from dynid.gap.delays import late_torques
from dynid.gap.problem import make_problem


@pytest.mark.parametrize("seconds", [0.23, -0.12])
def test_torques_that_are_late_since_are_found_on_another_motion(twolinks, old, kept, seconds):
    new = twolinks.logs(plans=(5, 6), first=20, delay=seconds, seconds=4.0)
    late = late_torques(make_problem(new, twolinks.base, kept, old))
    assert late == pytest.approx(seconds, abs=1e-3)


@pytest.mark.slow
def test_a_delay_that_its_slope_does_not_tell_is_named_with_its_size(twolinks, old, kept):
    seconds = 0.18
    new = twolinks.logs(plans=(5, 6), first=20, delay=seconds)
    seen = analyse_gap(new, twolinks.base, kept, SelectionOptions(), earlier=old)
    (one,) = seen.named
    assert one.name == "torque_delay"
    assert abs(one.values["delay"] - seconds) < 3 * one.std_errors["delay"] < 0.02


def test_torques_in_time_stay_where_they_are(twolinks, old, kept, more_friction):
    for added in (None, more_friction):
        new = twolinks.logs(added, plans=(5, 6), first=20)
        assert late_torques(make_problem(new, twolinks.base, kept, old)) == 0.0


def test_a_delay_of_one_joint_alone_is_none_of_the_recorder(twolinks, old, kept, on_joint):
    def added(t, q, qd, qdd):
        tau = twolink.torque(q, qd, qdd)[:, 1]
        return on_joint(1, np.interp(t - 0.1, t, tau) - tau)

    new = twolinks.logs(added, plans=(5, 6), first=20)
    assert late_torques(make_problem(new, twolinks.base, kept, old)) == 0.0


def test_new_logs_that_are_shorter_than_the_longest_delay_say_nothing(twolinks, old, kept):
    problem = make_problem(twolinks.logs(plans=(5,), delay=0.2), twolinks.base, kept, old)
    late = replace(problem, every=problem.every.only(~problem.every.is_new))
    assert late_torques(late) == 0.0
