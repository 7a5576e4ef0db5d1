"""The gap in the simulator: exported files driven along an unseen motion, without and with the effect.

    PYTHONPATH=src python benchmarks/simulator_gap.py ../shared/data > benchmarks/simulator_gap.md

Simulated arms are the LWR4+ of trajectories/lwr4plus_truth.yaml in PyBullet with a hidden torque of dynid.sim.hidden (seed
0), two motions fitted, the third driven. Before: bodies, rotors, frictionloss and damping alone. After: the same logs with
the effect in the robot file. The LWR4+ is fitted on runs 1 and 2, what `dynid gap` names on all three runs is added, as
`gap --apply` does, and run 3 is driven. The exported MJCF and effects.py are loaded in MuJoCo, URDF and effects.py in
PyBullet.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

import dynid
from dynid.robot import EffectSpec
from dynid.sim.hidden import CASES, hidden_logs
from dynid.sim.plant import plant_of
from dynid.workflows.simulator_gap import compare_in_simulator

#: Shapes of the effects that stand for hidden torques; the laws of some differ on purpose.
SHAPES = {
    "stribeck": {"vs": 0.06, "d": 2.0},
    "spring": {"order": 3.0, "constant": 0.0},
    "load_friction": {},
    "position_friction": {"h": 1.0},
    "torque_ripple": {"k": 40.0},
    "end_stop": {"side": 1.0, "q1": 0.2},
    "joint_coupling": {},
    "asymmetric_viscous": {},
    "presliding_hysteresis": {"delta": 0.03},
}


def row(name: str, joint: int, results, log) -> str:
    cells = [name]
    for engine in ("mujoco", "pybullet"):
        found = compare_in_simulator(results, log, engine=engine)
        position, torque = 1000 * found.position_rms, found.torque_rms
        cells.append(" -> ".join(f"{value:.3g}" for value in position[:, joint]))
        cells.append(" -> ".join(f"{value:.3g}" for value in torque[:, joint]))
    return f"| {' | '.join(cells)} |"


def main() -> None:
    print("# The gap in the simulator\n")
    print(__doc__.split("\n\n")[2].strip(), "\n")
    print(
        "| arm, effect, joint | MuJoCo: position [mrad] | torque [N m] | PyBullet: position [mrad] | torque [N m] |"
    )
    print("| --- | --- | --- | --- | --- |")
    robot, rng = dynid.load_robot("kuka_lwr4plus"), np.random.default_rng(0)
    for case in CASES:
        if case.name not in SHAPES:
            continue
        logs = hidden_logs(robot, plant_of(robot), case, rng, motions=3, repeats=1, seconds=20.0)
        own = [robot.joint_names[case.joint]]
        if case.name == "joint_coupling":
            own.append(robot.joint_names[case.joint + 1])
        with_effect = replace(
            robot, effects=(EffectSpec(case.name, tuple(own), SHAPES[case.name]),)
        )
        results = [dynid.identify(arm, logs[:2]) for arm in (robot, with_effect)]
        print(
            row(f"simulated, `{case.name}`, joint {case.joint + 1}", case.joint, results, logs[2]),
            flush=True,
        )
    data = Path(sys.argv[1]) / "kuka_lwr4plus"
    runs = [data / f"run{k}.bag" for k in (1, 2, 3)]
    before = dynid.identify(robot, runs[:2])
    gap = dynid.find_gap(before, runs)
    print(
        f"\nNamed on the runs of the real LWR4+: {', '.join(f'{e.effect} on {e.where}' for e in gap.named) or 'nothing'}; "
        f"held out: {gap.heldout}.\n"
    )
    if gap.named:
        after = gap.apply()
        print(
            "| real LWR4+, run 3 | MuJoCo: position [mrad] | torque [N m] | PyBullet: position [mrad] | torque [N m] |"
        )
        print("| --- | --- | --- | --- | --- |")
        for joint in range(7):
            print(row(f"joint {joint + 1}", joint, [before, after], runs[2]), flush=True)


if __name__ == "__main__":
    main()
