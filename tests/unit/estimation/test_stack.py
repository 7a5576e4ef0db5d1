"""Stacking and estimating against the same things done whole, and against simulated truth."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import NothingChanged, RankDeficient
from dynid.estimation import observation_files
from dynid.estimation.conditioned_log import ConditionedLog, without_known
from dynid.estimation.estimate import estimate, last_share
from dynid.estimation.estimators import wls
from dynid.estimation.observation_rows import rows_of
from dynid.estimation.physical_parameters import physical_parameters
from dynid.estimation.result import load
from dynid.estimation.stack import stack
from dynid.files.robotfile import load_robot
from dynid.log import Log
from dynid.model import build_model
from dynid.model.base_model import BaseModel
from dynid.model.prior import prior_base_parameters, prior_parameters
from dynid.model.reduce import reduce
from dynid.signals.conditioning import choose_filter, condition

RATE = 100.0


@pytest.fixture(scope="module")
def base():
    robot = load_robot("scara")
    model = build_model(robot)
    return BaseModel(model, reduce(model))


def motion(robot, seconds, seed):
    """A sum of sines with its exact derivatives."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    f = rng.uniform(0.1, 0.6, (4, robot.n))
    a = rng.uniform(0.1, 0.3, (4, robot.n)) * np.array([1.0 if j.revolute else 0.2 for j in robot.joints])
    w = 2 * np.pi * f
    phase = rng.uniform(0, 6, (4, robot.n))
    s, c = np.sin(w * t[:, None, None] + phase), np.cos(w * t[:, None, None] + phase)
    return t, (a * s).sum(1), (a * w * c).sum(1), (-a * w**2 * s).sum(1)


def simulated(base, seconds=30.0, seed=0, noise=0.0, gamma=None):
    robot = base.robot
    t, q, qd, qdd = motion(robot, seconds, seed)
    rng = np.random.default_rng(seed + 1000)
    gamma = truth(base) if gamma is None else gamma
    tau = base.model.regressor(q, qd, qdd) @ gamma
    return Log(t, q, tau + noise * rng.normal(size=tau.shape), robot.joint_names, dh=True)


def truth(base):
    links = prior_parameters(base.robot).reshape(-1, 10)
    values = {}
    for j in range(base.robot.n):
        for p, kind in enumerate(("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")):
            values[f"{kind}{j + 1}"] = 1.1 * links[j, p]
        values |= {f"Im{j + 1}": 0.05, f"fv{j + 1}": 0.4, f"fc{j + 1}": 0.6, f"fo{j + 1}": 0.1}
    return np.array([values[name] for name in base.model.parameter_names])


def stacked(base, *logs, cutoff=None):
    sources = []
    for log in logs:
        chosen = choose_filter(log, base.robot, cutoff)
        sources.append(ConditionedLog(without_known(condition(log, chosen), base.model), chosen, "log"))
    return stack(sources, base.model.observer(base.reduction.base), base.reduction.base_names, base.robot.joint_names)


def test_factors_hold_the_same_normal_equations_as_all_rows(base):
    found = stacked(base, simulated(base), simulated(base, seed=3))
    rows = [r for k in range(2) for r in found.rows_of_log(k)]
    factors, counts = found.whole
    for j in range(base.robot.n):
        A = np.concatenate([np.column_stack([r.W[:, j], r.tau[:, j]]) for r in rows])
        assert factors[j].T @ factors[j] == pytest.approx(A.T @ A, rel=1e-9, abs=1e-9 * np.abs(A.T @ A).max())
        assert counts[j] == len(A)


def test_rows_made_in_pieces_are_those_made_at_once(base, monkeypatch):
    log = simulated(base)
    chosen = choose_filter(log, base.robot)
    source = ConditionedLog(condition(log, chosen), chosen, "log")
    observer = base.model.observer(base.reduction.base)
    whole = np.concatenate([r.W for r in rows_of(source, observer)])
    monkeypatch.setattr("dynid.estimation.observation_rows.EVALUATED", 150)
    monkeypatch.setattr("dynid.signals.conditioning.BLOCK", 300)
    pieces = ConditionedLog(condition(log, chosen), chosen, "log")
    assert np.concatenate([r.W for r in rows_of(pieces, observer)]) == pytest.approx(whole, abs=1e-9)


def test_noise_free_motion_gives_the_true_base_parameters(base):
    found = estimate(stacked(base, simulated(base), cutoff=15.0), base, method="wls", holdout=None)
    true = base.reduction.K @ truth(base)
    scale = np.maximum(np.abs(true), 0.05)
    assert np.abs(found.theta - true) / scale == pytest.approx(0.0, abs=0.03)
    assert found.relative_error_percent < 0.3


def test_errors_shrink_when_a_second_log_is_stacked(base):
    noisy = [simulated(base, noise=0.5, seed=s) for s in (0, 5)]
    one = estimate(stacked(base, noisy[0]), base, method="wls", holdout=None)
    two = estimate(stacked(base, *noisy), base, method="wls", holdout=None)
    assert np.median(two.std_error / one.std_error) < 0.9


def test_standard_errors_match_the_spread_over_many_draws_of_noise(base):
    draws = [estimate(stacked(base, simulated(base, noise=0.5, seed=0, seconds=20)), base, method="wls", holdout=None)]
    clean = simulated(base, seconds=20)
    for k in range(12):
        rng = np.random.default_rng(50 + k)
        log = replace(clean, tau=clean.tau + 0.5 * rng.normal(size=clean.tau.shape))
        draws.append(estimate(stacked(base, log), base, method="wls", holdout=None))
    spread = np.std([d.theta for d in draws], axis=0, ddof=1)
    claimed = np.mean([d.std_error for d in draws], axis=0)
    assert 0.6 < np.median(claimed / spread) < 1.5


def test_held_out_rows_are_not_those_that_were_fitted(base):
    found = stacked(base, simulated(base, noise=0.2))
    split = last_share(found, 0.2)
    assert not set(split.train.block) & set(split.test.block)
    assert split.test.blocks / found.blocks == pytest.approx(0.2, abs=0.05)
    assert min(rows.t[0] for rows in split.test) > max(rows.t[-1] for rows in split.train)
    result = estimate(found, base, method="ols", holdout=split)
    assert result.heldout_relative_error_percent > 0.9 * result.relative_error_percent


def test_a_joint_that_stands_still_leaves_parameters_open(base):
    log = simulated(base)
    q = log.q.copy()
    q[:, -1] = 0.3
    found = stacked(base, replace(log, q=q))
    with pytest.raises(RankDeficient, match="base parameters"):
        estimate(found, base, method="wls", holdout=None)
    kept = estimate(found, base, method="wls", holdout=None, drop_weak=True)
    last = f"fv{base.robot.n}"
    assert kept.knowledge[kept.names.index(last)] == "not determined"
    assert np.isinf(kept.std_error[kept.names.index(last)])


def test_clipped_samples_do_not_count(base):
    log = simulated(base)
    clipped = np.zeros(log.tau.shape, dtype=bool)
    clipped[800:900, 0] = True
    tau = np.where(clipped, 99.0, log.tau)
    spoilt = stacked(base, replace(log, tau=tau, extra={"clipped": clipped}))
    clean = stacked(base, log)
    assert spoilt.whole[1][0] < clean.whole[1][0]
    assert spoilt.whole[1][1] == clean.whole[1][1]
    result = estimate(spoilt, base, method="wls", holdout=None)
    assert result.joints[0].rms < 0.1


def test_links_that_are_not_identified_keep_the_prior():
    robot = replace(load_robot("scara"), links=(3, 4))
    model = build_model(robot)
    part = BaseModel(model, reduce(model))
    assert not {"m1", "Izz2"} & set(part.reduction.names)
    whole_model = build_model(load_robot("scara"))
    whole = BaseModel(whole_model, reduce(whole_model))
    gamma = truth(whole)
    names = whole_model.parameter_names
    links = prior_parameters(robot).reshape(-1, 10)
    gamma[[names.index(f"{k}{j}") for j in (1, 2) for k in ("Im",)]] = 0.0
    for j in (1, 2):
        for p, kind in enumerate(("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")):
            gamma[names.index(f"{kind}{j}")] = links[j - 1, p]
    found = estimate(stacked(part, simulated(whole, gamma=gamma), cutoff=15.0), part, method="wls", holdout=None)
    assert found.relative_error_percent < 0.5


def test_the_numeric_regressor_is_read_back_as_the_same_stack(base, tmp_path):
    found = stacked(base, simulated(base))
    observation_files.save(tmp_path / "fullnumericregressor.npz", found, {"robot": "x"})
    sources, header = observation_files.load(tmp_path / "fullnumericregressor.npz")
    again = stack(sources, base.model.observer(base.reduction.base), base.reduction.base_names, base.robot.joint_names)
    assert again.whole[0] == pytest.approx(found.whole[0], abs=1e-12)
    assert header["robot"] == "x"


def test_a_result_is_read_back_with_its_robot(base, tmp_path):
    result = estimate(stacked(base, simulated(base)), base, method="wls", holdout=None)
    stored = load(replace(result, log_sha256=("ab",)).save(tmp_path / "parameters.npz"))
    assert stored.theta == pytest.approx(result.theta, abs=0)
    assert stored.robot.joint_names == base.robot.joint_names
    assert stored.robot.model_key == base.robot.model_key
    assert stored.log_sha256 == ("ab",)


def test_the_prior_of_a_base_parameter_is_the_sum_of_its_terms(base):
    values = prior_base_parameters(base.model, base.reduction)
    names = base.reduction.base_names
    kinds = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
    labels = [f"{kind}{j}" for j in range(1, base.robot.n + 1) for kind in kinds]
    links = dict(zip(labels, prior_parameters(base.robot), strict=True))
    combined = [k for k, name in enumerate(names) if name.endswith("R")]
    assert combined
    for k in combined:
        terms = base.reduction.terms(k)
        assert values[k] == pytest.approx(sum(factor * links.get(name, 0.0) for name, factor in terms.items()))
    assert np.isnan(values[names.index("fv1")])


def test_a_search_that_stays_at_its_start_is_refused(base, monkeypatch):
    """A physical set that is the prior although the torques say otherwise; where they say the same it is a result."""
    found = stacked(base, simulated(base))
    prior = prior_base_parameters(base.model, base.reduction)
    fit = physical_parameters(base, wls(found, prior))
    unmoved = replace(fit, x=np.linalg.lstsq(base.reduction.K, np.nan_to_num(prior), rcond=None)[0])
    monkeypatch.setattr("dynid.estimation.estimate.physical_parameters", lambda *given: unmoved)
    with pytest.raises(NothingChanged, match="nothing changed: the physical set equals the prior in"):
        estimate(found, base, method="wls", holdout=None, feasible=True)
    assert estimate(found, base, method="wls", holdout=None, feasible=False).in_force == "plain"
