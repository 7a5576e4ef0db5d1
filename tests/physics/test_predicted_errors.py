"""What is predicted before the arm moves is what comes out: the shipped Gen2 motion, run in MuJoCo and identified."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

import models
from arms import simulated_torques
from dynid import Log, LogOptions, identify, load_log, load_robot
from dynid.estimation.least_squares import weighted
from dynid.estimation.posterior import prior_information
from dynid.estimation.stack import stack_logs
from dynid.files.trajectoryfile import read_trajectory
from dynid.signals.conditioned_log import condition_logs
from dynid.sim.arm import SimulatedArm, SimulatedRun, track
from dynid.sim.plant import Sensors, read_plant
from dynid.trajectory.basis import Quintic, basis_from
from dynid.trajectory.feasible import bounds, coefficients, random_variables
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.predict import default_noise, held_out, predict

SHIPPED = Path(__file__).parents[2] / "trajectories" / "kinova_gen2_alpha1.0.npz"
DRAWS, RATE, STEP = 20, 100.0, 1e-3


def test_predicted_errors_are_those_of_20_noisy_logs_simulated_in_mujoco_and_identified(tmp_path):
    robot = load_robot("kinova_gen2")
    base = models.shipped("kinova_gen2")
    stored = read_trajectory(SHIPPED, robot)
    plan = Trajectory(basis_from(dict(stored.basis)), stored.coefficients)
    noise, other = default_noise(robot), held_out(base, bounds(robot))
    predicted = predict(base, plan.sampled(RATE), noise, other)

    arm = SimulatedArm(robot, dt=STEP)
    done, kept = track(arm, plan.sampled(1 / STEP)), slice(None, None, round(1 / STEP / RATE))
    truth = SimulatedRun(*(part[kept] for part in vars(done).values()))
    sensors = dataclasses.replace(
        Sensors.perfect(robot.n), torque_noise=tuple(noise), velocity_noise=None
    )
    rng = np.random.default_rng(8)
    draws = []
    for _ in range(DRAWS):
        sensors.measure(truth, robot.log_names, rng).save(tmp_path / "log.npz")
        sources = condition_logs(
            [load_log(tmp_path / "log.npz", robot, identify=False)], base.model, LogOptions()
        )
        stacked = stack_logs(sources, base)
        draws.append(weighted(stacked.factors, stacked.counts).theta)
    misses = np.array(draws) - base.prior(unknown=0.0)

    ratio = np.sqrt(np.mean(misses**2, axis=0)) / predicted.std_error
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.3)
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)
    # A standard deviation from 20 draws is itself 16 % uncertain, so by chance 6 % of the parameters miss by over 30 %.
    assert np.mean(np.abs(ratio - 1) < 0.3) > 0.85
    torque = np.sqrt(np.mean(np.einsum("kp,pq,kq->k", misses, other, misses)) / robot.n)
    assert torque == pytest.approx(predicted.torque_error, rel=0.3)


def test_expected_torque_errors_come_true_of_what_is_identified_by_default_from_three_motions_of_another_arm():
    """Torques of MuJoCo for the LWR4+ of trajectories/lwr4plus_truth.yaml; the prior knows none of its bodies."""
    robot, plant = load_robot("kuka_lwr4plus"), read_plant(SHIPPED.with_name("lwr4plus_truth.yaml"))
    base = models.shipped("kuka_lwr4plus")
    noise, other = default_noise(robot), held_out(base, bounds(robot))
    prior = prior_information(base)
    ratio = []
    for seed, alpha in enumerate((1.0, 0.6, 0.3)):
        basis, limits = Quintic.even(12.0, 8), bounds(robot, 0.1)
        rng = np.random.default_rng(seed)
        c = coefficients(basis, limits, random_variables(basis, limits, rng))
        motion = Trajectory(basis, c, alpha).sampled(RATE)
        arm = plant.arm(robot)
        tau = simulated_torques(arm, motion.q, motion.qd, motion.qdd)
        tau = tau + arm.friction.torque(motion.qd) + arm.rotor_inertia * motion.qdd
        tau = tau + noise * rng.normal(size=tau.shape)
        log = Log(motion.t, motion.q, tau, robot.joint_names, tau_unit="Nm", dh=True)
        found = identify(robot, log, holdout=None, base=base)
        known = plant.parameters()
        miss = found.theta - base.reduction.K @ np.array(
            [known[name] for name in base.reduction.names]
        )
        expected = predict(base, motion, noise, other, prior).torque_error
        ratio.append(np.sqrt(miss @ other @ miss / robot.n) / expected)
    # Why so wide: each ratio is one draw of the noise and of how far the arm is from the prior.
    assert 0.5 < np.median(ratio) < 1.6
    assert max(ratio) < 3.0
