"""What makes a motion good: functions of its information matrix G = W^T W, each with its gradient (Paper Eq. 14).

``condition`` and ``paper`` depend on the ends of the spectrum, ``d`` at its product, ``i`` at the torque error that the
identified model will make on other motions. docs/explanation/exciting-motions.md says which to choose.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats

#: Eigenvalues below this share of the largest are rounding noise: the motion does not determine that direction.
FLOOR = 1e-15


@dataclass(frozen=True)
class Cost:
    """A cost function of an information matrix.

    Attributes:
        kind: ``"condition"``: log cond(W); ``"paper"``: log(l1 cond(W) + l2 / sigma_min(W)), Paper Eq. 14; ``"d"``:
            -log det(G) / p; ``"i"``: log of the expected mean square torque error tr(V G^-1).
        normalised: scale the columns of W to equal length first; changes nothing for ``d`` and ``i``.
        weights: l1 and l2 of Eq. 14.
        V: mean of P^T P over motions that the model shall predict, (p, p); for ``i``.
    """

    kind: str
    normalised: bool = False
    weights: tuple[float, float] = (1.0, 100.0)
    V: Floats | None = None

    def value(self, G: Floats, power: float = np.inf) -> tuple[float, Floats]:
        """Return the cost and its gradient by G.

        Args:
            G: information matrix, (p, p), without unit when rows are weighted by the noise [N m].
            power: p-norm that stands in for the largest eigenvalue; infinity for the cost itself. Low powers make the
                ends of the spectrum smooth functions of the motion.
        """
        if not self.normalised or self.kind in ("d", "i"):
            return self._of(G, power)
        s = 1 / np.sqrt(np.maximum(np.diag(G), FLOOR * G.max()))
        scaled = G * np.outer(s, s)
        value, slope = self._of(scaled, power)
        return value, slope * np.outer(s, s) - np.diag(np.sum(slope * scaled, axis=1) * s**2)

    def _of(self, G: Floats, power: float) -> tuple[float, Floats]:
        values, U = np.linalg.eigh(G)
        values = np.maximum(values, FLOOR * values[-1])
        if self.kind == "d":
            return -float(np.mean(np.log(values))), -(U / values) @ U.T / len(values)
        if self.kind == "i":
            assert self.V is not None
            inverse = (U / values) @ U.T
            spread = inverse @ self.V @ inverse
            error = float(np.sum(self.V * inverse))
            return float(np.log(error)), -(spread + spread.T) / (2 * error)
        (top, up), (bottom, down) = _norm(values, power), _norm(1 / values, power)
        d_top, d_bottom = up / values, -down / values
        condition = np.sqrt(top * bottom)
        if self.kind == "condition":
            return float(np.log(condition)), (U * (d_top + d_bottom) / 2) @ U.T
        first, second = self.weights[0] * condition, self.weights[1] * np.sqrt(bottom)
        slope = (first * (d_top + d_bottom) + second * d_bottom) / (2 * (first + second))
        return float(np.log(first + second)), (U * slope) @ U.T


def _norm(values: Floats, power: float) -> tuple[float, Floats]:
    """Return the p-norm of positive values and d log(norm) / d log(value)."""
    largest = values.max()
    if np.isinf(power):
        return float(largest), (values == largest).astype(float)
    shares = (values / largest) ** power
    return float(largest * shares.sum() ** (1 / power)), shares / shares.sum()


@dataclass(frozen=True)
class Figures:
    """Figures of merit of an observation matrix.

    Attributes:
        condition: condition number of W as it is.
        condition_scaled: with columns of equal length.
        smallest: smallest singular value of W.
    """

    condition: float
    condition_scaled: float
    smallest: float


def figures(G: Floats) -> Figures:
    """Return the figures of merit of W [N m per unit of each parameter] from G = W^T W, (p, p)."""
    values = np.maximum(np.linalg.eigvalsh(G), 0.0)
    s = 1 / np.sqrt(np.maximum(np.diag(G), np.finfo(float).tiny))
    scaled = np.maximum(np.linalg.eigvalsh(G * np.outer(s, s)), 0.0)
    with np.errstate(divide="ignore"):
        ratios = [
            float(np.sqrt(v[-1] / v[0])) if v[0] > 0 else float("inf") for v in (values, scaled)
        ]
    return Figures(ratios[0], ratios[1], float(np.sqrt(values[0])))
