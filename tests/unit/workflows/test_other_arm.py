"""A log of one arm with the robot file of another: said as such, with the arm that it is."""

import math
from dataclasses import replace

import numpy as np
import pytest

from dynid import find_gap, identify, load_robot, simulate
from dynid.model.parameters import prior_bodies
from dynid.robot import Prior
from dynid.sim.sines import SineSpec, sines


@pytest.fixture(scope="module")
def logs():
    """A simulated UR3e whose bodies nobody has told dynid."""
    arm = load_robot("ur3e")
    arm = replace(arm, prior=Prior(links=tuple(prior_bodies(arm))), tool=None)
    spec = SineSpec(15.0, 6.0, 0.8, 0.9, 0.9, -math.inf)
    motions = [sines(arm, spec, 0.005, np.random.default_rng([k, 9])) for k in (1, 2)]
    return [
        replace(simulate(arm, each, seed=5, noise=0.0005).log, sha256=str(k))
        for k, each in enumerate(motions)
    ]


def test_the_file_of_another_arm_is_told_with_the_arm_that_it_is(logs):
    wrong = load_robot("ur10e")
    found = identify(wrong, [replace(log, names=wrong.log_names) for log in logs], drop_weak=True)
    other = found.header["other_arm"]
    assert other["name"] == "ur3e"
    assert other["percent"] < 0.6 * other["own"]
    judged = found.judgement
    assert judged.sentence.startswith("These logs fit another arm better")
    assert judged.light("fit").state == "bad"
    assert judged.steps[0].command.endswith("--robot ur3e")


@pytest.mark.slow
def test_a_search_with_the_file_of_another_arm_names_nothing(logs):
    wrong = load_robot("ur10e")
    renamed = [replace(log, names=wrong.log_names) for log in logs]
    found = identify(wrong, renamed, drop_weak=True)
    gap = find_gap(found, renamed, effects="spring,torque_crosstalk")
    assert gap.closest
    assert not gap.named
    assert gap.verdict == "unexplained"
    assert gap.judgement.sentence == found.judgement.sentence
    assert not any("Error of" in reason for reason in gap.judgement.reasons)


def test_the_right_file_raises_no_doubt(logs):
    found = identify("ur3e", logs, drop_weak=True)
    assert "other_arm" not in found.header
    assert found.judgement.light("fit").state == "good"
