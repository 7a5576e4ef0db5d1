"""Old and new logs of other motion: which joints have changed, and by how much, with nothing but the logs."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.estimation.estimate import estimate
from dynid.estimation.stack import stack_base
from dynid.gap.analysis import analyse_gap
from dynid.gap.problem import kept_model, make_problem
from dynid.gap.stepwise_selection import SelectionOptions


@pytest.fixture(scope="module")
def old(twolinks):
    return twolinks.logs(plans=(1, 2))


@pytest.fixture(scope="module")
def kept(twolinks, old):
    return kept_model(estimate(stack_base(old, twolinks.base), twolinks.base, method="wls", holdout=None))


def more_friction(on_joint):
    return lambda t, q, qd, qdd: on_joint(1, 0.15 * np.tanh(qd[:, 1] / 0.01))


def test_nothing_has_changed_on_another_motion_of_the_same_arm(twolinks, old, kept):
    problem = make_problem(twolinks.logs(plans=(5, 6), first=20), twolinks.base, kept, old)
    assert problem.change.joints == ()
    seen = analyse_gap(
        twolinks.logs(plans=(5, 6), first=20), twolinks.base, kept, SelectionOptions(), simulate=False, earlier=old
    )
    assert (seen.verdict.word, seen.effects) == ("nothing_changed", ())


def test_more_friction_is_named_with_its_size_on_its_joint_alone(twolinks, old, kept, on_joint):
    new = twolinks.logs(more_friction(on_joint), plans=(5, 6), first=20)
    problem = make_problem(new, twolinks.base, kept, old)
    assert 1 in problem.change.joints
    assert problem.change.growth[1] > 1.2 > problem.change.growth[0]
    seen = analyse_gap(new, twolinks.base, kept, SelectionOptions(), simulate=False, earlier=old)
    (one,) = seen.verdict.named
    assert (one.name, one.joints) == ("coulomb_change", (1,))
    assert abs(one.values["c"] - 0.15) < 3 * one.std_errors["c"] < 0.03


def test_what_was_always_there_is_no_change(twolinks, on_joint):
    """A spring that the model lacks, in old and new logs alike."""
    spring = lambda t, q, qd, qdd: on_joint(1, 2.0 * q[:, 1])  # noqa: E731
    old = twolinks.logs(spring, plans=(1, 2))
    kept = kept_model(estimate(stack_base(old, twolinks.base), twolinks.base, method="wls", holdout=None))
    new = twolinks.logs(spring, plans=(5, 6), first=20)
    seen = analyse_gap(new, twolinks.base, kept, SelectionOptions(), simulate=False, earlier=old)
    assert seen.verdict.named == ()


def test_effects_act_in_new_logs_alone(twolinks, old, kept, on_joint):
    """Torques of earlier logs may be anything: with their rows weightless the size of the change would be the same."""
    new = twolinks.logs(more_friction(on_joint), plans=(5, 6), first=20)
    problem = make_problem(new, twolinks.base, kept, old)
    fresh = {s.number for s in problem.segments if s.fresh}
    assert len(fresh) == len(new)
    assert not fresh & {s.number for s in problem.segments if not s.fresh}
    assert all(not held.any() for s, held in zip(problem.segments, problem.held, strict=True) if not s.fresh)
    assert replace(problem, change=None).since is False
