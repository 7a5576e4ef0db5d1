"""All parameters of an arm as simulators need them: bodies, rotors, friction, where each number is from, and frames.

Reads an identification. The physical set is possible by construction; the plain estimate gets the set nearest to it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.possible_arm import PhysicalParameters
from dynid.estimation.possible_set import body_parameters, pseudo_inertia, smallest_eigenvalues
from dynid.model.base_model import BaseModel
from dynid.model.kinematics import base_pose, fixed_poses
from dynid.model.parameters import body_of, moved, prior_bodies
from dynid.robot import LINK_PARAMETERS, Body, Robot, rotation_rpy

Floats = NDArray[np.float64]

#: Size of a parameter of a link of a kilogram and a decimetre: what "nearest" is measured in.
_SIZE = {
    "m": 1.0,
    **dict.fromkeys(("mcx", "mcy", "mcz"), 0.1),
    **dict.fromkeys(("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "Im"), 0.01),
}
#: Eigenvalues of a body's pseudo-inertia are at least this share of the largest one, and a body that lacks more than
#: this counts as impossible: MuJoCo refuses what is positive by less than rounding.
MARGIN = 1e-10


@dataclass(frozen=True)
class FullModel:
    """All parameters of an arm.

    Attributes:
        robot: the arm.
        bodies: one per link in its DH frame, n.
        rotor_inertia: seen from the joint side, (n,) [kg m^2 or kg].
        friction: parameters beyond the links' and rotors', by name.
        origin: ``"data"`` or ``"prior"`` by parameter name.
    """

    robot: Robot
    bodies: tuple[Body, ...]
    rotor_inertia: tuple[float, ...]
    friction: Mapping[str, float]
    origin: Mapping[str, str]

    @property
    def by_name(self) -> dict[str, float]:
        """Every parameter by its name."""
        found = dict(self.friction)
        links = zip(self.bodies, self.rotor_inertia, strict=True)
        for i, (body, rotor) in enumerate(links, start=1):
            row = (*body.parameters().tolist(), rotor)
            found |= {f"{name}{i}": value for name, value in zip(LINK_PARAMETERS, row, strict=True)}
        return found

    def values(self, names: Sequence[str]) -> Floats:
        """Return the parameters of the given names, zero where there is none."""
        known = self.by_name
        return np.array([known.get(name, 0.0) for name in names])

    def joint_friction(self, prefix: str) -> Floats:
        """Return one kind of friction of all joints, such as ``fv``, zero where a joint has none, (n,)."""
        return np.array([self.friction.get(f"{prefix}{i + 1}", 0.0) for i in range(self.robot.n)])

    def impossible_links(self) -> tuple[int, ...]:
        """Return the numbers of the links whose numbers no body has, 1-based."""
        return tuple(
            i
            for i, body in enumerate(self.bodies, start=1)
            if smallest_eigenvalues(body.parameters()) <= 0.0
        )

    def origin_of_link(self, link: int) -> str:
        """Return in a few words which of a link's ten parameters were measured."""
        kinds: dict[str, list[str]] = {"data": [], "prior": []}
        for name in LINK_PARAMETERS[:10]:
            kinds[self.origin.get(f"{name}{link}", "prior")].append(f"{name}{link}")
        return "; ".join(
            f"from {kind}: {', '.join(names)}" for kind, names in kinds.items() if names
        )


def lifted(parameters: Floats) -> Floats:
    """Return the parameters of a body, (10,), with a margin where it is possible up to rounding."""
    values, vectors = np.linalg.eigh(pseudo_inertia(parameters))
    least = MARGIN * values[-1]
    if not -least <= values[0] < least:
        return parameters
    return body_parameters(vectors * np.maximum(values, least) @ vectors.T)


def full_model(base: BaseModel, physical: PhysicalParameters, theta: Floats) -> FullModel:
    """Return all parameters behind base parameters; links that were not identified keep the prior's bodies.

    Args:
        base: model and base parameters.
        physical: the physical set of the result.
        theta: base parameters that are wanted, (p,); those of the physical set, or others that the nearest set gets.
    """
    size = np.array([_SIZE.get(parameter.kind, 1.0) for parameter in base.model.parameters])
    K = base.reduction.K * size
    gamma = (
        physical.x
        + size * np.linalg.lstsq(K, theta - base.reduction.K @ physical.x, rcond=1e-12)[0]
    )
    return model_of(base, physical.names, gamma, physical.origin)


def model_of(
    base: BaseModel, names: Sequence[str], gamma: Floats, origin: Mapping[str, str]
) -> FullModel:
    """Return bodies, rotors and friction of all parameters of a model.

    Args:
        base: the model.
        names: of its parameters, (c,).
        gamma: their values, (c,).
        origin: ``"data"`` or ``"prior"`` by name.
    """
    robot = base.robot
    values = dict(zip(names, gamma.tolist(), strict=True))
    bodies = list(prior_bodies(robot))
    for link in robot.identified_links:
        ten = np.array([values[f"{name}{link}"] for name in LINK_PARAMETERS[:10]])
        bodies[link - 1] = body_of(lifted(ten))
    return FullModel(
        robot=robot,
        bodies=tuple(bodies),
        rotor_inertia=tuple(values.get(f"Im{i + 1}", 0.0) for i in range(robot.n)),
        friction={name: values[name] for name in names[len(base.model.link_columns) :]},
        origin=origin,
    )


# ---------------------------------------------------------------- frames of simulators
def world_gravity(robot: Robot) -> Floats:
    """Return gravity in the world frame, (3,)."""
    return np.asarray(rotation_rpy(robot.base_rpy) @ np.array(robot.gravity))


def joint_poses(robot: Robot) -> tuple[Floats, ...]:
    """Return each joint's pose at q = 0 in the frame of the joint before, in the world for the first, n of (4, 4)."""
    previous, poses = base_pose(robot), []
    for joint in robot.joints:
        before, after = fixed_poses(joint, robot.convention)
        poses.append(previous @ before)
        previous = after
    return tuple(poses)


def moving_bodies(robot: Robot, bodies: tuple[Body, ...]) -> tuple[Body, ...]:
    """Return the bodies in the moving frames of their joints instead of the DH frames."""
    joints = zip(bodies, robot.joints, strict=True)
    return tuple(moved(body, fixed_poses(joint, robot.convention)[1]) for body, joint in joints)


def numbers(values: object) -> str:
    """Return numbers with all their digits, separated by spaces."""
    return " ".join(repr(float(value)) for value in np.ravel(np.asarray(values, dtype=float)))
