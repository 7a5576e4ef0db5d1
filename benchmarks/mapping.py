"""Is the right edit named when a robot file has a mistake? Robots x mistakes, on shipped, real and simulated recordings.

Usage: python benchmarks/mapping.py [--every N] [--pairs N] [--only NAME] [--store FILE] > benchmarks/mapping.md
"""

import argparse
import itertools
import math
import random
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import study
from arms import lumped, pinocchio_model, pinocchio_torques
from dynid.diagnose import diagnosis as mapping
from dynid.diagnose import tuning
from dynid.diagnose.fit import RobotFileFit, robot_file_fit
from dynid.diagnose.mistakes import with_edits
from dynid.files.logs import read_log
from dynid.files.robotfile import load_robot
from dynid.log import Log
from dynid.model.kinematics import link_frames
from dynid.signals.checks import check_ranges, unwrapped
from dynid.signals.columns import in_si, matching_columns, robot_columns, to_dh
from motions import harmonics, inside

RATE, SECONDS, HARMONICS = 200, 20, 5
RECORDED = [
    ("kuka_lwr4plus", study.ROOT / "trajectories/lwr4plus_identify.bag"),
    ("kuka_lwr4plus", study.ROOT / "trajectories/lwr4plus_validate.bag"),
    ("kinova_gen2", study.ROOT / "trajectories/kinova_gen2_identify.bag"),
    ("kinova_gen2", study.ROOT / "trajectories/kinova_gen2_validate.bag"),
    ("kuka_lwr4plus", study.DATA / "kuka_lwr4plus/run1.bag"),
    ("kuka_lwr4plus", study.DATA / "kuka_lwr4plus/run2.bag"),
    ("kuka_lwr4plus", study.DATA / "kuka_lwr4plus/run3.bag"),
    ("ur10", study.DATA / "ur10_salerno/exc.npz"),
    ("staubli_tx40", study.DATA / "tx40/exc.npz"),
    ("franka_panda", study.DATA / "panda_salerno/exc.npz"),
]
ROBOTS = sorted(path.stem for path in (study.ROOT / "robots").glob("*.yaml"))
VERDICTS = ("first", "tied", "among three", "wrong", "silent", "out of range", "hidden", "absorbed")


def recordings(seed):
    """Return what is tried: name, source and where from; simulated logs on motions of a seed."""
    recorded = [
        (name, path.parent.name + "/" + path.name, path) for name, path in RECORDED if path.exists()
    ]
    return [*recorded, *((name, f"simulated, seed {seed}", seed) for name in ROBOTS)]


def loaded(name, source):
    if isinstance(source, int):
        return simulated(name, source)
    robot = load_robot(name)
    log = read_log(source, robot=robot)
    return robot, log if log.names else replace(log, names=robot.log_names)


def driver_columns(log, robot):
    """Return the driver's columns in SI units, which a file with a mistake need not make sense of, and their names."""
    return in_si(robot_columns(log, robot), robot), [
        log.names[k] for k in matching_columns(log, robot)[0]
    ]


def simulated(name, seed, speed=0.5):
    """Return a log of a shipped robot in its driver's columns.

    Args:
        name: shipped robot.
        seed: of bodies, motion and noise.
        speed: share of the rated speed that the fastest instant of each joint reaches.
    """
    robot, rng = load_robot(name), np.random.default_rng(seed)
    limits = [joint.limits for joint in robot.joints]
    rated = np.array([each.torque for each in limits])
    fastest = np.minimum([each.velocity or 1.0 for each in limits], 2.5)
    motor = robot.torque.source != "joint_sensor"
    rotor = np.where(
        [j.revolute for j in robot.joints], rated / fastest / (40 if motor else 400), 2.0
    )
    t = np.arange(0, SECONDS, 1 / RATE)
    q, qd, qdd = motion_of(t, robot, rng, speed * fastest)
    tau = pinocchio_torques(pinocchio_model(robot, bodies_of(robot, rng), rotor), q, qd, qdd)
    viscous, coulomb = (0.02, 0.04) if motor else (0.004, 0.005)
    tau += viscous * rated / fastest * qd + coulomb * rated * np.tanh(qd / 0.02)
    size = np.sqrt(np.mean((tau - tau.mean(axis=0)) ** 2, axis=0))
    ripple = np.sin(8 * q + rng.uniform(0, 6, robot.n))
    tau += 0.02 * size * (ripple + rng.standard_normal(tau.shape))
    q = np.round(q / 2e-5) * 2e-5
    if robot.coupling is not None:
        matrix = np.array(robot.coupling.matrix)
        q, tau = q @ matrix.T, tau @ np.linalg.inv(matrix)
    return robot, Log(
        t, q, tau, robot.log_names, tau_unit="Nm", motor_side=robot.coupling is not None
    )


def motion_of(t, robot, rng, fastest):
    low, high = np.array([joint.limits.position or (-2.5, 2.5) for joint in robot.joints]).T
    a, b = rng.standard_normal((2, HARMONICS, robot.n)) / np.arange(1, HARMONICS + 1)[:, None]
    reach = 0.8 * np.minimum((high - low) / 2, 2.0)
    q, qd, qdd = inside(*harmonics(t, a, b), reach, fastest)
    return q + (low + high) / 2, qd, qdd


def bodies_of(robot, rng):
    """Return clouds of eight point masses between each joint and the next, lighter towards the tip."""
    frames = link_frames(robot, np.zeros((1, robot.n)))
    R, p = frames.R[0], np.concatenate([np.zeros((1, 3)), frames.p[0]])
    reach = sum(np.hypot(joint.a, joint.d) for joint in robot.joints)
    share = np.linspace(1.6, 0.4, robot.n) * rng.uniform(0.7, 1.3, robot.n)
    bodies = []
    for i, mass in enumerate((5 + 10 * reach) * share / share.sum()):
        ends = p[i : i + 3] @ R[i] - p[i + 1] @ R[i]
        along = ends[0] if robot.convention == "standard" or i + 1 == robot.n else ends[2]
        com = 0.5 * along + rng.uniform(-0.03, 0.03, 3)
        cloud = rng.standard_normal((8, 3)) * (0.04 + 0.2 * np.abs(along))
        bodies.append(lumped(np.full(8, mass / 8), com + cloud - cloud.mean(axis=0)))
    return bodies


MEMORY = {}


class Remembered(RobotFileFit):
    """A judge that fits each robot file once, whichever mistake and edits made it."""

    def least_residuals(self, robots):
        keys = [self._key("least", robot) for robot in robots]
        new = {key: robot for key, robot in zip(keys, robots, strict=True) if key not in MEMORY}
        MEMORY.update(zip(new, RobotFileFit.least_residuals(self, list(new.values())), strict=True))
        return [MEMORY[key] for key in keys]

    def possible_residuals(self, robot):
        key = self._key("possible", robot)
        if key not in MEMORY:
            MEMORY[key] = RobotFileFit.possible_residuals(self, robot)
        return MEMORY[key]

    def _key(self, what, robot):
        map_ = robot.driver.map
        turns = tuple(
            round(each % (2 * math.pi), 6) % round(2 * math.pi, 6) for each in map_.offset
        )
        return (
            what,
            robot.name,
            robot.convention,
            robot.gravity,
            robot.log_names,
            map_.sign,
            turns,
            map_.torque_signs,
            robot.driver.units["position"],
            self.has_say(robot).tobytes(),
            float(f"{np.abs(self.tau).sum():.6g}"),
        )


def remembered(log, robot, *, mapped=True):
    """Return the judge of a log that fits each robot file once."""
    judge = robot_file_fit(log, robot, mapped=mapped)
    return judge and Remembered(**vars(judge))


def mistakes(judge, names, every, pairs, seed):
    """Return the edits that put single mistakes in, and some pairs of them."""
    single = [(edit,) for edit in mapping.edits_of(judge, names)]
    both = [(a, b) for (a,), (b,) in itertools.combinations(single, 2) if a.kind != b.kind]
    # Why from the seed on: recordings take turns, so that all mistakes are there.
    return single[seed % every :: every] + random.Random(seed).sample(both, min(pairs, len(both)))


def one(name, _, source, every, pairs, seed):
    """Return seconds and false alarm of the right file, and edits, verdict and answer of each question."""
    MEMORY.clear()
    robot, log = loaded(name, source)
    raw, names = driver_columns(log, robot)
    robot = with_edits(robot, [mapping.Edit("sign", (0.0,))] * 2)
    start = time.process_time()
    alarm = mapping.find_mistake(raw, robot, names).wrong
    seconds, answers = time.process_time() - start, []
    mapping.robot_file_fit = remembered
    try:
        judge = Remembered(**vars(robot_file_fit(raw, robot)))
        right = mapping.Hypothesis((), *judge.possible_residuals(robot))
        for edits in mistakes(judge, names, every, pairs, seed):
            wrong = with_edits(robot, edits)
            in_order = [names[robot.log_names.index(each)] for each in wrong.log_names]
            raw_wrong, _ = driver_columns(log, wrong)
            said = verdict(judge, robot, wrong, raw_wrong, in_order, right, edits)
            answers.append(([(edit.kind, edit.value) for edit in edits], *said))
    finally:
        mapping.robot_file_fit = robot_file_fit
    return {"seconds": seconds, "alarm": alarm, "asked": answers}


def verdict(judge, robot, wrong, raw, names, right, edits):
    """Return a word of VERDICTS for a mistake, and what was named."""
    found = mapping.find_mistake(raw, wrong, names)
    noise = np.hypot(
        mapping.noise_of(robot, right.friction_residual), mapping.usual_error(robot, right.residual)
    )

    def hidden(file):
        return (
            mapping.Hypothesis((), *judge.possible_residuals(file)).misfit(noise)
            - right.misfit(noise)
            < tuning.CLEAR
        )

    if found is None or not found.wrong:
        if judge.same(wrong, robot):
            return "absorbed", ""
        if any(check_ranges(unwrapped(to_dh(raw, wrong), wrong), wrong)):
            return "out of range", ""
        return "hidden" if hidden(wrong) else "silent", ""
    said = " and ".join(f"{edit.kind}{edit.value}" for edit in found.best[0].edits)
    for place, hypothesis in enumerate((found.best[0], *found.tied, *found.best[1:3])):
        # Why: base parameters take some edits in, so that several repair a file; the answer lists those it knows.
        repaired = with_edits(wrong, hypothesis.edits)
        rest = [with_edits(robot, [edit]) for edit in edits]
        if judge.same(repaired, robot) or any(
            judge.same(repaired, each) and hidden(each) for each in rest
        ):
            return "first" if place == 0 else "tied" if place <= len(
                found.tied
            ) else "among three", said
    return "wrong", said


def main():
    parser = argparse.ArgumentParser()
    text = "every how manyth single mistake is tried"
    parser.add_argument("--every", type=int, default=1, help=text)
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=7, help="of simulated arms and motions")
    parser.add_argument("--only", default="", help="part of a robot's or recording's name")
    store = Path("mapping.json")
    parser.add_argument("--store", type=Path, default=store, help="what was asked before")
    given = parser.parse_args()
    answers = study.Answers(given.store)
    for k, each in enumerate(recordings(given.seed)):
        title = " | ".join(each[:2])
        if given.only not in "".join(each[:2]) or title in answers:
            continue
        found = one(*each, given.every, given.pairs, k)
        answers.keep(title, found)
        print(title, f"{found['seconds']:.1f}", found["alarm"], file=sys.stderr, flush=True)
        for edits, word, answer in found["asked"]:
            if word not in ("first", "absorbed"):
                print("   ", word, edits, "->", answer, file=sys.stderr, flush=True)
    print(INTRODUCTION)
    print(tables(answers))


def tables(answers):
    """Return the page's tables."""
    heads, rows, every = " | ".join(VERDICTS), [], []
    for title, found in answers.items():
        words = [word for _, word, _ in found["asked"]]
        counts, alarm = map(words.count, VERDICTS), "yes" if found["alarm"] else "no"
        rows.append([title, len(words), *counts, alarm, f"{found['seconds']:.1f}"])
        every += [(edits, word) for edits, word, _ in found["asked"]]
    first = study.markdown(
        f"robot | recording | mistakes | {heads} | false alarm on the right file | s", rows
    )
    single = [(edits[0][0], word) for edits, word in every if len(edits) == 1]
    kinds = {kind: [w for k, w in single if k == kind] for kind in sorted({k for k, _ in single})}
    kinds["all single"] = [word for _, word in single]
    kinds["pairs"] = [word for edits, word in every if len(edits) == 2]
    rows = []
    for kind, words in kinds.items():
        counts = [words.count(each) for each in VERDICTS]
        visible, named = sum(counts[:5]), sum(counts[:2])
        shares = [(counts[0], visible), (named, visible), (named + counts[5], sum(counts[:7]))]
        text = (f"{100 * some / most:.1f} %" if most else "-" for some, most in shares)
        rows.append([kind, len(words), *counts, *text])
    head = f"mistake | cases | {heads} | first | first or tied | of all but absorbed"
    return f"{first}\n\n{study.markdown(head, rows)}"


INTRODUCTION = """# Which mistake does a robot file have?

Mistakes put into right robot files, and what `dynid check` names first: `python benchmarks/mapping.py`.
*Absorbed*: base parameters and friction take the mistake in whole, so that no motion can show it and no result suffers
(tested on random motions); nothing is said. *Hidden*: on this log the wrong file explains the torques as well as the
right one but for less than the alarm's threshold. *Out of range*: the torques hide it, but W332 says that the joint moves
beyond its limits. *First*: the file with the first edit makes the same torques as the right one, or what still differs
is hidden. *Tied*: it is named beside the first one as what this log shows as well. *First* and *first or tied* are shares
of the mistakes that the torques of the log show; the last column is the share of all that are not absorbed for which
something right is said. Simulated arms have random bodies, friction, ripple and noise in Pinocchio.
"""


if __name__ == "__main__":
    main()
