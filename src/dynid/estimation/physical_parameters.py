"""From base parameters to a full set of link parameters that a real arm could have.

What the data determine is kept within its uncertainty, the rest is taken from the prior, and every number says which it
is. Source: entropic regularisation of pseudo-inertias (Lee, Wensing, Park 2020); docs/explanation/consistency.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.consistent import ConsistentFit, complete, fit_pooled
from dynid.estimation.estimators import Estimate
from dynid.estimation.physical_constraints import Physics, make_physics
from dynid.model.base_model import BaseModel
from dynid.model.prior import body_of, prior_vector
from dynid.robot import Robot

Floats = NDArray[np.float64]

#: A link parameter is called measured when the data take away at least this share of what the prior left open.
FROM_DATA = 0.5


@dataclass(frozen=True)
class FullSet:
    """A physically possible value for every parameter of the model.

    Attributes:
        names: parameter names, (c,).
        x: their values, (c,).
        std_error: data and prior together, (c,).
        data_share: how much of each value comes from the data, 0 (prior) to 1, (c,).
        theta: base parameters of the set, (p,).
        inflation: how much larger the honest variance is than the textbook one.
        touched: bounds that the data push against.
    """

    names: tuple[str, ...]
    x: Floats
    std_error: Floats
    data_share: Floats
    theta: Floats
    inflation: float
    touched: tuple[str, ...]

    def links(self) -> list[dict[str, Any]]:
        """Return mass, centre of mass and inertia of each identified link, for JSON; ``origin`` is data or prior."""
        where = {name: k for k, name in enumerate(self.names)}
        found = []
        for name in self.names:
            if name.startswith("m") and name[1:].isdigit():
                first = where[name]
                body = body_of(self.x[first : first + 10])
                xx, xy, xz, yy, yz, zz = body.inertia_com
                share = self.data_share[first : first + 10]
                found.append(
                    {
                        "link": int(name[1:]),
                        "mass_kg": body.mass,
                        "com_m": list(body.com),
                        "inertia_com_kg_m2": {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz},
                        "origin": {
                            self.names[first + k]: "data" if share[k] >= FROM_DATA else "prior" for k in range(10)
                        },
                    }
                )
        return found


def full_set(base: BaseModel, estimate: Estimate) -> FullSet:
    """Find the physically possible parameters that the estimate and the prior agree on best.

    Args:
        base: model and base parameters.
        estimate: base parameters from the data, with their honest covariance.

    Raises:
        NotPhysical: the prior of the robot file is itself not physical.
    """
    names, K, physics = base.reduction.names, base.reduction.K, physics_of(base)
    p = len(estimate.theta)
    A = estimate.whitened[:p, :p]
    inflation = max(1.0, float(np.sum((A @ estimate.covariance) * A)) / max(1, estimate.solution.rank))
    R = A / np.sqrt(inflation)
    fit, _ = fit_pooled(R @ K, R @ estimate.theta, physics)
    return _as_set(names, K, fit, inflation)


def physics_of(base: BaseModel) -> Physics:
    """Return the robot's prior and what is known about it, for all parameters of the model."""
    known, identified = base.robot.known, base.robot.identified_links
    return make_physics(
        base.model.parameters,
        prior_vector(base.model),
        total_mass=known.total_mass,
        link_mass={link: bounds for link, bounds in known.link_mass if link in identified},
        com_box={link: (np.array(a), np.array(b)) for link, (a, b) in known.com_box if link in identified},
        ratings=friction_ratings(base.robot),
    )


def friction_ratings(robot: Robot) -> dict[str, float]:
    """Return what the joints' friction is in proportion to where it is that of the motors; empty behind joint sensors.

    Coulomb friction goes with the rated torque, viscous friction with rated torque over speed.
    """
    limits = [(joint.limits.torque, joint.limits.velocity) for joint in robot.joints]
    rated = [(torque, velocity) for torque, velocity in limits if torque and velocity]
    if robot.torque.source != "motor_torque" or len(rated) < robot.n:
        return {}
    ratings = {f"fc{k}": torque for k, (torque, _) in enumerate(rated, start=1)}
    return ratings | {f"fv{k}": torque / velocity for k, (torque, velocity) in enumerate(rated, start=1)}


def reproduced(base: BaseModel, theta: Floats, covariance: Floats) -> bool:
    """Return whether some possible arm has exactly these base parameters."""
    return complete(base.reduction.K, theta, covariance, physics_of(base), exact=True).reproduced


def _as_set(names: tuple[str, ...], K: Floats, fit: ConsistentFit, inflation: float) -> FullSet:
    return FullSet(names, fit.x, fit.std_error, fit.data_share, K @ fit.x, inflation, fit.touched)
