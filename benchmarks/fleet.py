"""Hide changes in 5 % of 2,000 simulated arms and look for them: share found, false alarms, time.

    python benchmarks/fleet.py [--arms 2000] [--days 30] [--seeds 3]

A run's parameters are drawn with the whole covariance of an identification of the bundled LWR4+ log. Arms differ (friction
by 10 %), runs differ in length, the hall and each arm get warm and cold (viscous friction falls by 1.2 % a kelvin, Coulomb
friction by 0.4 %; arms differ in how restless they are), every mounting shifts everything by half a standard error, and one
run in 200 is off. Changes: friction of one joint by a step, friction of one joint that grows from a day on until the end,
and another tool. The last lines measure what reading results and writing the page cost.
"""

from __future__ import annotations

import argparse
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "src"))

import dynid  # noqa: E402
from dynid.estimation.fleet import History, look_at  # noqa: E402
from dynid.reports.fleet_page import fleet_page  # noqa: E402
from dynid.workflows.fleet import rows_of  # noqa: E402

KINDS = ("friction, step", "friction, growing", "tool")
#: Size of a change: of friction as a share, of the tool in kg.
SIZES = (0.02, 0.05, 0.1, 0.2)
#: What a kilogram at the flange adds to the gravity parameters of the LWR4+ [m].
LEVERS = {"mcz6R": 0.078, "mcz4R": 0.39, "mcz2R": 0.4}


def wandering(rng, shape, memory):
    x = np.empty(shape)
    x[:, 0] = rng.standard_normal(shape[0])
    for k in range(1, shape[1]):
        x[:, k] = memory * x[:, k - 1] + np.sqrt(1 - memory**2) * rng.standard_normal(shape[0])
    return x


def simulated(result, seed, arms, days, share):
    """Return a history, and of each arm that changed kind, size, day and parameters."""
    rng = np.random.default_rng(seed)
    names, error = result.names, np.sqrt(np.diagonal(result.plain_covariance))
    root = np.linalg.cholesky(result.plain_covariance)
    viscous, friction = (
        np.array([n.startswith(kinds) for n in names]) for kinds in ("fv", ("fv", "fc"))
    )
    nominal = result.plain
    spread = np.where(friction, 0.1 * np.abs(nominal), np.maximum(0.01 * np.abs(nominal), error))
    true = nominal + spread * rng.standard_normal((arms, len(names)))
    restless = np.exp(0.3 * rng.standard_normal((arms, 1)))
    kelvin = 1.5 * wandering(rng, (1, days), 0.8) + restless * wandering(rng, (arms, days), 0.7)
    value = true[:, None] * (
        1 + kelvin[:, :, None] * np.where(viscous, -0.012, np.where(friction, -0.004, 0.0))
    )
    value += (
        0.5
        * error
        * np.exp(0.2 * rng.standard_normal((arms, 1, 1)))
        * rng.standard_normal(value.shape)
    )
    length = np.exp(0.15 * rng.standard_normal((arms, days, 1)))
    value += length * (rng.standard_normal(value.shape) @ root.T)
    value += (rng.random((arms, days, 1)) < 0.005) * 8 * error * rng.standard_normal(value.shape)
    truth = {}
    for number, arm in enumerate(rng.choice(arms, round(share * arms), replace=False)):
        kind, size, day = (
            KINDS[number % 3],
            float(rng.choice(SIZES)),
            int(rng.integers(6, days - 5)),
        )
        after = (np.arange(days) >= day).astype(float)
        if kind == "tool":
            columns = [k for k, name in enumerate(names) if name in LEVERS]
            value[arm][:, columns] += (
                after[:, None] * size * np.array([LEVERS[names[k]] for k in columns])
            )
        else:
            joint = int(rng.integers(1, 8))
            columns = [k for k, name in enumerate(names) if name in (f"fv{joint}", f"fc{joint}")]
            shape = (
                after
                if kind != KINDS[1]
                else np.clip((np.arange(days) - day) / (days - 1 - day), 0, 1)
            )
            value[arm][:, columns] *= 1 + size * shape[:, None]
        truth[f"arm{arm}"] = (kind, size, day, {names[k] for k in columns})
    t = np.arange(days) + 0.3 * rng.random((arms, days))
    return History(tuple(f"arm{k}" for k in range(arms)), names, t, value, error * length), truth


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--arms", type=int, default=2000)
    parser.add_argument("--days", type=int, default=30)
    parser.add_argument("--seeds", type=int, default=3)
    given = parser.parse_args()
    robot = dynid.load_robot("kuka_lwr4plus")
    result = dynid.identify(
        robot, [dynid.load_log(ROOT / "trajectories" / "lwr4plus_identify.bag", robot)]
    )
    print(
        f"{given.arms} arms x {given.days} days x {len(result.names)} parameters, {given.seeds} fleets\n"
    )
    print("| changed | named | found | false | parameters right | processor |")
    print("| --- | --- | --- | --- | --- | --- |")
    hits, seconds = {}, []
    for share in (0.05, 0.0):
        for seed in range(given.seeds):
            history, truth = simulated(result, seed, given.arms, given.days, share)
            began = time.process_time()
            found = look_at(history)
            seconds.append(time.process_time() - began)
            named = {change.arm for change in found.changes}
            right = [c for c in found.changes if c.arm in truth and c.parameter in truth[c.arm][3]]
            print(
                f"| {len(truth)} | {len(named)} | {len(named & truth.keys())} | {len(named - truth.keys())} | "
                f"{len(right)} of {len(found.changes)} | {seconds[-1]:.1f} s |",
                flush=True,
            )
            for arm, (kind, size, _, _) in truth.items():
                hits.setdefault((kind, size), []).append(arm in named)
    print(
        f"\n| changed by | {' | '.join(f'{s:g}' for s in SIZES)} |\n| --- | {'--- | ' * len(SIZES)}"
    )
    for kind in KINDS:
        cells = (hits.get((kind, size), []) for size in SIZES)
        print(f"| {kind} | {' | '.join(f'{sum(c)} of {len(c)}' for c in cells)} |")
    began = time.process_time()
    page = fleet_page("what changed", [("arm", found, {}, {})], 0, [])
    print(f"\npage: {len(page) / 1e3:.0f} kB, {time.process_time() - began:.2f} s")
    with tempfile.TemporaryDirectory() as folder:
        path = result.save(Path(folder) / "parameters.npz")
        began = time.process_time()
        rows_of([path] * 100)
        print(
            f"reading a result of {path.stat().st_size / 1e3:.0f} kB: {10 * (time.process_time() - began):.1f} ms"
        )
    print(
        f"arrays: {3 * history.value.nbytes / 2**20:.0f} MB; peak of this process: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB"
    )


if __name__ == "__main__":
    main()
