"""Which way joints move: sharp where the encoder allows it, blunt where it is noisy."""

import numpy as np
import pytest

from dynid import Log, Robot
from dynid.robot import Coulomb, Joint
from dynid.signals import tuning
from dynid.signals.conditioned_log import condition, signs_of_shapes
from dynid.signals.filters import choose_filter, choose_sign_cutoffs, lowpass_kernel, white_noise

RATE = 1000.0
SIGN = Coulomb("smooth", (0.01,))
T = np.arange(0, 20, 1 / RATE)


def braking(t, before=4.0, after=1.0):
    """Velocity that falls faster than it rises after each zero, as friction makes it; with its integral."""
    phase = t % 2.0 - 1.0
    speed = np.where(phase < 0, -before * phase, -after * phase) * np.where(t % 4 < 2, 1, -1)
    return np.cumsum(speed) / RATE, speed


def test_white_noise_is_found_on_top_of_a_motion():
    rng = np.random.default_rng(0)
    q = np.sin(2 * np.pi * 1.5 * T)[:, None] + 1e-4 * rng.standard_normal((len(T), 1))
    assert white_noise(q)[0] == pytest.approx(1e-4, rel=0.05)


@pytest.mark.parametrize("noise", [1e-6, 1e-5, 1e-4, 1e-3])
def test_the_velocity_is_as_sharp_as_its_noise_allows(noise):
    rng = np.random.default_rng(0)
    q = np.sin(2 * np.pi * T)[:, None] + noise * rng.standard_normal((len(T), 1))
    (chosen,) = choose_sign_cutoffs(q, SIGN, RATE, 5.0, measured=False)
    spectrum = np.fft.rfft(lowpass_kernel(chosen, RATE), 1 << 14)
    slope = 2 * np.pi * np.fft.rfftfreq(1 << 14, 1 / RATE) * np.abs(spectrum)
    spread = noise * np.sqrt(np.mean(slope**2))
    assert spread < 1.2 * tuning.NOISE_OVER_COULOMB * 0.01 or chosen == 5.0
    assert chosen > 70 or 2**1.5 * spread > tuning.NOISE_OVER_COULOMB * 0.01


def test_a_filtered_sign_turns_when_the_joint_does():
    """The sign of a filtered velocity turns milliseconds late, the filtered sign of a sharp one does not."""
    q, speed = braking(T)
    robot = Robot("one", "standard", (Joint("j"),))
    log = Log(T, q[:, None], np.tanh(speed / 0.01)[:, None], ("j",))
    chosen = choose_filter(log, robot, 5.0)
    (segment,), (sign,) = condition(log, chosen), signs_of_shapes(log, chosen, SIGN, [SIGN])
    sharp, late = (
        np.abs(way - segment.tau).max() for way in (sign[..., 0], np.tanh(segment.qd / 0.01))
    )
    assert sharp < 0.2 * late
