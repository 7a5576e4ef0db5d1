"""The prior, what is known before measuring: one rigid body per link, explicit or from uniform cylinders (Paper Eq. 9).

Reads ``Robot.prior`` and ``Robot.tool``; gives bodies in the DH frames and their parameters in the order of Table 5.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.model.parameters import BODY_PARAMETERS
from dynid.robot import Body, Cylinders, Robot

if TYPE_CHECKING:
    from dynid.model.reduce import Reduction
    from dynid.model.regressor import Model

Floats = NDArray[np.float64]

#: Between aluminium tubing and plastic covers, drives included: what a robot file without a prior stands for.
DEFAULT_CYLINDERS = Cylinders(radius=0.06, density=1200.0)


@dataclass(frozen=True)
class Cylinder:
    """A cylinder in a link's DH frame.

    Attributes:
        start: centre of one end face, (3,) [m].
        end: centre of the other, (3,) [m].
        radius: [m].
    """

    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float

    @property
    def length(self) -> float:
        """Distance of the end faces [m]."""
        return math.dist(self.start, self.end)

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return math.pi * self.radius**2 * self.length

    def body(self, density: float) -> Body:
        """Return the uniform body of that density [kg/m^3]."""
        start, end = np.array(self.start), np.array(self.end)
        mass = density * self.volume
        across = mass * (3 * self.radius**2 + self.length**2) / 12
        along = mass * self.radius**2 / 2
        axis = (end - start) / self.length
        tensor = across * np.eye(3) + (along - across) * np.outer(axis, axis)
        return Body.of(mass, (start + end) / 2, tensor)


def link_cylinders(robot: Robot) -> tuple[Cylinder, ...]:
    """Return one cylinder a link in its DH frame: along the DH offset, or a housing about the joint axis without one.

    The cylinder goes from the point of the link's own joint axis where the previous link ends to the point of the next
    axis that is fixed in this link; the travel of a sliding joint belongs to neither. A housing is two radii long.
    """
    radius = (robot.prior.cylinders if robot.prior and robot.prior.cylinders else DEFAULT_CYLINDERS).radius
    return tuple(_cylinder(robot, i, radius) for i in range(robot.n))


def _cylinder(robot: Robot, i: int, radius: float) -> Cylinder:
    joint = robot.joints[i]
    slide = joint.d if joint.revolute else 0.0
    if robot.convention == "standard":
        axis = np.array([0.0, math.sin(joint.twist), math.cos(joint.twist)])
        start, end = -slide * axis - [joint.a, 0, 0], np.zeros(3)
    else:
        axis = np.array([0.0, 0.0, 1.0])
        start = -slide * axis
        end = np.array([robot.joints[i + 1].a if i + 1 < robot.n else 0.0, 0.0, 0.0])
    if np.linalg.norm(end - start) < 1e-9:
        start, end = end - radius * axis, end + radius * axis
    (x, y, z), (u, v, w) = start.tolist(), end.tolist()
    return Cylinder((x, y, z), (u, v, w), radius)


def prior_bodies(robot: Robot) -> tuple[Body, ...]:
    """Return the prior body of each link, n of them, in the DH frames; the last one carries the tool.

    A robot file without a prior stands for ``DEFAULT_CYLINDERS``; ask ``robot.prior`` where that matters.
    Source: Paper Eq. 9.
    """
    if robot.prior and robot.prior.links:
        bodies = robot.prior.links
    else:
        spec = robot.prior.cylinders if robot.prior and robot.prior.cylinders else DEFAULT_CYLINDERS
        shapes = link_cylinders(robot)
        density = spec.density if spec.mass is None else spec.mass / sum(shape.volume for shape in shapes)
        bodies = tuple(shape.body(density or 0.0) for shape in shapes)
    if robot.tool is None:
        return bodies
    return (*bodies[:-1], joined(bodies[-1], robot.tool))


def prior_parameters(robot: Robot) -> Floats:
    """Return the first ten parameters of Table 5 of each link's prior body, (10 n,) [kg, kg m, kg m^2]."""
    return np.concatenate([body.parameters() for body in prior_bodies(robot)])


def prior_vector(model: Model) -> Floats:
    """Return the prior gamma of all parameters of a model in the order of its columns, (c,), in their units.

    Nothing is known beforehand about rotor inertias, friction and added effects; they count as zero.
    """
    bodies = prior_parameters(model.robot).reshape(-1, len(BODY_PARAMETERS))
    return np.array(
        [
            bodies[parameter.number - 1, BODY_PARAMETERS.index(parameter.kind)] if parameter.of_body else 0.0
            for parameter in model.parameters
        ]
    )


def prior_base_parameters(model: Model, reduction: Reduction, *, unknown: float = np.nan) -> Floats:
    """Return the prior of the base parameters, K gamma, (p,), in their units.

    Args:
        model: the model.
        reduction: its base parameters.
        unknown: what stands where the prior says nothing: for friction, for added effects, and for a rotor inertia
            alone; in a combination a rotor inertia counts as zero.
    """
    table = [model.parameters[k] for k in reduction.base]
    combined = np.count_nonzero(reduction.K, axis=1) > 1
    known = [p.of_body or (p.kind == "Im" and mixed) for p, mixed in zip(table, combined, strict=True)]
    return np.where(known, reduction.K @ prior_vector(model), unknown)


def joined(first: Body, second: Body) -> Body:
    """Return two bodies that are fixed to the same frame as one."""
    return body_of(first.parameters() + second.parameters())


def body_of(parameters: Floats) -> Body:
    """Return the body with these ten parameters of Table 5, (10,)."""
    m = float(parameters[0])
    c = parameters[1:4] / m if m else np.zeros(3)
    about_origin = np.zeros((3, 3))
    about_origin[np.triu_indices(3)] = parameters[4:]
    return Body.of(m, c, about_origin - m * (c @ c * np.eye(3) - np.outer(c, c)))


def second_moments(inertia: Floats) -> Floats:
    """Return tr(I) / 2 - I: the second moments of a distribution of mass with inertia I, (..., 3, 3) [kg m^2].

    A body that can exist has none that is negative.
    """
    return np.asarray(np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] / 2 * np.eye(3) - inertia)


def inertia_of(moments: Floats) -> Floats:
    """Return tr(S) - S: the inertia of a distribution of mass with second moments S, (..., 3, 3) [kg m^2]."""
    return np.asarray(np.trace(moments, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - moments)


def moved(body: Body, pose: Floats) -> Body:
    """Return a body in another frame, in which its own frame has this pose, (4, 4)."""
    R = pose[:3, :3]
    return Body.of(body.mass, R @ np.array(body.com) + pose[:3, 3], R @ body.tensor @ R.T)
