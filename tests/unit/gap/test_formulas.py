"""Formulas for what no effect of the catalogue explains, on the two-link arm of the textbook."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.gap.analysis import analyse_gap, on_one_clock
from dynid.gap.evidence import Rest
from dynid.gap.formula_library import forms, library_of
from dynid.gap.formulas import find_formulas
from dynid.gap.problem import make_problem
from dynid.gap.search import EffectSearch, chi_squares
from dynid.gap.stepwise_selection import SelectionOptions
from dynid.gap.verdict import explained_share, unrepeatable
from dynid.model.effects.catalogue import added_effects
from dynid.model.effects.formula import Formula, formula_text
from dynid.robot import EffectSpec


def search_of(problem, selected=()):
    """A search that has found nothing."""
    chi, between = chi_squares(problem.regression())
    return EffectSearch(
        problem,
        list(selected),
        0.0,
        None,
        chi,
        chi,
        between,
        {},
        problem.regression().known_errors,
        Rest(np.zeros(len(chi)), ({"all": 0.0},) * len(chi), np.zeros(len(chi))),
    )


def words(twolinks, added, joint=1, **options):
    problem = make_problem(on_one_clock(twolinks.logs(added, **options)), twolinks.base, None)
    return find_formulas(search_of(problem), [joint])


def test_a_torque_without_a_name_is_written_down_with_its_size(twolinks, on_joint):
    found = words(
        twolinks,
        lambda t, q, qd, qdd: on_joint(1, 0.3 * np.sin(2 * q[:, 1]) * qd[:, 0] * np.abs(qd[:, 1])),
    )
    (one,) = found.formulas
    assert one.effect.text in ("a sin(2 q2) qd1 |qd2|", "a sin(2 q2) |qd2| qd1")
    assert one.joints == (1,)
    assert one.values["a"] == pytest.approx(0.3, abs=4 * one.std_errors["a"])
    assert one.std_errors["a"] < 0.03
    assert one.units == {"a": "N m s^2/rad^2"}


def test_nothing_is_written_down_where_nothing_is_hidden(twolinks, clean):
    found = find_formulas(search_of(clean), [0, 1])
    assert found.formulas == ()
    assert {clue.joint for clue in found.clues} == {0, 1}


def test_what_does_not_stay_is_no_formula(twolinks, on_joint):
    """A torque that is there in the first part of each log only."""
    found = words(
        twolinks,
        lambda t, q, qd, qdd: on_joint(
            1, np.where(t % 20 < 11, 0.4, 0.0) * np.sin(2 * q[:, 1]) * qd[:, 0]
        ),
    )
    assert found.formulas == ()


def test_a_clue_says_what_the_residual_follows_and_whether_it_repeats(twolinks, on_joint):
    """Teeth of three lengths: a torque over the position that no short formula has."""
    found = words(
        twolinks,
        lambda t, q, qd, qdd: on_joint(
            1, 0.3 * np.sign(np.sin(9 * q[:, 1] + 4 * np.cos(5 * q[:, 1])))
        ),
    )
    (clue,) = found.clues
    assert clue.signal == "q2"
    assert clue.repeats > 0.8


def test_every_product_of_the_library_is_a_formula():
    for joint in range(3):
        library = library_of(joint, 3, (True, False, True), (1.0, 2.0))
        products = list(library.products())
        texts = {tuple(sorted(form)) for one in products for form in forms(one)}
        assert len(texts) == sum(len(forms(one)) for one in products), "none is there twice"
        assert ("sign(qd1)",) not in texts
        for form in list(texts)[::37]:
            assert Formula(formula_text([" ".join(form)]), (True, False, True)).amplitudes(
                {}
            ).keys() == {"a"}


def test_a_formula_goes_through_the_robot_file(twolinks, on_joint):
    (one,) = words(twolinks, lambda t, q, qd, qdd: on_joint(1, 0.3 * qd[:, 0] * qd[:, 1])).formulas
    robot = twolinks.base.robot
    spec = EffectSpec("formula", (robot.joint_names[1],), one.values, {}, one.effect.text)
    (added,) = added_effects(replace(robot, effects=(spec,)))
    assert [column.value for column in added.columns] == list(one.values.values())


@pytest.mark.slow
@pytest.mark.parametrize(("size", "told"), [(0.012, True), (0.0, False)])
def test_what_grows_with_time_is_a_formula_although_no_repeat_repeats_it(
    twolinks, on_joint, size, told
):
    """A cable that slackens, or a sensor that wanders: of the two only one can be said."""

    def torque(t, q, qd, qdd):
        drift = np.cumsum(np.random.default_rng(int(t[0])).standard_normal(len(t))) / 150
        return on_joint(1, size * t * np.cos(2 * q[:, 1]) * qd[:, 0] + (drift if not told else 0.0))

    problem = make_problem(on_one_clock(twolinks.logs(torque)), twolinks.base, None)
    search = search_of(problem)
    assert unrepeatable(search) == [1]
    found = find_formulas(search, [1])
    if not told:
        assert found.formulas == ()
        assert found.clues[0].near.endswith("what disturbs it does not repeat")
        return
    (one,) = found.formulas
    assert one.effect.text in ("a cos(2 q2) qd1 t", "a cos(2 q2) t qd1")
    assert one.values["a"] == pytest.approx(size, rel=0.1)


@pytest.mark.slow
def test_a_name_that_explains_a_part_is_told_with_its_share_and_what_is_left(twolinks, on_joint):
    """Drag by the shoulder that depends on the elbow's angle, which is of one sign in these logs, or does not."""
    only = SelectionOptions(effects=("joint_coupling",), joints=(1,))
    for law, left in ((lambda q: 0.5 + np.sin(q[:, 1]) ** 2, (1,)), (lambda q: 0.8, ())):
        logs = twolinks.logs(lambda t, q, qd, qdd, law=law: on_joint(1, law(q) * qd[:, 0]))
        seen = analyse_gap(on_one_clock(logs), twolinks.base, None, only, simulate=False)
        (one,) = seen.verdict.named
        share, _ = explained_share(seen.search, seen.effects, one)
        assert (share < 1.0) == bool(left)
        assert share > 0.5
        assert set(left) <= set(seen.verdict.remainder)
