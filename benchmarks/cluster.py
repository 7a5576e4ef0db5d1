"""Measure `dynid run` on Dask: two workers against one, overhead, memory, what survives kills, many logs of one arm.

    python benchmarks/cluster.py speed [--logs 80]       jobs of one log of 60 s of a 7-joint arm; 3 minutes, one line
    python benchmarks/cluster.py overhead                tasks that do nothing
    python benchmarks/cluster.py kills [--seed 0]        ten workers killed, then a scheduler; same bytes?
    python benchmarks/cluster.py together [--logs 20]      one identification from many logs

Each part prints what it found; benchmarks/cluster.md has the last numbers.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import os
import random
import resource
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import psutil

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "tests")]

import twolink  # noqa: E402
from dynid.log import Log  # noqa: E402
from dynid.model import build_model  # noqa: E402
from dynid.model.parameters import prior_vector  # noqa: E402
from dynid.workflows.cluster import mapped, opened  # noqa: E402
from dynid.workflows.robots import load_robot  # noqa: E402

ENVIRONMENT = {**os.environ, "PYTHONPATH": str(ROOT / "src"), "OPENBLAS_NUM_THREADS": "1"}


def dynid(folder, *words):
    return subprocess.Popen(
        [sys.executable, "-m", "dynid", *words],
        cwd=folder,
        env=ENVIRONMENT,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    )


def digest(folder):
    every = hashlib.sha256()
    for path in sorted(folder.rglob("*")):
        if path.is_file():
            every.update(str(path.relative_to(folder)).encode() + path.read_bytes())
    return every.hexdigest()[:16]


def contents(folder):
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def differing(one, other):
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def processor_of(process):
    """Return what a process and its children have taken so far [s]."""
    total = 0.0
    for each in [
        psutil.Process(process.pid),
        *psutil.Process(process.pid).children(recursive=True),
    ]:
        with suppress(psutil.Error):
            total += sum(each.cpu_times()[:2])
    return total


class Watched:
    """Memory of the workers of a process, looked at while a block runs [MB]."""

    def __init__(self, process):
        self._process, self._on, self.seen = psutil.Process(process.pid), True, []

    def __enter__(self):
        self._thread = threading.Thread(target=self._look)
        self._thread.start()
        return self

    def __exit__(self, *error):
        self._on = False
        self._thread.join()

    def _look(self):
        while self._on:
            try:
                every = [self._process, *self._process.children(recursive=True)]
                self.seen.append(max(each.memory_info().rss for each in every) / 2**20)
            except psutil.Error:
                pass
            time.sleep(0.2)

    def thirds(self):
        part = max(1, len(self.seen) // 3)
        return [max(self.seen[k * part : (k + 1) * part], default=0.0) for k in range(3)]


# ---------------------------------------------------------------- two workers against one
def seven_joint_logs(folder, count, seconds=60.0, rate=200.0):
    """Logs of the bundled LWR4+: five sines a joint, torques of the prior with friction and noise."""
    robot = load_robot("kuka_lwr4plus")
    model = build_model(robot)
    theta = np.nan_to_num(prior_vector(model))
    for k, parameter in enumerate(model.parameters):
        theta[k] = {"fv": 1.0, "fc": 0.8, "Im": 0.1}.get(parameter.kind, theta[k])
    t = np.arange(0, seconds, 1 / rate)
    for number in range(count):
        rng = np.random.default_rng(number)
        q, qd, qdd = (np.zeros((len(t), robot.n)) for _ in range(3))
        for j in range(robot.n):
            for k in range(1, 6):
                w, a, phase = (
                    0.1 * 2 * np.pi * k,
                    rng.uniform(0.3, 0.8) / k,
                    rng.uniform(0, 2 * np.pi),
                )
                q[:, j] += a * np.sin(w * t + phase)
                qd[:, j] += a * w * np.cos(w * t + phase)
                qdd[:, j] -= a * w * w * np.sin(w * t + phase)
        tau = model.observer().torque(theta, q, qd, qdd) + 0.05 * rng.standard_normal(q.shape)
        Log(t=t, q=q, tau=tau, names=robot.joint_names, dh=True).save(
            folder / f"log{number:03d}.npz"
        )


class Run(NamedTuple):
    """One run of the batch: times [s] whole and of a job once started, memory of its largest process in thirds [MB]."""

    wall: float
    wall_each: float
    processor_each: float
    thirds: list[float]
    result: str


def run_of(folder, workers):
    shutil.rmtree(folder / "out", ignore_errors=True)
    began, ends = time.perf_counter(), []
    process = dynid(folder, "run", "batch.yaml", "--jobs", str(workers), "--json-lines")
    with Watched(process) as watched:
        for line in process.stdout:
            if b'"event": "job"' in line:
                ends.append((time.perf_counter(), processor_of(process)))
        said = process.stderr.read()
        process.wait()
    if process.returncode:
        raise SystemExit(said.decode()[-2000:])
    # Why from the fourth end on: processes start once, whether there are 16 logs or 500.
    wall_each, processor_each = (np.array(ends[-1]) - ends[3]) / (len(ends) - 4)
    return Run(
        time.perf_counter() - began,
        wall_each,
        processor_each,
        watched.thirds(),
        digest(folder / "out"),
    )


def speed(given):
    """Print one line; three minutes on a quiet machine with 80 logs and one round."""
    before = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seven_joint_logs(folder, given.logs)
        jobs = "".join(
            f"  - {{name: job{k:03d}, robot: kuka_lwr4plus, logs: log{k:03d}.npz, options: {{anyway: true}}}}\n"
            for k in range(given.logs)
        )
        (folder / "batch.yaml").write_text(f"jobs:\n{jobs}")
        runs = {workers: [] for workers in (2, 1)}
        for workers in (2, 1) * given.rounds:
            runs[workers].append(run_of(folder, workers))
    (w1, e1, c1), (w2, e2, c2) = (
        np.mean([run[:3] for run in runs[workers]], axis=0) for workers in (1, 2)
    )
    thirds, same = (
        runs[2][0].thirds,
        len({run.result for both in runs.values() for run in both}) == 1,
    )
    print(
        f"{given.logs} logs of 60 s: one worker {w1:.1f} s, two {w2:.1f} s, {w1 / w2:.2f} times as fast "
        f"({e1 / e2:.2f} once started, {2 * c1 / c2:.2f} by processor: {c1:.2f} and {c2:.2f} s a job); "
        f"largest process in thirds {', '.join(f'{each:.0f}' for each in thirds)} MB; {overhead_of(2)[0]:.1f} ms a task; "
        f"{'same' if same else 'OTHER'} bytes; load {before:.1f} before"
    )


def overhead_of(workers, count=2000):
    """Return clock and processor of this process that a task takes which does nothing [ms]."""
    with opened(workers) as client:
        began, used = time.perf_counter(), time.process_time()
        assert len(list(mapped(client, math.sqrt, range(count)))) == count
        return 1e3 * (time.perf_counter() - began) / count, 1e3 * (
            time.process_time() - used
        ) / count


def overhead(given):
    for workers in (1, 2):
        wall, used = overhead_of(workers)
        kind = "in this process" if workers == 1 else f"{workers} workers"
        print(f"{kind}: {wall:.2f} ms a task, {used:.2f} ms of processor here")


# ---------------------------------------------------------------- kills
def two_link_batch(folder):
    (folder / "arm.yaml").write_text(twolink.ROBOT)
    for k in range(16):
        twolink.write_log(folder / f"log{k}.csv", seed=k)
    jobs = "".join(f"  - {{name: job{k}, robot: arm.yaml, logs: log{k}.csv}}\n" for k in range(12))
    logs = ", ".join(f"log{k}.csv" for k in range(12, 16))
    many = f"  - {{name: many, robot: arm.yaml, logs: [{logs}], options: {{cutoff: 5}}}}\n"
    (folder / "batch.yaml").write_text(
        f"jobs:\n{jobs}{many}  - {{name: cut, robot: arm.yaml, logs: missing.csv}}\n"
    )


def last(out):
    return (out.decode().splitlines() or ["it said nothing"])[-1]


def workers_of(process):
    every = psutil.Process(process.pid).children(recursive=True)
    return [each for each in every if "spawn_main" in " ".join(each.cmdline())]


def kills(given):
    rng = random.Random(given.seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        two_link_batch(folder)
        began = time.perf_counter()
        out, _ = dynid(folder, "run", "batch.yaml", "--jobs", "2").communicate()
        wall, wanted, whole = (
            time.perf_counter() - began,
            digest(folder / "out"),
            contents(folder / "out"),
        )
        print(f"undisturbed: {wall:.1f} s, {wanted}, {last(out)}", flush=True)
        shutil.rmtree(folder / "out")
        process, killed = dynid(folder, "run", "batch.yaml", "--jobs", "2"), 0
        while process.poll() is None:
            time.sleep(rng.uniform(0.3, 1.0) * max(wall, 8.0) / 10)
            victims = [] if process.poll() is not None else workers_of(process)
            if killed < 10 and victims:
                rng.choice(victims).send_signal(signal.SIGKILL)
                killed += 1
        out, err = process.communicate()
        if not out:
            print(err.decode()[-4000:])
        print(f"{killed} workers killed: {digest(folder / 'out')}, {last(out)}", flush=True)
        if digest(folder / "out") != wanted:
            print(differing(whole, contents(folder / "out")), err.decode()[-3000:])
        shutil.rmtree(folder / "out")
        scheduler(folder, wall, wanted)


def scheduler(folder, wall, wanted):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    address = f"tcp://127.0.0.1:{port}"

    def started():
        quiet = {
            "stdout": subprocess.DEVNULL,
            "stderr": subprocess.DEVNULL,
            "env": ENVIRONMENT,
            "cwd": folder,
        }
        words = ["--host", "127.0.0.1", "--port", str(port), "--no-dashboard"]
        top = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_scheduler", *words], **quiet
        )
        words = [
            address,
            "--nthreads",
            "1",
            "--nworkers",
            "2",
            "--no-dashboard",
            "--local-directory",
            str(folder / "scratch"),
        ]
        return [
            top,
            subprocess.Popen(
                [sys.executable, "-m", "distributed.cli.dask_worker", *words], **quiet
            ),
        ]

    def ended(processes):
        for each in processes:
            for child in psutil.Process(each.pid).children(recursive=True):
                child.kill()
            each.kill()
            each.wait()

    processes = started()
    time.sleep(4)
    process = dynid(folder, "run", "batch.yaml", "--scheduler", address)
    while not (folder / "out").exists() and process.poll() is None:
        time.sleep(0.1)
    time.sleep(0.3 * wall)
    done = len(list((folder / "out").glob("*/job.json")))
    ended(processes)
    time.sleep(2)
    processes = started()
    out, err = process.communicate()
    ended(processes)
    last = out.decode().splitlines()[-1] if out else err.decode()[-800:]
    print(
        f"scheduler and workers killed after {done} jobs: {digest(folder / 'out')} (wanted {wanted}), {last}"
    )


# ---------------------------------------------------------------- many logs of one arm
def together(given):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        seven_joint_logs(folder, given.logs)
        logs = ", ".join(f"log{k:03d}.npz" for k in range(given.logs))
        options = "{anyway: true, report: false}"
        (folder / "batch.yaml").write_text(
            f"jobs: [{{name: long, robot: kuka_lwr4plus, logs: [{logs}], options: {options}}}]\n"
        )
        for workers in (1, 2):
            shutil.rmtree(folder / "out", ignore_errors=True)
            before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
            process = dynid(folder, "run", "batch.yaml", "--jobs", str(workers))
            with Watched(process) as watched:
                out, err = process.communicate()
            wall, after = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
            processor = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            print(
                f"one job of {given.logs} logs of 60 s, {workers} worker(s): {wall:.1f} s, {processor:.1f} s of processor, "
                f"largest process {max(watched.seen):.0f} MB, {digest(folder / 'out')}",
                flush=True,
            )
            if process.returncode:
                print(out.decode()[-2000:], err.decode()[-2000:])


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("part", choices=("speed", "overhead", "kills", "together"))
    parser.add_argument("--logs", type=int, default=80)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    globals()[given.part](given)


if __name__ == "__main__":
    main()
