"""effects.py: what simulators' files have no place for, as one Python file for MuJoCo and PyBullet."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dynid.exporters import mjcf, urdf
from dynid.exporters.code import imported, rendered
from dynid.exporters.engines import module, own_torques, silent
from dynid.exporters.formulas import Column, written
from dynid.exporters.interface import STEP_S, Floats, Format, IdentifiedArm, Loaded
from dynid.exporters.simulated import Simulated, numbers_of, simulated
from dynid.model.effects.laws import ANGLE_STEP
from dynid.model.kinematics import fixed_poses
from dynid.text import code, xml

#: Name of the file.
NAME = "effects.py"
#: Formats that it stands beside.
HOSTS = ("urdf", "mjcf")


def text(arm: IdentifiedArm) -> str:
    """Return the file."""
    found, robot = simulated(arm), arm.robot
    names, mapping = urdf.joints_of(arm)
    beside = {mjcf: found.in_effects_file(mjcf=mjcf) for mjcf in (True, False)}
    always, in_urdf, bristles = list[str](), list[str](), list[Column]()
    for column, size, native in found.columns:
        dry = column.dry_size
        value = written(dry or column.node, robot, len(bristles))
        bristles += [column] * ("z" in column.signals)
        target = f"{'dry' if dry else 'torque'}[{column.joint}]"
        line = f"{target} += {size!r} * {value}  # {code(column.name)}"
        (in_urdf if native else always).append(line)
    poses = [
        _row([part for x in pair for part in (*x[:3, :3].ravel(), *x[:3, 3])])
        for pair in (fixed_poses(joint, robot.convention) for joint in robot.joints)
    ]
    return rendered(
        "effects.txt",
        head=arm.head(code),
        beside={side: code(", ".join(held)) for side, held in beside.items()},
        joints=ascii(list(map(xml, robot.joint_names))),
        full=found.full,
        coulomb=robot.coulomb_shape,
        bends=[(one.joint, one.added.shape["delta"]) for one in bristles],
        urdf_joints=ascii(list(names)),
        mapping=mapping,
        always=[*always, *_whole_arm(arm, found)],
        in_urdf=in_urdf,
        loads=any(column.signals & {"tau", "total"} for column, _, _ in found.columns),
        holding=any(one.effect.name in ("tool_force", "base_tilt") for one in found.whole_arm),
        poses=poses,
    )


def _row(values: Any) -> str:  # noqa: ANN401 - any sequence of numbers
    return repr([float(value) for value in np.ravel(values)])


def _whole_arm(arm: IdentifiedArm, found: Simulated) -> list[str]:
    """Return the statements of effects that turn the torque of the whole arm."""
    lines, n, base = [], arm.robot.n, arm.base
    for added in found.whole_arm:
        sizes = arm.full.values([column.parameter.name for column in added.columns])
        if added.effect.name == "encoder_offset":
            step = max(added.effect.at, ANGLE_STEP, key=abs)
            there = f"rigid(q - {step!r} * np.eye(N)[{added.joints[0]}], qd, qdd)"
            lines.append(f"torque += {float(sizes[0]) / step!r} * ({there} - rigid(q, qd, qdd))")
        elif added.effect.name == "tool_force":
            mass, moment = _row(np.eye(n)[-1]), _row(np.zeros(3 * n))
            lines.append(f"torque += _holding(q, {mass}, {moment}, {_row(sizes)})")
        else:
            # Links whose base parameters are carried by their representatives.
            rigid = base.reduction.base < len(base.model.link_columns)
            links = np.zeros((n, 11))
            links.flat[base.model.link_columns[base.reduction.base[rigid]]] = arm.theta[rigid]
            gravity = np.linalg.norm(arm.robot.gravity) * np.array([*sizes[:2], 0.0])
            held = f"{_row(links[:, 0])}, {_row(links[:, 1:4])}, {_row(gravity)}"
            lines.append(f"torque += _holding(q, {held})")
            c, s = sizes[2:].tolist()
            lines.append(f"torque[0] += {c!r} * cos(q[0]) + {s!r} * sin(q[0])")
    return lines


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what not even this file holds."""
    return (*simulated(arm).left, *urdf.coupled_left_out(arm), *urdf.residual_left_out(arm))


def wanted(arm: IdentifiedArm, formats: tuple[str, ...]) -> bool:
    """Return whether a file of one of these formats lacks something that this file has."""
    found = simulated(arm)
    return any(found.in_effects_file(mjcf=name == "mjcf") for name in formats if name in HOSTS)


def loaded(path: Path, arm: IdentifiedArm) -> Loaded | None:
    """Load it with an MJCF in MuJoCo; what remembers is compared along the states."""
    found, engine = simulated(arm), module("mujoco")
    if engine is None or mjcf.negative_numbers(arm):
        return None
    with silent():
        model = engine.MjModel.from_xml_string(mjcf.text(arm))
    bristles = {one.joint: one.loss for one in found.native if one.loss}
    what = "all that is not left out" if found.left else "all"
    what += ", without the bristle of the file" * bool(bristles)
    theirs = stepped(imported(path).Mujoco(model))
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
