"""Filters against the laws they must obey: nothing delayed, polynomials kept, pieces equal the whole."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from dynid import Log, Robot, load_robot
from dynid.errors import LogTooShort, RateTooLow
from dynid.files.logs import read_log
from dynid.model import build_model
from dynid.model.regressor import prior_vector
from dynid.robot import Coulomb, Joint
from dynid.signals import tuning
from dynid.signals.checks import prepare
from dynid.signals.conditioned_log import (
    condition,
    condition_log,
    condition_logs,
    known_torque,
    signs_of_shapes,
    stretches,
)
from dynid.signals.filters import (
    check_position_noise,
    check_rate,
    choose_cutoff,
    choose_filter,
    choose_sign_cutoffs,
    despiked,
    lowpass_kernel,
    position_noise,
    white_noise,
)
from dynid.signals.stamps import without_intervals
from makelogs import shared_data
from motions import tones
from twolink import robot

ARM = Robot("two", "standard", (Joint("first"), Joint("second")))


def test_a_kernel_passes_slow_and_stops_fast_signals():
    kernel = lowpass_kernel(5.0, 200.0)
    k = np.arange(len(kernel)) - len(kernel) // 2

    def gain(f):
        return abs(np.sum(kernel * np.cos(2 * np.pi * f * k / 200.0)))

    assert gain(0.0) == pytest.approx(1.0)
    assert gain(1.5) == pytest.approx(1.0, abs=3e-3)
    assert gain(5.0) == pytest.approx(0.5, abs=0.02)
    assert max(gain(f) for f in np.linspace(8.5, 100, 50)) < 3e-3


def sine_log(rate=200.0, seconds=20.0, f=0.5, noise=1e-5, jitter=0.0, n=2):
    rng = np.random.default_rng(4)
    t = np.arange(int(rate * seconds)) / rate
    t = t + jitter / rate * rng.uniform(-0.5, 0.5, len(t))
    q = np.column_stack([np.sin(2 * np.pi * f * (j + 1) * t) for j in range(n)])
    return Log(t, q + noise * rng.normal(size=q.shape), np.cos(t)[:, None] * np.ones(n))


def test_the_cutoff_follows_the_motion_unless_given():
    assert choose_cutoff([sine_log(f=2.0)], ARM) == pytest.approx(20.0, abs=1.0)
    assert choose_cutoff([sine_log(f=0.1)], ARM) == 5.0
    assert choose_filter(sine_log(), 7.0).cutoff == 7.0


@pytest.mark.parametrize(("jitter", "within"), [(0.0, 1e-5), (0.4, 2e-4)])
def test_conditioning_finds_speed_and_acceleration_also_on_uneven_stamps(jitter, within):
    log = sine_log(jitter=jitter, noise=0.0)
    (segment,) = condition(log, choose_filter(log, 20.0))
    w, t = 2 * np.pi * 0.5 * np.arange(1, 3), segment.t[:, None]
    assert segment.q == pytest.approx(np.sin(w * t), abs=within)
    assert segment.qd == pytest.approx(w * np.cos(w * t), abs=within * w.max())
    assert segment.qdd == pytest.approx(-(w**2) * np.sin(w * t), abs=within * w.max() ** 2)


def test_what_is_excluded_in_the_logs_own_clock_is_cut_out_not_bridged_and_leaves_no_trace():
    log = sine_log()
    q, t = log.q.copy(), log.t + 7.0
    q[(t > 15) & (t < 16)] = 50.0
    clean = without_intervals(Log(t, q, log.tau), [(14.99, 16.01)])
    before, after = condition(clean, choose_filter(log, 5.0))
    assert before.t[-1] < 15
    assert 16 < after.t[0] < 16.6
    assert max(np.abs(part.q).max() for part in (before, after)) < 1.01


def log_with(tau, rate=200.0):
    t = np.arange(len(tau)) / rate
    return Log(t=t, q=np.zeros_like(tau), tau=tau, names=("a", "b"), units={}, dh=True)


def torques(noise=0.1, samples=4000, seed=0):
    t = np.arange(samples)[:, None] / 200.0
    phase = 2 * np.pi * np.array([0.4, 0.7]) * t
    clean = 10 * np.sin(phase) + 2 * np.sign(np.cos(phase))
    return clean, clean + noise * np.random.default_rng(seed).standard_normal(clean.shape)


def test_one_percent_of_spikes_is_found_and_replaced_by_values_like_those_around():
    clean, tau = torques()
    rng = np.random.default_rng(1)
    hit = rng.random(tau.shape) < 0.01
    spoilt = tau + hit * 5 * rng.choice([-1, 1], tau.shape)
    cured, findings = despiked(log_with(spoilt), 5.0)
    # Why not all: three of five may be hit, and a sample between two spikes is taken for a third.
    assert np.mean(np.abs(cured.tau - clean)[hit] < 1.0) > 0.97
    assert np.mean((cured.tau != spoilt)[~hit]) < 1e-3
    assert findings[0].evidence["samples"] == pytest.approx(hit.sum(axis=0), rel=0.03)


@pytest.mark.parametrize("noise", [0.0, 1e-3, 0.1, 1.0])
def test_torques_without_spikes_come_back_as_they_are(noise):
    log = log_with(torques(noise)[1])
    assert despiked(log, 5.0) == (log, ())


@pytest.mark.parametrize(("hit", "rate"), [(slice(100, 101), 50.0), (slice(None, None, 20), 200.0)])
def test_what_may_be_motion_and_spikes_too_many_for_accidents_stay(hit, rate):
    tau = torques()[1]
    tau[hit] += 50 if rate == 50.0 else 5
    log = log_with(tau, rate)
    assert despiked(log, 5.0) == (log, ())


# ---------------------------------------------------------------- the cut-off that noisy positions allow
RATE, SECONDS = 200.0, 60.0
T = np.arange(round(RATE * SECONDS)) / RATE


def slow_log(noise, seed=0):
    q = np.column_stack(
        [0.8 * np.sin(1.3 * T) + 0.2 * np.sin(2.9 * T), 0.6 * np.sin(1.7 * T + 0.4)]
    )
    q = q + noise * np.random.default_rng(seed).standard_normal(q.shape)
    return Log(T, q, 5 * np.cos(q), ("joint_1", "joint_2"))


def acceleration_below(q, cutoff):
    """Return accelerations below a cut-off, the ends left out, (N, n) [rad/s^2]."""
    smooth = sosfiltfilt(butter(8, cutoff, fs=RATE, output="sos"), q, axis=0)
    return np.gradient(np.gradient(smooth, 1 / RATE, axis=0), 1 / RATE, axis=0)[400:-400]


@pytest.mark.parametrize("noise", [5e-4, 2e-3])
def test_share_of_noise_at_the_chosen_cutoff_is_what_a_filter_leaves_of_it(noise):
    found = position_noise(slow_log(noise), robot())
    assert found.level == pytest.approx([noise] * 2, rel=0.05)
    j = found.joint
    clean, noisy = (
        acceleration_below(slow_log(size).q, found.cutoff)[:, j] for size in (0.0, noise)
    )
    share = np.std(noisy - clean) / np.std(noisy)
    assert found.share == pytest.approx(share, rel=0.15)
    assert tuning.NOISE_SHARE / 2 < share < 1.15 * tuning.NOISE_SHARE


@pytest.mark.parametrize(
    ("noise", "said"), [(1e-5, False), (1e-4, False), (2e-3, True), (8e-3, True)]
)
def test_noisy_positions_lower_the_cutoff_and_are_said(noise, said):
    log = slow_log(noise)
    found = {each.code: each.text for each in check_position_noise(log, robot())}
    assert list(found) == ["W327"] * said
    assert (choose_cutoff([log], robot()) < tuning.LOWEST_CUTOFF_HZ) == said
    # Why: of LWR logs with 2e-3 rad, 68 % of the true parameters lie in the intervals of least squares.
    assert not said or "those of least squares may be too narrow" in found["W327"]


def swing_of_twelve_bit(frequency, reach):
    t, step = np.arange(0, SECONDS, 0.02), 0.0015
    q = np.outer(reach * np.sin(2 * np.pi * frequency * t), [1.0, 0.0])
    return Log(t, step * np.round(q / step), 5 * np.cos(q), ("joint_1", "joint_2"))


@pytest.mark.parametrize(
    ("frequency", "reach", "codes"),
    [(0.11, 0.02, ["W327"]), (1.47, 0.2, [])],
)
def test_steps_of_a_coarse_encoder_are_noise_and_no_fast_motion(frequency, reach, codes):
    log = swing_of_twelve_bit(frequency, reach)
    check_rate(log, robot())
    assert [each.code for each in check_position_noise(log, robot())] == codes


def test_a_joint_that_creeps_on_a_coarse_encoder_is_as_noisy_as_its_steps():
    q = np.round(np.arange(400.0)[:, None] / 9)
    assert white_noise(q) == pytest.approx(12**-0.5)


def test_fast_motion_that_a_coarse_encoder_shows_needs_its_samples():
    with pytest.raises(RateTooLow, match=r"the fastest motion, 4\.5 Hz, needs >= 5\d Hz"):
        check_rate(swing_of_twelve_bit(4.5, 0.2), robot())


@pytest.mark.data
@pytest.mark.parametrize("name", ["large_amplitude", "reaching_points", "multisine"])
def test_hops_of_a_hobby_arm_are_filtered_below_the_noise_of_its_encoder(name):
    arm = load_robot(shared_data("so101/so101.yaml"))
    log = prepare(read_log(shared_data(f"so101/{name}.csv"), robot=arm), arm)
    assert "W327" in [each.code for each in log.findings]
    assert choose_cutoff([log], arm) < 6.0


def test_noise_that_no_cutoff_takes_away_is_called_so():
    (finding,) = check_position_noise(slow_log(0.2), robot())
    assert "intervals are too narrow" in finding.text


def test_of_several_logs_the_noisiest_says_how_high_the_cutoff_may_be():
    noisy = choose_cutoff([slow_log(2e-3)], robot())
    assert choose_cutoff([slow_log(1e-5), slow_log(2e-3)], robot()) == noisy


# ---------------------------------------------------------------- which way joints move
SHARP_RATE = 1000.0
SIGN = Coulomb("smooth", (0.01,))
SHARP_T = np.arange(0, 20, 1 / SHARP_RATE)


def braking(t, before=4.0, after=1.0):
    """Velocity that falls faster than it rises after each zero, as friction makes it; with its integral."""
    phase = t % 2.0 - 1.0
    speed = np.where(phase < 0, -before * phase, -after * phase) * np.where(t % 4 < 2, 1, -1)
    return np.cumsum(speed) / SHARP_RATE, speed


@pytest.mark.parametrize("noise", [1e-6, 1e-5, 1e-4, 1e-3])
def test_the_velocity_is_as_sharp_as_its_noise_allows(noise):
    rng = np.random.default_rng(0)
    q = np.sin(2 * np.pi * SHARP_T)[:, None] + noise * rng.standard_normal((len(SHARP_T), 1))
    (chosen,) = choose_sign_cutoffs(q, SIGN, SHARP_RATE, 5.0, measured=False)
    spectrum = np.fft.rfft(lowpass_kernel(chosen, SHARP_RATE), 1 << 14)
    slope = 2 * np.pi * np.fft.rfftfreq(1 << 14, 1 / SHARP_RATE) * np.abs(spectrum)
    spread = noise * np.sqrt(np.mean(slope**2))
    assert spread < 1.2 * tuning.NOISE_OVER_COULOMB * 0.01 or chosen == 5.0
    assert chosen > 70 or 2**1.5 * spread > tuning.NOISE_OVER_COULOMB * 0.01


def test_a_filtered_sign_turns_when_the_joint_does():
    """The sign of a filtered velocity turns milliseconds late, the filtered sign of a sharp one does not."""
    q, speed = braking(SHARP_T)
    log = Log(SHARP_T, q[:, None], np.tanh(speed / 0.01)[:, None], ("j",))
    chosen = choose_filter(log, 5.0)
    (segment,), (sign,) = condition(log, chosen), signs_of_shapes(log, chosen, SIGN, [SIGN])
    sharp, late = (
        np.abs(way - segment.tau).max() for way in (sign[..., 0], np.tanh(segment.qd / 0.01))
    )
    assert sharp < 0.2 * late


# ---------------------------------------------------------------- conditioned logs
@pytest.fixture(scope="module")
def model():
    return build_model(load_robot("scara"))


def sines_of(model, frequency=0.5, seconds=12.0, seed=0):
    """Sines whose torques are those of the prior bodies."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    w, phase = 2 * np.pi * frequency, rng.uniform(0, 6, model.robot.n)
    q, qd, qdd = tones(t, 0.2, w, phase)
    tau = model.regressor(q, qd, qdd) @ prior_vector(model)
    return Log(t, q, tau, model.robot.joint_names, dh=True)


def test_one_filter_serves_the_fastest_of_several_logs(model):
    slow, fast = sines_of(model, 0.3), sines_of(model, 2.5)
    alone = [choose_cutoff([each], model.robot) for each in (slow, fast)]
    together = condition_logs([slow, fast], model)
    assert alone[0] < alone[1]
    assert [each.filter.cutoff for each in together] == [max(alone)] * 2
    assert [each.name for each in together] == ["log 1", "log 2"]


def test_a_spike_is_taken_out_before_the_filter_and_said(model):
    clean, spike = sines_of(model), np.zeros((2400, model.robot.n))
    spike[1000, 1] = 100
    found = condition_log(replace(clean, tau=clean.tau + spike), model, 5.0)
    assert [finding.code for finding in found.findings] == ["W324"]
    expected = condition_log(clean, model, 5.0).segments[0].tau
    assert found.segments[0].tau == pytest.approx(expected, abs=0.02 * np.ptp(expected))


def test_torques_of_links_that_keep_their_prior_are_taken_off(model):
    """With the prior's bodies nothing but the identified links is left."""
    part = replace(model, robot=replace(model.robot, links=(4,)))
    (segment,) = condition_log(sines_of(model), part, cutoff=20.0).segments
    whole = replace(model, robot=replace(model.robot, links=(1, 2, 3)))
    others = known_torque(whole, segment.q, segment.qd, segment.qdd)
    inner = slice(50, -50)
    assert segment.tau[inner] == pytest.approx(others[inner], abs=2e-3 * np.abs(others).max())
    assert not known_torque(model, segment.q, segment.qd, segment.qdd).any()


def test_a_fault_says_which_log_it_was_found_in(model):
    short = replace(sines_of(model, seconds=0.1), source=Path("runs/short.bag"))
    with pytest.raises(LogTooShort) as caught:
        condition_logs([sines_of(model), short], model)
    assert "short.bag" in str(caught.value.where)


def test_logs_of_few_samples_stay_whole_however_long_they_take(model):
    logs = condition_logs([sines_of(model, seconds=12.0)], model)
    assert stretches(logs, 3.0) == (logs, 0)
