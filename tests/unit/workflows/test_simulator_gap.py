"""Exported files driven along a log: what a model lacks shows as strayed positions, and goes when it is added."""

from dataclasses import replace

import numpy as np
import pytest

import dynid
import twolink
from dynid.robot import EffectSpec
from dynid.signals.columns import take_samples
from dynid.workflows.simulate import save_figure


@pytest.fixture(scope="module")
def results(arm):
    """The two-link arm with a spring of 5 N m/rad at its elbow, identified without and with it; another log."""
    logs = [twolink.log(seed) for seed in (1, 2, 3)]
    for log in logs:
        log.tau[:, 1] += 5.0 * log.q[:, 1]
    spring = EffectSpec("spring", ("elbow",), {"order": 1.0, "constant": 0.0})
    arms = arm, replace(arm, effects=(spring,))
    return [dynid.identify(each, logs[:2]) for each in arms], take_samples(logs[2], np.arange(600))


def test_the_gap_shrinks_in_the_simulator_when_the_effect_is_added(results, tmp_path):
    """The physics of the log is the textbook's with a spring by hand; what is loaded are the exported files."""
    found = dynid.compare_in_simulator(*results)
    before, after = found.position_rms[:, 1]
    assert after < 0.5 * before
    assert found.torque_rms[1, 1] < 0.5 * found.torque_rms[0, 1]
    facts = found.facts()
    assert [model["name"] for model in facts["models"]] == ["before", "after"]
    assert "->" in repr(found)
    assert save_figure(found, tmp_path / "gap.png").stat().st_size > 10_000
