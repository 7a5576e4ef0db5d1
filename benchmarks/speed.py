"""Measure dynid beside Pinocchio, in one run on one machine; print a table of times and ratios.

    python benchmarks/speed.py [--samples 1000000]

The arm is the bundled KUKA LWR4+ (7 joints, 77 rigid-body parameters, 98 with friction). Whole processes start from
nothing in an empty folder. The logs are sums of sines with torques of the same model and noise: they are here for their
size, not for accuracy. Needs ``pip install -e '.[test]'``.
"""

import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import deque
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does, before NumPy is loaded

import numpy as np
import pinocchio as pin

import study
from arms import pinocchio_model, random_bodies
from dynid.files.robotfile import load_robot
from dynid.log import Log
from dynid.model import build_model
from motions import tones

ROOT = Path(__file__).parents[1]
ROBOT = "kuka_lwr4plus"
RATE = 200.0


def process(folder, line):
    """Run dynid and return its peak memory [MB]."""
    child = subprocess.Popen(
        [sys.executable, "-m", "dynid", *line.split()],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        # Why empty: an installed dynid has its byte code, which a source tree may keep from the second run on.
        env={**os.environ, "PYTHONPATH": str(ROOT / "src"), "PYTHONDONTWRITEBYTECODE": ""},
    )
    err = child.stderr.read()
    _, status, usage = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(f"dynid {line} failed:\n{err.decode()}")
    return usage.ru_maxrss / 1024


def timed(action, times, clock=time.perf_counter):
    """Return the median of the seconds of an action."""
    took = []
    for _ in range(times):
        began = clock()
        action()
        took.append(clock() - began)
    return statistics.median(took)


# ---------------------------------------------------------------- the other sides
def pinocchio_loop(robot, states):
    """The usual way to a stacked regressor: one call a sample."""
    model = pinocchio_model(robot, random_bodies(np.random.default_rng(0), robot.n))
    data = model.createData()
    W = np.empty((len(states[0]), robot.n, 10 * robot.n))
    for k, (q, qd, qdd) in enumerate(zip(*states, strict=True)):
        W[k] = pin.computeJointTorqueRegressor(model, data, q, qd, qdd)
    return W


# ---------------------------------------------------------------- logs
def sines(samples, n, seed=0):
    """Positions, velocities, accelerations of five sines a joint, all below 1 Hz."""
    t, random = np.arange(samples) / RATE, np.random.default_rng(seed)
    hertz, phase, size = random.uniform((0.05, 0, 0.4), (0.8, 2 * np.pi, 1.0), (n, 5, 3)).T
    w = 2 * np.pi * hertz
    return t, *tones(t, size * np.minimum(0.25, 0.5 / w), w, phase)


def make_log(path, model, samples):
    t, q, qd, qdd = sines(samples, model.robot.n)
    random = np.random.default_rng(1)
    bodies = random_bodies(random, model.robot.n)
    rigid = np.concatenate([np.append(body.parameters(), 0.1) for body in bodies])
    gamma = np.concatenate([rigid, random.uniform(0.2, 1.0, model.size - len(rigid))])
    tau = model.observer().torque(gamma, q, qd, qdd) + 0.05 * random.standard_normal(q.shape)
    names = model.robot.joint_names
    Log(t=t, q=q, tau=tau, names=names, units={"position": "rad", "effort": "Nm"}, dh=False).save(
        path
    )


# ---------------------------------------------------------------- rows of the table
def derivation(robot):
    yield (
        "derive the regressor, 7 joints",
        f"{timed(lambda: build_model(robot), 3):.2f} s",
        "0.5 s",
        "",
    )


def evaluation(robot):
    _, *states = sines(20000, robot.n)
    observer, micro = build_model(robot).observer(), 1e6 / 20000
    list(observer.blocks(*states))
    ours = micro * timed(lambda: deque(observer.blocks(*states), 0), 5)
    dense = micro * timed(lambda: observer.dense(*states), 3)
    theirs = micro * timed(lambda: pinocchio_loop(robot, states), 3)
    title, faster = "regressor, non-zero entries, a sample", "x faster than the loop"
    yield title, f"{ours:.2f} us", "3 us", f"{theirs / ours:.1f} {faster}"
    title = "regressor, dense 7 x 98, a sample"
    yield title, f"{dense:.2f} us", "", f"{theirs / dense:.1f} {faster}"
    title = "Pinocchio computeJointTorqueRegressor loop"
    yield title, f"{theirs:.2f} us", "", "70 columns, from Python"


def whole_processes(robot, folder, samples):
    for title, line, times, limit, beside in (
        ("dynid --help", "--help", 5, "0.15 s", ""),
        ("dynid model, cold", f"model {ROBOT} --rebuild --reduce", 3, "3 s", "the paper: 165 s"),
        ("dynid model, cached", f"model {ROBOT}", 3, "0.5 s", ""),
    ):
        yield title, f"{timed(partial(process, folder, line), times):.2f} s", limit, beside
    model, line, memory = build_model(robot), f"identify {ROBOT} log.npz --force", []
    for count, times, label, limit, beside in (
        (12000, 3, "60 s at 200 Hz", "2 s", "the paper: 109 s"),
        (samples, 1, f"{samples:,} samples", "15 s, 500 MB", "all rows of 83 minutes"),
    ):
        make_log(folder / "log.npz", model, count)
        took = timed(lambda: memory.append(process(folder, line)), times)
        yield f"dynid identify, {label}", f"{took:.2f} s, {max(memory):.0f} MB", limit, beside


def main():
    options = study.arguments(__doc__, samples=1_000_000)
    robot = load_robot(ROBOT)
    print(f"{study.MACHINE}, load average {os.getloadavg()[0]:.1f} at the start\n")
    with tempfile.TemporaryDirectory() as folder:
        processes = whole_processes(robot, Path(folder), options.samples)
        rows = [*derivation(robot), *evaluation(robot), *processes]
    print(study.markdown("what | measured | target | beside", rows))


if __name__ == "__main__":
    main()
