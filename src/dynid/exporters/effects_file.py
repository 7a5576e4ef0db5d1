"""effects.py: what simulators' files have no place for, as one Python file for MuJoCo and PyBullet."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.exporters import mjcf, urdf
from dynid.exporters.code import imported, rendered
from dynid.exporters.engines import own_torques, quiet
from dynid.exporters.formulas import without_torque, written
from dynid.exporters.interface import STEP_S, Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import numbers_of, simulated
from dynid.model.effects.laws import ANGLE_STEP
from dynid.model.kinematics import fixed_poses

#: Formats that it accompanies.
HOSTS = ("urdf", "mjcf")


def text(arm: IdentifiedArm) -> str:
    """Return the file."""
    simulation, (names, mapping) = simulated(arm), urdf.joints_of(arm)
    pairs = [fixed_poses(joint, arm.robot.convention) for joint in arm.robot.joints]
    return rendered(
        "effects.txt",
        arm=arm,
        simulation=simulation,
        full=simulation.full,
        urdf_joints=names,
        mapping=mapping,
        shape=arm.robot.coulomb_shape,
        bristles=[column for column, _ in simulation.columns if "z" in column.signals],
        loads=any(column.signals & {"tau", "total"} for column, _ in simulation.columns),
        arm_effects=[one.effect.name for one in simulation.arm_effects],
        written=written,
        angle_step=ANGLE_STEP,
        gravity=float(np.linalg.norm(arm.robot.gravity)),
        links=_carried(arm).tolist(),
        poses=[np.hstack([(*x[:3, :3].ravel(), *x[:3, 3]) for x in pair]) for pair in pairs],
    )


def _carried(arm: IdentifiedArm) -> Floats:
    """Return masses and first moments of links that carry the base parameters as their representatives, (4, n)."""
    model, base = arm.base.model, arm.base.reduction.base
    rigid, links = base < len(model.link_columns), np.zeros((arm.robot.n, 11))
    links.flat[model.link_columns[base[rigid]]] = arm.theta[rigid]
    return links[:, :4].T


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what not even this file holds."""
    return simulated(arm).left


def wanted(arm: IdentifiedArm, formats: tuple[str, ...]) -> bool:
    """Return whether a file of one of these formats lacks something that this file has."""
    simulation = simulated(arm)
    return any(simulation.in_effects_file(mjcf=name == "mjcf") for name in formats if name in HOSTS)


def loaded(text: str, arm: IdentifiedArm) -> Loaded | None:
    """Load it with an MJCF in MuJoCo; what remembers is compared along the states."""
    import mujoco

    if mjcf.negative_numbers(arm):
        return None
    with quiet():
        model = mujoco.MjModel.from_xml_string(mjcf.text(arm))
    what = "all that is not left out" if without_torque(arm.robot) else "all"
    theirs = stepped(imported(text).Mujoco(model))
    return Loaded(f"MuJoCo {mujoco.__version__}", what, theirs, own_torques(arm, own_values(arm)))


def own_values(arm: IdentifiedArm) -> dict[str, float]:
    """Return the parameters by name that files with this one hold."""
    simulation = simulated(arm)
    of_arm = [name for added in simulation.arm_effects for name in added.names]
    values = numbers_of(arm, "Im", "fv", "fc", "fo")
    values |= {column.name: size for column, size in simulation.columns}
    return values | dict(zip(of_arm, arm.full.values(of_arm), strict=True))


def stepped(effects: Any) -> Any:  # noqa: ANN401 - a class of the written file
    """Return its torques along states STEP_S apart."""

    def run(*states: Floats) -> Floats:
        effects.start()
        rows = []
        for state in zip(*states, strict=True):
            effects.step(state[0], STEP_S)
            with quiet():
                rows.append(effects.inverse_dynamics(*state))
        return np.array(rows)

    return run


EFFECTS = Format("effects", ".py", text, leaves_out, loaded)
