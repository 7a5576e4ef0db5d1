"""Identify from Python with one and with two BLAS threads, beside processes that keep the processors busy.

    python benchmarks/threads.py [--loads 0 1 2 4] [--seconds 60 5000] [--repeats 3]

NumPy is loaded first, as in a notebook, so that it has a thread for every processor. *Limited* is dynid as it is: one
thread inside its public functions. *Free* takes the limit away. Logs are those of long_logs.py at 200 Hz; times are
whole calls of identify, the shortest of the repeats, and every process is a new one.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from dynid.files.robotfile import load_robot
from long_logs import ROBOT, ROOT, write_npz

#: What a notebook does; {free} takes the place of the limit before dynid is loaded.
CALL = """
import json, resource, sys, time
import numpy
if {free}:
    import threadpoolctl
    from contextlib import nullcontext
    threadpoolctl.threadpool_limits = lambda **_: nullcontext()
import dynid
arm = dynid.load_robot({robot!r})
log = dynid.load_log({log!r}, arm)
clock, used = time.perf_counter(), time.process_time()
dynid.identify(arm, [log])
print(json.dumps([time.perf_counter() - clock, time.process_time() - used]))
"""


def spin():
    """Keep one processor busy."""
    while True:
        pass


def timed(log, *, free):
    """Return wall and processor time of one call in a new process [s]."""
    environment = {
        key: value for key, value in os.environ.items() if not key.endswith("_NUM_THREADS")
    }
    environment["PYTHONPATH"] = str(ROOT / "src")
    program = CALL.format(free=free, robot=ROBOT, log=str(log))
    done = subprocess.run(
        [sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--loads", type=int, nargs="+", default=[0, 1, 2, 4])
    parser.add_argument("--seconds", type=float, nargs="+", default=[60, 5000])
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    print(
        "| samples | other processes | limited: wall, processor | free: wall, processor |\n| --- | --- | --- | --- |"
    )
    with tempfile.TemporaryDirectory() as folder:
        for seconds in given.seconds:
            log = Path(folder) / f"{seconds:g}.npz"
            write_npz(log, load_robot(ROBOT), seconds)
            for load in given.loads:
                others = [multiprocessing.Process(target=spin, daemon=True) for _ in range(load)]
                for other in others:
                    other.start()
                found = {free: [] for free in (False, True)}
                for _ in range(given.repeats):
                    for free, times in found.items():
                        times.append(timed(log, free=free))
                for other in others:
                    other.terminate()
                cells = [
                    " , ".join(f"{x:.1f} s" for x in min(times)).replace(" ,", ",")
                    for times in found.values()
                ]
                print(
                    f"| {round(seconds * 200):,} | {load} | {cells[0]} | {cells[1]} |", flush=True
                )


if __name__ == "__main__":
    main()
