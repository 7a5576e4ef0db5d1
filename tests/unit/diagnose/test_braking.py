"""Friction brakes: it tells reversed torques on a short log, and torques that no robot file explains."""

from dataclasses import replace

import numpy as np
import pytest

from dynid import Motion, load_log, load_robot, simulate
from dynid.diagnose.diagnosis import diagnose
from dynid.errors import WrongMapping
from dynid.signals.checks import prepare
from dynid.signals.columns import take_samples
from makelogs import lwr, lwr_log, shared_data
from motions import tones


def test_a_joint_whose_friction_would_drive_is_named_and_accuses_no_file():
    log = lwr_log()
    speed = np.gradient(log.q, log.t, axis=0)
    tau = log.tau.copy()
    tau[:, 4] += 20.0 * np.tanh(speed[:, 4] / 0.01) - 40.0 * speed[:, 4]
    (found,) = diagnose(prepare(replace(log, tau=tau), lwr()), lwr())
    assert found.code == "W334"
    assert found.evidence["joints"] == [lwr().joint_names[4]]


def test_seconds_of_an_arm_that_creeps_accuse_no_joint():
    robot, t, k = load_robot("ur5e"), np.arange(0.0, 24.0, 0.01), np.arange(6)
    motion = Motion(t, *tones(t, 0.2, 0.3 + 0.1 * k[None], k))
    log = simulate(robot, motion, noise=0.005, resolution=1e-4).log
    for start in range(0, 2400, 400):
        assert diagnose(take_samples(log, start + np.arange(400)), robot) == ()


@pytest.mark.slow
@pytest.mark.data
def test_nine_seconds_of_an_arm_with_reversed_torques_say_so():
    robot = load_robot(shared_data("lbr_med7/med7.urdf"))
    with pytest.raises(WrongMapping, match="all torques reversed"):
        diagnose(load_log(shared_data("lbr_med7/med7.csv"), robot), robot)


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize("motion", [1, 2, 3])
def test_three_motions_of_one_arm_say_the_same(motion):
    folder = shared_data("shanghai_cobot")
    right, wrong = (load_robot(folder / f"{name}.yaml") for name in ("shanghai", "shanghai_raw"))
    log = load_log(folder / f"traj{motion}.csv", right)
    (found,) = diagnose(log, right)
    assert found.code == "W334"
    assert found.evidence["joints"] in (["J6"], ["J4", "J5", "J6"])
    with pytest.raises(WrongMapping, match="the torque of J3 reversed"):
        diagnose(load_log(folder / f"traj{motion}.csv", wrong), wrong)
