"""Names that explain a part of a joint's gap jointly with errors that nothing explains."""

from dataclasses import replace

import numpy as np
import pytest

import twolink
from dynid.gap import analysis, verdict
from dynid.gap.analysis import analyse_gap, on_one_clock, weakly_determined
from dynid.gap.formulas import better_explained_by_formula
from dynid.gap.partial import change_of_size, why_no_part, with_cutoff
from dynid.gap.record import record_of
from dynid.gap.refit import refit
from dynid.gap.search import search_effects
from dynid.gap.stepwise_selection import SelectionOptions
from dynid.gap.verdict import LITTLE
from dynid.gap.with_formula import explanations, parts_with_formulas, same_motion
from dynid.model.effects.catalogue import CATALOGUE

#: Ripple of the elbow [N m] with its frequency [1/rad], and rms of what repeats jointly with it [N m].
RIPPLE, WAVES, REST = 0.2, 21.3, 0.12
SOME = SelectionOptions(
    effects=("torque_ripple", "asymmetric_viscous", "spring", "stribeck", "position_friction", "torque_offset")
)
#: Share of the load that goes into friction [1] or, with the speed, into what has no name [s/rad].
SHARE = 0.25


def rest(t):
    """What repeats with the motion and follows nothing: smooth, the same in every period of 10 s [N m]."""
    rng = np.random.default_rng(5)
    grid = np.arange(0.0, 10.2, 0.12)
    series = np.interp(t % 10.0, grid, rng.standard_normal(len(grid)))
    return REST * series / series.std()


@pytest.fixture(scope="module")
def logs(twolinks, on_joint):
    law = lambda t, q, qd, qdd: on_joint(1, RIPPLE * np.cos(WAVES * q[:, 1]) + rest(t))  # noqa: E731
    return on_one_clock(twolinks.logs(law))


@pytest.fixture(scope="module")
def seen(twolinks, logs):
    """The search when more than any name explains is asked of a whole one, so that each is a part."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(verdict, "SHARES", (0.97, 0.98, 0.99))
        yield analyse_gap(logs, twolinks.base, None, SOME, simulate=False)


def test_a_part_is_named_with_its_size_and_share_and_the_rest_is_told(twolinks, seen):
    (one,) = seen.verdict.named
    assert one.key == ("torque_ripple", (1,))
    assert abs(one.values["a"] - RIPPLE) < 3 * one.std_errors["a"]
    assert abs(one.values["k"] - WAVES) < 3 * one.std_errors["k"]
    assert 1 in seen.verdict.remainder
    (told,) = record_of(seen, twolinks.base.robot, "numbers", "", "").named
    assert 0.5 < told.share < 0.97
    assert told.message == f"named; explains {100 * told.share:.0f} % of the gap of elbow, the rest is unexplained"
    assert told.facts()["share_of_gap"] == told.share


def test_its_size_holds_at_other_cut_offs(seen):
    problem, effects = seen.search.problem, list(seen.effects)
    for share in (0.5, 2.0):
        assert change_of_size(problem, effects, share) < 0.1
        assert with_cutoff(problem, share)[0].log.filter.cutoff == share * problem.segments[0].log.filter.cutoff


def test_what_is_not_sure_enough_is_no_part(seen):
    (one,) = seen.effects
    assert why_no_part(seen.search, seen.effects, one) == ""
    assert why_no_part(seen.search, seen.effects, replace(one, z=4.9)) == (
        "its size is only 4.9 standard errors from zero; a partial effect needs 5"
    )
    small = replace(one, test=replace(one.test, visible_rms=0.8))
    assert (
        why_no_part(seen.search, seen.effects, small)
        == "its torque is only 0.8 times the noise; a partial effect needs 1"
    )


def test_a_stand_in_for_something_else_is_no_part(twolinks, on_joint):
    """A wave over both angles that no effect of these has: what comes near it is beaten by others or by a formula."""
    law = lambda t, q, qd, qdd: on_joint(1, 0.4 * np.sin(2 * q[:, 0] - 3 * q[:, 1]) * qd[:, 0] + rest(t))  # noqa: E731
    found = analyse_gap(on_one_clock(twolinks.logs(law)), twolinks.base, None, SOME, simulate=False)
    assert found.verdict.named == ()
    assert all(LITTLE in why or "unseen" in why or "not" in why for _, why in found.verdict.closest)


def test_a_part_is_named_and_sized_beside_a_formula_for_the_rest(twolinks, on_joint):
    """A rest that is larger than the effect: fitted without it, the friction is off by several of its errors."""
    size = 0.25
    law = lambda t, q, qd, qdd: on_joint(  # noqa: E731
        1, size * np.abs(qd[:, 1]) + 0.35 * np.sin(2 * q[:, 1]) * np.abs(qd[:, 1]) * np.sign(qd[:, 0])
    )
    found = analyse_gap(on_one_clock(twolinks.logs(law)), twolinks.base, None, SOME, simulate=False)
    (one,) = found.verdict.named
    assert one.key == ("asymmetric_viscous", (1,))
    assert "sin(2 q2)" in one.fitted_with
    assert abs(one.values["a"] - size) < 3 * one.std_errors["a"]
    (told,) = record_of(found, twolinks.base.robot, "numbers", "", "").named
    assert told.message.endswith(f"fitted jointly with {one.fitted_with}")
    assert told.facts()["size_beside"] == one.fitted_with


def test_nothing_is_named_where_a_formula_explains_everything(twolinks, on_joint):
    law = lambda t, q, qd, qdd: on_joint(1, 0.5 * np.sin(2 * q[:, 1]) * np.abs(qd[:, 1]) * np.sign(qd[:, 0]))  # noqa: E731
    found = analyse_gap(on_one_clock(twolinks.logs(law)), twolinks.base, None, SOME, simulate=False)
    assert found.verdict.named == ()


@pytest.mark.parametrize("named_right", [False, True])
def test_names_of_a_joint_are_judged_as_parts_where_a_formula_does_better_than_one_of_them(
    twolinks, on_joint, named_right
):
    """Load times speed, which friction that grows with the load comes near; and such friction itself."""

    def law(t, q, qd, qdd):
        sign = np.tanh(qd[:, 1] / twolink.SMOOTH)
        load = twolink.torque(q, qd, qdd)[:, 1] - twolink.VISCOUS[1] * qd[:, 1] - twolink.COULOMB[1] * sign
        return on_joint(1, 0.5 * np.abs(qd[:, 1]) + SHARE * (np.abs(load) * sign if named_right else load * qd[:, 1]))

    pair = SelectionOptions(effects=("asymmetric_viscous", "load_friction"), joints=(1,))
    search = search_effects(on_one_clock(twolinks.logs(law)), twolinks.base, None, pair)
    effects, _ = refit(search)
    assert {one.name for one in effects} == {"asymmetric_viscous", "load_friction"}
    refused = better_explained_by_formula(search, effects, ())
    assert {one.name for one, _ in refused} == (set() if named_right else {one.name for one in effects})
    assert all(why.startswith("in place of load_friction a formula explains") for _, why in refused)


def test_a_spring_is_named_beside_a_formula_of_places_that_is_all_of_the_rest(twolinks, on_joint):
    rate = 0.6
    law = lambda t, q, qd, qdd: on_joint(1, rate * q[:, 1] + 0.5 * np.cos(4 * (q[:, 0] + q[:, 1])))  # noqa: E731
    found = analyse_gap(on_one_clock(twolinks.logs(law)), twolinks.base, None, SOME, simulate=False, words=False)
    (one,) = found.verdict.named
    assert (one.key, one.fitted_with) == (("spring", (1,)), "a cos(4 q2 + 4 q1)")
    assert abs(one.values["k1"] - rate) < 3 * one.std_errors["k1"]


def test_what_is_named_beside_a_formula_has_a_size_that_stands_by_its_told_errors(seen):
    """Each amplitude counts alone: those of a spring may be sure together and none of them known."""
    (one,) = seen.effects
    unsure = replace(one, std_errors=one.std_errors | {"a": abs(one.values["a"]) / 2.5, "b": np.inf}, z=40.0)
    assert weakly_determined([unsure, replace(one, fitted_with="a qd1")]) == []
    ((refused, why),) = weakly_determined([replace(unsure, fitted_with="a qd1")])
    assert refused.key == one.key
    assert why == "its size is not determined: 2.5 standard errors from zero, limit 3"


def test_what_a_formula_outdoes_is_a_part_only_beside_one_that_goes_with_other_motion(seen):
    (one,) = seen.effects
    part = replace(one, fitted_with="a cos(2 q2 + 2 q1) qd2 + b tau2 qd2")
    assert same_motion(part, "a sin(q2) qd2 + b cos(q2) qd2")
    assert not same_motion(part, "a sin(2 q2) |tau2| sign(qd2) + b cos(2 q2) |tau2| sign(qd2)")
    assert not same_motion(part, "")


#: Friction that follows the size of the speed [N m s/rad], half as large as what has no name.
FRICTION = 0.5


@pytest.fixture(scope="module")
def beside_larger(twolinks, on_joint):
    """Logs with a part jointly with a larger rest, which hides what the part gains where it is fitted alone."""
    law = lambda t, q, qd, qdd: on_joint(  # noqa: E731
        1, FRICTION * np.abs(qd[:, 1]) + np.sin(2 * q[:, 1]) * np.abs(qd[:, 1]) * np.sign(qd[:, 0])
    )
    return on_one_clock(twolinks.logs(law))


@pytest.fixture(scope="module")
def nothing_selected(twolinks, beside_larger):
    return replace(search_effects(beside_larger, twolinks.base, None, SOME), selected=[])


@pytest.mark.parametrize(("grown", "interval", "stays"), [(1.01, (0.97, 1.05), True), (1.05, (1.03, 1.07), False)])
def test_a_part_that_is_proved_beside_a_formula_may_gain_nothing_alone_but_not_make_its_joint_worse(
    twolinks, beside_larger, monkeypatch, grown, interval, stays
):
    real = analysis.held_out_improvement

    def hidden(first, search, effects):
        found = real(first, search, effects)
        if effects:
            found.after[1] = grown * found.before[1]
            found.ratio[1] = interval
        return found

    monkeypatch.setattr(analysis, "held_out_improvement", hidden)
    found = analyse_gap(beside_larger, twolinks.base, None, SOME, simulate=False, words=False)
    assert [one.key for one in found.verdict.named] == ([("asymmetric_viscous", (1,))] if stays else [])
    for one in found.verdict.named:
        assert abs(one.values["a"] - FRICTION) < 3 * one.std_errors["a"]
    assert stays or any("error of elbow on unseen data" in why for _, why in found.verdict.closest)


def test_an_effect_that_takes_no_part_is_no_rival_only_the_formula_that_was_found_beside_it(nothing_selected):
    found = explanations(nothing_selected, SOME, nothing_selected.problem.regression(), 1)
    named = [x for x in found if x.one is not None]
    assert {x.one.name for x in named} >= {"asymmetric_viscous"}
    assert all(x.takes_part for x in named)
    assert len(found) > len(named) + 1


@pytest.mark.parametrize(
    ("name", "shape", "terms"),
    [
        ("stribeck", {"vs": 0.1, "d": 1.0}, None),
        ("spring", {"order": 1.0, "constant": 0.0}, ["cos(4 q2 + 4 q1)", "cos(3 q2 + 3 q1)"]),
    ],
)
def test_a_name_that_cannot_stand_is_in_the_way_of_no_other(nothing_selected, monkeypatch, name, shape, terms):
    """A Stribeck hump, whose size such friction leaves open, and the slow part of a series over places.

    Either has the evidence of the right name and a little more.
    """

    def with_another(search, options, regression, joint):
        found = explanations(search, options, regression, joint)
        right = next(x for x in found if x.one is not None and x.one.name == "asymmetric_viscous")
        other = replace(right.one, effect=CATALOGUE[name], shape=shape)
        return [*found, replace(right, one=other, terms=terms or right.terms, score=right.score + 1)]

    monkeypatch.setattr("dynid.gap.with_formula.explanations", with_another)
    (one,) = parts_with_formulas(nothing_selected, SOME, [1])
    assert one.key == ("asymmetric_viscous", (1,))
