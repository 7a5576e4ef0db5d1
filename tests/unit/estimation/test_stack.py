"""Stacking and estimating against the same things done whole, and against simulated truth."""

from dataclasses import replace

import numpy as np
import pytest

import dynid
import models
from dynid import Log
from dynid.errors import RankDeficient
from dynid.estimation.estimate import estimate, last_share
from dynid.estimation.least_squares import relative_error, weighted
from dynid.estimation.stack import estimate_delay, on_time, stack_logs
from dynid.model.parameters import columns_of
from dynid.model.regressor import prior_vector
from dynid.signals.conditioned_log import (
    ConditionedLog,
    condition,
    condition_log,
    without_known,
)
from dynid.signals.filters import choose_cutoff, choose_filter
from motions import tones

RATE = 100.0


def motion(robot, seconds, seed):
    """A sum of sines with its exact derivatives."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    shape = (4, robot.n)
    f, size = rng.uniform(0.1, 0.6, shape), np.where(robot.turning, 1.0, 0.2)
    a = rng.uniform(0.1, 0.3, shape) * size
    return t, *tones(t, a, 2 * np.pi * f, rng.uniform(0, 6, shape))


def simulated(base, seconds=30.0, seed=0, noise=0.0, gamma=None):
    robot = base.robot
    t, q, qd, qdd = motion(robot, seconds, seed)
    rng = np.random.default_rng(seed + 1000)
    gamma = truth(base) if gamma is None else gamma
    tau = base.model.regressor(q, qd, qdd) @ gamma
    return Log(t, q, tau + noise * rng.normal(size=tau.shape), robot.joint_names, dh=True)


def truth(base):
    gamma = 1.1 * prior_vector(base.model)
    for kind, value in {"Im": 0.05, "fv": 0.4, "fc": 0.6, "fo": 0.1}.items():
        gamma[columns_of(base.model.parameters, kind)] = value
    return gamma


def stacked(base, *logs, cutoff=None):
    sources = []
    for log in logs:
        chosen = choose_filter(log, cutoff or choose_cutoff([log], base.robot))
        segments = without_known(condition(log, chosen), base.model)
        sources.append(ConditionedLog(segments, chosen, "log"))
    return stack_logs(sources, base)


def test_noise_free_motion_gives_the_true_base_parameters(base):
    """To a millionth of their size; only filter and resampling are between the sines and the fit."""
    found = estimate(stacked(base, simulated(base), cutoff=15.0), method="wls", holdout=None)
    true = base.reduction.K @ truth(base)
    scale = np.maximum(np.abs(true), 0.05)
    assert np.abs(found.theta - true) / scale == pytest.approx(0.0, abs=2e-6)
    assert found.relative_error_percent < 1e-6


def usable(stack):
    """Return all rows that count, as one matrix and one vector."""
    return stack.rows.W[stack.rows.use], stack.rows.tau[stack.rows.use]


def test_held_out_rows_judge_a_fit_to_the_others(base):
    """NumPy's fit to the first four fifths leaves the same error on the last; all rows give the parameters."""
    found = stacked(base, simulated(base, noise=0.2))
    split = last_share(found, 0.2)
    train, test, _ = split
    assert len(test.rows.t) == round(0.2 * len(found.rows.t))
    assert test.rows.t[0] > train.rows.t[-1]
    result = estimate(found, method="ols", holdout=split, drop_weak=True)
    theta = np.linalg.lstsq(*usable(train), rcond=None)[0]
    W, tau = usable(test)
    expected = 100 * np.linalg.norm(tau - W @ theta) / np.linalg.norm(tau)
    assert result.heldout_relative_error_percent == pytest.approx(expected, rel=1e-9)
    assert result.plain == pytest.approx(np.linalg.lstsq(*usable(found), rcond=None)[0], abs=1e-9)


def test_a_stopped_joint_rests_however_much_its_encoder_scatters(base):
    """Ten seconds on their way, one second where they are, and on: what friction holds in between is nobody's row."""
    log = simulated(base)
    order = np.r_[:1000, [1000] * 100, 1000:3000]
    scatter = np.random.default_rng(5).normal(size=(3100, base.robot.n))
    q = log.q[order] + np.where(base.robot.turning, 1e-4, 1e-5) * scatter
    stopped = replace(log, t=np.arange(3100) / RATE, q=q, tau=log.tau[order])
    (segment,) = condition_log(stopped, base.model, cutoff=15.0).segments
    still = np.abs(segment.t - 10.5) < 0.4
    assert not segment.usable[still].any()
    assert segment.usable[~still].mean() > 0.9


def test_a_joint_that_stands_still_leaves_parameters_open(base):
    log = simulated(base)
    q = log.q.copy()
    q[:, -1] = 0.3
    found = stacked(base, replace(log, q=q))
    with pytest.raises(RankDeficient, match="base parameters"):
        estimate(found, method="wls", holdout=None)
    kept = estimate(found, method="wls", holdout=None, drop_weak=True)
    unknown = [
        name
        for name, known in zip(kept.names, kept.knowledge, strict=True)
        if known == "not determined"
    ]
    # What only the last joint's motion shows, and what is shown with the same motion as these; an offset shows at rest.
    assert unknown == ["mcy2R", "mcx4", "mcy4", "Izz4", "Im4", "fv4", "fc4"]
    assert np.isinf(kept.std_error[[kept.names.index(name) for name in ("Im4", "fv4")]]).all()
    # Rotor inertia, viscous and Coulomb friction of the joint are columns of zeros.
    assert kept.rank == len(kept.names) - 3


def test_clipped_samples_do_not_count(base):
    """One second of a joint and what the filters mix into it is left out; the rest gives the same parameters."""
    log = simulated(base)
    clipped = np.zeros(log.tau.shape, dtype=bool)
    clipped[800:900, 0] = True
    tau = np.where(clipped, 99.0, log.tau)
    spoilt = stacked(base, replace(log, tau=tau, extra={"clipped": clipped}))
    clean = stacked(base, log)
    lost = clean.counts - spoilt.counts
    kept_rate = clean.logs[0].filter.kept_rate
    assert lost.tolist()[1:] == [0] * (base.robot.n - 1)
    assert kept_rate <= lost[0] <= 2 * kept_rate
    one, other = (estimate(found, method="wls", holdout=None) for found in (spoilt, clean))
    assert one.joints[0].rms == pytest.approx(other.joints[0].rms, rel=0.02)
    assert one.plain == pytest.approx(other.plain, abs=1e-3)


def test_links_that_are_not_identified_keep_the_prior_and_are_part_of_the_torques(base):
    part = models.base_of(replace(base.robot, links=(3, 4)))
    assert not {"m1", "Izz2"} & set(part.reduction.names)
    names, gamma = base.model.parameter_names, truth(base)
    rest = [k for k, p in enumerate(base.model.parameters) if p.number < 3 and p.kind[0] in "mI"]
    gamma[rest] = prior_vector(base.model)[rest]
    log = simulated(base, gamma=gamma)
    found = estimate(stacked(part, log, cutoff=15.0), method="wls", holdout=None)
    true = dict(zip(names, gamma, strict=True))
    expected = part.reduction.K @ [true[name] for name in part.reduction.names]
    assert found.theta == pytest.approx(expected, abs=1e-6)
    assert found.relative_error_percent < 1e-6
    state = motion(base.robot, 5.0, 7)[1:]
    true = base.model.regressor(*state) @ gamma
    assert found.inverse_dynamics(*state) == pytest.approx(true, abs=1e-4)


def test_the_prior_of_a_base_parameter_is_the_sum_of_its_terms(base):
    values = base.prior()
    links = dict(zip(base.model.parameter_names, prior_vector(base.model), strict=True))
    combined = [k for k, name in enumerate(base.names) if name.endswith("R")]
    assert combined
    for k in combined:
        terms = base.reduction.terms(k)
        assert values[k] == pytest.approx(sum(x * links[name] for name, x in terms.items()))
    assert np.isnan(values[base.names.index("fv1")])


# ---------------------------------------------------------------- the delay of the torques
def late(base, delay):
    """A log whose torques belong to the exact motion ``delay`` earlier, one for all joints or each, with noise."""
    log = simulated(base)
    delays = np.broadcast_to(delay, base.robot.n)
    pairs = zip(delays, log.tau.T, strict=True)
    moved = np.column_stack([np.interp(log.t - own, log.t, column) for own, column in pairs])
    noise = np.random.default_rng(0).normal(size=log.tau.shape) * 0.02 * np.std(log.tau, axis=0)
    return replace(log, tau=moved + noise)


@pytest.mark.parametrize("delay", [0.020, -0.010])
def test_torques_that_are_late_are_moved_back(base, delay):
    stack, (found, std_error), findings = on_time(stacked(base, late(base, delay)))
    applied = stack.logs[0].delay
    assert applied == pytest.approx(delay, abs=max(4 * std_error, 0.06 * abs(delay)))
    assert found == pytest.approx(applied, abs=1e-3)
    assert [finding.code for finding in findings] == ["W321"]
    left, best = (
        relative_error(each.factors, weighted(each.factors, each.counts).theta)
        for each in (stack, stacked(base, late(base, 0.0)))
    )
    assert left < 1.2 * best


def test_joints_that_disagree_make_a_delay_unsure(base):
    apart = np.linspace(0.0, 0.02, base.robot.n)
    sure, unsure = (estimate_delay(stacked(base, late(base, x)))[1] for x in (0.01, apart))
    assert unsure > 3 * sure


def test_a_delay_that_is_given_is_not_estimated(base):
    found = dynid.observe(base.robot, late(base, 0.012), dynid.LogOptions(delay=0.005), base=base)
    assert (found.delay, found.applied_delay) == (None, 0.005)
    assert found.stack.logs[0].delay == 0.005


def test_torques_on_time_are_not_moved(base):
    stack, _, findings = on_time(stacked(base, late(base, 0.0)))
    assert (stack.logs[0].delay, findings) == (0.0, ())


def test_the_torque_of_a_later_time_is_taken_and_the_end_does_not_count(base):
    t = np.arange(400) / 100.0
    x = np.column_stack([np.sin(t)] * base.robot.n)
    log = Log(t, x, x**2, base.robot.joint_names, dh=True)
    plain, moved = (
        condition_log(log, base.model, 20.0, dynid.LogOptions(delay=delay)).segments[0]
        for delay in (0.0, 0.013)
    )
    good = moved.usable[:, 0] & (moved.t < 3.5)
    assert moved.tau[good, 0] == pytest.approx(
        np.interp(moved.t[good] + 0.013, plain.t, plain.tau[:, 0]), abs=1e-3
    )
    assert not moved.usable[moved.t + 0.013 > plain.t[-1]].any()
    assert plain.usable[plain.t > 3.5].any()
