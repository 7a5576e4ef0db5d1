"""A result is what it says: torques, intervals, text, and the same again from its file."""

import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_stack import motion, simulated, stacked, truth

import models
from dynid import Identification, load_robot
from dynid.errors import Finding, WrongUsage
from dynid.estimation import tuning
from dynid.estimation.compare import compare
from dynid.estimation.estimate import estimate, last_share, unexplained
from dynid.estimation.evidence import found_path
from dynid.estimation.identified import JointQuality
from dynid.robot import EffectSpec, TorqueSource


@pytest.fixture(scope="module")
def result(base):
    rows = stacked(base, simulated(base, noise=0.1), cutoff=15.0)
    return estimate(rows, method="wls", holdout=last_share(rows, 0.2))


def test_its_torques_are_those_of_the_arm_that_was_simulated(base, result):
    state = motion(base.robot, 5.0, 7)[1:]
    true = base.model.regressor(*state) @ truth(base)
    tau = result.inverse_dynamics(*state)
    assert np.sqrt(np.mean((tau - true) ** 2)) < 0.02 * np.sqrt(np.mean(true**2))
    assert result.regressor(*state) @ result.theta == pytest.approx(tau, abs=1e-9)


def test_effects_of_the_robot_file_need_the_time_of_the_samples(base, result):
    """An offset that the sensor warms up to is a torque of time alone."""
    spec = EffectSpec("torque_drift", (base.robot.joint_names[0],), {"tc": 2.0, "amplitude": 3.0})
    robot = replace(base.robot, effects=(spec,))
    reduction, theta = models.base_of(robot).reduction, np.append(result.theta, 3.0)
    added = replace(result, robot=robot, reduction=reduction, rigid=None, theta=theta)
    t, *state = motion(robot, 2.0, 7)
    with pytest.raises(WrongUsage, match="order of the samples"):
        added.inverse_dynamics(*state)
    drift = added.inverse_dynamics(*state, t) - result.inverse_dynamics(*state)
    assert drift[:, 0] == pytest.approx(3.0 * 2.0 * (1 - np.exp(-t / 2.0)), abs=1e-9)
    assert drift[:, 1:] == pytest.approx(0.0, abs=1e-9)


def test_intervals_are_two_standard_errors_wide_and_open_where_nothing_is_known(result):
    vague = replace(
        result, std_error=np.where(np.arange(len(result.theta)) == 0, np.inf, result.std_error)
    )
    low, high = vague.conf_int().T
    assert (high - low)[1:] == pytest.approx(2 * 1.959964 * vague.std_error[1:], rel=1e-6)
    assert low[0] == -np.inf
    assert vague.conf_int(0.68)[1:, 1] - vague.theta[1:] == pytest.approx(
        0.994458 * vague.std_error[1:], rel=1e-6
    )
    assert vague.params["fv1"] == vague.theta[vague.names.index("fv1")]
    assert vague.table()[0]["97.5 %"] == np.inf


def test_what_is_saved_is_loaded(result, tmp_path):
    noted = replace(
        result,
        findings=(Finding("W402", "warning", "text", {"a": 1}),),
        header={**result.header, "logs": ["run.bag"], "log_sha256": ["ab"]},
    )
    stored = Identification.load(
        noted.save(tmp_path / "parameters.npz", {"command": "dynid identify"})
    )
    for key in ("theta", "plain", "covariance", "std_error", "prior", "noise", "factors", "counts"):
        assert np.array_equal(getattr(stored, key), getattr(noted, key), equal_nan=True)
    for key in ("robot", "names", "method", "why", "knowledge", "joints", "findings", "cutoff"):
        assert getattr(stored, key) == getattr(noted, key), key
    assert stored.header["command"] == "dynid identify"
    assert (stored.header["logs"], stored.log_sha256) == (["run.bag"], ("ab",))
    state = motion(result.robot, 1.0, 7)[1:]
    assert np.array_equal(stored.inverse_dynamics(*state), noted.inverse_dynamics(*state))
    again = Identification.load(stored.save(tmp_path / "again.npz"))
    assert np.array_equal(again.theta, noted.theta)


@pytest.fixture(scope="module", params=["parameters", "residual model", "some links"])
def described(request, base, result):
    """Results whose torques are made of all that they can be made of."""
    if request.param == "some links":
        part = models.base_of(replace(base.robot, links=(3, 4)))
        return estimate(stacked(part, simulated(base, noise=0.1)), method="wls", holdout=None)
    if request.param == "residual model":
        rows = stacked(base, simulated(base, noise=0.1))
        return estimate(rows, method="wls", holdout=None, residual_model=True)
    return result


@pytest.mark.slow
def test_the_torques_of_one_state_are_those_of_a_motion(described, tmp_path):
    """To rounding, with and without the residual model; a loaded result gives the same."""
    _, q, qd, qdd = motion(described.robot, 2.0, 7)
    again = Identification.load(described.save(tmp_path / "parameters.npz"))
    assert again.residual_facts() == described.residual_facts()
    for residual_model in (True, False):
        whole = described.inverse_dynamics(q, qd, qdd, residual_model=residual_model)
        loaded = again.inverse_dynamics(q, qd, qdd, residual_model=residual_model)
        assert np.array_equal(loaded, whole)
        for k in range(0, len(q), 10):
            tau = described.inverse_dynamics(
                q[k], qd[k].tolist(), tuple(qdd[k]), residual_model=residual_model
            )
            assert tau.shape == (described.robot.n,)
            assert tau == pytest.approx(whole[k], rel=1e-12, abs=1e-12 * np.abs(whole).max())


def test_a_result_pickles_with_all_that_it_holds(result):
    """Also after it was asked for torques: what was derived for them is derived again."""
    state = motion(result.robot, 1.0, 7)[1:]
    tau = result.inverse_dynamics(*state)
    again = pickle.loads(pickle.dumps(result))
    assert np.array_equal(again.inverse_dynamics(*state), tau)
    assert np.array_equal(again.stack.rows.W, result.stack.rows.W)


# ---------------------------------------------------------------- recordings that a result names
def test_a_recording_is_found_from_elsewhere_whichever_way_it_was_typed(tmp_path, monkeypatch):
    """A result that was identified in the folder s is opened in an empty folder beside."""
    for folder in ("s/out/arm", "elsewhere"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "s/a.csv").write_text("")
    header = {"logs": ["a.csv"], "logs_from_here": ["../../a.csv"]}
    moved = SimpleNamespace(path=tmp_path / "s/out/arm/parameters.npz", header=header)
    monkeypatch.chdir(tmp_path / "elsewhere")
    typed = "a.csv", "../s/a.csv", "../elsewhere/../s/a.csv", str(tmp_path / "s/a.csv")
    assert {found_path(moved, name) for name in typed} == {str(tmp_path / "s/a.csv")}
    assert [found_path(moved, name) for name in ("gone.csv", "")] == ["gone.csv", ""]
    monkeypatch.chdir(tmp_path / "s")
    assert found_path(moved, "a.csv") == "a.csv"


# ---------------------------------------------------------------- drift
JOINTS = (
    JointQuality("joint_1", 0.1, 1.0, 10.0, 0.12),
    JointQuality("joint_2", 0.2, 2.0, 10.0, 0.2),
)


def compared(theta, std_error, joints=JOINTS, plain=None):
    """What is compared of a result, with independent errors."""
    theta, error = np.asarray(theta, dtype=float), np.asarray(std_error, dtype=float)
    return SimpleNamespace(
        names=tuple(f"p{k}" for k in range(len(error))),
        theta=theta,
        plain=theta if plain is None else plain,
        plain_covariance=np.diag(error**2),
        std_error=error,
        knowledge=("well",) * len(error),
        joints=joints,
        relative_error_percent=1.5,
        heldout_relative_error_percent=1.6,
    )


def test_noise_alone_is_called_drift_as_rarely_as_promised():
    """2000 pairs of results of 40 unchanged parameters: about one percent of pairs name any."""
    rng = np.random.default_rng(0)
    truth, error = rng.normal(size=40), rng.uniform(0.01, 0.1, 40)
    alarms = 0
    for _ in range(2000):
        one, other = (compared(truth + error * rng.normal(size=40), error) for _ in range(2))
        alarms += bool(compare(one, other).drifted)
    assert 0.3 * tuning.CHANGE_FALSE_ALARM < alarms / 2000 < 2 * tuning.CHANGE_FALSE_ALARM


def test_the_parameter_that_changed_is_named_and_no_other():
    """A change of eight standard errors in one of 40."""
    rng = np.random.default_rng(1)
    truth, error = rng.normal(size=40), np.full(40, 0.05)
    one, other = (compared(truth + error * rng.normal(size=40), error) for _ in range(2))
    moved = other.plain + np.where(np.arange(40) == 17, 8 * np.sqrt(2) * 0.05, 0)
    changed = compared(other.theta, error, plain=moved)
    assert [change.name for change in compare(one, changed).drifted] == ["p17"]


def test_parameters_that_a_log_does_not_determine_are_not_tested():
    """An infinite error makes no p-value and no alarm."""
    one, other = compared([1.0, 2.0], [0.1, np.inf]), compared([1.0, 200.0], [0.1, 0.1])
    comparison = compare(one, other)
    assert not comparison.drifted
    assert comparison.changes[1].p_value is None


def test_well_known_parameters_are_measured_against_themselves_others_against_their_error():
    """2 % of a parameter known to 1 %; a change of one standard error is 10 % where nothing better is known."""
    one = compared([1.0, 0.0], [0.01, 0.2])
    other = compared([1.02, 0.2], [0.01, 0.2])
    first, second = compare(one, other).changes
    assert first.percent == pytest.approx(2.0)
    assert second.percent == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("tolerance", "beyond"), [(0.05, []), (0.019, ["p0"]), (0.001, ["p0", "joint_2 rms_nm"])]
)
def test_numbers_beyond_a_tolerance_are_listed_the_largest_move_first(tolerance, beyond):
    """Parameters and figures alike."""
    one = compared([1.0, 2.0], [0.01, 0.01])
    joints = (one.joints[0], replace(one.joints[1], rms=0.202))
    other = compared([1.02, 2.0], [0.01, 0.01], joints=joints)
    assert [each.name for each in compare(one, other).beyond(tolerance)] == beyond


def test_equal_results_differ_nowhere():
    """Not even where a value is zero."""
    one = compared([0.0, 2.0], [0.0, 0.01])
    comparison = compare(one, one)
    assert not comparison.beyond(1e-12)
    assert comparison.p_value == 1.0


def test_results_of_other_robots_are_not_the_same(result):
    in_amperes = replace(result.robot, torque=TorqueSource("motor_current", relative=True))
    assert result.describes(result.base)
    assert not result.describes(replace(result, robot=in_amperes).base)


def test_the_misfit_of_a_joint_that_slides_is_a_force():
    base, plain = SimpleNamespace(robot=load_robot("scara")), SimpleNamespace(rms=np.ones(4))
    (finding,) = unexplained(base, plain, np.array([1.0, 1, 9, 1]), None)
    assert "9 instead of 1 N;" in finding.text
