"""Columns with wrong numbers in them are named, and the fix that is printed mends them."""

import re
from dataclasses import replace

import numpy as np
import pytest

from dynid import load_robot
from dynid.errors import NotFinite, PositionInDegrees, WrongMessageType
from dynid.files.logs import read_log
from dynid.signals.checks import prepare
from makelogs import ROOT, gen2, gen2_log, lwr, lwr_log, shared_data


def codes(log):
    return [f.code for f in log.findings]


def with_units(robot, fix):
    """Apply the printed ``units: {...}`` to the robot, as a person would in its file."""
    inner = re.search(r"units: \{([^}]*)\}", fix).group(1)
    units = dict(pair.split(": ") for pair in inner.split(", "))
    return replace(robot, driver=replace(robot.driver, units={**robot.driver.units, **units}))


def spoilt(log, name, where, value):
    """Return a log in which some entries of a column have another value."""
    values = getattr(log, name).copy()
    values[where] = value
    return replace(log, **{name: values})


@pytest.mark.parametrize(
    ("value", "kind"), [(np.inf, "infinite"), (3e150, r"3e\+150, not measurable,")]
)
def test_a_position_that_is_infinite_or_that_a_flipped_bit_made_huge_is_named(value, kind):
    with pytest.raises(NotFinite, match=f"lwr_0_joint position is {kind} in 1 samples"):
        prepare(spoilt(lwr_log(), "q", (10, 0), value), lwr())


def test_a_finger_that_is_no_number_does_not_matter():
    log = spoilt(gen2_log(), "tau", (slice(None), -1), np.nan)
    assert len(prepare(log, gen2())) == len(log)


def test_degrees_of_joints_without_position_limits_are_seen_at_the_speed():
    joints = tuple(
        replace(joint, limits=replace(joint.limits, position=None)) for joint in gen2().joints
    )
    robot = replace(gen2(), joints=joints)
    broken = replace(gen2_log(), q=np.degrees(gen2_log().q), qd=np.degrees(gen2_log().qd))
    with pytest.raises(PositionInDegrees, match=r"degrees\? the speed limit is") as caught:
        prepare(broken, robot)
    assert "units: {position: deg, velocity: deg/s}" in caught.value.fix
    prepare(broken, with_units(robot, caught.value.fix))


def test_a_continuous_joint_that_has_turned_many_times_is_not_in_degrees():
    log = prepare(replace(gen2_log(), q=gen2_log().q + np.eye(13)[6] * 20 * np.pi), gen2())
    assert log.q[:, 6].min() > 50


def test_a_jump_by_a_full_turn_is_taken_out():
    turned = lwr_log().q[2000:, 6] - 2 * np.pi
    log = prepare(spoilt(lwr_log(), "q", (slice(2000, None), 6), turned), lwr())
    np.testing.assert_allclose(log.q, prepare(lwr_log(), lwr()).q, atol=1e-9)
    (finding,) = log.findings
    assert finding.code == "W315"
    assert re.match(r"lwr_6_joint jumps by -6\.2\d rad at 10\.00 s; unwrapped", finding.text)


def test_one_spike_in_the_torque_is_not_another_unit():
    prepare(spoilt(lwr_log(), "tau", (1234, 0), 5000.0), lwr())


def test_efforts_that_are_all_zero_are_no_torques():
    with pytest.raises(WrongMessageType, match="effort is 0"):
        prepare(replace(lwr_log(), tau=0 * lwr_log().tau), lwr())


def test_flat_tops_are_found_where_they_are_and_nowhere_else():
    level = np.quantile(lwr_log().tau[:, 1], 0.97)
    over = lwr_log().tau[:, 1] >= level
    log = prepare(spoilt(lwr_log(), "tau", (over, 1), level), lwr())
    (finding,) = log.findings
    assert finding.code == "W319"
    text = rf"lwr_1_joint torque sits at {level:.4g} Nm for .* s: clipped samples are left out"
    assert re.match(text, finding.text)
    clipped = log.extra["clipped"]
    assert clipped.shape == log.tau.shape
    assert not clipped[:, [0, 2, 3, 4, 5, 6]].any()
    assert not clipped[~over, 1].any()
    assert clipped[over, 1].mean() > 0.9


def test_a_coarsely_quantised_torque_is_not_clipped():
    tau = lwr_log().tau
    for step in (0.05, 0.2, 1.0):
        log = prepare(replace(lwr_log(), tau=np.round(tau / step) * step), lwr())
        assert "W319" not in codes(log)


def test_a_torque_that_stays_while_its_joint_moves_to_and_fro_is_none():
    level, stuck = lwr_log().tau[500, 3], slice(500, None)
    found = prepare(spoilt(lwr_log(), "tau", (stuck, 3), level), lwr())
    (finding,) = found.findings
    assert finding.code == "W319"
    text = rf"lwr_3_joint torque stays at {level:.4g} Nm for .* to and fro: these samples"
    assert re.match(text, finding.text)
    assert found.extra["clipped"][stuck, 3].all()
    assert not found.extra["clipped"][:500].any()


def test_a_torque_that_stays_while_its_joint_stands_is_one():
    log = lwr_log()
    q, tau = log.q.copy(), log.tau.copy()
    q[500:, 0], tau[500:, 0] = q[500, 0], 0.2
    assert "W319" not in codes(prepare(replace(log, q=q, tau=tau), lwr()))


def test_repeated_samples_in_motion_are_reported_with_the_true_rate():
    hold = np.arange(len(lwr_log())) // 2 * 2
    log = prepare(replace(lwr_log(), q=lwr_log().q[hold]), lwr())
    (finding,) = log.findings
    assert finding.code == "W325"
    assert "100 Hz" in finding.text


@pytest.mark.data
@pytest.mark.parametrize(
    ("robot", "recording"),
    [
        ("kuka_lwr4plus", "kuka_lwr4plus/run1.bag"),
        ("kuka_lwr4plus", "kuka_lwr4plus/run2.bag"),
        ("ur10", "ur10_salerno/exc.npz"),
        ("franka_panda", "panda_salerno/exc.npz"),
        ("staubli_tx40", "tx40/exc.npz"),
    ],
)
def test_good_recordings_of_real_arms_pass_without_a_false_warning(robot, recording):
    arm = load_robot(ROOT / "robots" / f"{robot}.yaml")
    log = prepare(read_log(shared_data(recording), robot=arm), arm)
    assert set(codes(log)) <= {"W320"}
