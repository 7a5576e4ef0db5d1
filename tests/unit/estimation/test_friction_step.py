"""The width of the Coulomb step is found from logs, and a result takes it to its predictions."""

from dataclasses import replace

import numpy as np

import dynid
from dynid.robot import Coulomb
from dynid.sim.sines import SineSpec, sines


def logs_of(width):
    """Two motions of a SCARA whose friction turns within a width [rad/s or m/s]."""
    arm = dynid.load_robot("scara")
    turns = replace(arm, coulomb=Coulomb("smooth", (width,) * arm.n))
    motions = [
        sines(arm, SineSpec(15.0, 3.0, 0.8, 0.9, 0.9, -np.inf), 0.002, np.random.default_rng(k))
        for k in (1, 2)
    ]
    return arm, turns, [dynid.simulate(turns, m, seed=k).log for k, m in enumerate(motions)]


def test_the_width_lies_in_its_interval_and_predicts_as_the_true_one(tmp_path):
    arm, turns, (log, unseen) = logs_of(0.003)
    result = dynid.identify(arm, log)
    found = result.robot.coulomb_shape
    for j in (0, 1, 3):
        low, high = found.interval[j]
        assert 0.8 * low < 0.003 < 1.2 * high
    assert result.robot.model_key == arm.model_key
    both = [dynid.validate(each, unseen) for each in (result, dynid.identify(turns, log))]
    assert both[0].relative_error_percent < 1.1 * both[1].relative_error_percent
    result.save(tmp_path / "parameters.npz")
    assert dynid.load(tmp_path).robot.coulomb_shape == found


def test_a_width_of_the_file_stays_and_so_does_the_usual_one_where_logs_do_not_contradict_it():
    arm, turns, (log, _) = logs_of(0.01)
    assert dynid.identify(turns, log).robot.coulomb_shape == turns.coulomb
    velocity = np.array(dynid.identify(arm, log).robot.coulomb_shape.velocity)
    assert np.abs(np.log(velocity[[0, 1, 3]] / 0.01)).max() < 0.2
