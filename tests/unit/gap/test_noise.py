"""The noise level on signals whose noise is known."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from dynid.errors import LogTooShort
from dynid.estimation.least_squares import autocorrelation_time
from dynid.estimation.noise_floor import RepeatPair, find_repeats
from dynid.gap.noise import (
    NoiseModel,
    measure_noise,
    whitened,
    with_steps,
    yule_walker,
)
from dynid.gap.problem import make_problem

RATE = 40.0


def coloured(rng, count):
    x = np.zeros(count)
    drive = rng.normal(size=count)
    for k in range(2, count):
        x[k] = 1.2 * x[k - 1] - 0.5 * x[k - 2] + drive[k]
    return x


def rows_of(*motions):
    """Return parts with just what the noise needs."""
    edges = np.cumsum([0, *map(len, motions)])
    q = np.concatenate(motions)
    return SimpleNamespace(
        rate=RATE,
        logs=[SimpleNamespace(filter=SimpleNamespace(cutoff=RATE / 4))],
        parts=[slice(*pair) for pair in pairwise(edges.tolist())],
        q=q,
        use=np.ones(q.shape, dtype=bool),
    )


def motion(t):
    return np.stack(
        [np.sin(0.7 * t) + 0.3 * np.sin(1.9 * t), np.cos(0.5 * t) + 0.2 * np.sin(2.3 * t)], axis=1
    )


def test_yule_walker_finds_the_process_and_whitening_leaves_its_drive():
    x, ar = coloured(np.random.default_rng(0), 200_000), [1.2, -0.5, 0, 0]
    found = yule_walker(np.array([x[lag:] @ x[: len(x) - lag] for lag in range(5)]))
    np.testing.assert_allclose(found, ar, atol=0.02)
    white = whitened(x, np.array(ar))
    assert abs(np.std(white) - 1) < 0.02
    assert abs(white[1:] @ white[:-1]) / (white @ white) < 0.02


def test_two_recordings_of_one_motion_are_found_with_their_lag_and_others_are_no_repeats():
    t = np.arange(1200) / RATE
    (pair,) = find_repeats([motion(t), motion(t + 50 / RATE), motion(1.3 * t + 2)], RATE)
    assert (pair.first, pair.second) == (0, 1)
    assert abs(pair.lag + 50) < 0.2


def test_periods_within_one_recording_are_repeats():
    t = np.arange(1600) / RATE
    q = np.stack([np.sin(2 * np.pi * t / 10), np.sin(2 * np.pi * t / 5 + 1)], axis=1)
    (pair,) = find_repeats([q], RATE)
    periods = pair.lag / (10 * RATE)
    assert periods == pytest.approx(round(periods), abs=1e-3)


T = np.arange(4000) / RATE


def noise_of(residuals):
    """Return the noise of a motion that is driven twice."""
    q = motion(T)
    return measure_noise(rows_of(q, q), np.concatenate([*residuals]), [RepeatPair(0, 1, 0.0)])


def test_repeats_show_the_noise_and_not_what_repeats():
    rng, same = np.random.default_rng(2), 5 * np.sin(3 * motion(T))
    noise = noise_of(
        same + 0.1 * np.stack([coloured(rng, len(T)) for _ in range(2)], axis=1) for _ in range(2)
    )
    np.testing.assert_allclose(noise.sigma, 0.1, rtol=0.05)
    assert noise.unrepeatable == []


def test_steps_of_an_encoder_are_noise_that_repeats_do_not_show():
    """A mass of 2 kg, whose motion is read in steps of 1 mm: what they accelerate below the cut-off."""
    q, f = motion(np.arange(60_000) / 500.0)[:, :1], np.fft.rfftfreq(60_000, 1 / 500.0)
    steps = np.round(q, 3)
    waves = (2 * np.pi * f) ** 2 * (f < 10.0) * np.fft.rfft((steps - q)[:, 0])
    read = SimpleNamespace(
        filter=SimpleNamespace(cutoff=10.0, rate=500.0),
        torque_step=np.zeros(1),
        segments=[SimpleNamespace(raw_q=steps)],
    )
    arm = SimpleNamespace(rigid=lambda q, qd, qdd: 2.0 * qdd)
    rows = SimpleNamespace(logs=[read], motions=[SimpleNamespace(q=q, reference=arm)])
    noise = with_steps(replace(NoiseModel.white(np.array([1e-3])), repeats=10.0), rows)
    assert noise.floor == pytest.approx(2.0 * np.fft.irfft(waves).std(), rel=0.1)


def test_new_logs_without_usable_rows_are_refused(twolinks, kept, old):
    short = [twolinks.log(5, 0, seconds=2.0)]
    with pytest.raises(LogTooShort, match="usable rows"):
        make_problem(short, twolinks.base, kept, old)


def test_a_contact_in_one_repeat_is_called_unrepeatable():
    rng = np.random.default_rng(3)
    residuals = [0.1 * rng.normal(size=(4000, 2)) for _ in range(2)]
    residuals[1][:, 0] += 2 * np.exp(-(((T - 40) / 0.4) ** 2))
    assert noise_of(residuals).unrepeatable == [0]


def test_rows_tell_the_same_as_long_as_they_go_on():
    rng = np.random.default_rng(2)
    assert autocorrelation_time([rng.normal(size=40_000)]) == pytest.approx(1.0, abs=0.1)
    slow = np.repeat(rng.normal(size=4_000), 10)
    for some in ([slow], [7 * slow[:20_000], 7 * slow[20_000:]]):
        assert autocorrelation_time(some) == pytest.approx(10.0, rel=0.1)


def test_a_spectrum_that_rises_with_the_frequency_does_not_ring_and_a_resonance_does():
    """Noise of positions, differentiated, rises; a link at 4 Hz stands out."""
    pole = 0.97 * np.exp(2j * np.pi * 0.1)
    ringing = [2 * pole.real, -(abs(pole) ** 2), 0.0, 0.0]
    rising = [-0.9, -0.2, 0.0, 0.0]
    noise = replace(NoiseModel.white(np.ones(2)), ar=np.array([ringing, rising]))
    assert noise.peak[0] > 50.0
    assert noise.peak[1] == pytest.approx(1.0)
    assert noise.unrepeatable == [0]
