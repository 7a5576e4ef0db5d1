"""What a joint lets pass: shares of a body that may as well belong to the link before, in any arm.

A turning joint cannot tell to which side mass on its axis belongs, a sliding joint where rotational inertia belongs.
Written with pseudo-inertia matrices J, 4 x 4 with J' = T J T^t under a change of frame, in the prime field.
Source: Gautier & Khalil 1990, direct calculation of minimum inertial parameters; pseudo-inertia as in Wensing 2018.
"""

from __future__ import annotations

import numpy as np

from dynid.model.kinematics import dh_step
from dynid.model.prime_field import PRIME, Residues, echelon, product
from dynid.robot import Joint

_P = np.uint64(PRIME)
_TENSOR = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))


def regrouping(
    joint: Joint, number: int, convention: str, geometry: dict[str, Residues]
) -> tuple[list[int], Residues]:
    """Return how parameters of a link pass through its joint.

    Args:
        joint: the joint.
        number: its number, 1-based.
        convention: ``"standard"`` or ``"modified"``.
        geometry: values of the DH symbols at G geometries, (G,) each; what is missing is zero or a right angle.

    Returns:
        The parameters (0-9, of the link itself) that others express, and those expressions, (G, r, 20): shares of the
        ten parameters of the link before, then of the link itself.

    Raises:
        ZeroDivisionError: when the structure differs between the geometries.
    """
    T = _transform(joint, number, convention, geometry)
    basis = _basis(joint.revolute)[None]
    before, own = basis, basis
    if joint.revolute and convention == "standard":
        own = _moved(_inverse(T), basis)
    else:
        before = _moved(T, basis)
    count = max(len(before), len(own))
    rows = [np.broadcast_to(_parameters(J), (count, len(basis[0]), 10)) for J in (before, own)]
    # Why: read from the right, the pivots are the last parameters of the link, as the textbook order wants.
    pivots, K = echelon(np.concatenate([rows[0], (_P - rows[1]) % _P], axis=2)[..., ::-1])
    shares = (_P - K[..., ::-1]) % _P
    places = [19 - k for k in pivots]
    shares[:, np.arange(len(places)), places] = 0
    return [place - 10 for place in places], shares


def _basis(revolute: bool) -> Residues:
    """Return the pseudo-inertias that pass: mass, moment and rod on the joint axis, or any second moment, (r, 4, 4)."""
    pairs = [(3, 3), (2, 3), (2, 2)] if revolute else list(_TENSOR)
    basis = np.zeros((len(pairs), 4, 4), dtype=np.uint64)
    for k, (i, j) in enumerate(pairs):
        basis[k, i, j] = basis[k, j, i] = 1
    return basis


def _transform(
    joint: Joint, number: int, convention: str, geometry: dict[str, Residues]
) -> Residues:
    """Return the transform from the link's frame to the one before, q = 0, (G, 4, 4)."""
    count = max((len(value) for value in geometry.values()), default=1)

    def take(name: str, otherwise: int) -> Residues:
        return np.broadcast_to(
            geometry.get(name, np.array([otherwise % PRIME], dtype=np.uint64)), (count,)
        )

    angle = 0.0 if joint.revolute else joint.theta_offset
    turned = (take(f"c{number}", round(np.cos(angle))), take(f"s{number}", round(np.sin(angle))))
    if joint.revolute:
        turned = (take("", 1), take("", 0))
    twist = (
        take(f"ca{number}", round(np.cos(joint.twist))),
        take(f"sa{number}", round(np.sin(joint.twist))),
    )
    R, p = dh_step(
        convention,
        turned,
        twist,
        take(f"a{number}", 0),
        take(f"d{number}", 0),
        multiply=_multiplied,
        negative=_negative,
    )
    T = np.zeros((count, 4, 4), dtype=np.uint64)
    for i in range(3):
        for j in range(3):
            T[:, i, j] = R[i][j]
        T[:, i, 3] = p[i]
    T[:, 3, 3] = 1
    return T


def _multiplied(x: Residues, y: Residues) -> Residues:
    return x * y % _P


def _negative(x: Residues) -> Residues:
    return (_P - x) % _P


def _inverse(T: Residues) -> Residues:
    """Return the inverse of rigid transforms."""
    inverse = np.zeros_like(T)
    inverse[:, :3, :3] = T[:, :3, :3].transpose(0, 2, 1)
    inverse[:, :3, 3:] = (_P - product(inverse[:, :3, :3], T[:, :3, 3:])) % _P
    inverse[:, 3, 3] = 1
    return inverse


def _moved(T: Residues, basis: Residues) -> Residues:
    """Return T J T^t for each transform and each pseudo-inertia, (G, r, 4, 4)."""
    return product(product(T[:, None], basis), T[:, None].transpose(0, 1, 3, 2))


def _parameters(J: Residues) -> Residues:
    """Return m, mc, I of pseudo-inertias, (..., 10)."""
    trace = (J[..., 0, 0] + J[..., 1, 1] + J[..., 2, 2]) % _P
    inertia = [((trace if i == j else np.uint64(0)) + _P - J[..., i, j]) % _P for i, j in _TENSOR]
    return np.stack([J[..., 3, 3], J[..., 0, 3], J[..., 1, 3], J[..., 2, 3], *inertia], axis=-1)
