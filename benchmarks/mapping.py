"""Is the right edit named when a robot file has a mistake? Robots x mistakes, on shipped, real and simulated recordings.

Usage: python benchmarks/mapping.py [--every N] [--pairs N] [--only NAME] [--store FILE] > benchmarks/mapping.md

Every N-th single mistake is tried, and N pairs of them, of robots and recordings with a NAME; the store holds what was asked before.
"""

import itertools
import random
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

import study
from dynid.diagnose import diagnosis as mapping
from dynid.diagnose import tuning
from dynid.diagnose.fit import robot_file_fit
from dynid.diagnose.mistakes import with_edits
from dynid.files.logs import read_log
from dynid.files.robotfile import load_robot
from dynid.signals.checks import check_ranges, unwrapped
from dynid.signals.columns import in_si, matching_columns, robot_columns, to_dh
from random_arms import Arm
from runner import rows

RECORDED = """
kuka_lwr4plus | trajectories/lwr4plus_identify.bag
kuka_lwr4plus | trajectories/lwr4plus_validate.bag
kinova_gen2   | trajectories/kinova_gen2_identify.bag
kinova_gen2   | trajectories/kinova_gen2_validate.bag
kuka_lwr4plus | kuka_lwr4plus/run1.bag
kuka_lwr4plus | kuka_lwr4plus/run2.bag
kuka_lwr4plus | kuka_lwr4plus/run3.bag
ur10          | ur10_salerno/exc.npz
staubli_tx40  | tx40/exc.npz
franka_panda  | panda_salerno/exc.npz
"""
ROBOTS = sorted(path.stem for path in (study.ROOT / "robots").glob("*.yaml"))
VERDICTS = ("first", "tied", "wrong", "silent", "out of range", "hidden")


def recordings(seed):
    """Yield what is tried: name, source, and a function that loads both; simulated logs are those of a seed."""
    for name, words in rows(RECORDED):
        for path in (study.ROOT / words, study.DATA / words):
            if path.exists():
                yield name, words, partial(recorded, name, path)
    for name in ROBOTS:
        yield name, f"simulated, seed {seed}", partial(simulated, name, seed)


def recorded(name, path):
    robot = load_robot(name)
    log = read_log(path, robot=robot)
    return robot, log if log.names else replace(log, names=robot.log_names)


def driver_columns(log, robot):
    """Return the driver's columns in SI units, which a file with a mistake need not make sense of, and their names."""
    return in_si(robot_columns(log, robot), robot), [
        log.names[k] for k in matching_columns(log, robot)
    ]


def simulated(name, seed):
    """Return a log of a shipped robot with random bodies, friction, ripple and noise, in its driver's columns."""
    robot = load_robot(name)
    reach = sum(np.hypot(joint.a, joint.d) for joint in robot.joints)
    arm = Arm(replace(robot, coupling=None), seed, 5 + 10 * reach)
    log = replace(arm.log(seed, 20.0, 0.5, ("ripple",)), names=robot.log_names)
    if robot.coupling is None:
        return robot, log
    matrix = np.array(robot.coupling.matrix)
    q, tau = log.q @ matrix.T, log.tau @ np.linalg.inv(matrix)
    return robot, replace(log, q=q, tau=tau, motor_side=True)


def mistakes(judge, names, every, pairs, seed):
    """Return the edits that put single mistakes in, and some pairs of them."""
    single = [(edit,) for edit in mapping.edits_of(judge, names)]
    both = [(a, b) for (a,), (b,) in itertools.combinations(single, 2) if a.kind != b.kind]
    # Why from the seed on: recordings take turns, so that all mistakes are there.
    return single[seed % every :: every] + random.Random(seed).sample(both, min(pairs, len(both)))


def one(load, every, pairs, seed):
    """Return seconds and false alarm of the right file, and edits, verdict and answer of each question."""
    robot, log = load()
    raw, names = driver_columns(log, robot)
    robot = with_edits(robot, [mapping.Edit("sign", (0.0,))] * 2)
    start = time.process_time()
    alarm = mapping.find_mistake(raw, robot, names).wrong
    seconds, answers = time.process_time() - start, []
    judge = robot_file_fit(raw, robot)
    right = mapping.Hypothesis((), *judge.possible_residuals(robot))
    for edits in mistakes(judge, names, every, pairs, seed):
        wrong = with_edits(robot, edits)
        in_order = [names[robot.log_names.index(each)] for each in wrong.log_names]
        raw_wrong, _ = driver_columns(log, wrong)
        said = verdict(judge, robot, wrong, raw_wrong, in_order, right, edits)
        answers.append(([(edit.kind, edit.value) for edit in edits], *said))
    return {"seconds": seconds, "alarm": alarm, "asked": answers}


def verdict(judge, robot, wrong, raw, names, right, edits):
    """Return a word of VERDICTS for a mistake, and what was named."""
    found = mapping.find_mistake(raw, wrong, names)
    noise = np.hypot(
        mapping.noise_of(robot, right.friction_residual), mapping.usual_error(robot, right.residual)
    )

    def hidden(file):
        misfit = mapping.Hypothesis((), *judge.possible_residuals(file)).misfit(noise)
        return misfit - right.misfit(noise) < tuning.CLEAR

    if found is None or not found.wrong:
        if any(check_ranges(unwrapped(to_dh(raw, wrong), wrong), wrong)):
            return "out of range", ""
        return "hidden" if hidden(wrong) else "silent", ""
    said = " and ".join(f"{edit.kind}{edit.value}" for edit in found.best.edits)
    for place, hypothesis in enumerate((found.best, *found.tied)):
        # Why: base parameters take some edits in, so that several repair a file.
        if hidden(with_edits(wrong, hypothesis.edits)):
            return "tied" if place else "first", said
    return "wrong", said


def main():
    store = Path("mapping.json")
    given = study.arguments(__doc__, every=1, pairs=20, seed=7, only="", store=store)
    answers = study.Answers(given.store)
    for k, (name, source, load) in enumerate(recordings(given.seed)):
        title = f"{name} | {source}"
        if given.only not in title or title in answers:
            continue
        found = one(load, given.every, given.pairs, k)
        answers.keep(title, found)
        print(title, f"{found['seconds']:.1f}", found["alarm"], file=sys.stderr, flush=True)
        for edits, word, answer in found["asked"]:
            if word != "first":
                print("   ", word, edits, "->", answer, file=sys.stderr, flush=True)
    print(INTRODUCTION)
    print(tables(answers))


def tables(answers):
    """Return the page's tables."""
    heads, lines, every = " | ".join(VERDICTS), [], []
    for title, found in answers.items():
        words = [word for _, word, _ in found["asked"]]
        counts, alarm = map(words.count, VERDICTS), "yes" if found["alarm"] else "no"
        lines.append([title, len(words), *counts, alarm, f"{found['seconds']:.1f}"])
        every += [(edits, word) for edits, word, _ in found["asked"]]
    head = f"robot | recording | mistakes | {heads} | false alarm on the right file | s"
    first = study.markdown(head, lines)
    single = [(edits[0][0], word) for edits, word in every if len(edits) == 1]
    kinds = {kind: [w for k, w in single if k == kind] for kind in sorted({k for k, _ in single})}
    kinds["all single"] = [word for _, word in single]
    kinds["pairs"] = [word for edits, word in every if len(edits) == 2]
    lines = []
    for kind, words in kinds.items():
        counts = [words.count(each) for each in VERDICTS]
        visible, named = sum(counts[:4]), sum(counts[:2])
        shares = [(counts[0], visible), (named, visible), (named + counts[4], len(words))]
        text = (f"{100 * some / most:.1f} %" if most else "-" for some, most in shares)
        lines.append([kind, len(words), *counts, *text])
    head = f"mistake | cases | {heads} | first | first or tied | of all"
    return f"{first}\n\n{study.markdown(head, lines)}"


INTRODUCTION = """# Which mistake does a robot file have?

Mistakes put into right robot files, and what `dynid check` names first: `python benchmarks/mapping.py`.
*Hidden*: on this log the wrong file explains the torques as well as the right one but for less than the alarm's
threshold; base parameters and friction take some mistakes in whole, so that no motion can show them. *Out of range*: the
torques hide it, but W332 says that the joint moves beyond its limits. *First*: the file with the first edit explains the
log as well as the right one. *Tied*: one that is named beside it does. *First* and *first or tied* are shares of the
mistakes that the torques of the log show; the last column is the share of all for which something right is said. Simulated arms have random bodies, friction, ripple and noise in Pinocchio.
"""


if __name__ == "__main__":
    main()
