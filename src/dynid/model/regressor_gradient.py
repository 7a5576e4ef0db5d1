"""Gradients through the regressor: reverse mode over the straight-line program, vectorised over samples.

Given weights dL/dentry of any scalar L of the regressor's entries, returns dL/dq, dL/dqd and dL/dqdd. Costs about four
evaluations, whatever the number of samples and joints; the optimiser of excitation trajectories lives on it.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from dynid.arrays import Floats, Ints
from dynid.model.effects.friction import add_friction_gradient, friction_rows
from dynid.model.program import MUL, NEG, SUB, Evaluator, Program, input_of
from dynid.model.regressor import Model, Observer
from dynid.robot import Robot

#: Gradients by q, qd and qdd, each (N, n).
Gradient = tuple[Floats, Floats, Floats]


class Tape(Evaluator):
    """A program whose values at the last run serve for its gradient."""

    def __init__(self, program: Program, robot: Robot, samples: int) -> None:
        super().__init__(program, robot, samples)
        self._slopes, self._spare = np.zeros_like(self._values), np.empty(samples)
        self._backward = self._backward_calls()

    def _backward_calls(self) -> list[tuple[Any, Any, Any, Any]]:
        """List the array operations of the reverse sweep; a first contribution is written, others added."""
        seen = set(self._outputs)
        calls: list[tuple[Any, Any, Any, Any]] = []

        def give(slot: int, slope: Floats, factor: Any) -> None:  # noqa: ANN401
            if self._value[slot] is not None:
                return
            target = self._slopes[self._row[slot]]
            if slot not in seen:
                seen.add(slot)
                calls.append((np.multiply, slope, factor, target))
            elif isinstance(factor, float) and abs(factor) == 1.0:
                calls.append((np.add if factor > 0 else np.subtract, target, slope, target))
            else:
                spare = self._spare
                calls.extend([(np.multiply, slope, factor, spare), (np.add, target, spare, target)])

        for op, lhs, rhs, out in reversed(self._steps):
            slope = self._slopes[self._row[out]]
            give(lhs, slope, self._at(rhs) if op == MUL else -1.0 if op == NEG else 1.0)
            if op != NEG:
                give(rhs, slope, self._at(lhs) if op == MUL else -1.0 if op == SUB else 1.0)
        return calls

    def add_gradient(self, q: Floats, weights: Floats, gradient: Gradient) -> None:
        """Add the gradient of sum(weights * entries) at q, the last run, to ``gradient``; weights (E, samples)."""
        self._slopes.fill(0.0)
        for e, slot in enumerate(self._outputs):
            if self._value[slot] is None:
                self._slopes[self._row[slot]] += weights[e]
        for ufunc, a, b, out in self._backward:
            ufunc(a, b, out)
        by_q, by_qd, by_qdd = gradient
        for slope, (_, name) in zip(self._slopes, self._moving, strict=False):
            kind, j = input_of(name)
            if kind in ("c", "s"):
                angle = q[:, j] + self._robot.joints[j].theta_offset
                by_q[:, j] += slope * (-np.sin(angle) if kind == "c" else np.cos(angle))
            else:
                {"q": by_q, "qd": by_qd, "qdd": by_qdd}[kind][:, j] += slope


class RegressorGradient(Observer):
    """Chosen columns of a model with their gradient.

    Args:
        model: the model.
        columns: indices of the columns, none of added effects, in the order wanted.
        samples: most samples of a call.
    """

    def __init__(self, model: Model, columns: Ints, samples: int) -> None:
        super().__init__(model, columns, samples, Tape)

    def dense(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the chosen columns at the samples, (N, n, p), and remember the samples for ``gradient``."""
        self._q, self._qd = q, qd
        return super().dense(q, qd, qdd)

    def gradient(self, weights: Floats) -> Gradient:
        """Return the gradient of sum(weights * P) by q, qd and qdd at the last samples; weights are (N, n, p)."""
        assert isinstance(self._rigid, Tape)
        by_q, by_qd, by_qdd = (np.zeros_like(self._qd) for _ in range(3))
        entries = np.ascontiguousarray(weights[:, self.rows, self.cols].T)
        stops = np.cumsum([len(friction_rows(parameter)) for parameter in self._friction[::-1]])
        rigid, *friction = np.split(entries, len(entries) - stops[::-1])
        self._rigid.add_gradient(self._q, rigid, (by_q, by_qd, by_qdd))
        for parameter, own in zip(self._friction, friction, strict=True):
            add_friction_gradient(parameter, self._robot, self._qd, list(own), by_qd, by_qdd)
        return by_q, by_qd, by_qdd
