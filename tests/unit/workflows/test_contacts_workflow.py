"""Contacts on logs: found where something pushed, by the law of momentum, and quiet where nothing did."""

from dataclasses import replace

import numpy as np
import pytest

import dynid
from dynid.errors import WrongUsage
from dynid.estimation import tuning
from dynid.estimation.contacts import inertial_columns, multiple
from dynid.estimation.momentum_observer import MomentumObserver
from dynid.sim.arm import track
from dynid.sim.plant import plant_of
from dynid.sim.sines import SineSpec, sines


@pytest.fixture(scope="module")
def arm():
    return dynid.load_robot("kuka_lwr4plus")


@pytest.fixture(scope="module")
def recorded(arm):
    """Three logs of the simulated arm, on motions that differ."""
    plant, rng = plant_of(arm), np.random.default_rng(1)
    spec, logs = SineSpec(12.0, 12.0, 0.5, 0.6, 0.4, 0.05), []
    for _ in range(3):
        with plant.arm(arm, 1.25e-3) as simulated:
            done = track(simulated, sines(arm, spec, 1.25e-3, rng), 4)
        logs.append(replace(plant.sensors.measure(done, arm.joint_names, rng), dh=True))
    return logs


@pytest.fixture(scope="module")
def found(arm, recorded):
    return dynid.identify(arm, recorded[:2])


def pushed(log, joint, size, start=7.0):
    tau = log.tau.copy()
    tau[(log.t >= start) & (log.t < start + 0.5), joint] -= size
    return replace(log, tau=tau)


def test_a_clean_log_has_no_contact(found, recorded):
    answer = dynid.contacts(found, recorded[2])
    assert answer.external.contacts == ()
    assert "No contact" in repr(answer)
    assert answer.facts()["contacts"] == []


def test_a_push_is_found_on_its_joint_at_its_time_with_its_size(found, recorded):
    """A torque that helps the drive is a positive one from outside."""
    log = pushed(recorded[2], 3, 6.0)
    answer = dynid.contacts(found, log, false_alarms="1/h")
    (contact,) = [
        each for each in answer.external.contacts if each.joint == found.robot.joint_names[3]
    ]
    assert 6.8 < contact.start < 7.4
    assert contact.end < 8.0
    assert contact.peak == pytest.approx(6.0, rel=0.2)
    assert {each.joint for each in answer.external.contacts} == {contact.joint}
    assert set(answer.facts()["contacts"][0]) == {"start_s", "end_s", "joint", "peak_nm"}
    assert len(answer.plot().axes) == 7


def test_a_sample_that_was_sent_twice_is_no_blow(found, recorded):
    """The observer sees a momentum that comes and goes; its neighbours say that the arm was not there."""
    log = recorded[2]
    fastest = int(np.argmax(np.abs(np.gradient(log.q[:, 3], log.t))))
    q = log.q.copy()
    q[fastest : fastest + 6] = q[fastest]
    assert dynid.contacts(found, replace(log, q=q)).external.contacts == ()


def test_the_ends_of_a_recording_are_not_judged(found, recorded):
    """A recorder's own filter bends the last samples."""
    log = recorded[2]
    q = log.q.copy()
    q[-20:] += 2e-5 * np.arange(20)[:, None] ** 2
    assert dynid.contacts(found, replace(log, q=q)).external.contacts == ()


def test_an_arm_that_has_changed_is_not_told_as_many_touches(found, recorded):
    """A constant torque of 8 N m on joint 2, such as that of a load."""
    log = replace(recorded[2], tau=recorded[2].tau - np.array([0, 8.0, 0, 0, 0, 0, 0]))
    answer = dynid.contacts(found, log)
    assert answer.external.changed
    assert "has changed since" in repr(answer)
    assert not dynid.contacts(found, pushed(recorded[2], 3, 6.0)).external.changed


def test_fewer_false_alarms_ask_for_larger_pushes(found, recorded):
    thresholds = [
        dynid.contacts(found, recorded[2], false_alarms=rate).external.threshold
        for rate in ("1/day", 1, 10)
    ]
    assert (thresholds[0] > thresholds[1]).all()
    assert (thresholds[1] > thresholds[2]).all()


def test_the_multiple_keeps_the_promised_rate_of_students_noise():
    """Rice: a level is crossed upwards f exp(-u^2 / 2 s^2) times a second, with the scales s of Student's noise."""
    rng = np.random.default_rng(0)
    tail, n = tuning.CONTACT_TAIL, 6
    scale = np.sqrt(tail / rng.chisquare(tail, 2_000_000))
    u = multiple(100.0, n, 0.0)
    band = tuning.OBSERVER_GAIN / (2 * np.pi)
    rate = 3600 * 2 * n * band * np.mean(np.exp(-0.5 * (u / scale) ** 2))
    assert rate == pytest.approx(100.0, rel=0.1)


def test_a_joint_that_sticks_may_carry_its_friction(found, recorded):
    """Where the arm rests the threshold is at least the Coulomb friction."""
    external = dynid.contacts(found, recorded[2]).external
    rest = external.t < external.t[0] + 0.3
    coulomb = np.array([found.params[f"fc{j + 1}"] for j in range(7)])
    assert (external.threshold[rest].min(axis=0) > coulomb).all()


def test_the_observer_follows_a_constant_push_as_a_low_pass_of_first_order(found):
    """On exact motion, torques of an independent engine less a push: r = push (1 - exp(-K t))."""
    base, theta = found.base, found.theta
    inertial = inertial_columns(found)
    dt, gain = 1e-3, 10.0
    t = np.arange(0, 1.0, dt)[:, None]
    size = np.linspace(0.2, 0.5, 7)
    q, qd, qdd = size * np.sin(2 * t), 2 * size * np.cos(2 * t), -4 * size * np.sin(2 * t)
    tau = base.observer.torque(np.where(inertial, theta, 0.0), q, qd, qdd) - np.array(
        [0, 3.0, 0, 0, -1.0, 0, 0]
    )
    r = MomentumObserver(base.observer, theta, inertial, gain).run(q, qd, tau, np.zeros_like(q), dt)
    expected = 1 - np.exp(-gain * t[:, 0])
    np.testing.assert_allclose(r[:, 1], 3.0 * expected, atol=0.03)
    np.testing.assert_allclose(r[:, 4], -1.0 * expected, atol=0.02)
    np.testing.assert_allclose(r[:, 0], 0.0, atol=0.02)


@pytest.mark.parametrize("rate", ["often", "1/year", 0, -1, "nan/h"])
def test_a_rate_that_is_none_is_refused(found, recorded, rate):
    with pytest.raises(WrongUsage, match="false"):
        dynid.contacts(found, recorded[2], false_alarms=rate)
