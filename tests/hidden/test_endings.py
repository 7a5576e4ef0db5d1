"""Each ending of ``dynid gap`` on logs from a generator that shares no code with the search (Pinocchio, other laws)."""

from pathlib import Path

import pytest
from logs_of_arms import logs_of, model_of, sources_of

import hidden_effects as hidden
from dynid.estimation.estimate import estimate
from dynid.estimation.stack import stack_logs
from dynid.gap.analysis import analyse_gap
from dynid.gap.candidates import SelectionOptions
from dynid.gap.problem import kept_model
from dynid.gap.verdict import labels

pytestmark = pytest.mark.slow

ARM = "lwr4plus"
SECONDS = 15.0


def look(effects, size, seed, arm=ARM, seconds=SECONDS, **options):
    base = model_of(arm)
    logs, cases = logs_of(effects, size, arm, seed, seconds=seconds, **options)
    sources = sources_of(logs, base.model)
    seen = analyse_gap(sources, base, None, SelectionOptions(), simulate=False)
    return seen, base, cases


def named(seen):
    return {(f.name, f.joints) for f in seen.verdict.named}


def test_nothing_hidden_is_called_nothing_missing():
    seen, _, _ = look([("torque_offset", 2)], 0.0, 21)
    assert seen.verdict.word == "nothing_missing"
    assert seen.verdict.named == ()
    assert "residual of every joint is at its noise" in seen.verdict.advice


def test_two_effects_on_two_joints_are_both_named():
    seen, _, _ = look([("asymmetric_viscous", 1), ("position_friction", 3)], 2.5, 23)
    assert named(seen) == {("asymmetric_viscous", (1,)), ("position_friction", (3,))}


def test_a_delay_is_measured_and_taken_out():
    seen, _, _ = look([("torque_delay", 1)], 2.0, 24)
    assert named(seen) == {("torque_delay", ())}
    assert seen.verdict.named[0].values["delay"] == pytest.approx(0.008, rel=0.05)


def test_an_effect_outside_the_catalogue_is_unexplained_and_gets_no_name():
    seen, _, _ = look([("ringing", 3)], 4.0, 25)
    assert seen.verdict.word == "unexplained"
    assert named(seen) == set()
    assert "lwr_3_joint" in seen.verdict.advice


def test_contacts_that_do_not_repeat_are_called_so():
    seen, _, _ = look([("contacts", 2)], 4.0, 26)
    assert seen.verdict.word == "unexplained"
    assert seen.search.problem.noise.unrepeatable == [2]
    assert "lwr_2_joint" in seen.verdict.advice
    assert "did not repeat" in seen.verdict.advice


def test_the_same_motion_before_tells_a_change_from_what_was_missing_already():
    """The model has lacked position friction on joint 4 all along; on joint 2 Coulomb friction grows."""
    base, lacking = model_of(ARM), ("position_friction", 3)
    before, now = (
        logs_of(effects, 2.0, ARM, 33, seconds=SECONDS, trajectories=2)[0]
        for effects in ([lacking], [lacking, ("coulomb_change", 1)])
    )
    earlier, same, new = (sources_of(x, base.model) for x in (before[::2], before[1::2], now[1::2]))
    fit = estimate(stack_logs(earlier, base), base, method="wls", holdout=None)
    for logs, changes in ((new, {("coulomb_change", (1,))}), (same, set())):
        known, some = kept_model(fit), SelectionOptions()
        seen = analyse_gap(logs, base, known, some, simulate=False, earlier=earlier)
        assert seen.problem.same_motion
        assert named(seen) == changes


def test_joints_that_always_move_together_make_their_coupling_ambiguous(monkeypatch):
    """Joint 3 is dragged along by joint 4, but joint 2 moves just as joint 4 does."""
    free = hidden.sines

    def together(arm, seconds, rng):
        f, size, phase = free(arm, seconds, rng)
        f[1], size[1], phase[1] = f[3], size[3], phase[3]
        return f, size, phase

    monkeypatch.setattr(hidden, "sines", together)
    tracked = hidden.motion
    monkeypatch.setattr(
        hidden, "motion", lambda arm, plan, t, rng: tracked(arm, plan, t, rng, 1e-5)
    )
    seen, base, cases = look([("joint_coupling", 2)], 2.0, 31)
    assert hidden.partner(cases[0], 7) == 3
    assert seen.verdict.word == "ambiguous"
    one = seen.verdict.named[0]
    assert {one.joints, *(joints for _, joints in one.rivals)} == {(2, 1), (2, 3)}
    assert seen.verdict.advice == (
        f"To tell {' and '.join(labels(one, base.robot.joint_names))} apart: move the two joints one after the other."
    )


def test_without_repeats_the_floor_is_a_bound_and_clean_logs_still_get_no_name():
    seen, _, _ = look([("torque_offset", 2)], 0.0, 29, repeats=1)
    assert seen.problem.noise.repeats == 0
    assert named(seen) == set()
    assert "lower bound" in seen.verdict.advice


def test_a_spring_whose_other_form_fits_as_well_is_named_through_lost_samples():
    """Linear and cubic spring have columns of different number here, and evidence that hardly differs."""
    arm, seed = "kinova_gen2", 4011982
    seen, _, _ = look([("spring", 4)], 1.5, seed, arm=arm, seconds=20.0, drop_outs=True)
    assert named(seen) == {("spring", (4,))}


def test_generator_and_catalogue_share_no_code():
    text = Path(hidden.__file__).read_text(encoding="utf-8")
    assert "import dynid" not in text
    assert "from dynid" not in text
