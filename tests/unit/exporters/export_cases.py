"""Arms whose bodies, rotors and friction are known, ready to be exported."""

import numpy as np
from arms import random_bodies, random_robot

from dynid.estimation.residual_model import GROUPS, ModelError
from dynid.exporters import FullModel, IdentifiedArm, Provenance
from dynid.files.robotfile import load_robot
from dynid.model.base_model import BaseModel
from dynid.model.reduce import reduce
from dynid.model.regressor import build_model

SHIPPED = ("kuka_lwr4plus", "kinova_gen2", "scara", "staubli_tx40", "franka_panda")


def made(robot, seed=1, bodies=None, urdf=None):
    """An identified arm whose parameters are random but possible."""
    rng = np.random.default_rng(seed)
    model = build_model(robot)
    reduction = reduce(model)
    rotors = rng.uniform(0.01, 0.2, robot.n)
    full = FullModel(
        robot=robot,
        bodies=bodies or random_bodies(rng, robot.n),
        rotor_inertia=tuple(float(x) if j.motor_inertia else 0.0 for x, j in zip(rotors, robot.joints, strict=True)),
        friction={one.name: float(rng.uniform(0.1, 1.0)) for one in model.friction},
        origin=dict.fromkeys(model.parameter_names, "data"),
    )
    theta = reduction.K @ full.values(model.parameter_names)
    provenance = Provenance("0.1.0", "wls", "physical", 1.5, ("ab" * 32,))
    return IdentifiedArm(BaseModel(model, reduction), theta, ("well",) * len(theta), full, provenance, urdf)


def shipped(name):
    return made(load_robot(name))


def random(seed):
    return made(random_robot(np.random.default_rng(seed), n=4), seed)


def random_model_error(arm, seed=0):
    """A residual model of random numbers; every column of every joint has its part."""
    rng = np.random.default_rng(seed)
    n, p, k = arm.robot.n, len(arm.theta), len(GROUPS)
    return ModelError(
        speed=rng.uniform(0.2, 1.0, n),
        reference=arm.theta * rng.uniform(0.9, 1.1, p),
        scale=rng.uniform(0.5, 2.0, (n, k)),
        projection=0.1 * rng.normal(size=(n, p, k)),
        mean=rng.normal(size=(n, k)),
        root=np.zeros((n, k, k)),
        slope=np.zeros((n, k, p)),
        size=np.ones(3),
        rms=np.ones((n, 4)),
        evidence=10.0,
    )
