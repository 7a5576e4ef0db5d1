"""Contacts: false alarms on clean recordings that were not fitted, the smallest push that is found, and its delay.

    PYTHONPATH=src python benchmarks/contacts.py ../shared/data > benchmarks/contacts.md
    PYTHONPATH=src python benchmarks/contacts.py ../shared/data 4 >> benchmarks/contacts.md

Recordings and pairs are those of real_arms.py. A push is a torque of 0.5 s with edges of 50 ms that is added to one
joint's measured torque at 60 % of the log, where it counts against the drive's; the smallest that raises an alarm there
at 1/h is found by halving. Simulated arms (PyBullet, truth of trajectories/lwr4plus_truth.yaml) have 0.5 kg more at
the flange, or less friction than when they were identified, as after an hour of work. With a number of minutes behind the
data, many motions of arms with a hidden torque of dynid.sim.hidden are counted instead, so many minutes of each.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid import IdentifyOptions, contacts, identify, load_robot
from dynid.errors import DynidError
from dynid.model.parameters import body_of
from dynid.sim.arm import track
from dynid.sim.hidden import CASES, hidden_logs
from dynid.sim.plant import plant_of
from dynid.sim.sines import SineSpec, sines
from real_arms import pairs

#: Rates of false alarms that are counted where logs are long.
RATES = ("1/h", "10/h", "100/h")
#: Hidden torques that are a contact, or drift from motion to motion.
NOT_CLEAN = ("contact", "torque_drift", "torque_delay", "torque_gain")

#: Unseen motions of 20 s of each simulated arm that has changed.
MOTIONS = 30


def pushed(log, joint: int, size: float):
    """Return a log with a push, and when it begins [s]."""
    start = log.t[0] + 0.6 * (log.t[-1] - log.t[0])
    shape = np.clip((log.t - start) / 0.05, 0, 1) * np.clip((start + 0.5 - log.t) / 0.05, 0, 1)
    tau = log.tau.copy()
    # Why minus: what pushes with the drive leaves it less to do.
    tau[:, joint] -= size * shape
    return replace(log, tau=tau, sha256=""), start


def smallest(result, log, joint: int) -> tuple[float, float]:
    """Return the smallest push that is found on a joint [N m], and the delay of one twice as large [s]."""

    def delay(size: float) -> float:
        there, start = pushed(log, joint, size)
        name = result.robot.joint_names[joint]
        hits = [
            c.start - start for c in contacts(result, there).external.contacts if c.joint == name
        ]
        hits = [late for late in hits if -0.2 <= late <= 0.7]
        return min(hits, default=np.inf)

    low, high = 0.0, 1.0
    while not np.isfinite(delay(high)) and high < 500:
        low, high = high, 2 * high
    for _ in range(4):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if np.isfinite(delay(middle)) else (middle, high)
    return high, delay(2 * high)


def recorded(data: Path) -> None:
    print(
        "| fitted | clean | seconds | alarms at 1/h | at 10/h | largest torque over threshold at 1/h |"
    )
    print("| --- | --- | --: | --: | --: | --: |")
    kept, total, alarms = {}, 0.0, np.zeros(2, dtype=int)
    for pair in pairs(data):
        try:
            result = identify(pair.robot, pair.fitted, IdentifyOptions(holdout=None))
        except DynidError:
            continue
        for name, log in pair.unseen:
            found = [contacts(result, log, false_alarms=rate).external for rate in ("1/h", "10/h")]
            seconds = float(log.t[-1] - log.t[0])
            total, count = total + seconds, [len(each.contacts) for each in found]
            alarms += count
            share = float((np.abs(found[0].torque) / found[0].threshold).max())
            print(
                f"| {pair.name} | {name} | {seconds:.0f} | {count[0]} | {count[1]} | {share:.2f} |",
                flush=True,
            )
            kept.setdefault(pair.name.split(" ")[0], (pair.name, result, name, log))
    print(f"| all | | {total:.0f} | {alarms[0]} | {alarms[1]} | |")
    print(
        f"\nTo be expected in {total:.0f} s: {total / 3600:.2f} at 1/h, {total / 360:.2f} at 10/h.\n"
    )
    print(
        "| fitted | pushed | smallest push found per joint [N m] | delay of a push twice as large [s] |"
    )
    print("| --- | --- | --- | --- |")
    for name, result, unseen, log in kept.values():
        rows = [smallest(result, log, joint) for joint in range(result.robot.n)]
        pushes, delays = (", ".join(f"{row[k]:.2g}" for row in rows) for k in (0, 1))
        print(f"| {name} | {unseen} | {pushes} | {delays} |", flush=True)


def simulated() -> None:
    robot = load_robot("kuka_lwr4plus")
    plant, rng = plant_of(robot), np.random.default_rng(0)
    spec = SineSpec(20.0, 20.0, 0.5, 0.6, 0.4, 0.05)

    def log(changed, motion):
        with changed.arm(robot, 1.25e-3) as arm:
            done = track(arm, motion, 4)
        return replace(changed.sensors.measure(done, robot.joint_names, rng), dh=True)

    result = identify(robot, [log(plant, sines(robot, spec, 1.25e-3, rng)) for _ in range(2)])
    last = plant.bodies[-1].parameters() + np.array([0.5, 0, 0, 0, 0, 0, 0, 0, 0, 0])

    def warm(share):
        parts = {
            key: tuple(share * x for x in getattr(plant.friction, key))
            for key in ("viscous", "coulomb")
        }
        return replace(plant, friction=replace(plant.friction, **parts))

    cases = {
        "as identified": plant,
        "0.5 kg more": replace(plant, bodies=(*plant.bodies[:-1], body_of(last))),
        "friction 5 % lower": warm(0.95),
        "friction 10 % lower": warm(0.9),
        "friction 20 % lower": warm(0.8),
    }
    print(
        "\n| simulated LWR4+ | seconds | contacts at 1/h where it is not told as changed | joints | told as changed | rougher than expected, largest |"
    )
    print("| --- | --: | --: | --- | --: | --: |")
    for name, changed in cases.items():
        found = [
            contacts(result, log(changed, sines(robot, spec, 1.25e-3, rng))).external
            for _ in range(MOTIONS)
        ]
        touched = [c for each in found if not each.changed for c in each.contacts]
        joints = sorted({c.joint for c in touched})
        rougher = max(float(each.rougher.max()) for each in found)
        told = sum(each.changed for each in found)
        print(
            f"| {name} | {20 * MOTIONS} | {len(touched)} | {', '.join(joints) or '-'} | {told} of {MOTIONS} | {rougher:.1f} |",
            flush=True,
        )


def long(minutes: float) -> None:
    """Count false alarms over many unseen motions of simulated arms whose model lacks a torque."""
    robot = load_robot("kuka_lwr4plus")
    plant = plant_of(robot)
    print("\n| simulated LWR4+, the model lacks | minutes | alarms at 1/h | at 10/h | at 100/h |")
    print("| --- | --: | --: | --: | --: |")
    total, hours = np.zeros(len(RATES), dtype=int), 0.0
    for number, case in enumerate(case for case in CASES if case.name not in NOT_CLEAN):
        rng = np.random.default_rng([11, number])
        logs = hidden_logs(
            robot, plant, case, rng, motions=2 + round(3 * minutes), repeats=1, seconds=20.0
        )
        result, alarms, seconds = (
            identify(robot, logs[:2], IdentifyOptions(holdout=None)),
            total * 0,
            0.0,
        )
        for unseen in logs[2:]:
            found = [contacts(result, unseen, false_alarms=rate).external for rate in RATES]
            alarms += [len(each.contacts) for each in found]
            seconds += float(unseen.t[-1] - unseen.t[0])
        total, hours = total + alarms, hours + seconds / 3600.0
        name = "nothing" if case.name == "nothing" else f"{case.name} on joint {case.joint + 1}"
        print(f"| {name} | {seconds / 60:.0f} | {' | '.join(map(str, alarms))} |", flush=True)
    print(f"| all | {60 * hours:.0f} | {' | '.join(map(str, total))} |")
    told = ", ".join(f"{hours * float(rate.split('/')[0]):.3g} at {rate}" for rate in RATES)
    print(f"\nTo be expected in {60 * hours:.0f} min: {told}.")


if __name__ == "__main__":
    print("# Contacts\n")
    print(__doc__.split("\n\n")[2].strip(), "\n")
    if len(sys.argv) > 2:
        long(float(sys.argv[2]))
        sys.exit()
    recorded(Path(sys.argv[1]))
    simulated()
    print(
        "\nAn arm that has changed is not told as so many touches: from 15 % of a log above the threshold on, the answer is that the arm"
    )
    print("has changed since it was identified (`arm_changed` in the JSON).")
