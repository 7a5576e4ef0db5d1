"""Is the right edit named when a robot file has a mistake? Robots x mistakes, on shipped and on real recordings.

Usage: python benchmarks/mapping.py [--pairs N] > benchmarks/mapping.md
"""

import argparse
import itertools
import random
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid.files.logs import read_log
from dynid.files.robotfile import load_robot
from dynid.signals.mapping import diagnose, driver_columns, edited, judge_of

ROOT = Path(__file__).parents[1]
SHARED = next((f / "shared" / "data" for f in ROOT.parents if (f / "shared" / "data").is_dir()), ROOT)
CASES = [
    ("kuka_lwr4plus", "trajectories/lwr4plus_identify.bag"),
    ("kuka_lwr4plus", "trajectories/lwr4plus_validate.bag"),
    ("kinova_gen2", "trajectories/kinova_gen2_identify.bag"),
    ("kinova_gen2", "trajectories/kinova_gen2_validate.bag"),
    ("kuka_lwr4plus", SHARED / "kuka_lwr4plus/run1.bag"),
    ("kuka_lwr4plus", SHARED / "kuka_lwr4plus/run2.bag"),
    ("kuka_lwr4plus", SHARED / "kuka_lwr4plus/run3.bag"),
    ("ur10", SHARED / "ur10_salerno/exc.npz"),
    ("staubli_tx40", SHARED / "tx40/exc.npz"),
    ("franka_panda", SHARED / "panda_salerno/exc.npz"),
]


def mistakes(judge, pairs, seed):
    """Return single mistakes, and some pairs of them; the edits that put them in."""
    single = [(edit,) for edit in judge.single() if edit.kind != "order"]
    single += [(edit,) for edit in judge.orders()]
    both = [(a[0], b[0]) for a, b in itertools.combinations(single, 2) if a[0].kind != b[0].kind]
    return single + random.Random(seed).sample(both, min(pairs, len(both)))


def columns(log, robot):
    raw, names = driver_columns(log, robot)
    return raw, robot, names


def put_in(robot, edits):
    """Return the robot file with the mistakes, and what it takes to take them out again."""
    wrong = robot
    for edit in edits:
        wrong = edited(wrong, edit)
    return wrong


def one(task):
    name, path, edits = task
    robot = load_robot(name)
    log = read_log(ROOT / path, robot=robot)
    if not log.names:
        log = replace(log, names=robot.log_names)
    wrong = put_in(robot, edits)
    start = time.perf_counter()
    found = diagnose(*columns(log, wrong))
    seconds = time.perf_counter() - start
    if judge_of(*columns(log, wrong)) is None:
        return name, str(path), edits, "silent", seconds, 0.0, 1.0, ""
    right, spoilt = judge_of(*columns(log, robot)).fit(()), judge_of(*columns(log, wrong)).fit(())
    absorbed = spoilt.unexplained < 1.15 * right.unexplained + 0.01
    if found is None or not found.wrong:
        verdict = "absorbed" if absorbed else "silent"
        return name, str(path), edits, verdict, seconds, right.unexplained, spoilt.unexplained, ""
    verdict = "wrong"
    for place, hypothesis in enumerate(found.best[:3]):
        repaired = put_in(wrong, hypothesis.edits)
        fit = judge_of(*columns(log, repaired)).fit(())
        # Another edit that makes the same torques repairs the file as well: base parameters cannot tell them apart.
        if same(repaired, robot) or fit.unexplained < 1.02 * right.unexplained + 1e-3:
            verdict = "first" if place == 0 else "among three"
            break
    if absorbed and verdict == "wrong":
        verdict = "wrong, absorbed"
    said = " + ".join(f"{e.kind}{e.value}" for e in found.best[0].edits)
    return name, str(path), edits, verdict, seconds, right.unexplained, spoilt.unexplained, said


def same(one, other):
    return (
        one.convention == other.convention
        and np.allclose(one.gravity, other.gravity)
        and one.log_names == other.log_names
        and one.driver.map == other.driver.map
    )


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--pairs", type=int, default=10)
    parser.add_argument("--every", type=int, default=1, help="take every so manieth mistake")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    tasks = []
    for seed, (name, path) in enumerate(CASES):
        if not (ROOT / path).exists():
            continue
        robot = load_robot(name)
        log = read_log(ROOT / path, robot=robot)
        if not log.names:
            log = replace(log, names=robot.log_names)
        tasks.append((name, path, ()))
        tasks += [
            (name, path, edits)
            for edits in mistakes(judge_of(*columns(log, robot)), given.pairs, seed)[seed % given.every :: given.every]
        ]
    with ProcessPoolExecutor(given.jobs) as pool:
        answers = []
        for answer in pool.map(one, tasks):
            answers.append(answer)
            print(
                *answer[:1],
                Path(answer[1]).name,
                [(e.kind, e.value) for e in answer[2]],
                *answer[3:],
                file=sys.stderr,
                flush=True,
            )
    table(answers)


def table(answers):
    print("# Which mistake does a robot file have?\n")
    print("Every single mistake, and some pairs, put into a right robot file; what `dynid check` names first.")
    print(
        "*Absorbed*: the wrong file explains the log as well as the right one does (base parameters take the mistake in), and nothing is said.\n"
    )
    columns = ("first", "among three", "wrong", "wrong, absorbed", "silent", "absorbed")
    print("| robot | recording | mistakes |", " | ".join(columns), "| false alarm on the right file | s |")
    print("| --- " * (len(columns) + 5) + "|")
    kinds = {}
    for name, path in dict.fromkeys((a[0], a[1]) for a in answers):
        own = [a for a in answers if a[:2] == (name, path)]
        wrong = [a for a in own if a[2]]
        counts = [sum(a[3] == column for a in wrong) for column in columns]
        alarm = "yes" if own[0][3] not in ("absorbed", "silent") else "no"
        print(
            f"| {name} | {Path(path).name} | {len(wrong)} |",
            " | ".join(map(str, counts)),
            f"| {alarm} | {np.median([a[4] for a in own]):.1f} |",
        )
        for a in wrong:
            kinds.setdefault(" + ".join(sorted(e.kind for e in a[2])), []).append(a[3])
    every = [a[3] for a in answers if a[2]]
    seen = [v for v in every if "absorbed" not in v]
    print(
        f"\nOf {len(every)} mistakes {len(every) - len(seen)} are absorbed; of the other {len(seen)} the right edit is first in "
        f"{100 * sum(v == 'first' for v in seen) / max(1, len(seen)):.1f} %.\n"
    )
    print("| mistake | cases |", " | ".join(columns), "|")
    print("| --- " * (len(columns) + 2) + "|")
    for kind, verdicts in sorted(kinds.items()):
        print(
            f"| {kind} | {len(verdicts)} |",
            " | ".join(str(sum(v == column for v in verdicts)) for column in columns),
            "|",
        )


if __name__ == "__main__":
    main()
