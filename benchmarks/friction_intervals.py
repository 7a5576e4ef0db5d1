"""Friction of simulated arms inside its intervals: short and long logs, friction that is large, small and next to none.

    PYTHONPATH=src python benchmarks/friction_intervals.py > benchmarks/friction_intervals.md

PyBullet's LWR4+ (trajectories/lwr4plus_truth.yaml) with friction drawn anew for each seed: viscous friction of each joint
times exp(0.7 z), Coulomb friction times exp(0.4 z), and all viscous friction smaller by a common factor. Torques with three
times the noise of its sensors. Inside: truth within 1.96 standard errors of the possible arm.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from dynid import identify, load_robot
from dynid.log import Log
from dynid.sim.plant import read_plant
from dynid.sim.sines import SineSpec, sines

TRUTH = Path(__file__).parents[1] / "trajectories" / "lwr4plus_truth.yaml"
SEEDS, RATE = range(20), 200.0


def recorded(robot, plant, seconds: float, rng) -> Log:
    """Return a log of an arm that moves as sines say."""
    motion = sines(robot, SineSpec(seconds, 6.0, 0.7, 0.7, 0.5, 0.1), 1.0 / RATE, rng)
    with plant.arm(robot) as arm:
        rigid = [
            arm.inverse_dynamics(*state)
            for state in zip(motion.q, motion.qd, motion.qdd, strict=True)
        ]
        tau = np.array(rigid) + arm.friction.torque(motion.qd) + arm.rotor_inertia * motion.qdd
    tau = tau + 3.0 * rng.normal(size=tau.shape) * np.array(plant.sensors.torque_noise)
    q = np.round(motion.q / plant.sensors.position_step) * plant.sensors.position_step
    return Log(motion.t, q, tau, robot.joint_names, tau_unit="Nm", dh=True)


def main() -> None:
    robot, arm = load_robot("kuka_lwr4plus"), read_plant(TRUTH)
    print("# Friction inside its intervals\n")
    print(__doc__.split("\n\n")[2].strip(), f"\nSeeds 0 to {max(SEEDS)}, 7 joints each.\n")
    print(
        "| viscous friction times | seconds | viscous inside [%] | largest error | Coulomb inside [%] | largest error |"
    )
    print("| --: | --: | --: | --: | --: | --: |")
    for share in (1.0, 0.1, 0.01):
        for seconds in (8.0, 20.0):
            errors: dict[str, list[float]] = {"fv": [], "fc": []}
            for seed in SEEDS:
                rng = np.random.default_rng(seed)
                known = arm.friction
                viscous = [share * x * np.exp(rng.normal(0.0, 0.7)) for x in known.viscous]
                coulomb = [x * np.exp(rng.normal(0.0, 0.4)) for x in known.coulomb]
                plant = replace(
                    arm, friction=replace(known, viscous=tuple(viscous), coulomb=tuple(coulomb))
                )
                found = identify(
                    robot,
                    recorded(robot, plant, seconds, rng),
                    holdout=None,
                    anyway=True,
                    drop_weak=True,
                )
                told = dict(
                    zip(found.names, zip(found.theta, found.std_error, strict=True), strict=True)
                )
                for kind, truth in (("fv", viscous), ("fc", coulomb)):
                    for j, value in enumerate(truth):
                        theta, error = told[f"{kind}{j + 1}"]
                        errors[kind].append(abs(theta - value) / error)
            cells = [
                f"{100 * np.mean(np.array(z) < 1.96):.0f} | {max(z):.1f}" for z in errors.values()
            ]
            print(f"| {share:g} | {seconds:g} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
