"""One body a link behind the base parameters: what simulators need, and which numbers of it were measured.

Reads a result; where it has no consistent set of its own, the set nearest to the prior stands for it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.identify.physics import smallest_eigenvalues
from dynid.model.prior import body_of, prior_bodies, prior_parameters
from dynid.model.reduce import Reduction
from dynid.model.regressor import Model
from dynid.robot import LINK_PARAMETERS, Body, Robot

Floats = NDArray[np.float64]

#: Where a number comes from.
DATA, MIXED, PRIOR = "data", "data and prior", "prior"
#: Size of a parameter of a link of a kilogram and a decimetre: what "nearest" to the prior is measured in.
_SIZE = {
    "m": 1.0,
    **dict.fromkeys(("mcx", "mcy", "mcz"), 0.1),
    **dict.fromkeys(("Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz", "Im"), 0.01),
}


@dataclass(frozen=True)
class FullSet:
    """All parameters of an arm.

    Attributes:
        robot: the arm.
        bodies: one a link in its DH frame, n.
        rotor_inertia: seen from the joint side, (n,) [kg m^2 or kg].
        friction: parameters beyond the links' and rotors', by name.
        origin: ``"data"``, ``"data and prior"`` or ``"prior"`` by parameter name.
    """

    robot: Robot
    bodies: tuple[Body, ...]
    rotor_inertia: tuple[float, ...]
    friction: Mapping[str, float]
    origin: Mapping[str, str]

    def values(self, names: Sequence[str]) -> Floats:
        """Return the parameters of the given names."""
        known = dict(self.friction)
        for i, (body, rotor) in enumerate(zip(self.bodies, self.rotor_inertia, strict=True), start=1):
            row = (*body.parameters().tolist(), rotor)
            known |= {f"{name}{i}": value for name, value in zip(LINK_PARAMETERS, row, strict=True)}
        return np.array([known.get(name, 0.0) for name in names])

    def joint_friction(self, prefix: str) -> Floats:
        """Return one kind of friction of all joints, such as ``fv``, zero where a joint has none, (n,)."""
        return np.array([self.friction.get(f"{prefix}{i + 1}", 0.0) for i in range(self.robot.n)])

    def impossible_links(self) -> tuple[int, ...]:
        """Return the numbers of the links whose numbers no body has, 1-based."""
        return tuple(i for i, body in enumerate(self.bodies, start=1) if smallest_eigenvalue(body) <= 0.0)

    def origin_of_link(self, link: int) -> str:
        """Return in a few words which of a link's ten parameters were measured."""
        kinds: dict[str, list[str]] = {DATA: [], MIXED: [], PRIOR: []}
        for name in LINK_PARAMETERS[:10]:
            kinds[self.origin.get(f"{name}{link}", PRIOR)].append(f"{name}{link}")
        return "; ".join(f"from {kind}: {', '.join(names)}" for kind, names in kinds.items() if names)


def smallest_eigenvalue(body: Body) -> float:
    """Return the smallest eigenvalue of a body's pseudo-inertia; a body that can exist has a positive one."""
    return float(smallest_eigenvalues(body.parameters()))


def full_set(
    model: Model, reduction: Reduction, theta: Floats, links: Sequence[Mapping[str, Any]] | None = None
) -> FullSet:
    """Return all parameters behind base parameters.

    Args:
        model: the model.
        reduction: how base parameters combine all parameters.
        theta: base parameters, (p,).
        links: consistent bodies of the result, as ``identify`` writes them; the nearest set to the prior when None.
    """
    robot, names = model.robot, reduction.names
    prior = FullSet(robot, prior_bodies(robot), (0.0,) * robot.n, {}, {}).values(names)
    if links is not None:
        bodies = tuple(_body(link) for link in links)
        given = FullSet(robot, bodies, (0.0,) * robot.n, {}, {}).values(names)
        fixed = np.array([_is_body(name) for name in names])
        gamma = given + _completed(names, np.where(fixed, 0.0, reduction.K), theta - reduction.K @ given)
    else:
        gamma = prior + _completed(names, reduction.K, theta - reduction.K @ prior)
    values = dict(zip(names, gamma.tolist(), strict=True))
    believed = prior_parameters(robot).reshape(-1, 10)
    rows = [
        [values.get(f"{p}{i + 1}", believed[i, k]) for k, p in enumerate(LINK_PARAMETERS[:10])] for i in range(robot.n)
    ]
    return FullSet(
        robot=robot,
        bodies=bodies if links is not None else tuple(body_of(np.array(row)) for row in rows),
        rotor_inertia=tuple(values.get(f"Im{i + 1}", 0.0) for i in range(robot.n)),
        friction={name: values[name] for name in names[len(model.link_columns) :]},
        origin={name: origin_of(reduction, name) for name in names},
    )


def origin_of(reduction: Reduction, name: str) -> str:
    """Return whether a parameter was measured, only as part of a combination, or not at all."""
    return {"alone": DATA, "combined": MIXED, "none": PRIOR}[reduction.class_of(name)]


def _completed(names: Sequence[str], K: Floats, missing: Floats) -> Floats:
    """Return the smallest change of all parameters that makes up for what the base parameters miss."""
    size = np.array([_SIZE.get(name.rstrip("0123456789"), 1.0) for name in names])
    return np.asarray(size * np.linalg.lstsq(K * size, missing, rcond=1e-12)[0])


def _is_body(name: str) -> bool:
    return name.rstrip("0123456789") in LINK_PARAMETERS[:10]


def _body(link: Mapping[str, Any]) -> Body:
    x, y, z = (float(value) for value in link["com_m"])
    xx, xy, xz, yy, yz, zz = (float(value) for value in link["inertia_com_kg_m2"])
    return Body(float(link["mass_kg"]), (x, y, z), (xx, xy, xz, yy, yz, zz))
