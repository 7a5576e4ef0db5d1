"""What is said of what was found: each ending and each reason to withhold a name, from inputs made for it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from dynid.gap.selected_effects import SelectedEffect
from dynid.gap.verdict import NOT_SMALLER, SMALL_DELAY, judge, refusal
from dynid.model.effects.catalogue import CATALOGUE

JOINTS = ("a", "b", "c")


def effect(name="spring", joints=(1,), size=2.0, chow=0.5, rivals=(), joint=None):
    test = SimpleNamespace(
        joint=(joints or (1,))[0] if joint is None else joint, visible_rms=size, chow_p_value=chow
    )
    return SelectedEffect(CATALOGUE[name], joints, {}, test, 100.0, rivals)


def search(
    before=(1.0, 5.0, 1.0),
    after=(1.0, 1.05, 1.0),
    between=None,
    repeats=20.0,
    unrepeatable=(),
    delay=0.0,
    matched=0.0,
    since=False,
    pooled=False,
):
    """A search on three joints whose gap is on joint b, and closed."""
    filter_ = SimpleNamespace(filter=SimpleNamespace(rate=200.0))
    noise = SimpleNamespace(repeats=repeats, unrepeatable=list(unrepeatable), misfit=())
    segments = [SimpleNamespace(log=filter_)]
    problem = SimpleNamespace(
        noise=noise, matched=matched, segments=segments, pooled=pooled, since=since, arm=None
    )
    between = after if between is None else between
    return SimpleNamespace(
        problem=problem,
        before=np.array(before),
        after=np.array(after),
        between_reversals=np.array(between),
        delay=delay,
        rest=None,
        strays=(),
    )


def said(found, *fitted, ratio=0.8, withdrawn=()):
    improvement = SimpleNamespace(ratio=np.tile([0.5, ratio], (3, 1)))
    reasons = [(one, refusal(found, fitted, one, improvement)) for one in fitted]
    refused = [
        *((one, why) for one, why in reasons if why),
        *((one, NOT_SMALLER) for one in withdrawn),
    ]
    return judge(found, [one for one, why in reasons if not why], refused, JOINTS)


def reason(found, *fitted, **options):
    """Return why the first effect is not named; it must not be."""
    verdict = said(found, *fitted, **options)
    return next(why for one, why in verdict.closest if one is fitted[0])


def test_what_passes_everything_is_named():
    verdict = said(search(), effect())
    assert (verdict.word, [one.name for one in verdict.named], verdict.remainder) == (
        "named",
        ["spring"],
        (),
    )
    assert (
        verdict.advice
        == "Add it with --apply, then check the result on a new log with dynid validate."
    )


def test_what_is_left_on_other_joints_is_told_beside_a_name():
    verdict = said(search(after=(1.0, 1.05, 1.6)), effect())
    assert (verdict.word, verdict.remainder) == ("named", (2,))
    assert "More is missing on c." in verdict.advice


def test_nothing_is_missing_where_nothing_is_above_the_noise():
    verdict = said(search(before=(1.0, 1.2, 1.0), after=(1.0, 1.2, 1.0)))
    assert verdict.word == "nothing_missing"
    assert verdict.advice == "The residual of every joint is at its noise."


@pytest.mark.parametrize(
    ("chi", "between", "repeats", "word"),
    [
        (1.24, 1.24, 20.0, "nothing_missing"),
        (1.26, 1.26, 20.0, "unexplained"),
        (1.55, 1.20, 20.0, "nothing_missing"),  # more at reversals, which are known less well
        (1.58, 1.20, 20.0, "unexplained"),
        (1.95, 1.95, 0.0, "nothing_missing"),  # the floor is only a lower bound
        (2.05, 2.05, 0.0, "unexplained"),
        (2.45, 1.95, 0.0, "nothing_missing"),
        (2.55, 1.95, 0.0, "unexplained"),
    ],
)
def test_how_much_may_be_left_depends_on_reversals_and_on_how_well_the_noise_is_known(
    chi, between, repeats, word
):
    verdict = said(
        search(before=(1, chi, 1), after=(1, chi, 1), between=(1, between, 1), repeats=repeats)
    )
    assert verdict.word == word
    assert ("lower bound" in verdict.advice) == (repeats == 0)


def test_what_the_same_motion_measured_is_no_lower_bound():
    found = search(before=(1, 1, 1), after=(1, 1, 1), repeats=0.0, matched=1.0)
    assert "lower bound" not in said(found).advice


def test_a_gap_without_a_candidate_is_unexplained():
    verdict = said(search(after=(1.0, 5.0, 1.0)))
    assert (verdict.word, verdict.remainder) == ("unexplained", (1,))
    assert verdict.advice.startswith("No effect of the catalogue explains it. where.png shows")


def test_what_does_not_repeat_is_unexplained_and_told():
    verdict = said(search(before=(1, 1.5, 1), after=(1, 1.1, 1), unrepeatable=[1]))
    assert verdict.word == "unexplained"
    assert verdict.advice.startswith("The disturbance of b does not repeat")


def test_what_repeats_and_is_larger_is_not_called_unrepeatable():
    assert (
        said(search(before=(1, 2.5, 1), after=(1, 1.0, 1), unrepeatable=[1]), effect()).word
        == "named"
    )


def test_rivals_make_it_ambiguous_and_the_advice_tells_them_apart():
    verdict = said(search(), effect(rivals=(("end_stop", (1,)),)))
    assert (verdict.word, verdict.alternatives) == ("ambiguous", (("spring", "end_stop"),))
    assert verdict.advice.startswith("To tell spring on b and end_stop on b apart: ")
    assert CATALOGUE["spring"].separate in verdict.advice


def test_the_same_effect_on_other_joints_is_ambiguous_too():
    one = effect("joint_coupling", (1, 0), rivals=(("joint_coupling", (1, 2)),))
    verdict = said(search(), one)
    assert (verdict.word, verdict.alternatives) == ("ambiguous", (("joint_coupling",),))
    assert "joint_coupling on b from a and joint_coupling on b from c" in verdict.advice


def test_most_of_the_gap_must_be_explained():
    """70 % by one name on a joint, 85 % by two, 92 % by three; or hardly anything is left."""
    assert (
        reason(search(after=(1, 2.3, 1)), effect())
        == "it explains only 67 % of the gap of this joint, limit 70 %"
    )
    assert said(search(after=(1, 2.1, 1)), effect()).named
    two = (effect(), effect("torque_ripple"))
    assert (
        reason(search(after=(1, 1.7, 1)), *two)
        == "it explains only 82 % of the gap of this joint, limit 85 %"
    )
    assert len(said(search(after=(1, 1.5, 1)), *two).named) == 2
    three = (*two, effect("load_friction"))
    assert (
        reason(search(after=(1, 1.4, 1)), *three)
        == "it explains only 90 % of the gap of this joint, limit 92 %"
    )
    assert said(search(before=(1, 1.2, 1), after=(1, 1.09, 1)), effect()).named, (
        "a tenth of the noise may be left"
    )


def test_the_closest_candidate_is_told_with_the_reason():
    verdict = said(search(after=(1, 3.0, 1)), effect())
    assert verdict.word == "unexplained"
    assert (
        "The closest candidate is spring: it explains only 50 % of the gap of this joint, limit 70 %."
        in verdict.advice
    )


def test_what_differs_between_parts_of_the_logs_gets_no_name():
    assert reason(search(), effect(chow=5e-4)) == "its size differs between parts of the logs"


def test_what_is_smaller_than_disturbances_that_do_not_repeat_gets_no_name():
    found = search(before=(1, 1.8, 1), unrepeatable=[1])
    assert reason(found, effect(size=0.9)) == "the disturbance of this joint does not repeat"
    assert said(found, effect(size=1.1)).named


def test_a_small_companion_of_the_same_kind_is_the_shape_of_the_larger():
    large, small = effect("stribeck", size=4.0), effect("nonlinear_viscous", size=0.9)
    assert large.effect.family == small.effect.family
    assert (
        reason(search(), small, large) == "it is probably part of a larger effect of the same kind"
    )
    assert len(said(search(), effect("nonlinear_viscous", size=1.1), large).named) == 2


def test_a_trace_beside_a_much_larger_effect_gets_no_name():
    large = effect("torque_ripple", size=10.0)
    why = "it is small and may be a remainder of a much larger effect on this joint"
    assert reason(search(), effect(size=1.1), large) == why
    assert len(said(search(), effect(size=1.3), large).named) == 2


def test_what_does_not_shrink_the_held_out_gap_gets_no_name():
    assert reason(search(), effect(), ratio=1.01) == f"{NOT_SMALLER} (-50 to +1 %)"


def with_shape(name, values, errors, z=20.0):
    return replace(effect(name), shape={}, values=values, std_errors=errors, z=z)


def test_a_size_whose_interval_holds_zero_gets_no_name():
    vague = with_shape("nonlinear_viscous", {"a": 53.0, "p": 2.5}, {"a": 530.0, "p": 0.1}, z=0.1)
    assert (
        reason(search(), vague)
        == "its size is not determined: 0.1 standard errors from zero, limit 3"
    )


def test_a_shape_whose_interval_holds_what_the_model_has_gets_no_name():
    linear = with_shape("nonlinear_viscous", {"a": 5.0, "p": 0.96}, {"a": 0.5, "p": 0.39})
    why = "p = 0.96 +- 0.39 may be 1, and with 1 the effect is in the model already"
    assert reason(search(), linear) == why
    assert said(
        search(), with_shape("nonlinear_viscous", {"a": 5.0, "p": 1.9}, {"a": 0.5, "p": 0.2})
    ).named


def test_a_shape_that_is_not_determined_gets_no_name_and_one_that_is_held_does():
    drift = with_shape("warmup_friction", {"tw": 90.0}, {"tw": 80.0})
    assert (
        reason(search(), drift)
        == "its tw is not determined: 1.1 standard errors from zero, limit 3"
    )
    held = with_shape("torque_drift", {"a": 0.1, "tc": 1e6}, {"a": 0.01, "tc": float("inf")})
    assert said(search(), held).named


def test_no_name_for_a_load_that_no_body_has():
    table = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
    for izz, word in ((0.01, "named"), (0.03, "unexplained")):  # Izz <= Ixx + Iyy of any body
        body = dict(zip(table, (1.0, 0, 0, 0, 0.01, 0, 0, 0.01, 0, izz), strict=True)) | {
            "form": 10.0
        }
        assert said(search(), with_shape("payload", body, {})).word == word
        taken_off = {name: value if name == "form" else -value for name, value in body.items()}
        assert said(search(), with_shape("payload", taken_off, {})).word == word


def test_what_was_withdrawn_is_listed_with_its_reason():
    verdict = said(search(), withdrawn=[effect()])
    assert verdict.word == "unexplained"
    assert [(one.name, why) for one, why in verdict.closest] == [("spring", NOT_SMALLER)]


def test_a_delay_below_the_sampling_is_not_missing():
    small = said(search(before=(1, 1, 1), after=(1, 1, 1), delay=0.001), effect("torque_delay", ()))
    assert (small.word, [why for _, why in small.closest]) == ("nothing_missing", [SMALL_DELAY])
    large = said(search(delay=-0.002), effect("torque_delay", ()))
    assert [one.name for one in large.named] == ["torque_delay"]


def test_nothing_has_changed_where_that_was_asked():
    verdict = said(search(before=(1, 1, 1), after=(1, 1, 1), since=True))
    assert verdict.word == "nothing_changed"
    assert verdict.advice.startswith("These logs show no change.")


def test_a_refused_name_is_no_change_where_old_and_new_logs_agree(monkeypatch):
    """Whether anything has changed the logs of both say themselves; what was tried and failed is listed."""
    pooled = search(unrepeatable=[0], since=True, pooled=True)
    for joints, word, said_first in (
        ((), "nothing_changed", "These logs show no change."),
        ((1,), "unexplained", "The disturbance of a"),
    ):
        monkeypatch.setattr(
            "dynid.gap.verdict.still_changed", lambda search, named, joints=joints: joints
        )
        verdict = said(pooled, withdrawn=[effect()])
        assert (verdict.word, verdict.remainder, len(verdict.closest)) == (word, joints, 1)
        assert verdict.advice.startswith(said_first)
