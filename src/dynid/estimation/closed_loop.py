"""The arm under its own controller, simulated from what was commanded: a motion that knows no measurement noise.

    u = kp (q_ref - q) + kd (qd_ref - qd) = tau(q, qd, qdd)

All samples are solved for together. The measured motion is the first guess, and Newton's method on central differences
corrects it: torques and mass matrices of all samples come from one vectorised evaluation, and only the linear recursion
for the correction runs step by step. It is an initial value problem, so the steps are as stable as its differences are.

Reads conditioned segments with a command; writes the simulated motion on the same samples.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid import limits
from dynid.errors import NotSimulated
from dynid.estimation import tuning
from dynid.estimation.stack import Stack
from dynid.model.regressor import Torque, mass_matrices
from dynid.robot import Controller
from dynid.signals.conditioned_log import Segment, resampled
from dynid.signals.filters import decimate, lowpass_kernel

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Arm:
    """What is simulated.

    Attributes:
        torque: inverse dynamics.
        coulomb_sign: Coulomb signs of velocities, (N, n) -> (N, n).
    """

    torque: Torque
    coulomb_sign: Callable[[Floats], Floats]


@dataclass(frozen=True)
class Followed:
    """A simulated motion.

    Attributes:
        q: positions, (N, n) [rad or m].
        qd: velocities, (N, n).
        qdd: accelerations, (N, n).
        coulomb_sign: sign of the velocities as Coulomb friction has it, (N, n).
        rounds: corrections that it took.
    """

    q: Floats
    qd: Floats
    qdd: Floats
    coulomb_sign: Floats
    rounds: int


def follow(
    segment: Segment, arm: Arm, known: Floats, controller: Controller, cutoff: float
) -> Followed:
    """Simulate the closed loop over one segment, from the measured state at its beginning.

    Args:
        segment: conditioned motion with a command.
        arm: its inverse dynamics.
        known: further torques at the segment's samples, (N, n) [N m or N].
        controller: gains of the position controller.
        cutoff: of the filter that measured torques and positions went through, and that the simulated motion gets [Hz].

    Raises:
        NotSimulated: the parameters belong to no arm, or the loop is unstable.
    """
    assert segment.command is not None
    kp, kd = np.array(controller.kp), np.array(controller.kd)
    grid = float(segment.t[-1] - segment.t[0]) / max(1, len(segment) - 1)
    inertia = mass_matrices(arm.torque, segment.q[:: max(1, len(segment) // 200)])
    fastest = float(
        np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(inertia, np.diag(kp)[None]))).max())
    )
    finer = max(
        1,
        int(
            np.ceil(
                max(grid / tuning.SIMULATION_STEP_S, grid * fastest / tuning.SIMULATION_STEP_SHARE)
            )
        ),
    )
    limits.check("samples", len(segment) * finer, "the simulated closed loop")
    step = grid / finer
    fine = segment.t[0] + step * np.arange((len(segment) - 1) * finer + 1)
    aim, further, guess = (
        resampled(segment.t, x, fine) if finer > 1 else x
        for x in (kp * segment.command[0] + kd * segment.command[1], known, segment.q)
    )
    problem = _ClosedLoop(
        arm.torque, kp, kd, step, max(1, round(tuning.MASS_MATRIX_SECONDS / step))
    )
    limit = tuning.SIMULATION_SETTLED * step * float(np.abs(segment.command[1]).max(initial=0.0))
    q, most = guess.copy(), 0
    q[1] = q[0] + step * segment.qd[0] + 0.5 * step**2 * segment.qdd[0]
    for first in range(0, len(fine) - 2, tuning.SIMULATION_STEPS_TOGETHER):
        part = slice(first, min(first + tuning.SIMULATION_STEPS_TOGETHER + 2, len(fine)))
        # Why: the guess of the next part begins where the last one ended.
        q[part][2:] += (q[part][1] - guess[part][1]) * (first > 0)
        q[part], rounds = problem.solve(q[part], aim[part] - further[part], limit)
        most = max(most, rounds)
    motion = _differences(q, step)
    smooth = [
        _thinned(x, cutoff, 1.0 / step, finer) for x in (*motion, arm.coulomb_sign(motion[1]))
    ]
    return Followed(smooth[0], smooth[1], smooth[2], smooth[3], most)


def _thinned(x: Floats, cutoff: float, rate: float, every: int) -> Floats:
    """Return a signal under the filter at every so many samples, (N, n)."""
    kernel = lowpass_kernel(cutoff, rate)[None]
    half = min(kernel.shape[1] // 2, len(x) - 1)
    padded = np.pad(x.T, ((0, 0), (half, half)), mode="reflect", reflect_type="odd")
    return np.ascontiguousarray(decimate(padded, kernel, every)[0].T)


def simulated(stack: Stack, theta: Floats, controller: Controller) -> Stack:
    """Return a stack whose commanded motion is that of the arm simulated under its controller.

    Args:
        stack: the stacked logs, all with a command.
        theta: base parameters, (p,), each in its unit.
        controller: gains of the position controller [N m/rad and N m s/rad, or N/m and N s/m].

    Raises:
        NotSimulated: the parameters belong to no arm, or the loop is unstable.
    """
    observer = stack.observer

    def torque(q: Floats, qd: Floats, qdd: Floats) -> Floats:
        return observer.torque(theta, q, qd, qdd)

    arm = Arm(torque, observer.coulomb_sign)

    def along(segment: Segment, cutoff: float) -> Segment:
        count = len(observer.rows) - len(observer.added_entries)
        known = np.zeros_like(segment.q)
        for entry, row, column in zip(
            observer.added_entries, observer.rows[count:], observer.cols[count:], strict=True
        ):
            known[:, row] += theta[column] * segment.effects[:, entry]
        found = follow(segment, arm, known, controller, cutoff)
        sign = found.coulomb_sign if segment.coulomb_sign.size else segment.command_coulomb_sign
        return replace(
            segment,
            command_q=found.q,
            command_qd=found.qd,
            command_qdd=found.qdd,
            command_coulomb_sign=sign,
        )

    try:
        logs = [
            replace(
                log, segments=[along(each, log.filter.position_cutoff) for each in log.segments]
            )
            for log in stack.logs
        ]
    except np.linalg.LinAlgError as error:
        raise NotSimulated("with these parameters a joint has no inertia") from error
    return stack.with_logs(logs)


@dataclass(frozen=True)
class _ClosedLoop:
    torque: Torque
    kp: Floats
    kd: Floats
    step: float
    thinning: int

    def solve(self, q: Floats, aim: Floats, limit: float) -> tuple[Floats, int]:
        """Return the motion from its first two samples on, and the number of corrections."""
        h = self.step
        M = np.repeat(mass_matrices(self.torque, q[:: self.thinning]), self.thinning, axis=0)[
            1 : len(q) - 1
        ]
        before: Floats | None = None
        for k in range(1, tuning.SIMULATION_ROUNDS + 1):
            state = tuple(x[1:-1] for x in _differences(q, h))
            tau = self.torque(*state)
            missing = aim[1:-1] - self.kp * state[0] - self.kd * state[1] - tau
            D = self.kd + self._slope(*state)
            if before is not None:
                D = np.maximum(D, self.kd + self._chord(state, tau, before))
            before = state[1]
            with np.errstate(over="ignore", invalid="ignore"):
                change = _corrections(M, D, self.kp, missing, h)
            q = q.copy()
            q[2:] += change
            size = float(np.abs(change).max(initial=0.0))
            if not np.isfinite(size):
                break
            if size <= limit:
                return q, k
        raise NotSimulated("the closed loop could not be simulated with these parameters and gains")

    def _slope(self, q: Floats, qd: Floats, qdd: Floats) -> Floats:
        """Return the slope of each joint's torque by the speeds, never negative, (N, n)."""
        more, less = (
            self.torque(q, qd + side, qdd)
            for side in (tuning.SIMULATION_SLOPE_SPEED, -tuning.SIMULATION_SLOPE_SPEED)
        )
        return np.maximum((more - less) / (2 * tuning.SIMULATION_SLOPE_SPEED), 0.0)

    def _chord(self, state: tuple[Floats, ...], tau: Floats, before: Floats) -> Floats:
        """Return the slope of each joint's torque from its speed in the last round to the present one, (N, n).

        Why: beyond a reversal friction is flat, and a tangent would jump over the step to and fro for ever.
        """
        q, qd, qdd = state
        apart = qd - before
        apart = np.where(np.abs(apart) > 1e-9, apart, np.inf)
        return np.asarray((tau - self.torque(q, before, qdd)) / apart)


def _corrections(M: Floats, D: Floats, K: Floats, missing: Floats, h: float) -> Floats:
    """Solve M e'' + D e' + K e = missing by central differences from rest, (N, n) -> (N, n)."""
    n = M.shape[1]
    inertia, damping = M / h**2, np.eye(n) * (D / (2 * h))[:, :, None]
    inverse = np.linalg.inv(inertia + damping)
    push = (inverse @ missing[:, :, None])[:, :, 0]
    here = inverse @ (2 * inertia - np.diag(K))
    before = inverse @ (damping - inertia)
    e = np.zeros((len(M) + 2, n))
    for k in range(len(M)):
        e[k + 2] = push[k] + here[k] @ e[k + 1] + before[k] @ e[k]
    return e[2:]


def _differences(q: Floats, h: float) -> tuple[Floats, Floats, Floats]:
    """Return position, velocity and acceleration by central differences, the ends repeated."""
    padded = np.concatenate([2 * q[:1] - q[1:2], q, 2 * q[-1:] - q[-2:-1]])
    qd = (padded[2:] - padded[:-2]) / (2 * h)
    qdd = (padded[2:] - 2 * q + padded[:-2]) / h**2
    return q, qd, qdd
