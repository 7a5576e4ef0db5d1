"""All estimators side by side on one log, through the command line."""

import json

import numpy as np
from loaded_arm import recorded


def table(run, encoder):
    """Compare the methods on a log whose commanded motion is the true one, with encoder noise [rad]."""
    log = recorded(31, seconds=20.0)[1]
    noise = encoder * np.random.default_rng(0).normal(size=log.q.shape)
    np.savez(run.folder / "log.npz", t=log.t, q=log.q + noise, tau=log.tau, q_ref=log.q)
    done = run("compare", "--methods", "kuka_lwr4plus", "log.npz", "--json")
    assert done.status == 0, done.err
    return json.loads(done.out)


def test_every_estimator_is_in_the_table(dynid):
    answer = table(dynid, 0.0)
    assert {row["method"] for row in answer["methods"]} == {"ols", "wls", "irls", "iv", "ridge"}
    assert answer["auto"] == "wls"
    assert all(
        row["heldout_relative_error_percent"] < 2 and row["seconds"] > 0
        for row in answer["methods"]
    )


def test_encoder_noise_raises_the_bias_alarm(dynid):
    answer = table(dynid, 0.0015)
    assert answer["bias_alarm"]
    assert answer["biased_parameters"]


def test_a_robot_without_a_log_is_refused(dynid):
    assert dynid("compare", "--methods", "kuka_lwr4plus").status == 2
