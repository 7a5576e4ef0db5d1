"""Measure dynid beside Pinocchio, in one run on one machine; print a table of times and ratios.

    python benchmarks/speed.py [--samples 1000000]

The arm is the bundled KUKA LWR4+ (7 joints, 77 rigid-body parameters, 98 with friction). Whole processes start from
nothing in an empty folder. The logs are sums of sines with torques of the same model and noise: they are here for their
size, not for accuracy. Needs ``pip install -e '.[test]'``.
"""

import argparse
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does, before NumPy is loaded

import numpy as np
import pinocchio as pin

import study  # noqa: F401
from arms import pinocchio_model, random_bodies
from conic import clarabel_optimum
from dynid.estimation import tuning
from dynid.estimation.possible_arm import fit_physical, fit_pooled
from dynid.files.robotfile import load_robot
from dynid.log import Log
from dynid.model import build_model
from motions import tones
from synthetic_arm import seven_joint_arm

ROOT = Path(__file__).parents[1]
ROBOT = "kuka_lwr4plus"
RATE = 200.0


def process(folder, *words):
    """Run dynid and return (seconds, peak memory [MB])."""
    began = time.perf_counter()
    child = subprocess.Popen(
        [sys.executable, "-m", "dynid", *words],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        # Why empty: an installed dynid has its byte code, which a source tree may keep from the second run on.
        env={**os.environ, "PYTHONPATH": str(ROOT / "src"), "PYTHONDONTWRITEBYTECODE": ""},
    )
    err = child.stderr.read()
    _, status, usage = os.wait4(child.pid, 0)
    seconds = time.perf_counter() - began
    if status:
        raise SystemExit(f"dynid {' '.join(words)} failed:\n{err.decode()}")
    return seconds, usage.ru_maxrss / 1024


def median(action, times):
    return statistics.median(action() for _ in range(times))


def seconds(action):
    began = time.perf_counter()
    action()
    return time.perf_counter() - began


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
    took = median(lambda: seconds(lambda: build_model(robot)), 3)
    yield "derive the regressor, 7 joints", f"{took:.2f} s", "0.5 s", ""


def evaluation(robot):
    model = build_model(robot)
    _, *states = sines(20000, robot.n)
    observer = model.observer()
    list(observer.blocks(*states))

    def walk():
        for _ in observer.blocks(*states):
            pass

    ours = median(lambda: seconds(walk), 5) / 20000 * 1e6
    dense = median(lambda: seconds(lambda: observer.dense(*states)), 3) / 20000 * 1e6
    theirs = median(lambda: seconds(lambda: pinocchio_loop(robot, states)), 3) / 20000 * 1e6
    yield (
        "regressor, non-zero entries, a sample",
        f"{ours:.2f} us",
        "3 us",
        f"{theirs / ours:.1f} x faster than the loop",
    )
    yield (
        "regressor, dense 7 x 98, a sample",
        f"{dense:.2f} us",
        "",
        f"{theirs / dense:.1f} x faster than the loop",
    )
    yield (
        "Pinocchio computeJointTorqueRegressor loop",
        f"{theirs:.2f} us",
        "",
        "70 columns, from Python",
    )


def consistency():
    """Solvers of the physically possible set on one thread, as processor time; Clarabel beside them."""
    arm = seven_joint_arm()
    regimes = {"rich": (2000, 1.0, 1.0), "slow": (2000, 0.2, 3.0), "300 noisy": (300, 0.2, 10.0)}
    for name, regime in regimes.items():
        R, r = arm.whitened(*regime)
        found = fit_physical(R, r, arm.constraints)
        own = median(lambda R=R, r=r: processor(lambda: fit_physical(R, r, arm.constraints)), 15)
        pooled = median(lambda R=R, r=r: processor(lambda: fit_pooled(R, r, arm.constraints)), 15)
        best, took = clarabel_optimum(R, r, arm.constraints, tuning.PRIOR_WEIGHT)
        bounds = -1e-5 * np.log(arm.constraints.slack(found.x)).sum()
        yield (
            f"physical set, {name} samples",
            f"{1e3 * own:.1f} ms",
            "20 ms",
            f"Clarabel {1e3 * took:.0f} ms; its optimum differs by {abs(found.objective - bounds - best):.0e} of {best:.0f}",
        )
        yield "the same with pooled friction and rotors", f"{1e3 * pooled:.1f} ms", "20 ms", ""


def processor(action):
    began = time.process_time()
    action()
    return time.process_time() - began


def whole_processes(robot, folder, samples):
    model = build_model(robot)
    yield "dynid --help", f"{median(lambda: process(folder, '--help')[0], 5):.2f} s", "0.15 s", ""

    def cold():
        return process(folder, "model", ROBOT, "--rebuild", "--reduce")[0]

    cold_time = median(cold, 3)
    yield "dynid model, cold", f"{cold_time:.2f} s", "3 s", "the paper: 165 s"
    yield (
        "dynid model, cached",
        f"{median(lambda: process(folder, 'model', ROBOT)[0], 3):.2f} s",
        "0.5 s",
        "",
    )
    for count, label, limit in (
        (12000, "dynid identify, 60 s at 200 Hz", "2 s"),
        (samples, f"dynid identify, {samples:,} samples", "15 s, 500 MB"),
    ):
        make_log(folder / "log.npz", model, count)
        runs = [
            process(folder, "identify", ROBOT, "log.npz", "--force")
            for _ in range(3 if count < 10**5 else 1)
        ]
        took, memory = statistics.median(run[0] for run in runs), max(run[1] for run in runs)
        note = "the paper: 109 s" if count < 10**5 else "all rows of 83 minutes"
        yield (
            label.replace(",", " ") if count > 10**5 else label,
            f"{took:.2f} s, {memory:.0f} MB",
            limit,
            note,
        )


def machine():
    """Describe the machine in one line."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":")[1].strip() for line in lines if "model name" in line]
    load = os.getloadavg()[0]
    return (
        f"{names[0] if names else platform.processor()}, {os.cpu_count()} cores, Python {platform.python_version()}, "
        f"NumPy {np.__version__}, Pinocchio {pin.__version__}, load average {load:.1f} at the start"
    )


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--samples", type=int, default=1_000_000)
    options = parser.parse_args()
    robot = load_robot(ROBOT)
    print(machine(), "\n")
    print("| what | measured | target | beside |\n| --- | --- | --- | --- |")
    with tempfile.TemporaryDirectory() as folder:
        for rows in (
            derivation(robot),
            evaluation(robot),
            consistency(),
            whole_processes(robot, Path(folder), options.samples),
        ):
            for row in rows:
                print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
