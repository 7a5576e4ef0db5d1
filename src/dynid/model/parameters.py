"""What each column of the regressor stands for, and what is known of it before measuring: the prior.

The prior is one rigid body per link, explicit or from uniform cylinders (Paper Eq. 9), in the DH frames; its parameters
have the order of Table 5.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import repeat

import numpy as np

from dynid.arrays import Floats, Ints
from dynid.model import tuning
from dynid.robot import LINK_PARAMETERS, Body, Cylinders, Joint, Robot

#: The ten parameters of a link that make a body; the eleventh, Im, belongs to the drive.
BODY_PARAMETERS = LINK_PARAMETERS[:10]
#: Rows and columns of the inertia tensor's six entries in the order of Table 5.
TENSOR = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


@dataclass(frozen=True)
class Parameter:
    """One parameter of the model: the meaning of one column.

    Attributes:
        kind: ``m``, ``mcx`` ... ``Izz`` and ``Im`` of a link; ``fv``, ``fc``, ``fo`` of a joint's friction; ``Imc``,
            ``fvc``, ``fcc`` of a motor that drives several joints; the identifier of an added effect.
        number: number of the link, joint or motor, 1-based; of the first joint that an added effect acts on.
        unit: its unit.
        name: unique name, such as ``Ixx3``.
        share: what a motor that drives several joints puts on each of them, (n,); () for one that drives its own.
    """

    kind: str
    number: int
    unit: str
    name: str
    share: tuple[float, ...] = ()

    @property
    def of_body(self) -> bool:
        """Whether it is one of the ten parameters of a link's rigid body."""
        return self.kind in BODY_PARAMETERS


def numbered(kind: str, number: int, unit: str) -> Parameter:
    """Return a parameter that is called after its kind and number."""
    return Parameter(kind, number, unit, f"{kind}{number}")


def link_parameters(robot: Robot) -> tuple[Parameter, ...]:
    """Return the 11 parameters of every link in the order of Table 5, (11 n)."""
    parameters = []
    for link, joint in enumerate(robot.joints, start=1):
        for kind in LINK_PARAMETERS:
            mass = kind == "m" or (kind == "Im" and not joint.revolute)
            unit = "kg" if mass else "kg m" if kind.startswith("mc") else "kg m^2"
            parameters.append(numbered(kind, link, unit))
    return tuple(parameters)


def columns_of(parameters: Iterable[Parameter], *kinds: str) -> Ints:
    """Return the columns whose parameter is of one of these kinds, (k,)."""
    return np.array(
        [k for k, parameter in enumerate(parameters) if parameter.kind in kinds], dtype=np.intp
    )


def representative_rank(convention: str, joint: Joint, kind: str) -> tuple[bool, bool]:
    """Return how late a parameter of a joint's link represents a sum: what the joint lets pass to the link before last.

    That is mass, first moment and a thin rod on the axis of a revolute joint, and inertia of a prismatic one; of the
    others inertia comes before mass. Why not the order of Table 5: where a length of the DH table is short,
    coefficients would grow as its inverse square, and a link of 3 kg be shown with -94 kg.
    Source: Gautier & Khalil 1990.
    """
    upright = convention == "modified" or abs(math.cos(joint.twist)) > abs(math.sin(joint.twist))
    on_axis = ("m", "mcz", "Iyy") if upright else ("m", "mcy", "Izz")
    passing = on_axis if joint.revolute else BODY_PARAMETERS[4:]
    return kind in passing, kind.startswith("m")


def body_columns(parameters: Iterable[Parameter]) -> dict[int, Ints]:
    """Return the columns of the ten body parameters of each link, (10,), by the link's number."""
    return {
        parameter.number: np.arange(k, k + len(BODY_PARAMETERS))
        for k, parameter in enumerate(parameters)
        if parameter.kind == BODY_PARAMETERS[0]
    }


# ---------------------------------------------------------------- the prior
#: What a robot file without a prior stands for.
DEFAULT_CYLINDERS = Cylinders(
    radius=tuning.DEFAULT_LINK_RADIUS_M, density=tuning.DEFAULT_LINK_DENSITY
)


def cylinders_of(robot: Robot) -> Cylinders:
    """Return radius and density of the uniform cylinders that stand for the links."""
    return robot.prior.cylinders if robot.prior and robot.prior.cylinders else DEFAULT_CYLINDERS


def link_cylinders(robot: Robot) -> Floats:
    """Return the centres of both end faces of one cylinder a link, in its DH frame, (n, 2, 3) [m].

    It lies along the DH offset, from the point of the link's own joint axis where the previous link ends to the point
    of the next axis that is fixed in this link; the travel of a prismatic joint belongs to neither. A link without an
    offset has a housing about the joint axis, two radii long.
    """
    radius, ends = cylinders_of(robot).radius, np.zeros((robot.n, 2, 3))
    for i, joint in enumerate(robot.joints):
        slide = joint.d if joint.revolute else 0.0
        axis = np.array([0.0, 0.0, 1.0])
        if robot.convention == "standard":
            axis[1:] = math.sin(joint.twist), math.cos(joint.twist)
            ends[i, 0] = -slide * axis - [joint.a, 0, 0]
        else:
            ends[i, 0] = -slide * axis
            ends[i, 1, 0] = robot.joints[i + 1].a if i + 1 < robot.n else 0.0
        if np.linalg.norm(ends[i, 1] - ends[i, 0]) < 1e-9:
            ends[i] = ends[i, 1] - radius * axis, ends[i, 1] + radius * axis
    return ends


def cylinder_body(ends: Floats, radius: float, mass: float) -> Body:
    """Return a uniform cylinder of that mass [kg] between the centres of its end faces, (2, 3) [m]."""
    axis = ends[1] - ends[0]
    length = float(np.linalg.norm(axis))
    across = mass * (3 * radius**2 + length**2) / 12
    along = mass * radius**2 / 2
    tensor = across * np.eye(3) + (along - across) * np.outer(axis, axis) / length**2
    return Body.of(mass, ends.mean(axis=0), tensor)


def prior_bodies(robot: Robot) -> tuple[Body, ...]:
    """Return the prior body of each link, n of them, in the DH frames; the last one carries the tool.

    A robot file without a prior stands for ``DEFAULT_CYLINDERS``; ask ``robot.prior`` where that matters.
    Source: Paper Eq. 9.
    """
    if robot.prior and robot.prior.links:
        bodies = robot.prior.links
    else:
        spec, ends = cylinders_of(robot), link_cylinders(robot)
        volumes = math.pi * spec.radius**2 * np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        given = spec.density or 0.0 if spec.mass is None else spec.mass / volumes.sum()
        bodies = tuple(map(cylinder_body, ends, repeat(spec.radius), (given * volumes).tolist()))
    return bodies if robot.tool is None else (*bodies[:-1], joined(bodies[-1], robot.tool))


def prior_parameters(robot: Robot) -> Floats:
    """Return the first ten parameters of Table 5 of each link's prior body, (10 n,) [kg, kg m, kg m^2]."""
    return np.concatenate([body.parameters() for body in prior_bodies(robot)])


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
    return np.asarray(
        np.trace(inertia, axis1=-2, axis2=-1)[..., None, None] / 2 * np.eye(3) - inertia
    )


def inertia_of(moments: Floats) -> Floats:
    """Return tr(S) - S: the inertia of a distribution of mass with second moments S, (..., 3, 3) [kg m^2]."""
    return np.trace(moments, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - moments


def moved(body: Body, pose: Floats) -> Body:
    """Return a body in another frame, in which its own frame has this pose, (4, 4)."""
    R = pose[:3, :3]
    return Body.of(body.mass, R @ np.array(body.com) + pose[:3, 3], R @ body.tensor @ R.T)
