"""Joints whose torques contradict those of the others, in torques of PyBullet."""

from dataclasses import replace

import numpy as np
import pytest
from loaded_arm import ROBOT, recorded

from dynid import identify, load, validate

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


@pytest.fixture(scope="module")
def reversed_(logs):
    """The result of a log with a joint whose torque has the wrong sign."""
    return identify(ROBOT, spoilt(logs[0], -1.0), holdout=None)


def shares(found):
    return np.array([joint.relative_percent for joint in found.joints]) / 100


@pytest.fixture(scope="module")
def good(logs):
    log, other = logs
    return shares(validate(identify(ROBOT, log, holdout=None), other))


def stuck(log):
    """Return the log with a torque that stays as it is after a third of it."""
    tau, last = log.tau.copy(), len(log.t) // 3
    tau[last:, BAD] = tau[last, BAD]
    return replace(log, tau=tau)


def partial(log):
    """Return the log with a part of the last three torques; the last of them agrees with an arm that no body makes."""
    tau = log.tau.copy()
    tau[:, -3:] = 0.3 * tau[:, -3:] - 0.5 * np.gradient(log.q[:, -3:], log.t, axis=0)
    return replace(log, tau=tau)


@pytest.mark.parametrize(
    ("change", "joints"),
    [
        *((lambda log, gain=gain: spoilt(log, gain), [BAD]) for gain in (-1.0, 0.4, 2.5, np.nan)),
        (stuck, [BAD]),
        (partial, [-1, -2, -3]),
    ],
)
def test_joints_with_wrong_or_missing_torques_spoil_no_other(logs, good, change, joints):
    log, other = logs
    bad = shares(validate(identify(ROBOT, change(log), holdout=None), change(other)))
    # Why more for three of seven: most of what the noise is taken from is wrong, and good joints count less.
    most = 1.5 if change is partial else 1.1
    assert np.linalg.norm(np.delete(bad, joints)) < most * np.linalg.norm(np.delete(good, joints))


def test_draws_of_a_joint_apart_are_those_of_its_own_parameters(logs, reversed_):
    result, other = reversed_, logs[1]
    assert result.model_error.joints_apart.tolist() == [BAD]
    qd = np.gradient(other.q, other.t, axis=0)
    qdd = np.gradient(qd, other.t, axis=0)
    moving = slice(200, -200, 10)
    torques = result.draws(200).torques(other.q[moving], qd[moving], qdd[moving])[:, :, BAD]
    measured = spoilt(other, -1.0).tau[moving, BAD]
    # Why a quarter: accelerations are second differences of rounded positions.
    off = torques.mean(axis=0) - measured
    assert np.sqrt(np.mean(off**2)) < 0.25 * np.std(measured)


def test_a_reversed_joint_is_named_and_predicted_by_parameters_of_its_own(logs, reversed_):
    result, other = reversed_, logs[1]
    (finding,) = [finding for finding in result.findings if finding.code == "W413"]
    assert finding.evidence["joints"] == [ROBOT.joint_names[BAD]]
    assert shares(validate(result, spoilt(other, -1.0)))[BAD] < 0.2


def test_joints_that_agree_are_not_set_apart(logs):
    log, _ = logs
    result = identify(ROBOT, log, holdout=None)
    assert "W413" not in [finding.code for finding in result.findings]
    assert result.model_error is None or not len(result.model_error.joints_apart)


def test_a_result_with_a_joint_apart_predicts_the_same_from_its_file(reversed_, tmp_path):
    result = reversed_
    again = load(result.save(tmp_path / "parameters.npz"))
    rng = np.random.default_rng(0)
    states = rng.uniform(-1.0, 1.0, (3, 7, ROBOT.n))
    assert again.inverse_dynamics(*states) == pytest.approx(
        result.inverse_dynamics(*states), rel=1e-9
    )
    one = np.array([result.inverse_dynamics(*state) for state in states.swapaxes(0, 1)])
    assert one == pytest.approx(result.inverse_dynamics(*states), rel=1e-9, abs=1e-9)
