"""What makes a parameter vector physical: pseudo-inertias, bounds on masses and centres of mass, signs.

Reads the table of parameters; writes ``PhysicalConstraints``, the set that ``dynid.estimation.physical_parameters``
works with.

Source: Wensing, Kim, Slotine 2018, "Linear matrix inequalities for physically consistent inertial parameter
identification" (the pseudo-inertia); Lee, Wensing, Park 2020, "Geometric robot dynamic identification" (its metric).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dynid.model.parameters import Parameter, body_columns, columns_of, inertia_of

Floats = NDArray[np.float64]
Ints = NDArray[np.intp]

#: Parameters that no real drive has with a minus sign: rotor inertia, viscous and Coulomb friction.
NONNEGATIVE = ("Im", "fv", "fc")


@cache
def basis() -> Floats:
    """Return E with P = sum_k parameter_k * E_k, (10, 4, 4), pure numbers."""
    E = np.zeros((10, 4, 4))
    E[0, 3, 3] = 1.0
    for axis in range(3):
        E[1 + axis, axis, 3] = E[1 + axis, 3, axis] = 1.0
    for k, (i, j) in enumerate(((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))):
        if i == j:
            E[4 + k, :3, :3] = 0.5 * np.eye(3)
            E[4 + k, i, i] = -0.5
        else:
            E[4 + k, i, j] = E[4 + k, j, i] = -1.0
    E.setflags(write=False)
    return E


def pseudo_inertia(bodies: Floats) -> Floats:
    """Map body parameters to pseudo-inertias P = [[tr(I)/2 - I, mc], [mc^T, m]].

    Args:
        bodies: m, mc, Ixx, Ixy, Ixz, Iyy, Iyz, Izz about the frame origin, (..., 10) [kg, kg m, kg m^2].

    Returns:
        P, (..., 4, 4): the second moment of the mass distribution in homogeneous coordinates.
    """
    return (bodies @ basis().reshape(10, 16)).reshape(*bodies.shape[:-1], 4, 4)


def body_parameters(P: Floats) -> Floats:
    """Map pseudo-inertias back to body parameters, (..., 4, 4) -> (..., 10) [kg, kg m, kg m^2]."""
    inertia = inertia_of(P[..., :3, :3])
    i, j = np.triu_indices(3)
    return np.concatenate([P[..., 3:, 3], P[..., :3, 3], inertia[..., i, j]], axis=-1)


def smallest_eigenvalues(bodies: Floats) -> Floats:
    """Return the smallest eigenvalue of the pseudo-inertia of bodies (..., 10), (...,); negative: no such body."""
    return np.asarray(np.linalg.eigvalsh(pseudo_inertia(bodies))[..., 0])


def is_consistent(bodies: Floats) -> bool:
    """Return whether every body, (L, 10) [kg, kg m, kg m^2], is a distribution of positive mass."""
    return bool(np.all(smallest_eigenvalues(bodies) > 0.0))


@dataclass(frozen=True)
class PhysicalConstraints:
    """The set of physical parameter vectors and the prior inside it.

    Attributes:
        parameters: what each column stands for, (c).
        bodies: columns of the ten parameters of each link, (L, 10).
        prior: what is known before measuring, (c,); zero where nothing is.
        G: rows of the bounds G x >= h, (k, c).
        h: right side of the bounds, (k,).
        labels: one sentence for each bound, (k).
        pools: columns of the positive parameters of one kind that have no prior, as many arrays as kinds.
        ratings: what the joints' parameters of one kind are thought to be in proportion to, (c,).
        spread: standard deviation of parameters whose prior is zero, (c,); infinite elsewhere.
    """

    parameters: tuple[Parameter, ...]
    bodies: Ints
    prior: Floats
    G: Floats
    h: Floats
    labels: tuple[str, ...]
    pools: tuple[Ints, ...]
    ratings: Floats
    spread: Floats

    @property
    def offsets(self) -> Ints:
        """Columns of friction offsets, (k,)."""
        return columns_of(self.parameters, "fo")

    @property
    def prior_pseudo_inertia(self) -> Floats:
        """P of the prior's links, (L, 4, 4)."""
        return pseudo_inertia(self.prior[self.bodies])

    def slack(self, x: Floats) -> Floats:
        """Return how far parameters x, (c,) in their units, keep the bounds, (k,); negative: broken."""
        return np.asarray(self.G @ x - self.h)

    def holds(self, x: Floats) -> bool:
        """Return whether x, (c,) in their units, is a physical parameter vector."""
        return is_consistent(x[self.bodies]) and bool(np.all(self.slack(x) >= 0.0))


def make_constraints(
    parameters: Sequence[Parameter],
    prior: Floats,
    *,
    total_mass: tuple[float, float] | None = None,
    link_mass: Mapping[int, tuple[float, float]] | None = None,
    com_box: Mapping[int, tuple[Floats, Floats]] | None = None,
    nonnegative: Sequence[str] = NONNEGATIVE,
    ratings: Mapping[str, float] | None = None,
) -> PhysicalConstraints:
    """Collect what is known about the arm besides the measurement.

    Args:
        parameters: what each column stands for, (c).
        prior: prior parameters, (c,), each in its unit; the bodies in it must be consistent.
        total_mass: smallest and largest mass of all links in ``parameters`` [kg].
        link_mass: the same for single links, by link number.
        com_box: corners of the box that holds the centre of mass, in the link frame, by link number [m].
        nonnegative: kinds of the parameters that cannot be negative.
        ratings: by parameter, what those of one kind are thought to be in proportion to; equal where nothing is said.

    Returns:
        Bounds and prior together.
    """
    rows: list[tuple[dict[int, float], float, str]] = []
    for k, parameter in enumerate(parameters):
        if parameter.kind in nonnegative:
            rows.append(({k: 1.0}, 0.0, f"{parameter.name} >= 0"))
    bodies = body_columns(parameters)
    masses = {link: int(columns[0]) for link, columns in bodies.items()}
    if total_mass is not None:
        rows += _between(dict.fromkeys(masses.values(), 1.0), total_mass, "total mass [kg]")
    for link, bounds in (link_mass or {}).items():
        rows += _between({masses[link]: 1.0}, bounds, f"m{link} [kg]")
    for link, (low, high) in (com_box or {}).items():
        for axis, (a, b) in enumerate(zip(low, high, strict=True)):
            first, m, letter = int(bodies[link][1 + axis]), masses[link], "xyz"[axis]
            rows.append(({first: 1.0, m: -float(a)}, 0.0, f"c{letter}{link} >= {a:g} m"))
            rows.append(({first: -1.0, m: float(b)}, 0.0, f"c{letter}{link} <= {b:g} m"))
    G, h = np.zeros((len(rows), len(parameters))), np.array([row[1] for row in rows])
    for k, (terms, _, _) in enumerate(rows):
        G[k, list(terms)] = list(terms.values())
    labels, prior = tuple(row[2] for row in rows), np.asarray(prior, dtype=float)
    pools = tuple(found[prior[found] <= 0.0] for found in (columns_of(parameters, kind) for kind in nonnegative))
    # Why of fc: an offset is the part of the friction that does not change its sign.
    rated = [f"fc{p.number}" if p.kind == "fo" else p.name for p in parameters]
    proportion = np.array([(ratings or {}).get(name, 1.0) for name in rated])
    nowhere = np.full(len(parameters), np.inf)
    links = np.array(list(bodies.values()), dtype=np.intp).reshape(-1, 10)
    return PhysicalConstraints(tuple(parameters), links, prior, G, h, labels, pools, proportion, nowhere)


def _between(
    terms: dict[int, float], bounds: tuple[float, float], what: str
) -> list[tuple[dict[int, float], float, str]]:
    low, high = bounds
    negative = {k: -value for k, value in terms.items()}
    return [(terms, low, f"{what} >= {low:g}"), (negative, -high, f"{what} <= {high:g}")]
