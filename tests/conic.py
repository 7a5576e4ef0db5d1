"""The physically consistent fit as a conic programme, solved by Clarabel: an optimum that dynid had no part in."""

import numpy as np
import pytest

from dynid.estimation.possible_set import basis


def clarabel_optimum(R, r, constraints, gamma, scale=1e-2):
    """Return the smallest 1/2 |R x - r|^2 + gamma * sum(-logdet P + tr(P0^-1 P)) within the bounds, and its seconds."""
    clarabel = pytest.importorskip("clarabel")
    sparse = pytest.importorskip("scipy.sparse")
    c, links = R.shape[1], len(constraints.bodies)
    size = c + (
        14 * links if gamma else 0
    )  # x, then for each link a triangle of ten and four logarithms
    quadratic, q = np.zeros((size, size)), np.zeros(size)
    centre = np.linalg.lstsq(R, r, rcond=1e-10)[
        0
    ]  # why: solver tolerances are relative to the objective
    residual = R @ centre - r
    quadratic[:c, :c], q[:c] = R.T @ R, R.T @ residual
    inverse = np.linalg.inv(constraints.prior_pseudo_inertia)
    rows, b, cones, constant = [], [], [], 0.5 * residual @ residual
    keep = np.zeros((len(constraints.h), size))
    keep[:, :c] = -constraints.G
    (
        rows.append(keep),
        b.append(constraints.G @ centre - constraints.h),
        cones.append(clarabel.NonnegativeConeT(len(constraints.h))),
    )
    for link, columns in enumerate(constraints.bodies):
        first = c + 14 * link
        order = 8 if gamma else 4
        matrices = np.zeros((size, order, order))
        matrices[columns, :4, :4] = basis()
        if gamma:
            slope = gamma * np.einsum("ab,kba->k", inverse[link], basis())
            q[columns] += slope
            constant += slope @ centre[columns]
            triangle = [(i, j) for j in range(4) for i in range(j, 4)]
            for k, (i, j) in enumerate(triangle):
                matrices[first + k, i, 4 + j] += 1
                matrices[first + k, 4 + j, i] += 1
                if i == j:
                    matrices[first + k, 4 + i, 4 + i] = 1
                    cone = np.zeros((3, size))
                    cone[0, first + 10 + i], cone[2, first + k] = -1, -1
                    (
                        rows.append(cone),
                        b.append(np.array([0.0, 1.0, 0.0])),
                        cones.append(clarabel.ExponentialConeT()),
                    )
                    q[first + 10 + i] = -gamma
        upper = [(i, j) for j in range(order) for i in range(j + 1)]
        rows.append(np.array([-matrices[:, i, j] * (1 if i == j else 2**0.5) for i, j in upper]))
        offset = np.tensordot(centre, matrices[:c], axes=1)
        (
            b.append(np.array([offset[i, j] * (1 if i == j else 2**0.5) for i, j in upper])),
            cones.append(clarabel.PSDTriangleConeT(order)),
        )
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    P = sparse.csc_matrix(np.triu(scale * quadratic))
    A = sparse.csc_matrix(np.vstack(rows))
    solution = clarabel.DefaultSolver(P, scale * q, A, np.concatenate(b), cones, settings).solve()
    assert "Solved" in str(solution.status)
    return solution.obj_val / scale + constant, solution.solve_time
