"""All parameters of an arm as simulators need them: bodies, rotors, friction, where each number is from, and frames.

Reads an identification. The physical set is consistent by construction; least squares get the nearest full set.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.possible_arm import PhysicalParameters
from dynid.estimation.possible_set import body_parameters, pseudo_inertia, smallest_eigenvalues
from dynid.model.base_model import BaseModel
from dynid.model.parameters import BODY_PARAMETERS, body_of, prior_bodies
from dynid.robot import Body, Robot

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
        drives: parameters that are none of bodies, by name: rotors, friction, effects.
        origin: ``"data"`` or ``"prior"`` by parameter name.
    """

    robot: Robot
    bodies: tuple[Body, ...]
    drives: Mapping[str, float]
    origin: Mapping[str, str]

    @property
    def by_name(self) -> dict[str, float]:
        """Every parameter by its name."""
        values = dict(self.drives)
        for i, body in enumerate(self.bodies, start=1):
            row = zip(BODY_PARAMETERS, body.parameters().tolist(), strict=True)
            values |= {f"{name}{i}": value for name, value in row}
        return values

    def values(self, names: Sequence[str]) -> Floats:
        """Return the parameters of the given names, zero where there is none."""
        known = self.by_name
        return np.array([known.get(name, 0.0) for name in names])

    def of_joints(self, kind: str) -> Floats:
        """Return a number of all joints, such as ``Im`` or ``fv``, zero where a joint has none, (n,)."""
        return self.values([f"{kind}{i + 1}" for i in range(self.robot.n)])

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
        for name in BODY_PARAMETERS:
            kinds[self.origin.get(f"{name}{link}", "prior")].append(f"{name}{link}")
        said = (f"from {kind}: {', '.join(names)}" for kind, names in kinds.items() if names)
        return "; ".join(said)


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
        ten = np.array([values.pop(f"{name}{link}") for name in BODY_PARAMETERS])
        bodies[link - 1] = body_of(lifted(ten))
    return FullModel(robot=robot, bodies=tuple(bodies), drives=values, origin=origin)


def numbers(values: object) -> str:
    """Return numbers with all their digits, separated by spaces."""
    return " ".join(repr(float(value)) for value in np.ravel(np.asarray(values, dtype=float)))
