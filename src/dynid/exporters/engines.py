"""Inverse dynamics of written files in Pinocchio, PyBullet and MuJoCo, where installed, and dynid's own by parts.

Positions are those of the robot file; ``JointMap`` says how the file's own joint values follow from them.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.exporters.full_model import FullModel
from dynid.model.regressor import Model
from dynid.robot import JointMap

Floats = NDArray[np.float64]
#: Torques (N, n) [N m or N] of positions, velocities and accelerations, each (N, n) [rad or m, and per s and s^2].
Torques = Callable[[Floats, Floats, Floats], Floats]

#: The parameters of bodies.
RIGID = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")


def part(model: Model, full: FullModel, *, rotors: bool = False, viscous: bool = False) -> Torques:
    """Return dynid's own torques of the bodies, and where wanted of rotors and viscous friction."""
    whole = Model(replace(model.robot, links=(), effects=()), model.rigid)
    wanted = whole.columns_of(*RIGID)
    observer, chosen = whole.observer(wanted), full.values(whole.parameter_names)[wanted]
    inertia, slope = np.array(full.rotor_inertia) * rotors, full.joint_friction("fv") * viscous
    return lambda q, qd, qdd: observer.torque(chosen, q, qd, qdd) + inertia * qdd + slope * qd


def module(name: str) -> Any | None:  # noqa: ANN401 - engines have no types
    """Return a module if it is installed."""
    if importlib.util.find_spec(name) is None:
        return None
    with silent():
        return importlib.import_module(name)


@contextmanager
def silent() -> Iterator[None]:
    """Send what compiled code writes to the standard streams nowhere; it would break --json."""
    sys.stdout.flush()
    sys.stderr.flush()
    kept, nowhere = [os.dup(1), os.dup(2)], os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        yield
    finally:
        for stream, number in zip(kept, (1, 2), strict=True):
            os.dup2(stream, number)
            os.close(stream)
        os.close(nowhere)


def mapped(torques: Torques, mapping: JointMap) -> Torques:
    """Return torques as a function of the robot file's joint values."""
    sign, offset = np.array(mapping.sign), np.array(mapping.offset)

    def run(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        return np.asarray(sign * torques(sign * (q - offset), sign * qd, sign * qdd))

    return run


def pinocchio(
    path: Path, names: Sequence[str], gravity: Floats, *, mjcf: bool = False
) -> tuple[str, Torques] | None:
    """Load a URDF or MJCF in Pinocchio; other joints than the named ones stay at zero."""
    pin = module("pinocchio")
    if pin is None:
        return None
    with silent():
        full = pin.buildModelFromMJCF(str(path)) if mjcf else pin.buildModelFromUrdf(str(path))
    others = [i for i, name in enumerate(full.names) if i and name not in names]
    model = pin.buildReducedModel(full, others, pin.neutral(full)) if others else full
    model.gravity.linear = gravity
    data, joints = model.createData(), [model.joints[model.getJointId(name)] for name in names]

    def run(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        tau = np.empty_like(q)
        own, speed, rate = np.zeros(model.nq), np.zeros(model.nv), np.zeros(model.nv)
        for k in range(len(q)):
            for j, joint in enumerate(joints):
                value = q[k, j]
                own[joint.idx_q : joint.idx_q + joint.nq] = (
                    value if joint.nq == 1 else (np.cos(value), np.sin(value))
                )
                speed[joint.idx_v], rate[joint.idx_v] = qd[k, j], qdd[k, j]
            result = pin.rnea(model, data, own, speed, rate)
            tau[k] = [result[joint.idx_v] for joint in joints]
        return tau

    return f"Pinocchio {pin.__version__}", run


def bullet(path: Path, names: Sequence[str], gravity: Floats) -> tuple[str, Torques] | None:
    """Load a URDF in PyBullet; other joints than the named ones stay at zero."""
    engine = module("pybullet")
    if engine is None:
        return None
    client, body = bullet_body(path, gravity)
    count = engine.getNumJoints(body, physicsClientId=client)
    every = [engine.getJointInfo(body, j, physicsClientId=client) for j in range(count)]
    moving = [info[1].decode() for info in every if info[2] != engine.JOINT_FIXED]
    place = [moving.index(name) for name in names]

    def run(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        tau, spread = np.empty_like(q), np.zeros((3, len(q), len(moving)))
        spread[:, :, place] = q, qd, qdd
        try:
            with silent():
                for k in range(len(q)):
                    inputs = (row.tolist() for row in spread[:, k])
                    tau[k] = np.array(
                        engine.calculateInverseDynamics(body, *inputs, physicsClientId=client)
                    )[place]
        except (engine.error, SystemError) as error:
            raise ValueError("PyBullet: inverse dynamics failed") from error
        return tau

    return "PyBullet", run


def bullet_body(path: Path, gravity: Floats) -> tuple[int, int]:
    """Load a URDF in a physics server of PyBullet, which must be installed; return server and body.

    Args:
        path: the file.
        gravity: in the world frame, (3,) [m/s^2].
    """
    engine = module("pybullet")
    assert engine is not None
    with silent():
        client = engine.connect(engine.DIRECT)
        try:
            body = _bullet_urdf(engine, client, path)
        except engine.error as error:
            raise ValueError(f"PyBullet: {error}") from error
    engine.setGravity(*gravity.tolist(), physicsClientId=client)
    return client, body


def _bullet_urdf(engine: Any, client: int, path: Path) -> int:  # noqa: ANN401
    """Load a URDF without its shapes: their meshes may be anywhere, and dynamics do not need them."""
    root = ET.parse(path).getroot()
    for link in root.iter("link"):
        for shape in [*link.findall("visual"), *link.findall("collision")]:
            link.remove(shape)
    with TemporaryDirectory() as folder:
        bare = Path(folder) / "bare.urdf"
        ET.ElementTree(root).write(bare)
        flags = engine.URDF_USE_INERTIA_FROM_FILE
        return int(
            engine.loadURDF(str(bare), useFixedBase=True, flags=flags, physicsClientId=client)
        )


def mujoco(path: Path, names: Sequence[str], gravity: Floats) -> tuple[str, Torques] | None:
    """Load an MJCF in MuJoCo; dry friction is left out: there it is a soft constraint, not a torque."""
    engine = module("mujoco")
    if engine is None:
        return None
    with silent():
        model = engine.MjModel.from_xml_path(str(path))
    model.opt.gravity[:] = gravity
    model.opt.disableflags |= engine.mjtDisableBit.mjDSBL_CONSTRAINT
    data = engine.MjData(model)
    joints = [model.joint(name) for name in names]

    def run(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        tau = np.empty_like(q)
        for k in range(len(q)):
            for j, joint in enumerate(joints):
                data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = q[k, j], qd[k, j]
                data.qacc[joint.dofadr[0]] = qdd[k, j]
            engine.mj_inverse(model, data)
            # Passive motors, such as cogging, act by themselves: a drive gives the rest.
            engine.mj_fwdActuation(model, data)
            tau[k] = [
                data.qfrc_inverse[joint.dofadr[0]] - data.qfrc_actuator[joint.dofadr[0]]
                for joint in joints
            ]
        return tau

    return f"MuJoCo {engine.__version__}", run
