"""Logs become stacks, stacks are added: the estimate is the same wherever the stacks were made."""

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from loaded_arm import recorded

import dynid
from dynid.estimation.estimate import estimate, last_share
from dynid.estimation.stack import added
from dynid.workflows.parameters import observed, shared_cutoff, stack_of


@pytest.fixture(scope="module")
def base():
    return dynid.base_model(dynid.load_robot("kuka_lwr4plus"))


@pytest.fixture(scope="module")
def logs(base):
    return [replace(recorded(seed, seconds=15.0)[1], dh=False) for seed in (41, 42)]


def elsewhere(function, logs):
    """Map as other processes do: what goes there and what comes back is bytes."""
    sent = pickle.dumps(function)
    return [
        pickle.loads(pickle.dumps(pickle.loads(sent)(pickle.loads(pickle.dumps(log)))))
        for log in logs
    ]


def stacks(mapped, base, logs, options):
    prepared = [
        dynid.load_log(log, base.robot, options) if isinstance(log, str) else log for log in logs
    ]
    options = replace(options, cutoff=shared_cutoff(prepared, base.robot, options))
    return observed(
        added(list(mapped(partial(stack_of, base=base, options=options), prepared))), options
    ).stack


@pytest.mark.parametrize("residual_model", [False, True])
def test_stacks_that_were_made_elsewhere_give_the_same_bytes(base, logs, residual_model):
    """Spikes, reversals and the residual model look at single rows, which are evaluated again."""
    options = dynid.LogOptions(cutoff=6.0)
    found = []
    for mapped in (map, elsewhere):
        stack = stacks(mapped, base, logs, options)
        found.append(
            estimate(stack, base, holdout=last_share(stack, 0.2), residual_model=residual_model)
        )
    one, other = found
    assert one.theta.tobytes() == other.theta.tobytes()
    assert one.covariance.tobytes() == other.covariance.tobytes()
    assert one.heldout_relative_error_percent == other.heldout_relative_error_percent


def test_a_sum_of_stacks_is_the_stack_of_all_logs(base, logs):
    options = dynid.LogOptions(cutoff=6.0, delay=0.0)
    one, two = (stack_of(log, base, options) for log in logs)
    whole = dynid.observe(base.robot, logs, options, base=base).stack
    np.testing.assert_array_equal((one + two).factors, whole.factors)
    assert (one + two).log_of_block.tolist() == whole.log_of_block.tolist()
    for ours, theirs in zip(one + two, whole, strict=True):
        np.testing.assert_array_equal(ours.W, theirs.W)


def test_identify_of_several_logs_is_the_estimate_from_their_sum(base, logs):
    options = dynid.IdentifyOptions(cutoff=6.0)
    result = dynid.identify(base.robot, logs, options, base=base)
    again = dynid.identify(
        base.robot, observed(stacks(elsewhere, base, logs, options), options, ()), options
    )
    assert again.theta.tobytes() == result.theta.tobytes()


def test_a_command_that_one_log_lacks_is_left_out_of_all(base, logs):
    one, other = logs
    with_command = replace(one, extra={**one.extra, "q_ref": one.q})
    options = dynid.LogOptions(cutoff=6.0, delay=0.0)
    commanded, plain = stack_of(with_command, base, options), stack_of(other, base, options)
    assert commanded.commanded
    assert not (commanded + plain).commanded
    assert all(rows.command is None for rows in commanded + plain)
