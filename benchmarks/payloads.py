"""Loads of random bodies on arms with links of random lumps, and on recordings of real arms: how many numbers of a load lie
inside their 95 % intervals.

PYTHONPATH=src python benchmarks/payloads.py [../shared/data] > benchmarks/payloads.md

Pinocchio gives the torques of arm and load. The arm is identified without the load from another motion; friction then
changes by 10 % and the gains of all joints are wrong in both logs, by up to 8 or 25 %, each joint's own or all joints' alike,
and the robot file says so or not.
Into recordings a load is put as the torque of a rigid body that Pinocchio computes.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import pinocchio as pin

from dynid import IdentifyOptions, Log, find_payload, identify, load_log, load_robot
from dynid.errors import DynidError
from random_arms import ARMS, Arm
from real_arms import part

#: What is wrong with the gains: how large their error is said to be, how large it is at most, and whether each joint has
#: its own.
GAINS = {
    "exact": (0.0, 0.0, False),
    "all alike": (0.05, 0.08, False),
    "each its own": (0.05, 0.08, True),
    "each its own, not told": (0.0, 0.08, True),
    "far off, not told": (0.0, 0.25, True),
}
#: What the arms have and the model lacks.
HIDDEN = {
    "nothing": (),
    "ripple, load friction": ("ripple", "load"),
    "angles, Stribeck": ("angle", "stribeck"),
    "springs, delay": ("spring", "delay"),
}
#: Mass of loads [kg].
MASSES = (0.2, 5.0)
#: Seconds and share of the fastest speed, without and with a load.
KEPT, LOADED = (25.0, 0.5), (15.0, 0.5)
#: Robot, recording without a load, recording that gets one, and the mass [kg].
RECORDINGS = (
    ("kuka_lwr4plus", "kuka_lwr4plus/run1.bag", "kuka_lwr4plus/run2.bag"),
    ("kuka_lwr4plus", "kuka_lwr4plus/run1.bag", "kuka_lwr4plus/run3.bag"),
    ("kuka_lwr4plus", "kuka_lwr4plus/run2.bag", "kuka_lwr4plus/run3.bag"),
    ("kuka_lwr4plus", "kuka_lwr4plus/run3.bag", "kuka_lwr4plus/run1.bag"),
    ("ur10", "ur10_salerno/exc.npz:0:15", "ur10_salerno/exc.npz:15:99"),
    ("ur10", "ur10_salerno/exc.npz:15:99", "ur10_salerno/exc.npz:0:15"),
    ("franka_panda", "panda_salerno/exc.npz:0:14", "panda_salerno/exc.npz:14:99"),
    ("franka_panda", "panda_salerno/exc.npz:14:99", "panda_salerno/exc.npz:0:14"),
)
BALL = (2.805, (0.02, -0.01, 0.07), 0.05)


@dataclass(frozen=True)
class Load:
    """A rigid body in the last link's frame: mass [kg], centre (3,) [m], inertia about it (3, 3) [kg m^2]."""

    mass: float
    com: np.ndarray
    inertia: np.ndarray

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> Load:
        """Return 2 to 8 balls within a few centimetres of a point up to 20 cm from the flange."""
        mass = float(np.exp(rng.uniform(*np.log(MASSES))))
        count, size = rng.integers(2, 9), rng.uniform(0.02, 0.08)
        middle = rng.normal(size=3) * [0.03, 0.03, 0.05] + [0.0, 0.0, rng.uniform(0.0, 0.12)]
        places, parts = (
            middle + size * rng.normal(size=(count, 3)),
            mass * rng.dirichlet(np.full(count, 2.0)),
        )
        com = parts @ places / mass
        inertia = 0.4 * rng.uniform(0.01, 0.04) ** 2 * mass * np.eye(3)
        for one, r in zip(parts, places - com, strict=True):
            inertia += one * (r @ r * np.eye(3) - np.outer(r, r))
        return cls(mass, com, inertia)

    @property
    def numbers(self) -> np.ndarray:
        """Mass, centre of mass and inertia, (10,)."""
        return np.array([self.mass, *self.com, *self.inertia[np.triu_indices(3)]])


@dataclass(frozen=True)
class LoadedArm(Arm):
    """An arm of which friction has changed and that carries a load."""

    load: Load | None = None

    @cached_property
    def truth(self) -> tuple[dict[str, float], pin.Model]:
        """True parameters of the arm without the load, and Pinocchio's copy of both."""
        values, plant = Arm(self.robot, self.seed, self.mass).truth
        rng = np.random.default_rng(self.seed + 77)
        values = {
            k: v * np.exp(0.1 * rng.normal()) if k[:2] in ("fc", "fv") else v
            for k, v in values.items()
        }
        body = pin.Inertia(self.load.mass, self.load.com, self.load.inertia)
        plant.appendBodyToJoint(self.robot.n, body, last_frame(self.robot))
        return values, plant


def last_frame(robot) -> pin.SE3:
    """Return the last link's frame in that of its joint in Pinocchio's copy of ``random_arms``."""
    joint = robot.joints[-1]
    turn = pin.SE3(pin.utils.rotate("z", joint.theta_offset), np.array([0, 0, joint.d]))
    bend = pin.SE3(pin.utils.rotate("x", joint.twist), np.array([joint.a, 0, 0]))
    return turn * bend if robot.convention == "standard" else turn


def judged(found, load: Load) -> tuple[np.ndarray, np.ndarray]:
    """Return z of all ten numbers and half the width of the intervals of mass and centre."""
    return (found.numbers - load.numbers) / found.std_error, 1.96 * found.std_error


def simulated(seeds: int) -> Iterator[tuple[str, str, float, np.ndarray, np.ndarray, float]]:
    """Yield gains, what is hidden, mass, z, half widths, and misfit of each load."""
    for index, (name, mass) in enumerate(ARMS.items()):
        robot = replace(load_robot(name), coupling=None)
        for k, hidden in enumerate(HIDDEN):
            rng = np.random.default_rng(1000 * index + k)
            arm = Arm(robot, 300 + 10 * index + k, mass)
            clean = arm.log(1, *KEPT, HIDDEN[hidden])
            for how, (said, worst, own) in GAINS.items():
                gains = 1.0 + rng.uniform(-worst, worst, robot.n if own else 1)
                known = replace(robot, torque=replace(robot.torque, gain_error=said))
                try:
                    kept = identify(
                        known, replace(clean, tau=clean.tau * gains), IdentifyOptions(holdout=None)
                    )
                except DynidError as error:
                    print(f"{name}, {hidden}, {how}: {error}", file=sys.stderr)
                    continue
                for seed in range(seeds):
                    load = Load.drawn(rng)
                    log = LoadedArm(robot, arm.seed, mass, load).log(
                        20 + seed, *LOADED, HIDDEN[hidden]
                    )
                    options = IdentifyOptions(holdout=None, drop_weak=True, cutoff=kept.cutoff)
                    loaded = identify(known, replace(log, tau=log.tau * gains), options)
                    found = find_payload(loaded, kept)
                    z, half = judged(found, load)
                    yield how, hidden, load.mass, z, half, found.misfit


def recorded(data: Path) -> Iterator[tuple[str, str, object]]:
    """Yield names of the recordings and the load that was found of ``BALL`` put into the second."""
    kept: dict[str, object] = {}
    for name, before, after in RECORDINGS:
        robot = load_robot(name)
        try:
            if before not in kept:
                kept[before] = identify(
                    robot, read(data, before, robot), IdentifyOptions(holdout=None)
                )
            log = with_ball(robot, read(data, after, robot))
            options = IdentifyOptions(
                holdout=None, cutoff=kept[before].cutoff, delay=kept[before].delay
            )
            yield before, after, find_payload(identify(robot, log, options), kept[before])
        except DynidError as error:
            print(f"{before} {after}: {error}", file=sys.stderr)


def read(data: Path, path: str, robot) -> Log:
    """Return a recording in DH quantities, or the seconds of one that ``path:from:to`` names."""
    from dynid.signals.checks import prepare

    name, *seconds = path.split(":")
    log = prepare(load_log(data / name, robot), robot, identify=False)
    return log if not seconds else replace(part(log, *map(float, seconds)), sha256="")


def ball() -> Load:
    """Return the load that is put into recordings."""
    mass, com, radius = BALL
    return Load(mass, np.array(com), 0.4 * mass * radius**2 * np.eye(3))


def with_ball(robot, log: Log) -> Log:
    """Return a recording with the torque of a ball at the last link, computed by Pinocchio from smoothed positions."""
    plant, before, parent = pin.Model(), pin.SE3.Identity(), 0
    for joint in robot.joints:
        turn = pin.SE3(pin.utils.rotate("z", joint.theta_offset), np.array([0, 0, joint.d]))
        bend = pin.SE3(pin.utils.rotate("x", joint.twist), np.array([joint.a, 0, 0]))
        standard = robot.convention == "standard"
        place, frame = (before, turn * bend) if standard else (before * bend, turn)
        parent, before = plant.addJoint(parent, pin.JointModelRZ(), place, joint.name), frame
    load = ball()
    plant.appendBodyToJoint(parent, pin.Inertia(load.mass, load.com, load.inertia), before)
    plant.gravity.linear = np.array(robot.gravity, float)
    data = plant.createData()
    q, qd, qdd = smooth(log)
    tau = np.array([pin.rnea(plant, data, *state) for state in zip(q, qd, qdd, strict=True)])
    return replace(log, tau=log.tau + tau, sha256="")


def smooth(log: Log, seconds: float = 0.15) -> tuple[np.ndarray, ...]:
    """Return positions, velocities and accelerations of local cubics."""
    from scipy.signal import savgol_filter

    step = float(np.median(np.diff(log.t)))
    grid = np.arange(log.t[0], log.t[-1] + step / 2, step)
    q = np.stack([np.interp(grid, log.t, c) for c in log.q.T], axis=1)
    width = max(5, round(seconds / step) | 1)
    found = [savgol_filter(q, width, 3, deriv=d, delta=step, axis=0) for d in range(3)]
    return tuple(np.stack([np.interp(log.t, grid, c) for c in x.T], axis=1) for x in found)


def row(name: str, cases: list[tuple]) -> str:
    """Return one row of the table."""
    z = np.abs(np.array([case[3] for case in cases]))
    inside = [
        100 * np.mean(z[:, part] < 1.96)
        for part in (slice(0, 1), slice(1, 4), slice(0, 4), slice(4, 10))
    ]
    share = np.median([case[4][0] / case[2] for case in cases])
    centre = np.median([case[4][1:4].max() for case in cases])
    median = np.median(z[:, :4])
    figures = " | ".join(f"{x:.0f}" for x in inside)
    return f"| {name} | {len(cases)} | {figures} | {median:.2f} | {100 * share:.1f} | {1000 * centre:.1f} |"


def main() -> None:
    """Print the tables."""
    seeds = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    cases = list(simulated(seeds)) if seeds else []
    print("# Loads\n\n## Random bodies of 0.2 to 5 kg on simulated arms\n")
    print("Inside their 95 % intervals [%]; half widths of the intervals are medians.\n")
    print(
        "| gains wrong, hidden | loads | mass | centre | mass and centre | inertia | median of z, mass and centre | half width of mass [%] | of centre [mm] |"
    )
    print("| - | - | - | - | - | - | - | - | - |")
    for hidden in HIDDEN:
        for how in GAINS:
            some = [case for case in cases if case[:2] == (how, hidden)]
            if some:
                print(row(f"{how}, {hidden}", some))
    for how in GAINS:
        some = [case for case in cases if case[0] == how]
        if some:
            print(row(f"{how}, all", some))
    if cases:
        print(row("all", cases))
    if len(sys.argv) > 1 and sys.argv[1] != "-":
        print(f"\n## A ball of {BALL[0]} kg put into recordings of real arms\n")
        print(
            "| kept model of | load in | mass [kg] | centre [m] | inertia inside | misfit |\n| - | - | - | - | - | - |"
        )
        truth = ball()
        for before, after, found in recorded(Path(sys.argv[1])):
            z, half = judged(found, truth)
            centre = ", ".join(
                f"{x:.3f} +- {h:.3f}" for x, h in zip(found.body.com, half[1:4], strict=True)
            )
            mark = ["no", "yes"]
            inside = f"{int(np.sum(np.abs(z[4:]) < 1.96))} of 6"
            print(
                f"| {before} | {after} | {found.body.mass:.3f} +- {half[0]:.3f}: {mark[int(abs(z[0]) < 1.96)]} | {centre}: "
                f"{int(np.sum(np.abs(z[1:4]) < 1.96))} of 3 | {inside} | {found.misfit:.1f} |"
            )


if __name__ == "__main__":
    main()
