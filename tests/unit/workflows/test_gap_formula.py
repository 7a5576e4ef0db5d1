"""A torque without a name: written down, stored, drawn, added to the robot file, identified again."""

import numpy as np
import pytest

import twolink
from dynid import GapOptions, IdentifyOptions, Log, find_gap, identify, load_robot
from dynid.workflows.gap_result import Gap

SIZE = 0.4


def log(plan, noise):
    """A log of the two-link arm whose elbow feels the speed of the shoulder in proportion to its own."""
    t, q, qd, qdd = twolink.motion(plan)
    tau = twolink.torque(q, qd, qdd) + 0.05 * np.random.default_rng(noise).standard_normal(q.shape)
    tau[:, 1] += SIZE * np.abs(qd[:, 1]) * qd[:, 0]
    return Log(t=t, q=q, tau=tau, names=("shoulder", "elbow"))


@pytest.fixture(scope="module")
def gap(arm):
    logs = [log(plan, 10 * plan + k) for plan in (1, 2) for k in range(2)]
    result = identify(arm, logs[::2], IdentifyOptions(feasible=False))
    return find_gap(result, logs, GapOptions(effects="spring,torque_offset"))


def test_it_is_written_down_with_size_and_unit(gap):
    assert gap.verdict == "unexplained"
    (one,) = gap.formulas
    assert (one.formula, one.where) == ("a |qd2| qd1", "elbow")
    assert one.values["a"] == pytest.approx(SIZE, abs=4 * one.std_errors["a"])
    assert one.units == {"a": "N m s^2/rad^2"}
    assert one.rms_after < 0.5 * one.rms_before
    assert "a |qd2| qd1 on elbow: a = 0." in gap.summary()
    assert "a formula describes the rest on elbow" in gap.advice
    assert gap.curves[-1].follows == "torque that the formula says [N m]"
    assert gap.facts()["formulas"][0]["formula"] == "a |qd2| qd1"
    assert gap.table()[-1]["result"] == "formula, not in the catalogue"


def test_it_is_stored_and_read_back(gap, tmp_path):
    gap.save(tmp_path / "gap.npz")
    again = Gap.load(tmp_path / "gap.npz")
    assert again.formulas == gap.formulas
    assert again.clues == gap.clues


def test_it_is_drawn_through_unseen_data(gap, tmp_path):
    assert (tmp_path / "effect_1_formula.png") in gap.write_figures(tmp_path)


def test_added_it_is_identified_with_everything_else(gap, tmp_path):
    found = gap.apply("formula@2", robot_file=tmp_path / "arm.yaml")
    again = load_robot(tmp_path / "arm.yaml")
    assert again.effects[0].formula == "a |qd2| qd1"
    assert found.theta[found.names.index("formula2_a")] == pytest.approx(SIZE, rel=0.05)
    logs = [log(plan, 50 + plan) for plan in (1, 2)]
    plain = identify(again, logs, IdentifyOptions(feasible=False))
    assert plain.theta[plain.names.index("formula2_a")] == pytest.approx(SIZE, rel=0.05)
