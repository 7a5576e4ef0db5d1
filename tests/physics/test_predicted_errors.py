"""What is predicted before the arm moves is what comes out: the shipped Gen2 motion, run in PyBullet and identified."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from dynid.estimation.least_squares import weighted
from dynid.estimation.stack import stack
from dynid.files.robotfile import load_robot
from dynid.files.trajectoryfile import read_trajectory
from dynid.model.prior import prior_base_parameters
from dynid.model.reduce import reduce
from dynid.model.regressor import build_model
from dynid.sim.plant import Sensors
from dynid.sim.track import track
from dynid.trajectory.basis import basis_from
from dynid.trajectory.feasible import bounds
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.predict import default_noise, held_out, predict
from dynid.workflows.logs import LogOptions, condition_logs, load_log

SHIPPED = Path(__file__).parents[2] / "trajectories" / "kinova_gen2_alpha1.0.npz"
DRAWS, RATE, STEP = 20, 100.0, 1e-3


def test_predicted_errors_are_those_of_20_noisy_logs_simulated_in_pybullet_and_identified(tmp_path):
    pytest.importorskip("pybullet")
    from dynid.sim.arm import SimulatedArm

    robot = load_robot("kinova_gen2")
    model = build_model(robot)
    reduction = reduce(model)
    stored = read_trajectory(SHIPPED, robot)
    plan = Trajectory(basis_from(dict(stored.basis)), stored.coefficients)
    noise, other = default_noise(robot), held_out(model, reduction.base, bounds(robot))
    predicted = predict(model, reduction.base, plan.sampled(RATE), noise, other)

    with SimulatedArm(robot, dt=STEP) as arm:
        truth = track(arm, plan.sampled(1 / STEP), every=round(1 / STEP / RATE))
    sensors = dataclasses.replace(Sensors.perfect(robot.n), torque_noise=tuple(noise), velocity_noise=None)
    rng = np.random.default_rng(8)
    draws = []
    for _ in range(DRAWS):
        sensors.measure(truth, robot.log_names, rng).save(tmp_path / "log.npz")
        sources = condition_logs([load_log(tmp_path / "log.npz", robot)], model, LogOptions())
        stacked = stack(sources, model.observer(reduction.base), reduction.base_names, robot.joint_names)
        draws.append(weighted(*stacked.whole).theta)
    misses = np.array(draws) - prior_base_parameters(model, reduction, unknown=0.0)

    ratio = np.sqrt(np.mean(misses**2, axis=0)) / predicted.std_error
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.3)
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)
    # A standard deviation from 20 draws is itself 16 % uncertain, so by chance 6 % of the parameters miss by over 30 %.
    assert np.mean(np.abs(ratio - 1) < 0.3) > 0.85
    torque = np.sqrt(np.mean(np.einsum("kp,pq,kq->k", misses, other, misses)) / robot.n)
    assert torque == pytest.approx(predicted.torque_error, rel=0.3)
