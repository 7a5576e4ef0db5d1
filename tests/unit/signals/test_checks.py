"""What is wrong with times, numbers and velocities of a log is named with a fix that mends it; good logs pass."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import twolink
from dynid import Log, Robot, load_robot
from dynid.errors import (
    LogTooShort,
    NotFinite,
    PositionInDegrees,
    RateTooLow,
    TimeNotIncreasing,
    WrongMessageType,
)
from dynid.files.logs import read_log
from dynid.robot import Joint, Limits
from dynid.signals.checks import check_ranges, prepare
from dynid.signals.columns import take_samples
from dynid.signals.stamps import with_even_clock, without_copies, without_stale
from makelogs import ROOT, gen2, gen2_log, lwr, lwr_log, shared_data


def generic():
    """The Gen2 behind a driver whose velocity is to be believed."""
    return replace(gen2(), driver=replace(gen2().driver, kind="generic"))


def boundless(robot):
    limits = [replace(joint.limits, position=None) for joint in robot.joints]
    joints = zip(robot.joints, limits, strict=True)
    return replace(robot, joints=tuple(replace(j, limits=each) for j, each in joints))


def of(name, change):
    """Return a function that changes one column of a log."""
    return lambda log: replace(log, **{name: change(getattr(log, name).copy())})


def put(where, value):
    def change(values):
        values[where] = value
        return values

    return change


def samples(index):
    return lambda log: take_samples(log, np.arange(len(log))[index])


def columns(order):
    return lambda values: values[:, np.r_[order, len(order) : 13]]


def noise(size):
    return lambda values: values + size * np.random.default_rng(0).normal(size=values.shape)


def checked(robot, change=None, **options):
    """Return a shipped log after a change and the checks, of the Gen2 or of the LWR4+."""
    log = lwr_log() if robot.n == 7 and robot.name == lwr().name else gen2_log()
    return prepare(change(log) if change else log, robot, **options)


def codes(log):
    return [finding.code for finding in log.findings]


# ---------------------------------------------------------------- refused
SHUFFLED = np.arange(4000).reshape(-1, 4)[:, [1, 0, 3, 2]].ravel()
HUGE = r"lwr_0_joint position is 3e\+150, not measurable, in 1 samples"


@pytest.mark.parametrize(
    ("robot", "change", "error", "said", "fix"),
    [
        (lwr, samples(SHUFFLED), TimeNotIncreasing, "shuffled", "--sort-time"),
        (lwr, of("t", lambda t: np.round(t, 2)), TimeNotIncreasing, "too coarse", ""),
        (lwr, of("t", put(321, np.nan)), NotFinite, "row 322", ""),
        (
            lwr,
            of("q", put((10, 0), np.inf)),
            NotFinite,
            "lwr_0_joint position is infinite in 1",
            "",
        ),
        (lwr, of("q", put((10, 0), 3e150)), NotFinite, HUGE, ""),
        (lwr, samples(slice(5)), LogTooShort, "5 samples", ""),
        (lwr, of("tau", np.zeros_like), WrongMessageType, "effort is 0", ""),
        (
            gen2,
            samples(slice(None, None, 10)),
            RateTooLow,
            r"joint states arrive at 10\.0 Hz; the fastest motion, .* needs >= 50 Hz",
            "feedback_publish_rate:=0.01",
        ),
    ],
)
def test_what_no_parameters_can_be_found_from_is_refused(robot, change, error, said, fix):
    with pytest.raises(error, match=f"(?s){said}") as caught:
        checked(robot(), change)
    assert fix in caught.value.fix


def test_shuffled_stamps_are_put_in_order_when_asked_to():
    found = checked(lwr(), samples(SHUFFLED), sort_time=True)
    np.testing.assert_array_equal(found.q, checked(lwr()).q)


def test_degrees_of_joints_without_position_limits_are_seen_at_the_speed():
    """The printed units, put into the robot file, mend it."""
    robot = boundless(gen2())
    broken = replace(gen2_log(), q=np.degrees(gen2_log().q), qd=np.degrees(gen2_log().qd))
    with pytest.raises(PositionInDegrees, match=r"degrees\? the speed limit is") as caught:
        prepare(broken, robot)
    inner = re.search(r"units: \{(position: deg, velocity: deg/s)\}", caught.value.fix)[1]
    units = robot.driver.units | dict(pair.split(": ") for pair in inner.split(", "))
    prepare(broken, replace(robot, driver=replace(robot.driver, units=units)))


# ---------------------------------------------------------------- said
TWICE = np.sort(np.r_[0:4000, 100, 200, 300])


def turned(q):
    q[2000:, 6] -= 2 * np.pi
    return q


@pytest.mark.parametrize(
    ("robot", "change", "code", "text"),
    [
        (lwr, samples(TWICE), "W311", ""),
        (lwr, of("q", turned), "W315", r"lwr_6_joint jumps by -6\.2\d rad at 10\.00 s; unwrapped"),
        (generic, of("qd", lambda qd: 0.65 * qd), "W308", ".*0.65 x the change of position"),
    ],
)
def test_what_is_odd_is_said(robot, change, code, text):
    found = checked(robot(), change).findings
    assert [finding.code for finding in found] == [code] * (7 if code == "W308" else 1)
    assert re.match(text, found[0].text)
    if robot is lwr:
        np.testing.assert_allclose(checked(lwr(), change).q, checked(lwr()).q, atol=1e-9)


def test_flat_tops_are_found_where_they_are_and_nowhere_else():
    tau = lwr_log().tau[:, 1]
    level = np.quantile(tau, 0.97)
    over = tau >= level
    log = checked(lwr(), of("tau", put((over, 1), level)))
    assert codes(log) == ["W319"]
    text = f"lwr_1_joint torque sits at {level:.4g} Nm for .* s: clipped samples are left out"
    assert re.match(text, log.findings[0].text)
    clipped = log.extra["clipped"]
    assert clipped.shape == log.tau.shape
    assert not clipped[:, [0, 2, 3, 4, 5, 6]].any()
    assert not clipped[~over, 1].any()
    assert clipped[over, 1].mean() > 0.9


def test_kinovas_velocity_is_put_aside_with_its_ratio():
    log = checked(gen2(), of("qd", lambda qd: 2 * qd))
    (finding,) = log.findings
    assert (finding.code, finding.level) == ("W308", "info")
    np.testing.assert_allclose(finding.evidence["slope"], 2.0, rtol=0.02)
    assert log.qd is None
    np.testing.assert_array_equal(log.extra["qd_reported"], 2 * gen2_log().qd[:, :7])


# ---------------------------------------------------------------- no fault
def late(t):
    return t + np.minimum(np.random.default_rng(0).exponential(0.0015, len(t)), 0.004)


def resting(log):
    """Return a log whose first joint stands from 2.5 s on, with a torque that stays."""
    q, tau = log.q.copy(), log.tau.copy()
    q[500:, 0], tau[500:, 0] = q[500, 0], 0.2
    return replace(log, q=q, tau=tau)


def still(log):
    return replace(log, q=0 * log.q + log.q[0], qd=noise(0.01)(0 * log.qd))


def alike(log):
    """Return a log of joints that all swing in one way, two of their velocities exchanged."""
    size, w = np.linspace(0.4, 0.8, 13), 0.6
    q, qd = (np.outer(f(w * log.t), k * size) for f, k in ((np.sin, 1), (np.cos, w)))
    return replace(log, q=q + np.pi, qd=columns([1, 0])(noise(0.01)(qd)))


def rounded(step):
    return of("tau", lambda tau: np.round(tau / step) * step)


def weightless():
    return replace(generic(), torque=replace(generic().torque, source="gravity_free"))


@pytest.mark.parametrize(
    ("robot", "change", "said"),
    [
        (lwr, of("t", late), ["W323"]),
        (lwr, of("tau", put((1234, 0), 5000.0)), []),
        *((lwr, rounded(step), []) for step in (0.05, 0.2, 1.0)),
        (lwr, resting, []),
        (gen2, of("tau", put((slice(None), -1), np.nan)), ["W308"]),
        (generic, of("qd", noise(0.05)), []),
        (weightless, alike, []),
    ],
)
def test_what_is_no_fault_passes(robot, change, said):
    """Late stamps, a spike, coarse torques, one that stays at rest, a finger, noise, joints that all move alike."""
    log = checked(robot(), change)
    assert codes(log) == said
    assert len(log) == len(lwr_log() if robot is lwr else gen2_log())


def test_what_is_left_out_and_what_does_not_move_is_not_judged():
    assert checked(lwr(), exclude=[(5.0, 9.0)]).findings == ()
    assert checked(generic(), still, identify=False).findings == ()


def test_a_continuous_joint_that_has_turned_many_times_is_not_in_degrees():
    assert checked(gen2(), of("q", lambda q: q + np.eye(13)[6] * 20 * np.pi)).q[:, 6].min() > 50


@pytest.mark.parametrize(
    ("robot", "change"),
    [
        (gen2, of("qd", put((5, 3), np.nan))),
        (generic, of("qd", np.zeros_like)),
        (generic, lambda log: replace(log, qd=None)),
    ],
)
def test_a_velocity_that_was_never_measured_or_is_not_used_may_have_holes(robot, change):
    assert checked(robot(), change).qd is None


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


# ---------------------------------------------------------------- stamps
def known(t):
    """Return a log of a motion that is known at every time."""
    q = np.stack([np.sin(0.9 * t) + 0.2 * np.sin(4 * t), 0.8 * np.cos(0.7 * t)], axis=1)
    return Log(t, q, np.zeros_like(q), ("a", "b"))


def test_stamps_that_come_late_are_put_on_an_even_clock():
    rng, t = np.random.default_rng(3), np.arange(4000) / 200.0
    stamps = np.maximum.accumulate(t + rng.exponential(5e-4, len(t))) + 1e-9 * np.arange(4000)
    found = with_even_clock(replace(known(t), t=stamps))
    assert np.std(found.t - t) < 2e-5  # the mean lateness cannot be known
    assert codes(found) == ["W323"]


def test_lost_samples_keep_their_places_on_the_even_clock():
    rng, t = np.random.default_rng(4), np.arange(4000) / 200.0
    kept = rng.random(4000) > 0.02
    stamped = replace(known(t), t=t + rng.uniform(0, 1e-3, 4000))
    assert np.std(with_even_clock(take_samples(stamped, kept)).t - t[kept]) < 3e-5


def test_samples_taken_unevenly_and_coarse_encoders_that_cannot_tell_keep_their_stamps():
    uneven = known(
        np.arange(4000) / 200.0 + np.random.default_rng(5).uniform(-0.0015, 0.0015, 4000)
    )
    t = np.arange(2000) / 100.0
    coarse = of("q", lambda q: np.round(q / 0.01) * 0.01)(known(t))
    coarse = replace(coarse, t=t + np.random.default_rng(6).exponential(1e-4, len(t)))
    for log in (uneven, coarse):
        assert with_even_clock(log) is log


# ---------------------------------------------------------------- limits
def moved(low, high, limits=(-1.0, 2.0)):
    """Return the findings for a joint that moves from one angle to another."""
    arm = Robot("one", "standard", (Joint("a", limits=Limits(limits)),))
    q = np.linspace(low, high, 50)[:, None]
    return tuple(check_ranges(Log(np.arange(50) * 0.01, q, 0 * q, dh=True), arm))


def test_only_what_is_beyond_the_limits_is_named():
    for turn in (0.0, 2 * np.pi, -4 * np.pi):
        assert moved(-1.05 + turn, 2.0 + turn) == ()
    assert moved(-20.0, 20.0, None) == ()
    (finding,) = moved(np.pi / 2 + 0.2, np.pi / 2 + 1.5)
    assert finding.code == "W332"
    assert finding.evidence["beyond"] == pytest.approx(np.pi / 2 + 1.5 - 2.0)


# ---------------------------------------------------------------- samples that were not measured again
@pytest.mark.parametrize("every", [2, 4, 5])
def test_samples_held_by_the_driver_are_left_out(every):
    log = twolink.log(1)
    index = np.arange(len(log)) // every * every
    kept = without_stale(replace(take_samples(log, index), t=log.t), twolink.robot())
    assert_array_equal(kept.t, log.t[::every])
    assert_array_equal(kept.q, log.q[::every])
    assert [finding.code for finding in kept.findings] == ["W325"]
    assert kept.findings[0].evidence["rate_hz"] == pytest.approx(log.rate / every, rel=0.02)


def test_positions_held_beside_fresh_torques_are_left_out():
    log = twolink.log(1)
    kept = without_stale(replace(log, q=log.q[np.arange(len(log)) // 4 * 4]), twolink.robot())
    assert_array_equal(kept.t, log.t[::4])


def test_encoders_so_coarse_that_positions_repeat_are_no_held_samples():
    log = twolink.log(1)
    coarse = replace(log, q=np.round(log.q / 0.01) * 0.01)
    assert np.mean(np.all(np.diff(coarse.q, axis=0) == 0, axis=1)) > 0.05
    assert without_stale(coarse, twolink.robot()) is coarse


def test_an_arm_at_rest_repeats_nothing_and_a_clean_log_is_the_same_object():
    log = twolink.log(1)
    still = replace(take_samples(log, np.zeros(len(log), dtype=int)), t=log.t)
    assert without_stale(still, twolink.robot()) is still
    assert without_stale(log, twolink.robot()) is log
    assert without_copies([log]) == ([log], ())


def test_a_log_given_again_is_left_out_whatever_its_clock_says():
    log = twolink.log(1)
    other = replace(log, q=noise(0.01)(log.q))
    kept, findings = without_copies([log, other, replace(log, t=log.t + 100.0)])
    assert kept == [log, other]
    assert [(finding.code, finding.evidence["log"]) for finding in findings] == [("W326", 3)]
