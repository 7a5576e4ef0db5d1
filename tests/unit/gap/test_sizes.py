"""Sizes that were put in come back with errors that hold, and the held-out gap shrinks by what was explained."""

import numpy as np
import pytest

import twolink
from dynid.gap.analysis import on_one_clock
from dynid.gap.candidates import SelectionOptions
from dynid.gap.delays import search_effects, searches
from dynid.gap.held_out import held_out, held_out_improvement, simulated_error

OFFSET = 0.12


def searched(twolinks, added, effects, **options):
    sources = on_one_clock(twolinks.logs(added, **options))
    at = searches(sources, twolinks.base, None)
    return search_effects(sources, at, SelectionOptions(effects=effects))


@pytest.fixture(scope="module")
def offset(twolinks, on_joint):
    return searched(
        twolinks, lambda t, q, qd, qdd: on_joint(1, np.full(len(t), OFFSET)), ("torque_offset",)
    )


def test_errors_are_the_spread_over_noise(twolinks, on_joint):
    found = []
    for k in range(12):
        search = searched(
            twolinks,
            lambda t, q, qd, qdd: on_joint(1, np.full(len(t), OFFSET)),
            ("torque_offset",),
            plans=(1,),
            first=50 + 2 * k,
        )
        (one,) = search.selected
        assert (one.key, one.units) == (("torque_offset", (1,)), {"c": "N m"})
        found.append((one.values["c"] - OFFSET, one.std_errors["c"]))
    away, errors = np.array(found).T
    assert 0.5 < np.std(away) / np.mean(errors) < 1.6
    assert abs(np.mean(away)) < 3 * np.mean(errors) / np.sqrt(len(away))


SHAPES = {
    "torque_ripple": (
        lambda t, q, qd: 0.2 * np.cos(21.3 * q + 0.5),
        {"a": 0.2 * np.cos(0.5), "b": -0.2 * np.sin(0.5), "k": 21.3},
    ),
    "position_friction": (
        lambda t, q, qd: 0.6 * np.cos(1.6 * q + 0.4) * np.tanh(qd / 0.01),
        {"a": 0.6 * np.cos(0.4), "b": -0.6 * np.sin(0.4), "h": 1.6},
    ),
    "nonlinear_viscous": (lambda t, q, qd: 0.5 * np.sign(qd) * qd**2, {"a": 0.5, "p": 2.0}),
    "warmup_friction": (
        lambda t, q, qd: 0.6 * np.exp(-t / 20) * np.tanh(qd / 0.01),
        {"a1": 0.6, "a2": 0.0, "tw": 20.0},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", SHAPES)
def test_a_shape_and_its_amplitudes_come_back_with_errors_that_know_of_each_other(
    twolinks, on_joint, name
):
    law, truth = SHAPES[name]
    search = searched(
        twolinks, lambda t, q, qd, qdd: on_joint(0, law(t, q[:, 0], qd[:, 0])), (name,)
    )
    (one,) = search.selected
    assert set(one.values) == set(truth) == set(one.std_errors)
    for key, value in truth.items():
        assert abs(one.values[key] - value) < 3 * one.std_errors[key], key
        assert one.std_errors[key] < 0.05 * max(abs(value), 0.6), key


def test_the_held_out_gap_shrinks_to_the_noise_where_the_effect_was(offset):
    before, after = (held_out(offset.problem, some) for some in ([], offset.selected))
    known = offset.state.rows.known_power(offset.state.evidence)
    found = held_out_improvement(offset.problem, before, after, known)
    visible = OFFSET * np.sqrt(offset.visibility["torque_offset", (1,)])
    assert np.sqrt(found.before[1] ** 2 - found.floor[1] ** 2) == pytest.approx(visible, rel=0.5)
    np.testing.assert_allclose(found.after, found.floor, rtol=0.15)
    ratio = found.after / found.before
    assert np.all((found.ratio[:, 0] < ratio) & (ratio < found.ratio[:, 1]))
    assert found.ratio[1, 1] < 1.0


@pytest.mark.slow
def test_a_delay_is_taken_out_and_the_search_goes_on(twolinks, on_joint):
    effects = ("torque_delay", "torque_offset")
    there = lambda t, q, qd, qdd: on_joint(1, 0.0 * t + 0.15)  # noqa: E731
    offset, late = searched(twolinks, there, effects, delay=0.008).selected
    assert offset.key == ("torque_offset", (1,))
    assert late.values["delay"] == pytest.approx(0.008, rel=0.03)
    assert abs(late.values["delay"] - 0.008) < 4 * late.std_errors["delay"] < 4e-3


def test_a_torque_that_is_left_drives_a_joint_as_its_inertia_says(clean):
    """0.1 N m on the second joint for half a second, from rest: t^2 / 2 over the inertia of its link."""
    rows = clean.rows
    left = np.where(rows.held[:, None], [0.0, 0.1], np.nan)
    inertia = twolink.INERTIA[1] + twolink.MASS[1] * twolink.COM[1] ** 2
    t = np.arange(1, round(0.5 * rows.rate) + 1) / rows.rate
    expected = np.sqrt(np.mean((0.5 * 0.1 / inertia * t**2) ** 2))
    np.testing.assert_allclose(simulated_error(clean, left), [0.0, expected], rtol=0.1)
