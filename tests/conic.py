"""The physically consistent fit as a conic programme, solved by Clarabel: an optimum that dynid had no part in."""

import numpy as np
import pytest

from dynid.estimation.possible_set import basis

#: Why: solver tolerances are relative to the objective, which is made this much smaller.
SCALE = 1e-2


def clarabel_optimum(R, r, constraints, gamma):
    """Return the smallest 1/2 |R x - r|^2 + gamma * sum(-logdet P + tr(P0^-1 P)) within the bounds, and its seconds."""
    clarabel = pytest.importorskip("clarabel")
    sparse = pytest.importorskip("scipy.sparse")
    c = R.shape[1]
    # x, then for each link a triangle of ten and four logarithms
    size = c + 14 * len(constraints.bodies)
    quadratic, q = np.zeros((size, size)), np.zeros(size)
    centre = np.linalg.lstsq(R, r, rcond=1e-10)[0]
    residual = R @ centre - r
    quadratic[:c, :c], q[:c] = R.T @ R, R.T @ residual
    inverse = np.linalg.inv(constraints.prior_pseudo_inertia)
    bounds = np.zeros((len(constraints.h), size))
    bounds[:, :c] = -constraints.G
    b = [constraints.G @ centre - constraints.h]
    rows, cones = [bounds], [clarabel.NonnegativeConeT(len(bounds))]
    constant = 0.5 * residual @ residual
    lower, column = np.tril_indices(8)  # the upper triangle, column by column
    weight = np.where(lower == column, 1, 2**0.5)
    triangle = [(j, i) for j in range(4) for i in range(j, 4)]
    for link, columns in enumerate(constraints.bodies):
        matrices, first = np.zeros((size, 8, 8)), c + 14 * link
        matrices[columns, :4, :4] = basis()
        slope = gamma * np.einsum("ab,kba->k", inverse[link], basis())
        q[columns] += slope
        constant += slope @ centre[columns]
        for k, (j, i) in enumerate(triangle):
            matrices[first + k, [i, 4 + j], [4 + j, i]] += 1
            if i == j:
                matrices[first + k, 4 + i, 4 + i] = 1
                logarithm = np.zeros((3, size))
                logarithm[[0, 2], [first + 10 + i, first + k]] = -1
                rows.append(logarithm)
                b.append([0.0, 1.0, 0.0])
                cones.append(clarabel.ExponentialConeT())
                q[first + 10 + i] = -gamma
        rows.append(-(matrices[:, lower, column] * weight).T)
        b.append(np.tensordot(centre, matrices[:c], axes=1)[lower, column] * weight)
        cones.append(clarabel.PSDTriangleConeT(8))
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    P = sparse.csc_matrix(np.triu(SCALE * quadratic))
    A = sparse.csc_matrix(np.vstack(rows))
    solution = clarabel.DefaultSolver(P, SCALE * q, A, np.concatenate(b), cones, settings).solve()
    assert "Solved" in str(solution.status)
    return solution.obj_val / SCALE + constant, solution.solve_time
