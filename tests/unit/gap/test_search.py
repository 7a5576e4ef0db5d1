"""Delays are taken out of the logs, and chi-squares are those of the rows with and without what was found."""

import numpy as np
import pytest

from dynid.gap.analysis import on_one_clock
from dynid.gap.search import search_effects, without
from dynid.gap.stepwise_selection import SelectionOptions


@pytest.fixture(scope="module")
def both(twolinks, on_joint):
    """A delay of all torques, and an offset of joint 2."""
    sources = twolinks.logs(lambda t, q, qd, qdd: on_joint(1, np.full(len(t), 0.15)), delay=0.008)
    options = SelectionOptions(effects=("torque_delay", "torque_offset"))
    return search_effects(on_one_clock(sources), twolinks.base, None, options)


@pytest.mark.slow
def test_a_delay_is_taken_out_and_the_search_goes_on(both):
    assert both.delay == pytest.approx(0.008, rel=0.03)
    assert both.delay_test.p_value < 1e-6
    assert [one.key for one in both.selected] == [("torque_offset", (1,))]


def test_chi_square_falls_to_one_when_all_is_found(both):
    assert both.before.max() > 2
    np.testing.assert_allclose(both.after, 1.0, atol=0.15)
    assert np.all(both.between_reversals <= both.after)


def test_without_an_effect_its_joint_has_its_gap_again(both):
    bare = without(both.problem, both, both.selected[0])
    assert bare.selected == []
    assert bare.after[1] > 1.5 * both.after[1]
    np.testing.assert_allclose(bare.before, both.before)
