"""The cut-off that noisy positions allow, against noise that is filtered and differentiated by SciPy."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt
from signal_cases import robot

from dynid import Log, load_robot
from dynid.errors import RateTooLow
from dynid.files.logs import read_log
from dynid.signals import tuning
from dynid.signals.checks import prepare
from dynid.signals.filters import check_position_noise, check_rate, choose_cutoff, position_noise
from makelogs import shared_data

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


def test_fast_motion_that_a_coarse_encoder_shows_needs_its_samples():
    with pytest.raises(RateTooLow, match=r"the fastest motion, 4\.5 Hz, needs >= 5\d Hz"):
        check_rate(swing_of_twelve_bit(4.5, 0.1), robot())


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
