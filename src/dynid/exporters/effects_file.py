"""effects.py: what simulators' files have no place for, as one Python file for MuJoCo and PyBullet."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.exporters import closed_forms, formula_code, mjcf, urdf
from dynid.exporters.code import template
from dynid.exporters.engines import bullet_body, module, silent
from dynid.exporters.full_model import world_gravity
from dynid.exporters.interface import Format, IdentifiedArm, Loaded
from dynid.exporters.languages import PYTHON, STEP_S, effect_entries, imported
from dynid.exporters.simulated import Simulated, simulated
from dynid.exporters.user_urdf import attached
from dynid.model.base_model import model_torques
from dynid.model.kinematics import fixed_poses
from dynid.robot import JointMap
from dynid.text import code, xml

Floats = NDArray[np.float64]

#: Name of the file.
NAME = "effects.py"


def text(arm: IdentifiedArm) -> str:
    """Return the file."""
    found, robot = simulated(arm), arm.robot
    full, shape = found.full, robot.coulomb_shape
    names, mapping = (
        tuple(map(xml, robot.joint_names)),
        JointMap((1.0,) * robot.n, (0.0,) * robot.n),
    )
    if arm.urdf is not None:
        place = attached(arm.urdf, robot)
        names, mapping = tuple(map(xml, place.names)), place.mapping
    lengths = sorted(bristles_of(arm))
    bends = [
        f"        self._bend({k}, q[{joint}], {length!r})"
        for k, (joint, length) in enumerate(lengths)
    ]
    held = {
        side: found.in_effects_file(mjcf=side, names=robot.joint_names) for side in (True, False)
    }
    smooth = (
        "np.tanh(qd / WIDTH)"
        if shape.shape == "smooth"
        else "np.where(np.abs(qd) >= WIDTH, np.sign(qd), 0.0)"
    )
    return template("effects.txt").substitute(
        head=arm.head(code),
        holds=code(
            f"For an MJCF: {', '.join(held[True]) or 'nothing'}. For a URDF: {', '.join(held[False])}."
        ),
        joints=ascii(list(map(xml, robot.joint_names))),
        n=robot.n,
        rotors=_row(full.rotor_inertia),
        viscous=_row(full.joint_friction("fv")),
        coulomb=_row(full.joint_friction("fc")),
        offset=_row(full.joint_friction("fo")),
        width=_row(shape.velocity),
        bristles=len(lengths),
        urdf_joints=ascii(list(names)),
        sign=_row(mapping.sign),
        zero=_row(mapping.offset),
        coulomb_sign=smooth,
        bends="\n".join(bends),
        statements="\n".join(_statements(arm, found)),
        arm=_arm_functions(arm, found),
    )


def _row(values: Any) -> str:  # noqa: ANN401 - any sequence of numbers
    return repr([float(value) for value in np.ravel(values)])


def _statements(arm: IdentifiedArm, found: Simulated) -> list[str]:
    """Return the statements that add torques and sizes of dry friction."""
    lengths = sorted(bristles_of(arm))
    spelling = formula_code.Spelling(
        item=lambda array, joint: f"{array}[{joint}]",
        sign=lambda joint: f"sign[{joint}]",
        call=lambda function, x: f"np.{function}({x})",
        absolute="abs",
        power=PYTHON.power,
        plain_sign=PYTHON.plain_sign,
        time="self.t",
        bristle=lambda joint, length: f"self.z[{lengths.index((joint, length))}]",
    )
    always: list[str] = []
    in_urdf: list[str] = []
    for column, size, native in found.columns:
        dry = closed_forms.dry_size(column)
        node, target = (column.node, "torque") if dry is None else (dry, "dry")
        line = f"{target}[{column.joint}] += {size!r} * {formula_code.written(node, spelling)}"
        (in_urdf if native else always).append(f"        {line}  # {code(column.name)}")
    lines = [*always, *_whole_arm(arm, found)]
    if in_urdf:
        lines += ["        if not self.mjcf:", *(f"    {line}" for line in in_urdf)]
    needed = set().union(*(closed_forms.heads(column.node) for column, _, _ in found.columns), {""})
    first = ["        sign = _sign(qd)"] if "sign" in needed else []
    if needed & {"tau", "total"}:
        friction = "VISCOUS * qd + COULOMB * _sign(qd) + OFFSET"
        first += [
            "        tau = rigid(q, qd, qdd) + ROTORS * qdd",
            f"        total = tau + {friction}",
        ]
    return first + lines


def _whole_arm(arm: IdentifiedArm, found: Simulated) -> list[str]:
    """Return the statements of effects that turn the torque of the whole arm."""
    lines, robot = [], arm.robot
    for added in found.whole_arm:
        sizes = [
            float(arm.full.friction.get(column.parameter.name, 0.0)) for column in added.columns
        ]
        name = added.effect.name
        if name == "encoder_offset":
            step = closed_forms.offset_step(added)
            moved = (
                f"rigid(q - {step!r} * np.eye(N)[{added.joints[0]}], qd, qdd) - rigid(q, qd, qdd)"
            )
            lines.append(f"        torque += {sizes[0] / step!r} * ({moved})  # encoder_offset")
        elif name == "tool_force":
            mass, moment = _row(np.eye(robot.n)[-1]), _row(np.zeros(3 * robot.n))
            lines.append(
                f"        torque += _holding(q, {mass}, {moment}, {_row(sizes)})  # tool_force"
            )
        elif name == "base_tilt":
            links = closed_forms.representatives(arm.base, arm.theta)
            gravity = float(np.linalg.norm(robot.gravity)) * np.array([*sizes[:2], 0.0])
            held = f"_holding(q, {_row(links[:, 0])}, {_row(links[:, 1:4])}, {_row(gravity)})"
            lines.append(f"        torque += {held}  # base_tilt")
            lines.append(
                f"        torque[0] += {sizes[2]!r} * np.cos(q[0]) + {sizes[3]!r} * np.sin(q[0])"
            )
    return lines


def _arm_functions(arm: IdentifiedArm, found: Simulated) -> str:
    """Return the function that tool forces and tilted bases need."""
    if not {one.effect.name for one in found.whole_arm} & {"tool_force", "base_tilt"}:
        return ""
    poses = [fixed_poses(joint, arm.robot.convention) for joint in arm.robot.joints]
    rows = [
        np.concatenate([part for x in pair for part in (x[:3, :3].ravel(), x[:3, 3])])
        for pair in poses
    ]
    values = "\n".join(f"    {', '.join(repr(float(x)) for x in row)}," for row in rows)
    turning = repr([int(joint.revolute) for joint in arm.robot.joints])
    return template("holding.txt").substitute(poses=values, turning=turning)


def bristles_of(arm: IdentifiedArm) -> set[tuple[int, float]]:
    """Return the bristles that effects of an arm remember: joint from 0 and length [rad or m]."""
    columns = (
        column for added in arm.base.model.added for column in closed_forms.columns_of(added) or ()
    )
    return set().union(*(closed_forms.bristles(column.node) for column in columns))


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return what not even this file holds."""
    return (*simulated(arm).left, *urdf.coupled_left_out(arm), *urdf.residual_left_out(arm))


def wanted(arm: IdentifiedArm, formats: tuple[str, ...]) -> bool:
    """Return whether a file of one of these formats lacks something that this file has."""
    found, names = simulated(arm), arm.robot.joint_names
    return any(
        found.in_effects_file(mjcf=name == "mjcf", names=names) for name in formats if name in HOSTS
    )


#: Formats that it stands beside.
HOSTS = ("urdf", "mjcf")


def loaded(path: Path, arm: IdentifiedArm) -> Iterator[Loaded]:
    """Load it with an MJCF in MuJoCo and with a URDF in PyBullet; what remembers is compared along the states."""
    found = simulated(arm)

    def ours(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        return _torques(arm, found, q, qd, qdd, bristles=False)

    what = "all" if not found.left else "all that is not left out"
    engine = module("mujoco")
    if engine is not None and not mjcf.negative_numbers(arm):
        with silent():
            model = engine.MjModel.from_xml_string(mjcf.text(arm))
        effects = imported(path).Mujoco(model)
        but = ", without the bristle of the file" if found.bristles else ""
        yield Loaded(f"MuJoCo {engine.__version__}", what + but, _stepped(effects), ours)
    engine = module("pybullet")
    if engine is not None and not mjcf.negative_numbers(arm):
        with TemporaryDirectory() as folder:
            there = Path(folder) / "arm.urdf"
            there.write_text(urdf.text(arm), encoding="utf-8")
            client, body = bullet_body(there, world_gravity(arm.robot))
        effects = imported(path).Bullet(body, client)
        yield Loaded(
            "PyBullet", what, _stepped(effects), lambda *s: _torques(arm, found, *s, bristles=True)
        )


def _stepped(effects: Any) -> Any:  # noqa: ANN401 - a class of the written file
    def run(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        effects.start()
        rows = []
        for state in zip(q, qd, qdd, strict=True):
            effects.step(state[0], STEP_S)
            with silent():
                rows.append(effects.inverse_dynamics(*state))
        return np.array(rows)

    return run


def _torques(
    arm: IdentifiedArm, found: Simulated, q: Floats, qd: Floats, qdd: Floats, *, bristles: bool
) -> Floats:
    """Return dynid's own torques of all parameters, (N, n) [N m or N].

    Args:
        arm: the arm.
        found: where its effects go.
        q: positions, (N, n).
        qd: velocities, (N, n).
        qdd: accelerations, (N, n).
        bristles: with friction that an MJCF has as a bristle, which only moves along a simulation.
    """
    model = arm.base.model
    names = model.parameter_names
    values = arm.full.values(names)
    gone = [p.name for p in model.friction if p.kind in ("Imc", "fvc", "fcc")]
    gone += [
        c.parameter.name
        for a in model.added
        if a.effect.name in closed_forms.REASONS
        for c in a.columns
    ]
    values[[names.index(name) for name in gone]] = 0.0
    tau = model.observer(np.arange(model.plain_size)).torque(values[: model.plain_size], q, qd, qdd)
    reference = model_torques(model, arm.base.reduction, arm.theta)
    for name, row, entry in effect_entries(arm, reference, q, qd, qdd):
        tau[:, row] += values[names.index(name)] * entry
    if not bristles:
        sign = model.observer().coulomb_sign(qd)
        for each in found.bristles:
            entries = effect_entries(arm, reference, q, qd, qdd)
            entry = next(
                e for name, row, e in entries if row == each.joint and name.startswith("presliding")
            )
            tau[:, each.joint] -= each.size * (entry + sign[:, each.joint])
    return tau


EFFECTS = Format("effects", ".py", text, leaves_out, loaded)
