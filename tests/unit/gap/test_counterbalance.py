"""Whether links do better beside a counterbalance, before anything is searched."""

import numpy as np
import pytest

from dynid.gap.counterbalance import suspicions


@pytest.mark.parametrize(("carried", "sure"), [(60.0, False), (200.0, True)])
def test_it_is_likely_where_links_would_be_heavy_and_sure_where_they_would_be_absurd(twolinks, on_joint, carried, sure):
    problem = twolinks.problem(lambda t, q, qd, qdd: on_joint(0, -carried * np.cos(q[:, 0])))
    (one,) = suspicions(problem, [])
    assert (one.joint, one.link) == (0, 1)
    assert one.gain > 25.0
    assert one.sure is sure, "a counterweight of 200 kg would do the same, one of three tons would not"
    without, beside = one.masses
    assert without > 10 * beside


def test_an_arm_without_one_is_not_suspected(clean):
    assert suspicions(clean, []) == []
