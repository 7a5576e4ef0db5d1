"""Time of inverse dynamics and regressors of other libraries beside dynid's, one thread; print a table.

    python benchmarks/other_libraries.py

The arm is the bundled KUKA LWR4+ (roboticstoolbox: its own Panda, which has seven joints too). What is not installed is
left out: ``pip install pin mujoco figaroh roboticstoolbox-python adam-robotics``. Libraries that take one state at a time
are called in a loop, as their users do.
"""

from __future__ import annotations

import importlib.util
import re
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "benchmarks"), str(ROOT / "tests" / "physics")]
from dynid.files.robotfile import load_robot  # noqa: E402
from dynid.model import build_model  # noqa: E402
from dynid.sim.urdf import write_urdf  # noqa: E402

SAMPLES, FEW = 20_000, 100


def states(n, samples=SAMPLES):
    """Return positions, velocities and accelerations, (N, n) each."""
    random = np.random.default_rng(0)
    return [random.uniform(-1.0, 1.0, (samples, n)) * size for size in (1.5, 1.0, 3.0)]


def microseconds(action, samples=SAMPLES):
    """Return the shortest processor time of three runs, per sample."""
    action()
    took = []
    for _ in range(3):
        began = time.process_time()
        action()
        took.append(time.process_time() - began)
    return 1e6 * min(took) / samples


def own(robot, urdf, x):
    model = build_model(robot)
    observer, gamma = model.observer(), np.random.default_rng(0).uniform(0.1, 1.0, model.size)
    yield (
        "regressor",
        "dynid, entries that are not zero",
        microseconds(lambda: [None for _ in observer.blocks(*x)]),
    )
    yield "regressor", "dynid, dense 7 x 98", microseconds(lambda: observer.dense(*x))
    yield "inverse dynamics", "dynid", microseconds(lambda: observer.torque(gamma, *x))


def pinocchio(robot, urdf, x):
    import pinocchio as pin

    model = pin.buildModelFromUrdf(str(urdf))
    data = model.createData()
    rows = list(zip(*x, strict=True))
    yield (
        "regressor",
        f"Pinocchio {pin.__version__}, loop, 7 x 70",
        microseconds(
            lambda: [pin.computeJointTorqueRegressor(model, data, *row).copy() for row in rows]
        ),
    )
    yield (
        "inverse dynamics",
        "Pinocchio rnea, loop",
        microseconds(lambda: [pin.rnea(model, data, *row) for row in rows]),
    )


def mujoco(robot, urdf, x):
    import mujoco as mj

    model = mj.MjModel.from_xml_string(urdf.read_text())
    data = mj.MjData(model)

    def loop():
        for data.qpos[:], data.qvel[:], data.qacc[:] in zip(*x, strict=True):
            mj.mj_inverse(model, data)

    yield "inverse dynamics", f"MuJoCo {mj.__version__} mj_inverse, loop", microseconds(loop)


def figaroh(robot, urdf, x):
    import pinocchio as pin
    from figaroh.tools.regressor import build_regressor_basic

    class Arm:
        model = pin.buildModelFromUrdf(str(urdf))

    Arm.data = Arm.model.createData()
    asked = (
        "is_external_wrench",
        "has_friction",
        "has_actuator_inertia",
        "has_joint_offset",
        "is_static_regressor",
    )
    asked = dict.fromkeys((*asked, "is_inertia_regressor", "has_coupled_wrist"), False)
    asked |= {"is_joint_torques": True, "force_torque": None, "act_idxv": list(range(robot.n))}
    few = [part[: 10 * FEW] for part in x]
    yield (
        "regressor",
        "FIGAROH build_regressor_basic",
        microseconds(lambda: build_regressor_basic(Arm, *few, asked), 10 * FEW),
    )


def roboticstoolbox(robot, urdf, x):
    import roboticstoolbox as rtb

    arm, few = rtb.models.DH.Panda(), [part[: 10 * FEW] for part in x]
    yield (
        "inverse dynamics",
        "roboticstoolbox rne (C), Panda",
        microseconds(lambda: arm.rne(*few), 10 * FEW),
    )


def adam(robot, urdf, x):
    from adam.numpy import KinDynComputations

    names = re.findall(r'<joint name="([^"]+)" type="(?:revolute|continuous)"', urdf.read_text())
    arm, base, still = KinDynComputations(str(urdf), names), np.eye(4), np.zeros(6)
    few = list(zip(*(part[:FEW] for part in x), strict=True))

    def loop():
        for q, v, a in few:
            arm.mass_matrix(base, q) @ np.concatenate([still, a]) + arm.bias_force(
                base, q, still, v
            )

    yield "inverse dynamics", "ADAM (NumPy) mass matrix and bias, loop", microseconds(loop, FEW)


def main():
    robot = load_robot("kuka_lwr4plus")
    x, found = states(robot.n), []
    with tempfile.TemporaryDirectory() as folder:
        urdf = Path(folder) / "arm.urdf"
        write_urdf(robot, None, urdf)
        for name, rows in (
            ("dynid", own),
            ("pinocchio", pinocchio),
            ("mujoco", mujoco),
            ("figaroh", figaroh),
            ("roboticstoolbox", roboticstoolbox),
            ("adam", adam),
        ):
            if importlib.util.find_spec(name) is not None:
                found += rows(robot, urdf, x)
    least = {
        kind: next(us for each, _, us in found if each == kind)
        for kind in ("regressor", "inverse dynamics")
    }
    print("| what | who | us a sample | times dynid's |\n| --- | --- | ---: | ---: |")
    for kind in least:
        for each, name, us in found:
            if each == kind:
                print(f"| {kind} | {name} | {us:.3g} | {us / least[kind]:.2g} |")


if __name__ == "__main__":
    main()
