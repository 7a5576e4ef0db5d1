"""Gains of drives and a load, from an arm that Pinocchio moves in closed loop with the noise of real sensors."""

from dataclasses import replace

import numpy as np
import pytest

from arms import pinocchio_model
from dynid import Log, base_model
from dynid.estimation.drive_gains import find_gains, known_load
from dynid.estimation.estimate import estimate
from dynid.estimation.payload import find_payload
from dynid.estimation.stack import stack_logs
from dynid.model.parameters import joined
from dynid.robot import Body
from dynid.signals.conditioned_log import condition_log
from dynid.sim.sines import SineSpec, sines
from follower import follow_motion
from recorded_lwr import PLANT, ROBOT

ROTOR = (0.3, 0.3, 0.2, 0.2, 0.1, 0.1, 0.05)
CONTROLLER = (2000.0, 2000, 1500, 1500, 800, 500, 250), (100.0, 100, 60, 60, 25, 15, 8)
LOAD = Body(1.8, (0.03, -0.02, 0.09), (0.006, 0.0004, -0.0003, 0.005, 0.0002, 0.004))
GAINS = np.array([11.0, 9.5, 8.0, 7.0, 3.5, 3.0, 2.4])
RATE, ENCODER = 500.0, np.deg2rad(1e-3)


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    return base_model(ROBOT, tmp_path_factory.mktemp("lwr"))


def logged(seed, load=None, seconds=25.0):
    rng = np.random.default_rng(seed)
    motion = sines(ROBOT, SineSpec(seconds, 12.0, 0.8, 0.7, 0.7, 0.1), 1 / RATE, rng)
    bodies = PLANT.bodies if load is None else (*PLANT.bodies[:-1], joined(PLANT.bodies[-1], load))
    encoder = ENCODER * rng.standard_normal(motion.q.shape)
    plant = pinocchio_model(ROBOT, bodies, ROTOR)
    seen, tau = follow_motion(plant, PLANT.friction.torque, motion, CONTROLLER, encoder)
    # A torque is held from its sample to the next, so the mean of two belongs to the sample between them.
    tau[1:] = 0.5 * (tau[1:] + tau[:-1])
    tau += np.array(PLANT.sensors.torque_noise) * rng.standard_normal(tau.shape)
    log = Log(motion.t, seen, tau, ROBOT.joint_names, tau_unit="Nm", dh=True)
    return replace(log, extra={"q_ref": motion.q})


def stacked(base, log):
    return stack_logs([condition_log(log, base.model, cutoff=6.0)], base)


@pytest.fixture(scope="module")
def logs():
    return logged(31), logged(32, LOAD)


def test_the_load_is_found_within_three_percent_and_inside_its_error_bars(base, logs):
    empty, loaded = (estimate(stacked(base, log), holdout=None) for log in logs)
    payload = find_payload(loaded, empty)
    assert payload.body.mass == pytest.approx(LOAD.mass, rel=0.03)
    assert np.linalg.norm(np.subtract(payload.body.com, LOAD.com)) < 0.03 * np.linalg.norm(LOAD.com)
    found = np.array([payload.body.mass, *payload.body.com, *payload.body.inertia_com])
    truth = np.array([LOAD.mass, *LOAD.com, *LOAD.inertia_com])
    assert np.mean(np.abs(found - truth) <= 1.96 * payload.std_error) >= 0.8


def test_currents_with_a_load_of_known_mass_tell_the_gains_and_the_mass_within_three_percent(
    base, logs
):
    def in_amperes(log):
        return stacked(base, replace(log, tau=log.tau / GAINS, tau_unit="A"))

    load = known_load(base, in_amperes(logs[1]), LOAD.mass)
    found = find_gains(in_amperes(logs[0]), np.full(7, np.nan), load)
    assert found.gain == pytest.approx(GAINS, rel=0.03)
    empty, loaded = (
        estimate(stacked(base, replace(log, tau=log.tau / GAINS * found.gain)), holdout=None)
        for log in logs
    )
    assert find_payload(loaded, empty).body.mass == pytest.approx(LOAD.mass, rel=0.03)
