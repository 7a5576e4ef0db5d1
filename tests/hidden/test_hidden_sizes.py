"""Sizes of effects that are not in proportion to them, in logs of a generator that shares no code with the search."""

import pytest

import gap_blind
import hidden_effects as hidden
from dynid.gap.analysis import on_one_clock
from dynid.gap.refit import refit
from dynid.gap.search import search_effects
from dynid.gap.stepwise_selection import SelectionOptions


@pytest.mark.parametrize(
    ("name", "joint", "size", "near"), [("encoder_offset", 2, 4.2, 0.01), ("joint_elasticity", 3, 3.0, 0.05)]
)
def test_a_large_size_is_right_and_leaves_nothing_for_a_companion(name, joint, size, near):
    """An encoder zero of an eighth of a radian, and a gear that bends by some hundredths of one."""
    case = hidden.Case("lwr4plus", name, joint, size, 5)
    base = gap_blind.model_of("lwr4plus")
    logs = on_one_clock(gap_blind.sources_of(hidden.simulate(case, seconds=12.0), base.model))
    options = SelectionOptions(effects=("encoder_offset", "joint_elasticity", "spring", "end_stop"))
    search = search_effects(logs, base, None, options)
    assert [one.key for one in search.selected] == [(name, (joint,))]
    (one,), _ = refit(search)
    ((parameter, true),) = hidden.sizes_of(case).items()
    assert one.values[parameter] == pytest.approx(true, rel=near)
