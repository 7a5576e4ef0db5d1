"""The torque that something outside puts on an arm, from its momentum: no acceleration is needed.

    r_k = gain (p_k - p_0 - s_k),     s_k = s_k-1 + dt ((u_k-1 + u_k) / 2 + r_k-1)
    p = M qd,                         u = tau - f - g + C^T qd

C is that of the Christoffel symbols, so that C^T qd is the change of the momentum by the configuration; f is friction
with everything else that the model adds. r follows the outside torque as a low-pass of first order. Exported C does the
same step. A joint whose torques contradict those of the others has parameters of its own: its row of p and u is that of
an arm that has these. Source: De Luca and Mattone 2003, 2005.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dynid.model.regressor import Observer, mass_matrices
from dynid.scratch import spans

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MomentumObserver:
    """The observer of an arm.

    Attributes:
        observer: evaluator of the base columns.
        theta: base parameters, (p,).
        inertial: which of them move masses and rotors, (p,).
        gain: of the observer [1/s].
        apart: base parameters of joints that have their own, (p,) each, by number of the joint.
    """

    observer: Observer
    theta: Floats
    inertial: NDArray[np.bool_]
    gain: float
    apart: Mapping[int, Floats] = field(default_factory=dict)

    def momentum(self, q: Floats, qd: Floats) -> Floats:
        """Return M qd, (N, n) [N m s or N s], at positions and velocities, (N, n)."""
        return np.asarray(np.einsum("mij,mj->mi", self._masses(q), qd))

    def momentum_size(self, q: Floats, spread: Floats) -> Floats:
        """Return the size of the momentum's error by independent errors of the velocities, (N, n) [N m s or N s]."""
        found = np.empty_like(q)
        for part in spans(len(q)):
            found[part] = np.sqrt(
                np.einsum("mij,mj->mi", self._masses(q[part]) ** 2, spread[part] ** 2)
            )
        return found

    def drift(self, q: Floats, qd: Floats) -> Floats:
        """Return C^T qd - g, (N, n) [N m or N], at positions and velocities, (N, n)."""
        found = np.empty_like(q)
        for j in range(q.shape[1]):
            # The column of C is the polar form of the Coriolis torques.
            moving, unit, still = self._moving(j), np.eye(q.shape[1])[j], np.zeros_like(qd)
            column = 0.25 * (moving(q, qd + unit, still) - moving(q, qd - unit, still))
            found[:, j] = np.sum(column * qd, axis=1) - moving(q, still, still)[:, j]
        return found

    def _masses(self, q: Floats) -> Floats:
        """Return the mass matrices, (M, n, n); rows of joints apart are those of their own parameters."""
        found = np.array(mass_matrices(self._moving(), q))
        for j in self.apart:
            found[:, j] = mass_matrices(self._moving(j), q)[:, j]
        return found

    def _moving(self, joint: int = -1) -> Callable[[Floats, Floats, Floats], Floats]:
        """Return the torques of moving masses as a joint sees them; of those that agree where none is given."""
        theta = np.where(self.inertial, self.apart.get(joint, self.theta), 0.0)
        return lambda q, qd, qdd: self.observer.torque(theta, q, qd, qdd)

    def run(self, q: Floats, qd: Floats, tau: Floats, other: Floats, dt: float) -> Floats:
        """Return the torque from outside along a motion, zero at its first sample, (N, n) [N m or N].

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            tau: torques of the drives, (N, n) [N m or N].
            other: torques of friction and of everything else beyond moving masses, (N, n) [N m or N].
            dt: time between two samples [s].
        """
        p, push = np.empty_like(q), np.empty_like(q)
        for part in spans(len(q)):
            p[part] = self.momentum(q[part], qd[part])
            push[part] = tau[part] - other[part] + self.drift(q[part], qd[part])
        start, total, found = p[0], np.zeros(q.shape[1]), np.empty_like(q)
        found[:1] = 0.0
        for k in range(1, len(q)):
            total = total + dt * (0.5 * (push[k - 1] + push[k]) + found[k - 1])
            found[k] = self.gain * (p[k] - start - total)
        return found
