"""One analysis of the two-link arm, from logs to a verdict, and how time runs through several logs."""

from dataclasses import replace

import numpy as np
import pytest

import twolink
from dynid.gap.analysis import analyse_gap, on_one_clock
from dynid.gap.candidates import SelectionOptions
from dynid.gap.verdict import refusal


@pytest.mark.parametrize(
    ("hidden", "key", "sizes"),
    [
        (lambda t, *_: 0.2 * (t > 27.0), ("offset_step", (1,)), {"c": 0.2, "since": 27.0}),
        (lambda t, *_: 0.004 * t, ("torque_drift", (1,)), {"a": 0.004}),
        (
            lambda t, *motion: 0.1 * twolink.torque(*motion)[:, 0],
            ("torque_crosstalk", (1, 0)),
            {"a": 0.1, "b": 0.1},
        ),
    ],
)
def test_a_jump_is_no_drift_and_a_leak_of_all_torque_no_coupling(
    twolinks, on_joint, hidden, key, sizes
):
    logs = on_one_clock(twolinks.logs(lambda *motion: on_joint(1, hidden(*motion))))
    seen = analyse_gap(logs, twolinks.base, None, SelectionOptions())
    (one,) = seen.named
    assert (seen.verdict, one.key) == ("named", key)
    for name, size in sizes.items():
        assert abs(one.values[name] - size) < 3 * one.std_errors[name] < 0.5 * size


def test_what_these_logs_cannot_show_is_listed(twolinks):
    """A zero of the first joint is a turn of gravity, which the links' centres of mass take up."""
    some = SelectionOptions(effects=("encoder_offset", "asymmetric_viscous"))
    seen = analyse_gap(twolinks.logs(), twolinks.base, None, some)
    assert 0 in seen.invisible["encoder_offset"]
    assert "asymmetric_viscous" not in seen.invisible


@pytest.mark.slow
def test_what_is_shown_after_is_what_is_named_alone(twolinks, on_joint):
    """The held-out error after is that of a model with the named effect and without the withdrawn one."""
    sources = on_one_clock(
        twolinks.logs(
            lambda t, q, qd, qdd: (
                on_joint(0, 0.2 * np.abs(qd[:, 0])) + on_joint(1, np.where(t % 20 < 12, 0.3, 0.0))
            )
        )
    )
    options = SelectionOptions(effects=("torque_offset", "asymmetric_viscous"))
    seen = analyse_gap(sources, twolinks.base, None, options)
    alone = replace(options, effects=("asymmetric_viscous",), joints=(0,))
    expected = analyse_gap(sources, twolinks.base, None, alone)
    assert [one.key for one in seen.named] == [one.key for one in expected.named]
    np.testing.assert_allclose(seen.improvement.after, expected.improvement.after, rtol=0.01)
    for one, why in seen.closest:
        assert why, one.name


def test_time_runs_through_logs_whose_stamps_do_in_whatever_order_they_are_given(twolinks):
    at = 100, 0, 200
    made = [twolinks.log(1, k, start=k) for k in at]
    anew = on_one_clock(
        [replace(s, segments=[replace(x, elapsed=x.t - x.t[0]) for x in s.segments]) for s in made]
    )
    starts = [source.segments[0].elapsed[0] for source in anew]
    assert starts == pytest.approx(at, abs=0.2)


def test_each_log_has_its_own_time_when_stamps_begin_anew(twolinks):
    made = [twolinks.log(1, k) for k in range(2)]
    for source in on_one_clock(made):
        assert source.segments[0].elapsed[0] < 0.2


def test_a_change_is_no_name_on_a_joint_whose_logs_agree(twolinks, old, kept, more_friction):
    new = twolinks.logs(more_friction, plans=(5, 6), first=20)
    search = analyse_gap(new, twolinks.base, kept, SelectionOptions(), earlier=old).search
    assert "logs agree" in refusal(search, search.selected[0], [0], 1.0)
