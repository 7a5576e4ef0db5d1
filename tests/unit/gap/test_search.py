"""Delays are taken out of the logs, and the search goes on."""

import pytest

from dynid.gap.analysis import on_one_clock
from dynid.gap.candidates import SelectionOptions
from dynid.gap.delays import search_effects


@pytest.mark.slow
def test_a_delay_is_taken_out_and_the_search_goes_on(twolinks, on_joint):
    sources = twolinks.logs(lambda t, q, qd, qdd: on_joint(1, 0.0 * t + 0.15), delay=0.008)
    options = SelectionOptions(effects=("torque_delay", "torque_offset"))
    found = search_effects(on_one_clock(sources), twolinks.base, None, options)
    offset, late = found.selected
    assert offset.key == ("torque_offset", (1,))
    assert late.values["delay"] == pytest.approx(0.008, rel=0.03)
    assert abs(late.values["delay"] - 0.008) < 4 * late.std_errors["delay"] < 4e-3
