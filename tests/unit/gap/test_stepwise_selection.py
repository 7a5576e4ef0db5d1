"""What is selected on the two-link arm, whose logs come from the textbook's equations."""

from types import SimpleNamespace

import numpy as np
import pytest

from dynid.gap.selected_effects import SelectedEffect
from dynid.gap.stepwise_selection import (
    EQUAL,
    SelectionOptions,
    StepwiseSelection,
    clearly_better,
    contains,
    told_apart,
    wanted_effects,
)
from dynid.model.effects.catalogue import CATALOGUE
from dynid.progress import SILENT

SOME = (
    "torque_offset",
    "spring",
    "position_friction",
    "asymmetric_viscous",
    "load_friction",
    "joint_coupling",
)


def run(problem, before=None, **options):
    asked = SelectionOptions(**({"effects": SOME} | options))
    stepwise = StepwiseSelection(problem, asked, SILENT, before or {}, delay=True)
    return stepwise, stepwise.run()


def keys(stepwise):
    return {one.key for one in stepwise.selected}


@pytest.fixture(scope="module")
def two(twolinks, on_joint):
    """An offset of joint 2 and friction of joint 1 that grows with its speed one way only."""
    return twolinks.problem(
        lambda t, q, qd, qdd: (
            on_joint(1, np.full(len(t), 0.1)) + on_joint(0, 0.12 * np.abs(qd[:, 0]))
        )
    )


def test_nothing_is_selected_where_nothing_is_hidden(clean):
    stepwise, late = run(clean)
    assert keys(stepwise) == set()
    assert late is None


def test_two_effects_on_two_joints_are_selected_with_their_sizes(two):
    stepwise, _ = run(two)
    assert keys(stepwise) == {("torque_offset", (1,)), ("asymmetric_viscous", (0,))}
    amplitudes = stepwise.regression.amplitudes
    sizes = {
        one.effect.name: float(a) for one, a in zip(stepwise.selected, amplitudes, strict=True)
    }
    assert sizes["torque_offset"] == pytest.approx(0.1, rel=0.1)
    assert sizes["asymmetric_viscous"] == pytest.approx(0.12, rel=0.1)


def test_no_more_are_selected_than_asked_for(two):
    assert len(run(two, most=1)[0].selected) == 1


def test_joints_that_are_not_asked_for_are_not_searched(two):
    assert keys(run(two, joints=(1,))[0]) == {("torque_offset", (1,))}


def test_a_chance_that_nothing_can_fall_below_selects_nothing(two):
    assert keys(run(two, false_alarm=1e-300)[0]) == set()


def test_what_a_candidate_explained_in_earlier_logs_is_no_evidence(two):
    stepwise, _ = run(two, before={("torque_offset", (1,)): 1e9})
    assert ("torque_offset", (1,)) not in keys(stepwise)
    assert ("asymmetric_viscous", (0,)) in keys(stepwise)


def test_a_delay_ends_the_selection_with_its_size(twolinks):
    problem = twolinks.problem(delay=0.008)
    _, late = run(problem, effects=())
    assert late.amplitudes[0] == pytest.approx(0.008, rel=0.1)


def test_a_shape_is_refined_off_its_grid(twolinks, on_joint):
    problem = twolinks.problem(lambda t, q, qd, qdd: on_joint(0, 0.3 * np.cos(21.3 * q[:, 0])))
    stepwise, _ = run(problem, effects=("torque_ripple",))
    (one,) = stepwise.selected
    assert one.key == ("torque_ripple", (0,))
    assert one.shape["k"] == pytest.approx(21.3, rel=0.003)


def test_what_nothing_imitates_has_no_rivals(twolinks, on_joint):
    problem = twolinks.problem(lambda t, q, qd, qdd: on_joint(1, 0.2 * np.abs(qd[:, 1])))
    stepwise, _ = run(problem, effects=("asymmetric_viscous", "nonlinear_viscous", "load_friction"))
    assert [one.key for one in stepwise.selected] == [("asymmetric_viscous", (1,))]
    assert stepwise.selected[0].rivals == ()


def one(score, gains, name="torque_offset", joints=(0,)):
    test = SimpleNamespace(
        gains=np.asarray(gains), amplitudes=np.zeros(1), gain=float(np.sum(gains))
    )
    return SelectedEffect(CATALOGUE[name], joints, {}, test, score)


def test_a_lead_is_clear_when_it_is_large_and_does_not_come_from_few_blocks():
    even = np.full(40, 2.0)
    few = np.zeros(40)
    few[0] = 2.0 * 40
    assert clearly_better(one(EQUAL + 1, even), one(0.0, np.zeros(40)))
    assert not clearly_better(one(EQUAL - 1, even), one(0.0, np.zeros(40)))
    assert not clearly_better(one(EQUAL + 1, few), one(0.0, np.zeros(40)))


@pytest.mark.parametrize(("gained", "apart"), [(3.0, True), (5.0, False)])
def test_a_rival_is_not_refuted_by_the_price_of_freedom_that_is_of_use(gained, apart):
    """One parameter more is worth 3.84 by chance in one of twenty cases; its price here is 20 more than that."""
    own, wide = (
        one(100.0, np.full(40, 10.0)),
        one(80.0, np.full(40, 10.0 + gained / 40), "nonlinear_viscous"),
    )
    assert wide.freedom == own.freedom + 1
    assert told_apart(own, wide) is apart


def test_a_wider_form_is_no_rival_of_a_narrower_one():
    assert contains(one(0, [], "spring"), one(0, []))
    assert not contains(one(0, []), one(0, [], "spring"))
    assert not contains(one(0, [], "spring", (1,)), one(0, []))


def test_candidates_are_what_the_model_lacks_at_joints_that_moved(clean):
    names = {(effect.name, joints) for effect, joints in wanted_effects(clean, SelectionOptions())}
    assert ("torque_offset", (0,)) in names
    assert not {name for name, _ in names} & {"viscous", "coulomb"}, "the model has them"
    assert not {name for name, _ in names} & {"payload", "coulomb_change"}, (
        "a model that is refitted absorbs them"
    )


def test_a_joint_that_rests_has_no_candidates(twolinks):
    problem = twolinks.problem()
    for segment in problem.segments:
        segment.use[:, 1] = False
    places = {joints for _, joints in wanted_effects(problem, SelectionOptions())}
    assert not any(joints[0] == 1 for joints in places if joints)
