"""Estimators on an arm that Pinocchio moves under its own controller, with bad encoders."""

from dataclasses import replace

import numpy as np
import pytest
from arms import random_bodies
from follower import follow_motion

from dynid.errors import NotSimulated, WrongUsage
from dynid.estimation.closed_loop import Arm, follow
from dynid.estimation.estimators import METHODS
from dynid.estimation.stack import stack_logs
from dynid.robot import Controller, Joint, Limits, Robot
from dynid.signals.conditioned_log import ConditionedLog, condition
from dynid.signals.filters import choose_filter
from dynid.sim.arm import Friction
from dynid.sim.sines import SineSpec, sines
from dynid.workflows.model import base_model

HALF = np.pi / 2
LIMITS = Limits((-2.5, 2.5), 2.0, 8.0)
GAINS = Controller((1500.0, 1200.0, 500.0), (60.0, 50.0, 20.0))
ROBOT = Robot(
    "three",
    "standard",
    tuple(
        Joint(f"j{k}", a=a, twist=twist, d=d, limits=LIMITS, friction=("viscous", "coulomb"))
        for k, (a, twist, d) in enumerate([(0.0, HALF, 0.3), (0.35, 0.0, 0.0), (0.2, HALF, 0.1)])
    ),
    controller=GAINS,
)
FRICTION = Friction((2.0, 1.5, 0.8), (2.0, 1.5, 0.8), (0.0, 0.0, 0.0), (0.01, 0.01, 0.01))
ROTOR = (0.2, 0.2, 0.1)
BODIES = random_bodies(np.random.default_rng(3), 3)
RATE, TORQUE_NOISE = 500.0, (0.05, 0.05, 0.05)


def logged(encoder_deg, seed=0, seconds=12.0):
    rng = np.random.default_rng(seed)
    motion = sines(ROBOT, SineSpec(seconds, 10.0, 0.8, 0.8, 0.8, -9.0), 1 / RATE, rng)
    return follow_motion(
        ROBOT, BODIES, FRICTION, ROTOR, motion, GAINS, np.deg2rad(encoder_deg), TORQUE_NOISE, rng
    )


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    return base_model(ROBOT, tmp_path_factory.mktemp("three"))


@pytest.fixture(scope="module")
def truth(base):
    values = {f"Im{k + 1}": rotor for k, rotor in enumerate(ROTOR)}
    for k, body in enumerate(BODIES, start=1):
        names = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
        values |= {
            f"{name}{k}": value for name, value in zip(names, body.parameters(), strict=True)
        }
        values |= {f"fv{k}": FRICTION.viscous[k - 1], f"fc{k}": FRICTION.coulomb[k - 1]}
    return base.reduction.K @ np.array([values[name] for name in base.reduction.names])


def stacked(base, log, cutoff=10.0):
    chosen = choose_filter(log, ROBOT, cutoff)
    segments = condition(log, chosen, coulomb=ROBOT.coulomb_shape)
    return stack_logs([ConditionedLog(segments, chosen, "log")], base)


def error(theta, truth):
    return float(np.linalg.norm(theta - truth) / np.linalg.norm(truth))


def test_the_simulated_arm_moves_as_pinocchio_moves_it(base, truth):
    """From the command and the true parameters alone, ten times closer than the command itself."""
    log = logged(0.0)
    rows = stacked(base, log)
    (segment,) = rows.logs[0].segments
    observer = rows.observer
    arm = Arm(lambda q, qd, qdd: observer.torque(truth, q, qd, qdd), observer.coulomb_sign)
    found = follow(segment, arm, np.zeros_like(segment.q), GAINS, 40.0)
    lag = np.abs(segment.command_q - segment.q).max(axis=0)
    assert np.all(np.abs(found.q - segment.q).max(axis=0) < 0.1 * lag)
    assert found.rounds < 10


def test_instruments_from_the_simulated_arm_remove_the_bias_of_bad_encoders(base, truth):
    """With 0.03 degrees of noise behind wide filters least squares are far off; IDIM-IV and DIDIM are not."""
    rows = stacked(base, logged(0.03), cutoff=20.0)
    found = {
        name: METHODS[name](rows, np.zeros(len(truth)), GAINS)
        for name in ("ols", "wls", "idim-iv", "didim")
    }
    wrong = {name: error(each.theta, truth) for name, each in found.items()}
    assert wrong["ols"] > 0.2
    assert wrong["idim-iv"] < 0.2 * wrong["ols"]
    assert wrong["didim"] < 0.2 * wrong["ols"]
    z = (found["idim-iv"].theta - truth) / np.sqrt(np.diagonal(found["idim-iv"].covariance))
    assert np.mean(np.abs(z) < 1.96) >= 0.85


def test_wrong_gains_bias_the_direct_fit_more_than_the_instruments(base, truth):
    """Instruments only have to move like the arm; 30 % of wrong gain leaves IDIM-IV as it was."""
    log = logged(0.01)
    wrong = Controller(tuple(0.7 * k for k in GAINS.kp), GAINS.kd)
    rows, names = stacked(base, log), ("idim-iv", "didim")
    right = {name: error(METHODS[name](rows, truth, GAINS).theta, truth) for name in names}
    off = {name: error(METHODS[name](rows, truth, wrong).theta, truth) for name in names}
    assert off["idim-iv"] < 1.5 * right["idim-iv"] + 1e-3
    assert off["didim"] > 2 * off["idim-iv"]


def test_a_loop_that_runs_away_is_said_so(base, truth):
    rows = stacked(base, logged(0.0))
    (segment,) = rows.logs[0].segments
    observer = rows.observer
    arm = Arm(lambda q, qd, qdd: observer.torque(-truth, q, qd, qdd), observer.coulomb_sign)
    with pytest.raises(NotSimulated):
        follow(segment, arm, np.zeros_like(segment.q), GAINS, 40.0)


def test_the_gains_and_the_command_are_asked_for(base):
    log = logged(0.0, seconds=6.0)
    with pytest.raises(WrongUsage, match="gains"):
        METHODS["didim"](stacked(base, log), np.zeros(1), None)
    with pytest.raises(WrongUsage, match="commanded"):
        METHODS["idim-iv"](stacked(base, replace(log, extra={})), np.zeros(1), GAINS)
