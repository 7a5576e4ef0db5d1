"""What all joints leave when they share their bodies, against rows that are stacked and solved whole."""

from __future__ import annotations

import numpy as np

from dynid.diagnose import tuning
from dynid.diagnose.fit import Columns


def test_bodies_that_joints_share_leave_what_stacked_rows_leave():
    rng = np.random.default_rng(0)
    N, n = 120, 3
    bodies, own = rng.standard_normal((N, n, 10 * n)), rng.standard_normal((n, N, 4))
    for j in range(n):
        bodies[:, j, : 10 * j] = 0.0
    sizes = 0.2 * np.tile(tuning.USUAL_BODY, n)
    noise, friction = rng.standard_normal((N, n)) * [0.5, 1.0, 2.0], rng.standard_normal((n, 4))
    tau = (
        bodies @ (sizes * rng.standard_normal(10 * n))
        + np.einsum("jtk,jk->tj", own, friction)
        + noise
    )
    free = [np.eye(N) - np.linalg.qr(own[j])[0] @ np.linalg.qr(own[j])[0].T for j in range(n)]
    W, left = [free[j] @ bodies[:, j] for j in range(n)], [free[j] @ tau[:, j] for j in range(n)]
    least = np.array([np.sqrt(np.mean(each**2)) for each in left])
    rms = least
    for _ in range(3):
        scale = 1.0 / (np.sqrt(tuning.SAMPLES_ALIKE) * rms)
        rows = np.vstack(
            [
                *(s * each for s, each in zip(scale, W, strict=True)),
                np.diag(1.0 / np.tile(tuning.USUAL_BODY, n)),
            ]
        )
        side = np.concatenate(
            [*(s * each for s, each in zip(scale, left, strict=True)), np.zeros(10 * n)]
        )
        theta = np.linalg.lstsq(rows, side)[0]
        rest = [one - each @ theta for one, each in zip(left, W, strict=True)]
        rms = np.maximum([np.sqrt(np.mean(each**2)) for each in rest], tuning.MODELLED * least)
    several = Columns(np.stack([bodies, bodies]).transpose(2, 3, 0, 1), np.stack([own, own]))
    found = several.left([1, 0], np.stack([tau, tau]), np.ones((2, n), dtype=bool), apart=False)
    np.testing.assert_allclose(found, [rms, rms], rtol=1e-9)
