"""Predicted errors are those that repeated identification shows, and earlier knowledge is used."""

import numpy as np
import pytest
from randomplans import random_trajectory

from dynid.trajectory.basis import Quintic
from dynid.trajectory.cost import Cost
from dynid.trajectory.feasible import bounds, coefficients, random_variables
from dynid.trajectory.objective import ExcitationObjective, PlanProblem
from dynid.trajectory.optimise import descend
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.predict import (
    alpha_table,
    default_noise,
    held_out,
    information_of,
    predict,
)


@pytest.fixture(scope="module")
def other(lwr):
    return held_out(lwr, bounds(lwr.robot))


def test_slowing_down_costs_accuracy_at_every_step(lwr, other):
    noise = np.full(7, 0.1)
    motion = random_trajectory(lwr.robot, 2)
    rows = alpha_table(motion, lwr, noise, other, samples=6000)
    assert [row.alpha for row in rows] == [0.2, 0.5, 1.0]
    errors = [row.torque_error for row in rows]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] > 5 * errors[2]


def test_the_table_counts_the_samples_that_the_log_will_have(lwr, other):
    motion, noise = random_trajectory(lwr.robot, 2), np.full(7, 0.1)
    samples = motion.sampled(200)
    row = alpha_table(motion, lwr, noise, other, samples=len(samples))[-1]
    assert row.torque_error == pytest.approx(
        predict(lwr, samples, noise, other).torque_error, rel=0.01
    )


def test_a_motion_without_one_joint_leaves_its_friction_unknown(lwr, other):
    motion = random_trajectory(lwr.robot, 3).sampled(50)
    motion.qd[:, 6] = motion.qdd[:, 6] = 0.0
    found = predict(lwr, motion, np.full(7, 0.1), other)
    errors = dict(zip(lwr.reduction.base_names, found.std_error, strict=True))
    assert errors["fv7"] == errors["fc7"] == np.inf
    assert np.isfinite(errors["fv2"])
    assert found.torque_error == np.inf


@pytest.mark.slow
def test_a_motion_planned_after_an_earlier_log_adds_more_than_one_planned_without_it(lwr, other):
    columns, noise = lwr.reduction.base, default_noise(lwr.robot)
    moved = random_trajectory(lwr.robot, 4).sampled(100)
    for part in (moved.q, moved.qd, moved.qdd):
        part[:, 4:] = 0.0  # the earlier log, long and good, left the wrist still
    known = 1000 * information_of(lwr, moved, noise)[1]
    basis, limit = Quintic.even(5.0, 3), bounds(lwr.robot, 0.1)
    # Why four starts: a single descent ends in one of many valleys, and which depends on rounding.
    aware, unaware = [], []
    for start in range(4):
        for knowledge, errors in ((known, aware), (None, unaware)):
            problem = PlanProblem(
                lwr.model, columns, basis, limit, Cost("i", V=other), noise, knowledge, samples=60
            )
            objective = ExcitationObjective(problem)
            x = random_variables(basis, limit, np.random.default_rng((start, 0)))
            plan = Trajectory(basis, coefficients(basis, limit, descend(objective, x)[1]))
            errors.append(predict(lwr, plan.sampled(100), noise, other, known).torque_error)
    assert np.mean(aware) < 0.95 * np.mean(unaware)
