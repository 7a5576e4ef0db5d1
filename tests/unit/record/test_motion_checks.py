import re

import numpy as np
import pytest

from arms import simulated_torques
from dynid import load_robot
from dynid.errors import Collision, LimitBroken
from dynid.record.motion_checks import (
    TorqueForecaster,
    check_clearance,
    check_limits,
    check_torque,
)
from dynid.record.playing import PlayedMotion, approach, joined
from dynid.sim.arm import SimulatedArm
from dynid.trajectory.scene import Box, Scene, scene_from
from motions import standing, there_and_back

LWR = load_robot("kuka_lwr4plus")
BENT = np.array([0.0, 0.5, 0.0, 0.9, 0.0, -0.7, 0.0])


def swing(far, seconds=2.0):
    return there_and_back(np.linspace(0, seconds, 201), far, BENT)


def only(joint, size):
    return size * (np.arange(7) == joint - 1)


def forecaster(torque):
    return TorqueForecaster(torque, "a simulation", "")


@pytest.fixture(scope="module")
def bullet():
    arm = SimulatedArm(LWR)
    return forecaster(lambda motion: simulated_torques(arm, motion.q, motion.qd, motion.qdd))


def advised(error, speed=1.0):
    return float(re.search(r"--speed ([0-9.]+)%", error.fix)[1]) / 100


def test_a_broken_rate_is_refused_with_the_speed_that_passes():
    motion = swing(only(5, 2.0), 1.0)
    with pytest.raises(
        LimitBroken, match=r"lwr_5_joint moves|accelerates at .* at t = 0\.\d s; limit"
    ) as caught:
        check_limits(LWR, PlayedMotion(motion))
    speed = advised(caught.value)
    check_limits(LWR, PlayedMotion(motion.at_speed(speed), speed=speed))
    with pytest.raises(LimitBroken):
        check_limits(LWR, PlayedMotion(motion.at_speed(1.1 * speed), speed=1.1 * speed))


def test_a_torque_near_the_rating_is_refused_with_the_speed_that_passes(bullet):
    motion = swing(only(2, 1.3), 0.5)
    with pytest.raises(
        LimitBroken, match=r"lwr_1_joint needs \d+ N m at t = .*limit 123 with 30 % margin"
    ) as caught:
        check_torque(LWR, PlayedMotion(motion), bullet)
    speed = advised(caught.value)
    load = check_torque(LWR, PlayedMotion(motion.at_speed(speed), speed=speed), bullet)
    assert load <= 0.7
    faster = motion.at_speed(1.08 * speed)
    assert np.abs(bullet.torque(faster)[:, 1]).max() > 0.7 * 176


@pytest.mark.slow
def test_the_floor_an_obstacle_and_the_arm_itself_are_kept_clear_of():
    played = PlayedMotion(swing(only(2, 0.3)))
    near = check_clearance(LWR, played, Scene())
    assert near[0].distance > 0.05
    with pytest.raises(
        Collision, match=r"link_\d and floor: the arm touches it \(depth \d+ mm\) at t = 1\.0 s"
    ):
        check_clearance(
            LWR, PlayedMotion(swing(np.array([0.0, 1.4, 0.0, -0.9, 0.0, 0.7, 0.0]))), Scene()
        )
    with pytest.raises(Collision, match="obstacle 1"):
        check_clearance(LWR, played, Scene(obstacles=(Box((0.05, -0.2, 0.9), (0.5, 0.2, 1.2)),)))
    kinova = load_robot("kinova_gen2")
    folded = np.array([0.0, 3.14, 0.0, 0.55, 0.0, 5.1, 0.0])
    with pytest.raises(Collision, match=r"link_\d and (link_\d|base)"):
        check_clearance(kinova, PlayedMotion(standing(folded)), Scene(floor=None))


def test_contact_on_the_approach_names_the_approach():
    motion = swing(only(5, 0.2))
    way = approach(LWR, np.array([0.0, 1.9, 0.0, 0.0, 0.0, 0.0, 0.0]), motion.q[0])
    with pytest.raises(Collision, match="floor") as caught:
        check_clearance(LWR, PlayedMotion(joined([way, motion]), float(way.t[-1])), Scene())
    assert "nearer to the start" in caught.value.fix


def test_a_scene_survives_its_facts():
    scene = Scene(
        None, (Box((0.0, 0.0, 0.0), (1.0, 1.0, 1.0)),), Box((-1.0, -1.0, 0.0), (1.0, 1.0, 2.0))
    )
    assert scene_from(scene.facts) == scene
