"""Sizes of effects that are not in proportion to them, in logs of a generator that shares no code with the search."""

import pytest
from logs_of_arms import model_of, sources_of

import hidden_effects as hidden
from dynid.gap.analysis import on_one_clock
from dynid.gap.candidates import SelectionOptions
from dynid.gap.search import search_effects

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(
    ("name", "joint", "size", "near"),
    [("encoder_offset", 2, 4.2, 0.01), ("joint_elasticity", 3, 3.0, 0.1)],
)
def test_a_large_size_is_right_and_leaves_nothing_for_a_companion(name, joint, size, near):
    """An encoder zero of an eighth of a radian, and a gear that bends by some hundredths of one."""
    case = hidden.Case("lwr4plus", name, joint, size, 5)
    base = model_of("lwr4plus")
    logs = on_one_clock(sources_of(hidden.simulate(case, seconds=12.0), base.model))
    options = SelectionOptions(effects=("encoder_offset", "joint_elasticity", "spring", "end_stop"))
    search = search_effects(logs, base, None, options)
    assert [one.key for one in search.selected] == [(name, (joint,))]
    (one,) = search.selected
    (size,) = one.values.values()
    assert size == pytest.approx(case.facts["shown"], rel=near)


def test_the_last_tenth_of_a_delay_is_taken_out_too():
    """With a coarse encoder it is too small beside the noise to be found as an effect of its own."""
    case = hidden.Case("kinova_gen2", "torque_delay", 1, 4.5, 5)
    base = model_of("kinova_gen2")
    logs = on_one_clock(sources_of(hidden.simulate(case, seconds=12.0), base.model))
    search = search_effects(logs, base, None, SelectionOptions(effects=("torque_delay",)))
    assert search.selected[0].values["delay"] == pytest.approx(0.018, rel=0.02)
