"""What each command says at 80 columns in four cases: a good arm, a bad model, a changed arm, a wrong robot file.

    python benchmarks/screens.py [--keep FOLDER] > benchmarks/screens.md

The arms are simulated, the commands are real: each runs in a terminal of 80 columns, in the folder of its case, one
after the other. Lines about progress and written files are left out.
"""

import argparse
import math
import os
import pty
import re
import struct
import subprocess
import sys
import tempfile
import termios
from dataclasses import replace
from fcntl import ioctl
from pathlib import Path

import numpy as np

from dynid.files.convert import write_log
from dynid.model.parameters import prior_bodies
from dynid.robot import Prior
from dynid.sim.sines import SineSpec, sines
from dynid.workflows.model import base_model
from dynid.workflows.robots import load_robot
from dynid.workflows.simulate import simulate

ROWS, COLUMNS = 60, 80
STEP, SECONDS, NOISE = 0.005, 20.0, 0.003
#: What a person sees and does not read.
LEFT_OUT = re.compile(
    r"(wrote|reused|read|model|log|filter|stacked?|delay|estimate|excited|search|simulate|arm|noticed) {2,}|info\["
)

#: Title, what is simulated, and the commands.
CASES = (
    (
        "good",
        "Two motions of a SCARA, each recorded twice, and a third one that is not fitted.",
        (
            "check a1.csv --robot scara",
            "identify scara a1.csv a2.csv b1.csv b2.csv",
            "validate out/scara c.csv",
            "gap out/scara a1.csv a2.csv b1.csv b2.csv c.csv",
            "identify scara c.csv d.csv -o out/june -q",
            "compare out/june --baseline out/scara",
            "report out/scara",
        ),
    ),
    (
        "bad",
        "The same arm; a spring at the elbow that the model lacks.",
        (
            "check a1.csv --robot scara",
            "identify scara a1.csv a2.csv b1.csv b2.csv",
            "validate out/scara c.csv",
            "report out/scara",
            "gap out/scara a1.csv a2.csv b1.csv b2.csv c.csv",
            "report out/scara",
        ),
    ),
    (
        "changed",
        "The good arm with 1.2 kg more than when it was identified.",
        (
            "identify scara a1.csv a2.csv b1.csv b2.csv -q",
            "check loaded1.csv --robot scara",
            "validate out/scara loaded1.csv",
            "gap out/scara loaded1.csv",
            "identify scara loaded1.csv loaded2.csv -o out/june -q",
            "compare out/june --baseline out/scara",
            "report out/scara",
        ),
    ),
    (
        "wrong arm",
        "A UR5e with the robot file of a UR10e.",
        (
            "check u1.csv --robot ur10e",
            "identify ur10e u1.csv u2.csv",
            "validate out/ur10e u3.csv",
            "gap out/ur10e u1.csv u2.csv u3.csv",
            "report out/ur10e",
        ),
    ),
)


def record(folder, name, log):
    """Write a log as somebody's CSV file."""
    return write_log(log, folder / f"{name}.csv")


def logs(folder, case):
    """Write the logs of a case."""
    # Why so fast: slow torques do not tell the lengths of an arm (benchmarks/judgement.md).
    word, speed, acceleration = ("ur5e", 1.0, 4.0) if case == "wrong arm" else ("scara", 0.5, 0.5)
    robot = load_robot(word)
    robot = replace(robot, prior=Prior(links=tuple(prior_bodies(robot))), tool=None)
    base = base_model(robot)
    spec = SineSpec(SECONDS, 10.0, 0.7, speed, acceleration, -math.inf)
    motions = [sines(robot, spec, STEP, np.random.default_rng([29, k])) for k in range(6)]

    def drive(motion, seed, payload=0.0):
        log = simulate(robot, motion, base=base, noise=NOISE, seed=seed, payload=payload).log
        tau = log.tau.copy()
        if case == "bad":
            tau[:, 1] += 0.8 * np.sqrt(np.mean(tau[:, 1] ** 2)) * motion.q[:, 1]
        return replace(log, tau=tau)

    if case == "wrong arm":
        for k in range(3):
            record(folder, f"u{k + 1}", drive(motions[k], k))
        return
    for k, name in enumerate(("a1", "a2", "b1", "b2", "c", "d")):
        record(folder, name, drive(motions[(0, 0, 1, 1, 2, 3)[k]], k))
    if case == "changed":
        for k in (1, 2):
            record(folder, f"loaded{k}", drive(motions[3 + k], 10 + k, payload=1.2))


def screen(command, folder):
    """Return what a command prints in a terminal of 80 columns."""
    ours, theirs = pty.openpty()
    ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    # Why dumb: a bar of progress would move the cursor, and colours are not read aloud.
    env = os.environ | {"TERM": "dumb", "NO_COLOR": "1", "PYTHONUNBUFFERED": "1"}
    for name in ("COLUMNS", "LINES"):
        env.pop(name, None)
    words = [sys.executable, "-m", "dynid", *command.split()]
    child = subprocess.Popen(
        words, cwd=folder, env=env, stdin=subprocess.DEVNULL, stdout=theirs, stderr=theirs
    )
    os.close(theirs)
    found = b""
    while True:
        try:
            more = os.read(ours, 65536)
        except OSError:
            break
        if not more:
            break
        found += more
    os.close(ours)
    child.wait()
    return [line.rstrip() for line in found.decode().replace("\r", "").splitlines()]


def read_aloud(lines):
    """Return what is left without lines of progress and files, and the lines that these go on in."""
    found, out = [], False
    for line in lines:
        out = bool(LEFT_OUT.match(line)) or (out and line.startswith(" "))
        if not out:
            found.append(line)
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--keep", type=Path, help="folder for logs and results")
    parser.add_argument("--all", action="store_true", help="leave no line out")
    parser.add_argument("--case", choices=[name for name, _, _ in CASES])
    given = parser.parse_args()
    print("# What each command says, at 80 columns\n")
    print(
        "Made by `python benchmarks/screens.py > benchmarks/screens.md`: simulated arms, real commands, stdin closed."
    )
    print("Lines about progress and written files are left out.")
    with tempfile.TemporaryDirectory() as temporary:
        for case, text, commands in CASES:
            if given.case not in (None, case):
                continue
            folder = (given.keep or Path(temporary)) / case.replace(" ", "_")
            folder.mkdir(parents=True, exist_ok=True)
            logs(folder, case)
            print(f"\n## {case[0].upper()}{case[1:]}\n\n{text}")
            for command in commands:
                lines = screen(command, folder)
                if not given.all:
                    lines = [] if " -q" in command else read_aloud(lines)
                wide = [line for line in lines if len(line) > COLUMNS]
                print("\n```text", f"$ dynid {command}", *lines, "```", sep="\n", flush=True)
                for line in wide:
                    print(f"{len(line)} columns: {line}", file=sys.stderr)


if __name__ == "__main__":
    main()
