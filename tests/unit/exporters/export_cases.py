"""Arms whose bodies, rotors and friction are known, ready to be exported."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pinocchio as pin
import pybullet

import models
from arms import pinocchio_torques, random_bodies, random_robot
from dynid import load_robot
from dynid.estimation.residual_model import GROUPS, ModelError
from dynid.exporters import FORMATS
from dynid.exporters.code import imported
from dynid.exporters.effects_file import EFFECTS, own_values, stepped
from dynid.exporters.engines import bare_urdf, own_torques
from dynid.exporters.full_model import FullModel
from dynid.exporters.interface import IdentifiedArm
from dynid.exporters.simulated import numbers_of
from dynid.exporters.urdf import joints_of
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.reduce import random_states
from dynid.robot import EffectSpec

SHIPPED = ("kuka_lwr4plus", "kinova_gen2", "scara", "staubli_tx40", "franka_panda")


def made(robot, seed=1, bodies=None, urdf=None):
    """An identified arm whose parameters are random but possible."""
    rng = np.random.default_rng(seed)
    base = models.base_of(robot)
    model = base.model
    rotors = rng.uniform(0.01, 0.2, robot.n)
    drives = {
        f"Im{i}": float(x)
        for i, (x, joint) in enumerate(zip(rotors, robot.joints, strict=True), start=1)
        if joint.motor_inertia
    }
    full = FullModel(
        robot=robot,
        bodies=bodies or random_bodies(rng, robot.n),
        drives=drives | {one.name: float(rng.uniform(0.1, 1.0)) for one in model.friction},
        origin=dict.fromkeys(model.parameter_names, "data"),
    )
    theta = base.reduction.K @ full.values(model.parameter_names)
    made = "0.1.0", "wls", "physical", 1.5, ("ab" * 32,)
    return IdentifiedArm(base, theta, ("well",) * len(theta), full, *made, urdf)


def shipped(name):
    return made(load_robot(name))


def random(seed):
    return made(random_robot(np.random.default_rng(seed), n=4), seed)


def random_model_error(arm, seed=0):
    """A residual model of random numbers; every column of every joint has its part."""
    rng = np.random.default_rng(seed)
    n, p, k = arm.robot.n, len(arm.theta), len(GROUPS)
    own = np.vstack([0.2 * rng.normal(size=(1, p)), np.zeros((n - 1, p))])
    return ModelError(
        speed=rng.uniform(0.2, 1.0, n),
        reference=arm.theta * rng.uniform(0.9, 1.1, p),
        scale=rng.uniform(0.5, 2.0, (n, k)),
        projection=0.1 * rng.normal(size=(n, p, k)),
        mean=np.hstack([rng.normal(size=(n, k)), own]),
        root=np.zeros((n, k + p, k + p)),
        slope=np.zeros((n, k + p, p)),
        size=np.ones(3),
        rms=np.ones((n, 4)),
        evidence=10.0,
        apart=np.r_[1.0, np.zeros(n - 1)],
    )


#: Numbers of effects for which any will not do: what bodies have, and orders and sides.
SIZES = {
    "spring": {"order": 3.0, "constant": 1.0, "k1": 2.0, "k2": 0.3, "k3": 0.4, "c": 0.5},
    "end_stop": {"side": -1.0, "q1": 0.2, "a": 4.0},
    "stribeck": {"a": 1.1, "vs": 0.3, "d": 1.7},
    "encoder_offset": {"offset": 0.02},
    "payload": {"form": 10.0, "m": 1.5, "mcx": 0.02, "mcy": 0.01, "mcz": 0.1}
    | {"Ixx": 0.012, "Ixy": 0.0, "Ixz": 0.0, "Iyy": 0.012, "Iyz": 0.0, "Izz": 0.004},
}


def sizes_of(effect):
    """Return numbers of an effect of the catalogue, of a size that arms have."""
    shape = dict.fromkeys(effect.shape_units, 1.7)
    amplitudes = {name: 0.1 * k for k, name in enumerate(effect.amplitudes(shape), 1)}
    return SIZES.get(effect.name, shape | amplitudes)


def with_effect(name, robot="kuka_lwr4plus", seed=1):
    """An identified arm with one effect of the catalogue, on joint 3 where it has a joint."""
    arm = load_robot(robot)
    effect = CATALOGUE[name]
    joints = {"joint": (arm.joint_names[2],), "pair": arm.joint_names[2:4], "arm": ()}[effect.scope]
    arm = replace(arm, effects=(EffectSpec(name, joints, sizes_of(effect)),))
    made_of = made(arm, seed)
    (values,), sizes = (spec.parameters for spec in arm.effects), {}
    for added in made_of.base.model.added:
        own = added.effect.amplitudes(added.shape)
        sizes |= {name: values.get(each, 0.0) for name, each in zip(added.names, own, strict=True)}
    full = replace(made_of.full, drives=made_of.full.drives | sizes)
    theta = made_of.base.reduction.K @ full.values(made_of.base.model.parameter_names)
    return replace(made_of, full=full, theta=theta)


# ---------------------------------------------------------------- other people's engines
def written(source, name, folder):
    path = folder / f"arm{FORMATS[name].suffix}"
    path.write_text(FORMATS[name].text(source), encoding="utf-8")
    return path


def off_in_pinocchio(source, path):
    """Largest difference of torques on 1000 states [N m or N]: bodies, and rotors of an MJCF."""
    mjcf = path.suffix == ".xml"
    names, mapping = joints_of(source)
    build = pin.buildModelFromMJCF if mjcf else pin.buildModelFromUrdf
    full = build(str(path))
    others = [i for i, name in enumerate(full.names) if i and name not in names]
    model = pin.buildReducedModel(full, others, pin.neutral(full))
    model.gravity.linear = source.robot.world_gravity
    assert list(model.names)[1:] == list(names)
    sign = np.array(mapping.sign)
    ours = own_torques(source, numbers_of(source, *["Im"] * mjcf))
    q, qd, qdd = states = random_states(source.robot, 1000, 0)
    found = pinocchio_torques(model, sign * (q - mapping.offset), sign * qd, sign * qdd)
    return np.abs(sign * found - ours(*states)).max()


def bullet_body(text, gravity):
    """Load a URDF in a physics server of PyBullet; return server and body."""
    client = pybullet.connect(pybullet.DIRECT)
    with TemporaryDirectory() as folder:
        bare = Path(folder) / "bare.urdf"
        bare.write_text(bare_urdf(text), encoding="utf-8")
        flags = pybullet.URDF_USE_INERTIA_FROM_FILE
        body = pybullet.loadURDF(str(bare), useFixedBase=True, flags=flags, physicsClientId=client)
    pybullet.setGravity(*gravity.tolist(), physicsClientId=client)
    return client, body


def off_in_pybullet(source, path):
    """Largest difference of all torques on 1000 states [N m or N], of a URDF with its effects.py."""
    client, body = bullet_body(path.read_text(), source.robot.world_gravity)
    theirs = stepped(imported(EFFECTS.text(source)).Bullet(body, client))
    states = random_states(source.robot, 1000, 0)
    difference = theirs(*states) - own_torques(source, own_values(source))(*states)
    pybullet.disconnect(client)
    return np.abs(difference).max()
