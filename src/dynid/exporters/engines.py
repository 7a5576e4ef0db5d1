"""Written files in MuJoCo, which computes their inverse dynamics, and dynid's own torques."""

from __future__ import annotations

import os
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from dynid.arrays import Floats
from dynid.exporters.interface import IdentifiedArm, Loaded, Torques, motion_of
from dynid.model.regressor import Model
from dynid.robot import JointMap


def own_torques(arm: IdentifiedArm, values: Mapping[str, float]) -> Torques:
    """Return dynid's torques of parameters by name, those of bodies that were not identified too; others are zero."""
    model = Model(replace(arm.robot, links=()), arm.base.model.rigid)
    gamma = np.array([values.get(name, 0.0) for name in model.parameter_names])
    observer = model.observer()
    return lambda *states: observer.along(motion_of(arm, *states)) @ gamma


@contextmanager
def quiet() -> Iterator[None]:
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


def bare_urdf(text: str) -> str:
    """Return a URDF without shapes and friction: meshes may be anywhere, and torques of bodies need neither."""
    root = ET.fromstring(text)
    for parent in [*root.iter("link"), *root.iter("joint")]:
        for tag in ("visual", "collision", "dynamics"):
            for part in parent.findall(tag):
                parent.remove(part)
    # Why: MuJoCo refuses fingers without a mass.
    engine = ET.SubElement(root, "mujoco")
    ET.SubElement(engine, "compiler", boundmass="1e-14", boundinertia="1e-14")
    return ET.tostring(root, encoding="unicode")


def in_mujoco(
    text: str,
    names: Sequence[str],
    arm: IdentifiedArm,
    what: str,
    values: Mapping[str, float],
    mapping: JointMap | None = None,
) -> Loaded:
    """Load an MJCF or a bare URDF in MuJoCo.

    Dry friction is left out: there it is a soft constraint, not a torque. Joints without a name here stay at zero.

    Args:
        text: of the file.
        names: its joints in the order of the arm.
        arm: what was written.
        what: what is compared.
        values: parameters by name whose torques the file has.
        mapping: from its joint values to the arm's; None where they are the same.
    """
    import mujoco

    with quiet():
        model = mujoco.MjModel.from_xml_string(text)
    model.opt.gravity[:] = arm.robot.world_gravity
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, joints = mujoco.MjData(model), [model.joint(name) for name in names]
    places = [joint.qposadr[0] for joint in joints]
    dofs = [joint.dofadr[0] for joint in joints]
    sign, offset = np.array([mapping.sign, mapping.offset] if mapping else [[1.0], [0.0]])

    def run(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        tau = np.empty_like(q)
        for k, state in enumerate(zip(q - offset, qd, qdd, strict=True)):
            data.qpos[places], data.qvel[dofs], data.qacc[dofs] = sign * state
            mujoco.mj_inverse(model, data)
            tau[k] = sign * data.qfrc_inverse[dofs]
        return tau

    return Loaded(f"MuJoCo {mujoco.__version__}", what, run, own_torques(arm, values))
