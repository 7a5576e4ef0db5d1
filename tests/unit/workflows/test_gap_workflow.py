"""The search called from Python: objects in, an object out that prints, is stored, and can be applied."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import twolink
from dynid import (
    Gap,
    GapOptions,
    PlanOptions,
    find_gap,
    identify,
    load_log,
    load_robot,
    plan_trajectory,
    validate,
)
from dynid.cli.session import plain
from dynid.errors import WrongUsage
from dynid.loading import load_run
from dynid.robot import Known
from dynid.workflows.gap import earlier_logs, joint_indices
from dynid.workflows.identify import save_result

EFFECTS = "spring,torque_offset,asymmetric_viscous"
STIFFNESS = 2.0


def log(plan, noise, spring=0.0):
    """A log of the two-link arm with a spring at its elbow [N m/rad]."""
    made = twolink.log(plan, 0.05, draw=noise)
    made.tau[:, 1] += spring * made.q[:, 1]
    return made


def twice(*plans, spring=0.0):
    """Each motion twice."""
    return [log(plan, 10 * plan + k, spring) for plan in plans for k in range(2)]


def rubbing(one, plan, friction):
    """The log with more Coulomb friction at the elbow."""
    _, _, qd, _ = twolink.motion(plan)
    more = np.stack([np.zeros(len(qd)), friction * np.tanh(qd[:, 1] / 0.01)], axis=1)
    return replace(one, tau=one.tau + more)


@pytest.fixture(scope="module")
def springy(arm):
    """Two motions, each twice, of an arm with a spring, and what is identified without one."""
    logs = twice(1, 2, spring=STIFFNESS)
    return logs, identify(arm, logs[::2], feasible=False)


@pytest.fixture(scope="module")
def gap(springy):
    logs, result = springy
    return find_gap(result, logs, effects=EFFECTS)


def test_what_was_hidden_is_named_with_its_size(gap):
    assert gap.verdict == "named"
    (one,) = gap.named
    assert (one.effect, one.joints, one.where) == ("spring", ("elbow",), "elbow")
    assert abs(one.values["k1"] - STIFFNESS) < 3 * one.std_errors["k1"]
    assert one.rms_after < 0.5 * one.rms_before


def test_it_prints_what_a_person_wants_to_see(gap):
    assert "spring or cable torque" in repr(gap)
    for text in (gap._repr_html_(), gap.summary()):
        assert "spring" in text
        assert "k1 = " in text
        assert "elbow (" in text
        assert "check the result on a new log" in text
    (row,) = gap.table()
    assert (row["effect"], row["where"], row["result"]) == ("spring", "elbow", "named")
    assert [row["joint"] for row in gap.joint_table()] == ["shoulder", "elbow"]
    assert gap.joint_table()[1]["rms after"] == gap.named[0].rms_after


def test_what_is_saved_reads_back_and_prints_the_same(gap, tmp_path):
    gap.save(tmp_path / "gap.npz")
    again = Gap.load(tmp_path / "gap.npz")
    assert repr(again) == repr(gap)
    assert again.summary() == gap.summary()
    facts, expected = plain(again.facts()), plain(gap.facts())
    read, judged = (each.pop("judgement") for each in (facts, expected))
    assert facts == expected
    # What is known of the arm beside the search is in other files.
    assert (read["sentence"], read["reasons"], read["lights"][-1]) == (
        judged["sentence"],
        judged["reasons"],
        judged["lights"][-1],
    )
    assert again.chosen("spring") == gap.named
    with pytest.raises(WrongUsage, match="read from a file"):
        again.apply()


def test_an_applied_effect_is_in_the_result_and_explains_another_log(gap, springy, tmp_path):
    logs, result = springy
    found = gap.apply(robot_file=tmp_path / "arm+spring.yaml")
    k = found.names.index("spring2_k1")
    assert abs(found.theta[k] - STIFFNESS) < 3 * found.std_error[k]
    assert load_robot(tmp_path / "arm+spring.yaml").effects == found.robot.effects
    assert found.log_sha256 == ("",) * 4
    unseen = log(3, 99, STIFFNESS)
    before, after = (validate(one, unseen) for one in (result, found))
    assert after.joints[1].rms < 0.5 * before.joints[1].rms
    assert find_gap(found, logs, effects=EFFECTS).verdict == "nothing_missing"


def test_effects_are_chosen_by_name_and_joint(gap):
    assert (
        gap.chosen()
        == gap.chosen("spring")
        == gap.chosen("spring@2")
        == gap.chosen("spring@elbow")
        == gap.named
    )
    with pytest.raises(WrongUsage, match="this was not found") as raised:
        gap.chosen("spring@1")
    assert raised.value.why == "found: spring@2"


def test_nothing_can_be_applied_where_nothing_is_named(result):
    found = find_gap(result, [log(1, 5), log(1, 6)], effects=EFFECTS)
    assert found.verdict == "nothing_missing"
    with pytest.raises(WrongUsage, match="no effect is named"):
        found.apply()


def test_logs_of_a_result_are_found_again_where_they_are_what_they_were(arm, tmp_path):
    paths = [tmp_path / f"{k}.npz" for k in range(2)]
    for k, path in enumerate(paths):
        log(1 + k, k).save(path)
    read = [load_log(path, arm) for path in paths]
    result = identify(arm, read)

    def there(new, ask):
        return [one.source for one in earlier_logs(result, [new], GapOptions(ask=ask))]

    assert there(log(3, 7), "auto") == paths
    assert there(read[0], "changed") == paths[1:], "a log is not compared with itself"
    log(1, 99).save(paths[0])
    assert there(log(3, 7), "auto") == paths[1:]


def test_joints_are_names_numbers_and_ranges():
    names = ("a", "b", "c", "3")
    assert joint_indices(names, "b", "--joints") == (1,)
    assert joint_indices(names, ["1-2", " c"], "--joints") == (0, 1, 2)
    assert joint_indices(names, "3", "--joints") == (3,), "a name goes before a number"
    assert joint_indices(names, ["2", "b"], "--joints") == (1,)
    for wrong in ("0", "5", "3-1", "d"):
        with pytest.raises(WrongUsage, match="--joints: no joint"):
            joint_indices(names, [wrong], "--joints")


@pytest.fixture(scope="module")
def before_and_after(arm):
    """Two motions twice, what is identified from them, and two other motions twice with more friction at the elbow."""
    old = twice(1, 2)
    new = [rubbing(one, plan, 0.3) for plan in (5, 6) for one in twice(plan)]
    return identify(arm, old), old, new


@pytest.mark.slow
def test_other_logs_are_asked_for_changes_first_which_are_applied_to_the_new_logs_alone(
    before_and_after,
):
    """The arm identified again from all logs keeps the friction that it had, and has the change beside it."""
    result, old, new = before_and_after
    found = find_gap(result, new, earlier=old)
    assert (found.question, found.mode, found.verdict) == ("changed", "frozen", "named")
    assert [(one.effect, one.indices) for one in found.named] == [("coulomb_change", (1,))]
    assert found.named[0].values["c"] == pytest.approx(0.3, rel=0.1)
    assert found.asked.startswith("what has changed since the model was identified?")
    applied = found.apply()
    values = dict(zip(applied.names, applied.theta, strict=True))
    assert values["coulomb_change2_c"] == pytest.approx(0.3, rel=0.1)
    assert values["fc2"] == pytest.approx(twolink.COULOMB[1], rel=0.1)
    assert len(applied.log_sha256) == len(old) + len(new)


@pytest.mark.slow
def test_where_nothing_has_changed_all_logs_are_searched_for_what_was_always_missing(arm):
    old, new = twice(1, 2, spring=STIFFNESS), twice(5, 6, spring=STIFFNESS)
    found = find_gap(identify(arm, old), new, effects=EFFECTS, earlier=old)
    assert (found.question, found.mode) == ("numbers", "refit")
    assert [one.effect for one in found.named] == ["spring"]
    assert f"all {len(old) + len(new)} logs" in found.asked
    assert len(found.recordings) == len(old) + len(new)


@pytest.mark.slow
def test_nothing_has_changed_is_another_sentence_than_nothing_is_missing(before_and_after):
    result, old, _ = before_and_after
    new = twice(5, 6)
    changed = find_gap(result, new, ask="changed", earlier=old)
    missing = find_gap(result, new, ask="numbers")
    assert (changed.verdict, missing.verdict) == ("nothing_changed", "nothing_missing")
    assert changed.judgement.sentence.startswith("No change since the model was identified")
    assert missing.judgement.sentence.startswith("No missing effect found")


def carried_logs():
    """Return logs of the arm with a counterbalance of 40 N m at its shoulder."""
    logs = twice(1, 2)
    for one in logs:
        one.tau[:, 0] -= 40.0 * np.cos(one.q[:, 0])
    return logs


@pytest.mark.slow
def test_a_counterbalance_is_not_told_from_heavier_links_until_their_mass_is_known(arm):
    logs, options = carried_logs(), GapOptions(effects=f"{EFFECTS},counterbalance")
    unknown = find_gap(identify(arm, logs[::2]), logs, options)
    assert not unknown.named
    assert (
        "A counterbalance on shoulder makes the links more plausible (without it, there is a link 1 of"
        in unknown.asked
    )
    assert "Give the mass of link 1 from the data sheet" in unknown.advice
    (one,) = [one for one in unknown.closest if one.effect == "counterbalance"]
    assert unknown.verdict == "unexplained", "an odd link is not nothing"
    assert one.values["b"] == pytest.approx(-40.0, abs=4 * one.std_errors["b"])
    assert "Likely effect on shoulder: counterbalance" in unknown.judgement.sentence
    known = Known(
        link_mass=tuple((k + 1, (0.8 * mass, 1.2 * mass)) for k, mass in enumerate(twolink.MASS))
    )
    (one,) = find_gap(identify(replace(arm, known=known), logs[::2]), logs, options).named
    assert (one.effect, one.joints) == ("counterbalance", ("shoulder",))


# ---------------------------------------------------------------- earlier logs, wherever the result is opened from
def in_folder(log, folder):
    """Write a log as a folder of text files, as a driver's recorder does."""
    folder.mkdir(parents=True)
    for name, values in (("time", log.t), ("position", log.q), ("torque", log.tau)):
        np.savetxt(folder / f"{name}.txt", values)
    return folder


def stored(arm, tmp_path, monkeypatch):
    """A result in a folder of its own, identified from two logs in folders, with paths relative to where one stood."""
    monkeypatch.chdir(tmp_path)
    paths = [in_folder(log(plan, plan), tmp_path / "logs" / f"run{plan}") for plan in (1, 2)]
    given = [path.relative_to(tmp_path) for path in paths]
    save_result(tmp_path / "out" / "arm", identify(arm, given))
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    monkeypatch.chdir(elsewhere)
    return load_run(tmp_path / "out" / "arm")


def test_earlier_logs_are_found_in_folders_and_from_another_working_folder(
    arm, tmp_path, monkeypatch
):
    result = stored(arm, tmp_path, monkeypatch)
    there = earlier_logs(result, [], GapOptions())
    assert [len(each) for each in there] == [len(log(1, 1)), len(log(2, 2))]


@pytest.mark.slow
def test_nothing_is_never_said_of_a_model_that_misses_more_than_it_expected(
    arm, tmp_path, monkeypatch
):
    """The earlier logs are gone, and new numbers for all parameters take in a load of 2 kg at the elbow's link."""
    result = stored(arm, tmp_path, monkeypatch)
    for file in (tmp_path / "logs").rglob("*.txt"):
        file.unlink()
    heavier = 0.3 * twolink.torque(*twolink.motion(3)[1:])
    loaded = [replace(one, tau=one.tau + heavier) for one in twice(3)]
    found = find_gap(result, loaded, effects="payload,spring")
    assert not found.verdict.startswith("nothing")
    assert found.kept > 3 * found.expected
    assert not found.judgement.sentence.startswith(("No missing effect", "No change"))


# ---------------------------------------------------------------- numbers shown are numbers reproduced
HIDDEN = {
    "spring": lambda q, qd, tau: 2.0 * q[:, 1],
    "asymmetric_viscous": lambda q, qd, tau: 0.8 * np.abs(qd[:, 1]),
    "load_friction": lambda q, qd, tau: 0.08 * np.abs(tau[:, 1]) * np.tanh(qd[:, 1] / 0.01),
    "torque_ripple": lambda q, qd, tau: 0.8 * np.cos(12.0 * q[:, 1]),
}


@pytest.mark.parametrize(
    "effect",
    [pytest.param(name, marks=[pytest.mark.slow] * (name != "load_friction")) for name in HIDDEN],
)
def test_the_error_after_is_that_of_apply_and_then_validate_on_the_log_held_out(arm, effect):
    logs = []
    for plan in (1, 2, 3):
        _, q, qd, qdd = twolink.motion(plan)
        added = HIDDEN[effect](q, qd, twolink.torque(q, qd, qdd))
        for k, one in enumerate(twice(plan)):
            one.tau[:, 1] += added
            logs.append(replace(one, source=Path(f"run{plan}{k}.csv")))
    found = find_gap(identify(arm, logs[:4], feasible=False), logs, effects=effect)
    assert [one.effect for one in found.named] == [effect]
    assert len(found.unseen_logs) == 2
    applied = found.apply()
    replays = [validate(applied, each, cutoff=found.signals.cutoff) for each in found.unseen_logs]
    for j in range(2):
        rms = np.sqrt(np.mean([each.joints[j].rms ** 2 for each in replays]))
        np.testing.assert_allclose(found.improvement.after[j], rms, rtol=1e-3)
    assert found.named[0].rms_after == found.improvement.after[1]


@pytest.mark.slow
def test_what_happened_once_is_told_with_the_option_that_leaves_it_out(arm):
    """A bump of 15 N m at 7 s of one of four runs."""
    logs = twice(1, 2)
    bump = 15.0 * np.exp(-(((logs[1].t - 7.0) / 0.15) ** 2))
    hit = logs[1].tau + np.column_stack([0.0 * bump, bump])
    logs = [replace(each, source=Path(f"run{k}.csv")) for k, each in enumerate(logs)]
    logs[1] = replace(logs[1], tau=hit)
    found = find_gap(identify(arm, logs, feasible=False), logs, effects=EFFECTS)
    event = found.events[0]
    assert event.joint == "elbow"
    assert event.log == "run1.csv"
    assert event.start < 7.0 < event.end
    assert found.judgement.sentence.startswith("A disturbance that does not repeat")
    again = next(x.command for x in found.judgement.steps if "--exclude" in x.command)
    assert all(f"run{k}.csv" in again for k in range(4)), "no log is lost"
    ends = [float(x) for x in again.rpartition("--exclude ")[2].split("-")]
    assert ends == pytest.approx([event.start, event.end], abs=0.06)


# ---------------------------------------------------------------- the next experiment
@pytest.fixture(scope="module")
def base(gap):
    return gap.searched.base


def left_open(gap, *rivals, verdict="ambiguous"):
    """The search as it would be if these fitted as well as its spring, and the elbow alone showed a gap."""
    spring = replace(
        gap.named[0],
        sizes=(
            ("k1", 3.0, 0.1, "N m/rad"),
            ("c", 0.2, 0.1, "N m"),
            ("order", 1.0, 0.0, ""),
            ("constant", 1.0, 0.0, ""),
        ),
        rival_keys=tuple((effect, (1,)) for effect in rivals),
    )
    pairs = zip(gap.joints, (1.0, 3.0), strict=True)
    joints = tuple(replace(joint, chi=chi) for joint, chi in pairs)
    return replace(gap, named=(spring,), verdict=verdict, joints=joints)


def planned(base, record):
    options = PlanOptions(alpha=1.0, duration=6.0, segments=4, restarts=1, floor=None)
    return plan_trajectory(base.robot, options, base=base, for_gap=record)


def test_the_planned_motion_promises_to_tell_every_pair_apart_that_was_not(gap, base, tmp_path):
    left_open(gap, "counterbalance", "end_stop").save(tmp_path / "gap.npz")
    plan = planned(base, tmp_path / "gap.npz")
    assert [text.split(" on ")[0] for text in plan.outlook] == ["spring", "spring"]
    for text, rival in zip(plan.outlook, ("counterbalance", "end_stop"), strict=True):
        assert rival in text
        assert ("gap", text) in plan.lines()
    assert "will be separated" in plan.outlook[0]
    assert plan.facts()["outlook"] == list(plan.outlook)


def test_a_search_that_left_nothing_open_or_was_of_another_arm_asks_for_no_motion(gap, base):
    with pytest.raises(WrongUsage, match="left no question"):
        planned(base, left_open(gap, verdict="named"))
    with pytest.raises(WrongUsage, match="joints differ"):
        planned(base, replace(left_open(gap, "end_stop"), joint_names=("x", "y")))


def test_what_nothing_explains_is_looked_for_by_the_usual_motion(gap, base):
    plan = planned(base, left_open(gap, verdict="unexplained"))
    assert plan.outlook == ()
    assert plan.search["ended"] == "all starts"
