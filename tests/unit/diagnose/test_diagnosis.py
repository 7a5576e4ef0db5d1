"""A mistake in a robot file is named with the edit that takes it out; right files are left alone."""

from dataclasses import replace

import numpy as np
import pytest

from dynid import Motion, load_robot, simulate
from dynid.diagnose.diagnosis import diagnose, find_mistake
from dynid.diagnose.mistakes import Edit, as_robot_file_lines, edited, in_words, with_edits
from dynid.errors import WrongMapping
from dynid.files.logs import read_log
from dynid.signals.checks import prepare
from dynid.signals.columns import in_si, robot_columns, take_samples
from makelogs import lwr, lwr_log, shared_data
from motions import tones


def columns(log, robot):
    """The driver's columns in SI units, which a robot file with a mistake need not make sense of."""
    return in_si(robot_columns(log, robot), robot)


def looked_at(robot, log=None):
    return find_mistake(columns(log or lwr_log(), robot), robot)


def test_a_right_file_is_not_questioned():
    assert not looked_at(lwr()).wrong


@pytest.mark.slow
@pytest.mark.parametrize(
    "mistake",
    [
        Edit("convention"),
        Edit("sign", (1.0,)),
        Edit("offset", (1.0, 1.0)),
        Edit("order", (0.0, 3.0, 2.0, 1.0, 4.0, 5.0, 6.0)),
        Edit("gravity", (9.81, 0.0, 0.0)),
        Edit("torque", (3.0,)),
        Edit("unit"),
    ],
    ids=lambda edit: edit.kind,
)
def test_the_mistake_is_named_and_its_edit_repairs_the_file(mistake):
    wrong = edited(lwr(), mistake)
    found = looked_at(wrong)
    assert found is not None
    assert found.wrong
    assert mistake.kind in {edit.kind for each in (found.best, *found.tied) for edit in each.edits}
    assert not looked_at(with_edits(wrong, found.best.edits)).wrong


@pytest.mark.slow
def test_two_mistakes_are_named_together():
    wrong = with_edits(
        lwr(), [Edit("sign", (3.0,)), Edit("order", (1.0, 0.0, 2.0, 3.0, 4.0, 5.0, 6.0))]
    )
    found = looked_at(wrong)
    assert {edit.kind for edit in found.best.edits} == {"sign", "order"}
    assert not looked_at(with_edits(wrong, found.best.edits)).wrong


def test_steps_of_an_encoder_are_no_motion():
    """Two joints creep over steps of 0.5 mrad at 1 kHz, which look like 34 Hz; no joint moves at more than 0.2."""
    t, reach = np.arange(0.0, 30.0, 1e-3), np.array([0.06, 0.3, 0.3, 0.06, 0.3, 0.3, 0.3])
    motion = Motion(t, *tones(t, reach, np.linspace(0.35, 0.6, 7)))
    log = simulate(lwr(), motion, resolution=5e-4, seed=1).log
    found = looked_at(lwr(), log)
    assert not found.wrong
    # Differentiated, the steps leave 11 N m.
    assert found.as_written.friction_residual[1] < 1.0


def test_edits_that_make_the_same_torques_are_listed_as_such():
    """Joint 3 turned by 180 degrees reverses what joint 2 does to the links behind it, as a is 0 at both."""
    found = looked_at(edited(lwr(), Edit("sign", (1.0,))))
    named = {in_words(each.edits, lwr()) for each in (found.best, *found.tied)}
    assert named == {"lwr_1_joint reversed", "lwr_2_joint offset by +180 deg"}


def test_an_offset_about_the_direction_of_gravity_changes_nothing_and_is_not_named():
    for joint in (0, 6):
        found = looked_at(edited(lwr(), Edit("offset", (float(joint), 1.0))))
        assert not found.wrong


def test_reversed_torques_come_right_with_torque_sign():
    log, wrong = lwr_log(), edited(lwr(), Edit("torques"))
    assert wrong.driver.map.torque_sign == (-1.0,) * 7
    np.testing.assert_array_equal(
        prepare(replace(log, tau=-log.tau), wrong).tau, prepare(log, lwr()).tau
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mistake", "said"),
    [(Edit("sign", (1.0,)), "lwr_1_joint reversed"), (Edit("gravity", (9.81, 0.0, 0.0)), "")],
)
def test_it_stops_with_the_edit_and_goes_on_when_asked(mistake, said):
    """The second looks like torques without gravity."""
    wrong = edited(lwr(), mistake)
    log = prepare(lwr_log(), wrong)
    with pytest.raises(WrongMapping) as caught:
        diagnose(log, wrong)
    assert said in caught.value.what
    assert not said or as_robot_file_lines([mistake], wrong) in caught.value.fix
    assert [finding.code for finding in diagnose(log, wrong, anyway=True)] == ["W329"]
    assert diagnose(prepare(lwr_log(), lwr()), lwr()) == ()


def test_a_log_in_dh_quantities_accuses_no_map_of_the_driver():
    """Signs, offsets and order were applied before it was written; convention and gravity may still be wrong."""
    log = replace(prepare(lwr_log(), lwr()), checked=False, extra={})
    reversed_, other = (edited(lwr(), edit) for edit in (Edit("sign", (1.0,)), Edit("convention")))
    assert diagnose(prepare(log, reversed_), reversed_) == ()
    with pytest.raises(WrongMapping, match="the other DH convention"):
        diagnose(prepare(log, other), other)


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize(
    ("run", "first", "seconds"), [("run1", 5.0, 6.0), ("run2", 5.0, 12.0), ("run3", 7.0, 3.0)]
)
def test_a_short_piece_of_a_real_recording_does_not_accuse_the_right_file(run, first, seconds):
    """What passes sideways through the wrist's sensors looks like another wrist, by 0.2 N m."""
    log = read_log(shared_data(f"kuka_lwr4plus/{run}.bag"), robot=lwr())
    some = np.flatnonzero((log.t > first) & (log.t < first + seconds))
    assert not looked_at(lwr(), take_samples(log, some)).wrong


@pytest.mark.slow
@pytest.mark.data
def test_edits_that_a_log_cannot_tell_apart_are_named_together():
    """A reversed position of an upright first joint makes nearly the same torques as its reversed torque."""
    robot = load_robot("ur10")
    log = read_log(shared_data("ur10_salerno/exc.npz"), robot=robot)
    found = looked_at(edited(robot, Edit("position", (0.0,))), log)
    kinds = {each.edits[0].kind for each in (found.best, *found.tied) if len(each.edits) == 1}
    assert {"position", "torque"} <= kinds
