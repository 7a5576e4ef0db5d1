"""What is said of a model agrees with all that is known of it, whatever that is."""

import random
from dataclasses import fields, replace

import numpy as np

from dynid.judgement import tuning
from dynid.judgement.evidence import (
    Change,
    Evidence,
    JointEvidence,
    Unseen,
    unseen_state,
)
from dynid.judgement.gap import Event, GapEffect, GapRecord, HeldOutImprovement
from dynid.judgement.rules import judge
from judgement import contradictions

#: From best to worst; a light that nothing stands behind praises less than a good one.
RANK = {"good": 0, "open": 1, "fair": 2, "bad": 3}
SEEDS = range(400)
NAMES = ("shoulder", "elbow", "wrist")
#: Joints that a model predicts nearly to their noise.
JOINTS = tuple(JointEvidence(name, "N m", 10.0, 0.05, 0.04) for name in NAMES)


def every_seed(test):
    """Run a test with all seeds; the one that fails is in its message."""

    def of_all():
        for seed in SEEDS:
            try:
                test(seed)
            except AssertionError as error:
                raise AssertionError(f"seed {seed}: {error}") from error

    of_all.__name__ = test.__name__
    return of_all


def positive(rng, low=1e-3, high=1e2):
    return low * (high / low) ** rng.random()


#: What words and lists of a random evidence are drawn from, by the name of their field.
WORDS = {
    "asked": ("result", "replay", "gap", "change"),
    "robot": ("my_arm.yaml",),
    "result": ("", "out/my_arm/parameters.npz", "out/with space/parameters.npz"),
    "logs": ((), ("a.bag",), ("a.bag", "b c.bag")),
    "doubts": ((), (), ("W404",)),
    "alarms": ((), (), (), ("W329",)),
    "earlier": ("", "january"),
    "earlier_result": ("", "out/january/parameters.npz"),
    "tolerance": (None, 0.01),
    "open": range(20),
    "question": ("numbers", "arm", "changed"),
    "more": ((), ("elbow",)),
    "not_repeatable": ((), (), ("wrist",)),
    "events": ((), (), (Event("run.bag", "elbow", 14.0, 14.4, 15.0),)),
    "changes": (
        None,
        (),
        (),
        (Change("m3", 1.0, 2.0, p_value=1e-5),),
        (Change("m3", 1.0, 2.0),) * 3,
    ),
    "log": ("run.bag",),
    "name": ("run.bag",),
}


def some(kind, rng, **own):
    """Return random evidence of a kind; what may be unknown is so at times."""
    for each in fields(kind):
        if each.name in own:
            continue
        if each.name in WORDS:
            value = rng.choice(WORDS[each.name])
        elif "bool" in each.type:
            value = rng.random() < 0.5
        elif "float" not in each.type:
            continue
        elif "tuple" in each.type:
            value = tuple(positive(rng) for _ in NAMES) if rng.random() < 0.8 else ()
        else:
            value = positive(rng, 1e-3, 1 if each.name == "known" else 1e2)
        unknown = "None" in each.type and rng.random() < 0.2
        own[each.name] = None if unknown else value
    return kind(**own)


def some_effect(rng, named):
    return GapEffect(
        effect="stribeck",
        title="Stribeck friction",
        where="elbow",
        sizes=(("fs", positive(rng), rng.choice((None, positive(rng))), "N m"),),
        joint="elbow",
        rms_before=positive(rng),
        rms_after=positive(rng) if named else None,
        probability=rng.choice((None, positive(rng, 1e-3, 1.0))),
    )


def errors_of(before, after, noise):
    """Return held-out errors of joints, and their noise."""
    before, after, noise = (np.array(each) for each in (before, after, noise))
    return HeldOutImprovement(before, after, np.zeros((len(noise), 2)), noise, 0.0 * noise)


def some_gap(rng):
    named = (some_effect(rng, True),) * rng.choice((0, 0, 1, 2))
    verdict = rng.choice(("named", "named", "ambiguous") if named else ("unexplained",))
    return GapRecord(
        question=rng.choice(WORDS["question"]),
        verdict=verdict,
        named=named,
        closest=(some_effect(rng, False),) * rng.choice((0, 0, 1)),
        joint_names=NAMES,
        improvement=errors_of(*([positive(rng) for _ in NAMES] for _ in range(3))),
        not_repeatable=rng.choice(WORDS["not_repeatable"]),
        logs=rng.choice(WORDS["logs"]),
        repeats=rng.choice((0.0, 20.0)),
        more=rng.choice(WORDS["more"]),
        kept=rng.choice((None, positive(rng))),
        expected=rng.choice((None, positive(rng))),
        events=rng.choice(WORDS["events"]),
        flags=rng.choice(WORDS["logs"]),
    )


def some_evidence(seed):
    rng = random.Random(seed)
    joints = tuple(
        some(JointEvidence, rng, joint=name, torque=positive(rng), fitted=positive(rng))
        for name in NAMES
    )
    return some(
        Evidence,
        rng,
        joints=joints,
        physical=rng.random() < 0.5,
        unseen=tuple(some(Unseen, rng) for _ in range(rng.choice((0, 1, 1, 2)))),
        gap=rng.choice((None, *[some_gap(rng)] * 4)),
    )


def worse(evidence, seed):
    """Return the same evidence with one error larger, or one fact more that speaks against the model."""
    rng, gap = random.Random(seed), evidence.gap
    choices = [
        {"alarms": ("W329",)},
        {"doubts": ("W404", "W405")},
        {"physical": False},
    ]
    factors = {"possible": 3, "fitted": 3, "known": 1 / 3}
    for name, factor in factors.items():
        value = getattr(evidence, name)
        choices += [{name: factor * value}] if value is not None else []
    joints = list(evidence.joints)
    k = rng.randrange(len(NAMES))
    joints[k] = replace(joints[k], fitted=3 * joints[k].fitted)
    choices.append({"joints": tuple(joints)})
    if evidence.unseen:
        first, *rest = evidence.unseen
        factor = positive(rng, 1.0, 30.0)
        rms = tuple(factor * x for x in first.rms)
        choices.append({"unseen": (replace(first, percent=factor * first.percent, rms=rms), *rest)})
    if gap is not None:
        more = [
            {"improvement": replace(gap.improvement, before=3 * gap.improvement.before)},
            {"named": (*gap.named, some_effect(rng, True))},
            {"more": NAMES},
            {"not_repeatable": NAMES},
            *([{"kept": 3 * gap.kept}] if gap.kept is not None else []),
        ]
        choices += [{"gap": replace(gap, **each)} for each in more]
    return replace(evidence, **rng.choice(choices))


@every_seed
def test_more_error_makes_no_light_better(seed):
    evidence = some_evidence(seed)
    for k in range(5):
        other = worse(evidence, 1000 * seed + k)
        for before, after in zip(judge(evidence).lights, judge(other).lights, strict=True):
            assert RANK[after.state] >= RANK[before.state], (before, after)


@every_seed
def test_a_light_is_no_better_than_the_worst_fact_that_it_covers(seed):
    evidence = some_evidence(seed)
    judged = judge(evidence)
    for unseen in evidence.unseen:
        state = unseen_state(unseen, evidence)
        if state != "good":
            assert RANK[judged.light("unseen motion").state] >= RANK[state]
    if evidence.alarms:
        assert judged.light("fit").state == "bad"
    for field in fields(evidence):
        # Facts alone give what all of them together may not improve.
        if field.name in ("possible", "plain", "joints", "unseen"):
            continue
        alone = replace(Evidence(), **{field.name: getattr(evidence, field.name)})
        for one, whole in zip(judge(alone).lights, judged.lights, strict=True):
            if one.state != "open":
                assert RANK[whole.state] >= RANK[one.state], field.name


@every_seed
def test_nothing_is_missing_only_where_every_joint_is_at_its_noise_and_the_model_as_good_as_expected(
    seed,
):
    evidence = replace(some_evidence(seed), asked="gap")
    judged = judge(evidence)
    says = judged.sentence.startswith(("No missing effect", "No change since"))
    gap = evidence.gap
    if says and gap is not None:
        assert not gap.named
        assert not gap.likely
        assert not gap.more
        most = tuning.MISSING[not gap.repeats]
        assert np.all(gap.improvement.before <= most * gap.improvement.allowed)
        assert not (gap.kept and gap.expected) or gap.kept <= tuning.EXPECTED[0] * gap.expected
        assert judged.light("complete").state == "good"


@every_seed
def test_every_light_that_is_not_green_has_a_next_step_whose_command_can_be_pasted(seed):
    judged = judge(some_evidence(seed))
    covered = {name for step in judged.steps for name in step.lights}
    assert {light.name for light in judged.lights if light.state != "good"} <= covered
    assert all(step.command.startswith("dynid ") for step in judged.steps)
    assert len({step.command for step in judged.steps}) == len(judged.steps)


def test_a_wrist_that_misses_much_of_a_small_torque_does_not_make_the_arm_useless():
    shoulder = JointEvidence("shoulder", "N m", 40.0, 0.5, 0.4, 176.0)
    wrist = JointEvidence("wrist", "N m", 0.6, 0.14, 0.02, 38.0)
    judged = judge(Evidence(joints=(shoulder, wrist), fitted=1.8))
    assert judged.light("fit").state == "fair"
    assert not judged.sentence.startswith("Do not use")
    wrong = judge(Evidence(joints=(shoulder, replace(wrist, fitted=1.2)), fitted=2.6))
    assert wrong.light("fit").state == "bad"


def test_a_search_says_nothing_of_a_replay_that_it_has_not_seen():
    joints = (JointEvidence("a", "N m", 10.0, 0.1, 0.09),)
    loaded = Unseen("loaded.bag", 26.0, (2.6,), False, 1.4, True, "loaded.bag")
    gap = GapRecord(
        question="numbers",
        joint_names=("a",),
        improvement=errors_of([0.1], [0.1], [0.09]),
        logs=("other.bag",),
    )
    known = Evidence(result="out/arm/parameters.npz", joints=joints, unseen=(loaded,), gap=gap)
    judged = judge(known)
    assert judged.light("complete").state == "fair"
    assert judged.steps[0].command == "dynid gap out/arm loaded.bag"
    assert judge(replace(known, asked="gap")).sentence == (
        "These logs show no missing effect, but loaded.bag was not searched: relative torque error 26 % there."
    )


@every_seed
def test_no_two_statements_contradict_each_other(seed):
    assert contradictions({"it": {"judgement": judge(some_evidence(seed)).facts()}}) == []


def held_out_beside(replays):
    """Return what is said of a model whose half missed much of another motion, after replays of the whole model."""
    held = Unseen("b.csv (held out, another motion)", 39.0, (3.9, 3.9, 3.9))
    return judge(
        Evidence(joints=JOINTS, fitted=0.5, unseen=(held, *replays), known=0.9, physical=True)
    )


def test_what_the_model_in_force_predicts_counts_more_than_what_a_model_of_half_the_logs_missed():
    assert held_out_beside(()).light("unseen motion").state == "bad"
    right = Unseen("c.csv", 0.5, (0.05, 0.05, 0.05), replayed=True, log="c.csv")
    assert held_out_beside((right,)).light("unseen motion").state == "fair"
    # The fitted motion again shows nothing of others, and a replay that is wrong is as bad as before.
    assert (
        held_out_beside((replace(right, same_motion=True),)).light("unseen motion").state == "bad"
    )
    wrong = Unseen("c.csv", 39.0, (3.9, 3.9, 3.9), replayed=True, log="c.csv")
    assert held_out_beside((right, wrong)).light("unseen motion").state == "bad"


def test_torques_that_are_proved_are_not_bad_because_no_arm_has_such_links():
    right = Unseen("c.csv", 0.5, (0.05, 0.05, 0.05), replayed=True, log="c.csv")
    known = Evidence(
        joints=JOINTS,
        fitted=0.5,
        unseen=(right,),
        known=0.9,
        physical=True,
        possible=12.0,
        plain=2.0,
    )
    judged = judge(known)
    assert judged.light("physics").state == "bad"
    assert judged.state == "fair"
    assert "use it for torques, not for its links" in judged.sentence
    assert not any("export" in step.command for step in judged.steps)
    assert judge(replace(known, unseen=())).state == "bad"


def test_what_was_not_looked_at_is_not_good():
    judged = judge(Evidence())
    assert {light.state for light in judged.lights} == {"open"}
    assert judged.state == "open"


def test_a_short_log_with_a_third_held_out_is_not_good():
    held = Unseen(
        "the last 20 % of each log, the same motion (held out)", 32.0, (3.0, 3.0, 3.0), True
    )
    judged = judge(Evidence(joints=JOINTS, fitted=0.47, unseen=(held,), known=0.9, physical=True))
    assert judged.light("unseen motion").state == "bad"
    assert judged.state == "bad"
    assert "32 %" in judged.sentence


def test_a_joint_without_torque_is_neither_above_its_noise_nor_helped_by_a_motion_alone():
    joints = (*JOINTS[:2], JointEvidence("wrist", torque=0.0, fitted=0.0))
    held = Unseen("the same motion (held out)", 0.4, (0.04, 0.04, 0.0), same_motion=True)
    judged = judge(Evidence(joints=joints, fitted=0.5, unseen=(held,), known=0.6, open=4))
    assert judged.light("unseen motion").state == "open"
    assert any("moves wrist, and record its torque" in step.why for step in judged.steps)


def test_a_replay_of_the_fitted_motion_that_is_far_off_is_a_change_and_no_noise_floor():
    replayed = Unseen("new.bag", 14.7, (1.5, 1.5, 1.5), True, 0.32, True, "new.bag")
    judged = judge(
        Evidence(
            asked="replay",
            result="out/arm/parameters.npz",
            joints=JOINTS,
            fitted=0.5,
            unseen=(replayed,),
        )
    )
    assert judged.sentence.startswith("Something has changed since the model was identified")
    assert any(step.command == "dynid gap out/arm new.bag" for step in judged.steps)


def test_an_event_comes_with_the_option_that_leaves_it_out():
    event = Event("run.bag", "elbow", 14.0, 14.42, 15.2)
    gap = GapRecord(
        question="numbers",
        joint_names=("elbow",),
        improvement=errors_of([1.0], [1.0], [0.1]),
        events=(event,),
    )
    judged = judge(Evidence(asked="gap", gap=gap, robot="my_arm.yaml"))
    assert "15 N m on elbow, from 14.0 to 14.4 s of run.bag" in judged.sentence
    assert any(step.command == "dynid gap RESULT LOG --exclude 14.0-14.4" for step in judged.steps)
