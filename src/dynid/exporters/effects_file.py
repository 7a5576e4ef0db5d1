"""effects.py: what simulators' files have no place for, as one Python file for MuJoCo and PyBullet."""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.exporters import mjcf, urdf
from dynid.exporters.code import imported, rendered
from dynid.exporters.engines import module, own_torques, silent
from dynid.exporters.formulas import written
from dynid.exporters.interface import STEP_S, Floats, Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import numbers_of, simulated
from dynid.model.effects.laws import ANGLE_STEP
from dynid.model.kinematics import fixed_poses
from dynid.text import xml

#: Formats that it stands beside.
HOSTS = ("urdf", "mjcf")


def text(arm: IdentifiedArm) -> str:
    """Return the file."""
    found, (names, mapping) = simulated(arm), urdf.joints_of(arm)
    pairs = [fixed_poses(joint, arm.robot.convention) for joint in arm.robot.joints]
    return rendered(
        "effects.txt",
        arm=arm,
        found=found,
        full=found.full,
        joints=list(map(xml, arm.robot.joint_names)),
        urdf_joints=names,
        mapping=mapping,
        shape=arm.robot.coulomb_shape,
        bristles=[column for column, _, _ in found.columns if "z" in column.signals],
        loads=any(column.signals & {"tau", "total"} for column, _, _ in found.columns),
        whole_arm=[one.effect.name for one in found.whole_arm],
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
    return (*simulated(arm).left, *urdf.coupled_left_out(arm), *urdf.residual_left_out(arm))


def wanted(arm: IdentifiedArm, formats: tuple[str, ...]) -> bool:
    """Return whether a file of one of these formats lacks something that this file has."""
    found = simulated(arm)
    return any(found.in_effects_file(mjcf=name == "mjcf") for name in formats if name in HOSTS)


def loaded(text: str, arm: IdentifiedArm) -> Loaded | None:
    """Load it with an MJCF in MuJoCo; what remembers is compared along the states."""
    found, engine = simulated(arm), module("mujoco")
    if engine is None or mjcf.negative_numbers(arm):
        return None
    with silent():
        model = engine.MjModel.from_xml_string(mjcf.text(arm))
    bristles = {one.place[1]: one.loss for one in found.native if one.loss}
    what = "all that is not left out" if found.left else "all"
    what += ", without the bristle of the file" * bool(bristles)
    theirs = stepped(imported(text).Mujoco(model))
    values = own_values(arm)
    for column, _, native in found.columns:
        if native and "z" in column.signals:
            values[column.name] = 0.0
            values[f"fc{column.joint + 1}"] -= bristles[column.joint]
    return Loaded(f"MuJoCo {engine.__version__}", what, theirs, own_torques(arm, values))


def own_values(arm: IdentifiedArm) -> dict[str, float]:
    """Return the parameters by name that files with this one hold."""
    found = simulated(arm)
    whole = [column.parameter.name for added in found.whole_arm for column in added.columns]
    values = numbers_of(arm, "Im", "fv", "fc", "fo")
    values |= {column.name: size for column, size, _ in found.columns}
    return values | dict(zip(whole, arm.full.values(whole), strict=True))


def stepped(effects: Any) -> Any:  # noqa: ANN401 - a class of the written file
    """Return its torques along states STEP_S apart."""

    def run(*states: Floats) -> Floats:
        effects.start()
        rows = []
        for state in zip(*states, strict=True):
            effects.step(state[0], STEP_S)
            with silent():
                rows.append(effects.inverse_dynamics(*state))
        return np.array(rows)

    return run


EFFECTS = Format("effects", ".py", text, leaves_out, loaded)
