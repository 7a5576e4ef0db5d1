"""The base parameters of random arms against Pinocchio's regressor: same span, same rank, same classes."""

from dataclasses import replace

import numpy as np
import pytest

from arms import pinocchio_model, pinocchio_torques, random_bodies, random_robot
from dynid.model import build_model
from dynid.model.reduce import random_states
from dynid.model.relations import base_parameters
from dynid.robot import Body

GRAVITIES = ((0, 0, -9.81), (9.81, 0, 0), (0, 6.9, -6.9), (0, 0, 0), (1.2, -3.4, -9.0))


def random_arm(seed):
    """Return an arm of 3 to 6 joints without rotors and friction; half of its numbers are special ones."""
    robot = random_robot(
        np.random.default_rng(seed), 3 + seed % 4, ("standard", "modified")[seed % 2]
    )
    joints = tuple(replace(joint, motor_inertia=False, friction=()) for joint in robot.joints)
    return replace(robot, joints=joints, gravity=GRAVITIES[seed % 5])


def pinocchio_regressor(robot, *states):
    """Return columns (N n, 10 n): the torques of ten bodies on one link after the other, in their parameters."""
    bodies, columns = random_bodies(np.random.default_rng(0), 10), []
    for k in range(robot.n):
        torques = []
        for body in bodies:
            alone = [body if k == link else Body(0.0) for link in range(robot.n)]
            torques.append(pinocchio_torques(pinocchio_model(robot, alone), *states).ravel())
        columns.append(np.linalg.solve([body.parameters() for body in bodies], torques))
    return np.concatenate(columns).T


def normalised_rank(W):
    size = np.linalg.norm(W, axis=0)
    W = W[:, size > 1e-9] / size[size > 1e-9]
    values = np.linalg.svd(W, compute_uv=False)
    # Why 1e-7: the torques of ten bodies tell columns to 1e-12, which those of hardly any size make larger.
    return int(np.sum(values > 1e-7 * values[0]))


@pytest.mark.parametrize("seed", range(20))
def test_random_arm_has_the_span_rank_and_classes_of_pinocchio(seed):
    robot = random_arm(seed)
    model = build_model(robot)
    states = random_states(robot, 60, seed)
    ours = model.regressor(*states).reshape(-1, model.size)
    theirs = pinocchio_regressor(robot, *states)
    np.testing.assert_allclose(ours, theirs, atol=1e-9 * np.abs(theirs).max())

    found = base_parameters(model)
    assert found.rank == normalised_rank(theirs) == normalised_rank(np.hstack([ours, theirs]))
    # Dropping a column that stands alone costs a rank; a zero column is zero; any other can be dropped without loss.
    for k, name in enumerate(found.names):
        if name in found.none:
            assert np.linalg.norm(theirs[:, k]) < 1e-9
        else:
            assert (normalised_rank(np.delete(theirs, k, axis=1)) < found.rank) == (
                name in found.alone
            )
