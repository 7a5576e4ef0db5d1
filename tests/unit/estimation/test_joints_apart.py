"""Joints whose torques contradict those of the others, in torques of PyBullet; the algebra beside all unknowns."""

from dataclasses import replace

import numpy as np
import pytest
from loaded_arm import recorded
from test_stack import simulated, stacked

from dynid import identify, load, validate
from dynid.estimation.estimators import wls
from dynid.estimation.posterior import prior_covariance
from dynid.estimation.residual_model import GROUPS, model_error, whitened_rows
from dynid.files.robotfile import load_robot
from dynid.model import build_model
from dynid.model.base_model import BaseModel, prior_base_parameters
from dynid.model.reduce import reduce

pytestmark = pytest.mark.slow

#: The joint whose torque is spoilt: it shares links with those before and after it.
BAD = 3


def spoilt(log, gain):
    tau = log.tau.copy()
    tau[:, BAD] *= gain
    return replace(log, tau=tau)


@pytest.fixture(scope="module")
def logs():
    return [recorded(seed, seconds=12.0) for seed in (3, 4)]


def shares(found):
    return np.array([joint.rms / joint.torque_rms for joint in found.joints])


@pytest.mark.parametrize("gain", [-1.0, 0.4, 2.5])
def test_a_joint_with_another_scale_or_sign_spoils_no_other(logs, gain):
    (robot, log), (_, other) = logs
    good = validate(identify(robot, log, holdout=None), other)
    bad = validate(identify(robot, spoilt(log, gain), holdout=None), spoilt(other, gain))
    rest = np.arange(robot.n) != BAD
    assert np.linalg.norm(shares(bad)[rest]) < 1.1 * np.linalg.norm(shares(good)[rest])


def test_draws_of_a_joint_apart_are_those_of_its_own_parameters(logs):
    (robot, log), (_, other) = logs
    result = identify(robot, spoilt(log, -1.0), holdout=None)
    assert result.model_error.joints_apart.tolist() == [BAD]
    qd = np.gradient(other.q, other.t, axis=0)
    qdd = np.gradient(qd, other.t, axis=0)
    moving = slice(200, -200, 10)
    torques = result.draws(200).torques(other.q[moving], qd[moving], qdd[moving])[:, :, BAD]
    measured = spoilt(other, -1.0).tau[moving, BAD]
    # Why a quarter: accelerations are second differences of rounded positions.
    assert np.sqrt(np.mean((torques - measured) ** 2)) < 0.25 * np.std(measured)


def test_three_joints_in_a_row_that_give_a_part_of_their_torque_spoil_no_other(logs):
    """The last of them agrees with all others once the first two are apart, but for an arm that no body makes."""

    def partial(log):
        tau = log.tau.copy()
        tau[:, -3:] = 0.3 * tau[:, -3:] - 0.5 * np.gradient(log.q[:, -3:], log.t, axis=0)
        return replace(log, tau=tau)

    (robot, log), (_, other) = logs
    good = validate(identify(robot, log, holdout=None), other)
    bad = validate(identify(robot, partial(log), holdout=None), partial(other))
    assert np.linalg.norm(shares(bad)[:-3]) < 1.1 * np.linalg.norm(shares(good)[:-3])


def stuck(log):
    """Return the log with a torque that stays as it is after a third of it."""
    tau, last = log.tau.copy(), len(log.t) // 3
    tau[last:, BAD] = tau[last, BAD]
    return replace(log, tau=tau)


def test_a_joint_whose_sensor_sticks_spoils_no_other(logs):
    (robot, log), (_, other) = logs
    good = validate(identify(robot, log, holdout=None), other)
    bad = validate(identify(robot, stuck(log), holdout=None), other)
    assert np.linalg.norm(shares(bad)) < 1.1 * np.linalg.norm(shares(good))


def test_a_stack_without_a_joint_is_that_of_the_rows_of_the_others():
    model = build_model(load_robot("scara"))
    base = BaseModel(model, reduce(model))
    stack = stacked(base, simulated(base, seed=0, noise=0.05))
    part = stack.without(np.array([1]))
    kept = [0, 2, 3]
    assert part.whole[1][1] == 0
    assert all(not rows.mask[:, 1].any() and rows.mask[:, kept].all() for rows in part)
    others = np.concatenate([rows.W[:, kept].reshape(-1, len(stack.names)) for rows in stack])
    R = part.whole[0][kept].reshape(-1, len(stack.names) + 1)[:, :-1]
    assert pytest.approx(others.T @ others, rel=1e-9, abs=1e-9) == R.T @ R


def test_a_reversed_joint_is_named_and_predicted_by_parameters_of_its_own(logs):
    (robot, log), (_, other) = logs
    result = identify(robot, spoilt(log, -1.0), holdout=None)
    (finding,) = [finding for finding in result.findings if finding.code == "W413"]
    assert finding.evidence["joints"] == [robot.joint_names[BAD]]
    assert finding.evidence["scales"][robot.joint_names[BAD]] == pytest.approx(-1.0, abs=0.05)
    assert f"{robot.joint_names[BAD]} has -1.0" in finding.text
    assert shares(validate(result, spoilt(other, -1.0)))[BAD] < 0.2


def test_joints_that_agree_are_not_set_apart(logs):
    (robot, log), _ = logs
    result = identify(robot, log, holdout=None)
    assert "W413" not in [finding.code for finding in result.findings]
    assert result.model_error is None or not len(result.model_error.joints_apart)


def test_a_result_with_a_joint_apart_predicts_the_same_from_its_file(logs, tmp_path):
    (robot, log), _ = logs
    result = identify(robot, spoilt(log, -1.0), holdout=None)
    again = load(result.save(tmp_path / "parameters.npz"))
    rng = np.random.default_rng(0)
    states = rng.uniform(-1.0, 1.0, (3, 7, robot.n))
    assert again.inverse_dynamics(*states) == pytest.approx(
        result.inverse_dynamics(*states), rel=1e-9
    )
    one = np.array([result.inverse_dynamics(*state) for state in states.swapaxes(0, 1)])
    assert one == pytest.approx(result.inverse_dynamics(*states), rel=1e-9, abs=1e-9)


def test_eliminating_parameters_of_a_joint_s_own_is_the_joint_solution_of_all_unknowns():
    model = build_model(load_robot("scara"))
    base = BaseModel(model, reduce(model))
    stack = stacked(base, simulated(base, seed=0, noise=0.05))
    estimate = wls(stack, prior_base_parameters(base.model, base.reduction))
    C = prior_covariance(base)
    rows = whitened_rows(stack, base, estimate.theta, estimate.noise, 4.0, C)
    rows = replace(rows, apart=np.r_[0.0, 0.3, np.zeros(len(estimate.noise) - 2)])
    size = np.array([0.1, 0.2, 0.3])
    left, heads = rows.eliminated(size)
    theta = np.linalg.lstsq(left[:-1, :-1], left[:-1, -1], rcond=None)[0]
    error = model_error(rows, size, 0.0, heads, theta, stack.whole[1])
    n, k, p = len(stack.joints), rows.k, len(theta)
    # Unknown: the columns of each joint, what joint 2 has of its own in units of C's root, the parameters of the arm.
    L, total = np.linalg.cholesky(C + 1e-14 * np.diag(np.diag(C))), n * k + 2 * p
    H, g = np.zeros((total, total)), np.zeros(total)
    for j, F in enumerate(rows.factors):
        A = np.zeros((len(F), total))
        A[:, j * k : (j + 1) * k], A[:, -p:] = F[:, :k], F[:, k:-1]
        if j == 1:
            A[:, n * k : n * k + p] = F[:, k:-1] @ L
        H, g = H + A.T @ A, g + A.T @ F[:, -1]
        H[range(j * k, (j + 1) * k), range(j * k, (j + 1) * k)] += 1 / (
            size[GROUPS] * estimate.noise[j] ** 2
        )
    H[range(n * k, n * k + p), range(n * k, n * k + p)] += 1 / 0.3
    whole = np.linalg.solve(H, g)
    assert theta == pytest.approx(whole[-p:], rel=1e-5, abs=1e-7)
    assert error.own[1] == pytest.approx(L @ whole[n * k : n * k + p], rel=1e-4, abs=1e-6)
    assert error.mean.ravel() == pytest.approx(whole[: n * k], rel=1e-4, abs=1e-6)
    W, Z = (
        np.random.default_rng(0).normal(size=(5, n, p)),
        np.random.default_rng(1).normal(size=(5, n, k)),
    )
    covariance = np.linalg.inv(H)
    row = np.concatenate([np.zeros(k), Z[0, 1], np.zeros((n - 2) * k), W[0, 1] @ L, W[0, 1]])
    variance = error.variance(W, Z, covariance[-p:, -p:])
    assert variance[0, 1] == pytest.approx(row @ covariance @ row, rel=1e-4)
