"""Old and new logs of other motion: which joints have changed, and by how much, with nothing but the logs."""

from dataclasses import replace

import numpy as np

from dynid.estimation.estimate import estimate
from dynid.estimation.stack import stack_base
from dynid.gap.analysis import analyse_gap
from dynid.gap.problem import kept_model, make_problem
from dynid.gap.refit import chance_of_growth
from dynid.gap.stepwise_selection import SelectionOptions


def test_nothing_has_changed_on_another_motion_of_the_same_arm(twolinks, old, kept):
    problem = make_problem(twolinks.logs(plans=(5, 6), first=20), twolinks.base, kept, old)
    assert problem.change.joints == ()
    seen = analyse_gap(
        twolinks.logs(plans=(5, 6), first=20), twolinks.base, kept, SelectionOptions(), simulate=False, earlier=old
    )
    assert (seen.verdict.word, seen.effects) == ("nothing_changed", ())


def test_more_friction_is_named_with_its_size_on_its_joint_alone(twolinks, old, kept, more_friction):
    new = twolinks.logs(more_friction, plans=(5, 6), first=20)
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


def test_effects_act_in_new_logs_alone(twolinks, old, kept, more_friction):
    """Torques of earlier logs may be anything: with their rows weightless the size of the change would be the same."""
    new = twolinks.logs(more_friction, plans=(5, 6), first=20)
    problem = make_problem(new, twolinks.base, kept, old)
    fresh = {s.number for s in problem.segments if s.fresh}
    assert len(fresh) == len(new)
    assert not fresh & {s.number for s in problem.segments if not s.fresh}
    assert all(not held.any() for s, held in zip(problem.segments, problem.held, strict=True) if not s.fresh)
    assert replace(problem, change=None).since is False


def test_noise_of_a_comparison_does_not_know_held_out_rows(twolinks, on_joint):
    """Whatever is recorded in them, what rows count for must not depend on the rows that are the proof."""
    old = twolinks.logs(plans=(1, 2), repeats=1, seconds=10.0)
    kept = kept_model(estimate(stack_base(old, twolinks.base), twolinks.base, method="wls", holdout=None))
    late = lambda t, q, qd, qdd: on_joint(0, 3.0 * np.sin(2.0 * t) * (t % 20.0 > 7.0))  # noqa: E731
    one, other = (
        make_problem(
            twolinks.logs(added, plans=(5, 6), repeats=1, first=20, seconds=10.0), twolinks.base, kept, old
        ).noise
        for added in (None, late)
    )
    assert one.repeats == 0
    for name in ("sigma", "floor", "count"):
        np.testing.assert_allclose(getattr(one, name), getattr(other, name), rtol=1e-6)


def test_a_joint_is_called_worse_no_more_often_than_the_chance_says():
    """Residuals of equal size, four blocks of a second with a memory of half a second."""
    rng = np.random.default_rng(3)
    block = np.repeat(np.arange(4), 40)
    smooth = np.ones(20) / 20.0
    chances = []
    for _ in range(2000):
        before, after = (np.convolve(rng.standard_normal(180), smooth, "valid")[:160] for _ in range(2))
        chances.append(chance_of_growth((before, block), (after, block)))
    assert np.mean(np.array(chances) < 0.05) < 0.065
    grown = 1.5 * rng.standard_normal(160)
    assert chance_of_growth((rng.standard_normal(160), block), (grown, block)) < 0.05
    assert chance_of_growth((grown[:80], block[:80]), (2 * grown[:80], block[:80])) == 1.0
