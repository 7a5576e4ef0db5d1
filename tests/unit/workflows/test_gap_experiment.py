"""The next experiment after a gap search: what it asks, what it promises, and when there is nothing to ask."""

from dataclasses import replace

import numpy as np
import pytest

import models
from dynid.errors import WrongUsage
from dynid.gap.improvement import HeldOutImprovement
from dynid.gap.localisation import JointGap
from dynid.gap.record import GapEffect, GapRecord, read_record, write_record
from dynid.trajectory.options import PlanOptions
from dynid.workflows.gap_experiment import question_of
from dynid.workflows.trajectory import plan_trajectory


@pytest.fixture
def base():
    return models.two_links()


def record_of(base, named=(), verdict="ambiguous", chi=(1.0, 3.0), **more):
    names = base.robot.joint_names
    levels = HeldOutImprovement(
        np.full(2, 0.3), np.full(2, 0.1), np.ones((2, 2)), np.array([0.05, 0.04]), np.zeros(2)
    )
    joints = tuple(JointGap(j, one, one - 1, (), "") for j, one in enumerate(chi))
    return GapRecord(
        base.robot.name,
        "refit",
        verdict,
        tuple(named),
        (),
        (),
        "",
        names,
        ("N m",) * 2,
        joints,
        levels,
        np.zeros((0, 2)),
        "",
        "",
        "",
        (),
        {},
        (),
        "",
        **more,
    )


def spring(base, rivals):
    name = base.robot.joint_names[1]
    words = tuple(f"{effect} on {name}" for effect in rivals)
    keys = tuple((effect, (1,)) for effect in rivals)
    values = {"k1": 3.0, "c": 0.2, "order": 1.0, "constant": 1.0}
    return GapEffect(
        "spring",
        (1,),
        (name,),
        name,
        values,
        {},
        {},
        1e-9,
        name,
        0.3,
        0.1,
        "N m",
        rivals=words,
        rival_keys=keys,
    )


def test_the_question_is_every_pair_that_was_not_told_apart(base, tmp_path):
    record = record_of(base, [spring(base, ["counterbalance", "end_stop"])])
    write_record(tmp_path / "gap.npz", record)
    asked = question_of(read_record(tmp_path / "gap.npz"), base, np.ones(base.reduction.rank))
    assert [(one.effect.name, one.rival.name) for one in asked.rivalries] == [
        ("spring", "counterbalance"),
        ("spring", "end_stop"),
    ]
    assert asked.rivalries[0].shape == {"order": 1.0, "constant": 1.0}
    np.testing.assert_array_equal(asked.rivalries[0].amplitudes, [3.0, 0.2])
    assert asked.unexplained == ()


def test_what_is_unexplained_is_asked_by_its_joint(base):
    asked = question_of(record_of(base, verdict="unexplained"), base, np.ones(base.reduction.rank))
    assert (asked.rivalries, asked.unexplained) == ((), (1,))


def test_a_search_that_left_nothing_open_asks_for_nothing(base):
    with pytest.raises(WrongUsage, match="left no question"):
        question_of(
            record_of(base, [spring(base, [])], "named"), base, np.ones(base.reduction.rank)
        )


def test_a_search_of_another_arm_is_refused(base):
    other = replace(record_of(base), joint_names=("x", "y"))
    with pytest.raises(WrongUsage, match="joints differ"):
        question_of(other, base, np.ones(base.reduction.rank))


def test_the_planned_motion_promises_to_tell_them_apart(base):
    options = PlanOptions(alpha=1.0, duration=6.0, segments=4, restarts=1, floor=None)
    plan = plan_trajectory(
        base.robot, options, base=base, for_gap=record_of(base, [spring(base, ["counterbalance"])])
    )
    (text,) = plan.outlook
    assert "will be told apart" in text
    assert plan.facts()["outlook"] == [text]
    assert ("gap", text) in plan.lines()
