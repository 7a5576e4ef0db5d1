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

    def inside(cone, row, offset):
        rows.append(row)
        b.append(offset)
        cones.append(cone)

    keep = np.zeros((len(constraints.h), size))
    keep[:, :c] = -constraints.G
    slack = constraints.G @ centre - constraints.h
    inside(clarabel.NonnegativeConeT(len(slack)), keep, slack)
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
                    inside(clarabel.ExponentialConeT(), cone, np.array([0.0, 1.0, 0.0]))
                    q[first + 10 + i] = -gamma
        offset = np.tensordot(centre, matrices[:c], axes=1)
        j, i = np.tril_indices(order)  # the upper triangle, column by column
        weight = np.where(i == j, 1, 2**0.5)
        cone = clarabel.PSDTriangleConeT(order)
        inside(cone, -(matrices[:, i, j] * weight).T, offset[i, j] * weight)
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    P = sparse.csc_matrix(np.triu(scale * quadratic))
    A = sparse.csc_matrix(np.vstack(rows))
    solution = clarabel.DefaultSolver(P, scale * q, A, np.concatenate(b), cones, settings).solve()
    assert "Solved" in str(solution.status)
    return solution.obj_val / scale + constant, solution.solve_time
