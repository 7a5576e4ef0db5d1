"""Does the robot file describe the arm that made the log? If not: which single edits would explain it far better.

Each hypothesis is a robot file with one to three edits: the other DH convention, reversed joints, another order of the
columns, offsets of multiples of 90 degrees, another unit, another direction of gravity. All are fitted to a few hundred
samples by least squares, bodies and friction free, and compared by what they leave unexplained. Base parameters absorb
some mistakes whole; those do no harm and are not named.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.drivers.registry import driver_of
from dynid.log import Log
from dynid.model.numeric_regressor import body_regressor
from dynid.robot import Robot
from dynid.signals.columns import in_si, matching_columns, robot_columns
from dynid.signals.gravity import expected_torque
from dynid.signals.motion import MOVING_SPEED, bandwidth, moving, per_joint

Floats = NDArray[np.float64]

#: Samples that hypotheses are fitted to, and those that a first choice among them is made with.
SAMPLES = 400
#: Longest time that positions are smoothed over before they are differentiated [s]; a third of the fastest period.
SMOOTHING = 0.15
#: Samples from the middle of a long log.
MOST_SAMPLES = 60_000
#: Mean logarithm of the residuals per joint below which one robot file is better than another.
CLEAR = 0.12
#: A further edit has to earn so much more than the one before it.
FURTHER = 0.06
#: Hypotheses that are taken further with a second edit, and a third.
BEAM = 6
#: A robot file that leaves less than this share of what constant and friction leave is not questioned.
GOOD = 0.02
#: Eigenvalues below this share of the largest are combinations of parameters that the log does not show.
RANK = 1e-9
#: Weight of implausible inertias and frictions in the comparison, where two hypotheses explain alike.
IMPLAUSIBLE = 0.05


@dataclass(frozen=True)
class Edit:
    """One edit of a robot file.

    Attributes:
        kind: ``"convention"``, ``"sign"``, ``"order"``, ``"offset"``, ``"unit"`` or ``"gravity"``.
        value: joint numbers, order of the columns, offset in quarter turns, factor or direction.
    """

    kind: str
    value: tuple[float, ...]


@dataclass(frozen=True)
class Hypothesis:
    """A robot file with edits, and how well it explains the log.

    Attributes:
        edits: what is changed.
        score: mean over joints of the logarithm of the residual, relative to that of constant and friction; lower is
            better.
        unexplained: what it leaves of the torques that constant and friction leave, root mean square over joints.
        implausible: share of negative inertias and frictions.
    """

    edits: tuple[Edit, ...]
    score: float
    unexplained: float
    implausible: float

    @property
    def rank(self) -> float:
        """What hypotheses are ordered by: fit, plausibility, few edits."""
        return self.score + IMPLAUSIBLE * self.implausible + 0.5 * FURTHER * len(self.edits)


@dataclass(frozen=True)
class Diagnosis:
    """What was found out about a robot file and a log.

    Attributes:
        given: the robot file as it is.
        best: the best hypotheses, the best first.
        wrong: whether the best one is so much better that the file must be wrong.
    """

    given: Hypothesis
    best: tuple[Hypothesis, ...]
    wrong: bool


@dataclass(frozen=True)
class _Motion:
    """A thinned log in the driver's columns and SI units.

    Attributes:
        x: position, velocity, acceleration, (3, N, n).
        tau: torques, (N, n).
        apart: whether torques are currents of unknown gains, so that each joint is fitted for itself.
    """

    x: Floats
    tau: Floats
    apart: bool


class _Judge:
    """Fits hypotheses to one log.

    Args:
        robot: the arm as its file says.
        motion: the thinned log.
        mapped: whether signs, offsets and order of the columns still have a say.
    """

    def __init__(self, robot: Robot, motion: _Motion, names: Sequence[str], mapped: bool) -> None:
        self.robot, self.motion, self.names, self.mapped = robot, motion, names, mapped
        sign, offset = robot.driver.map.sign if robot.driver else (1.0,) * robot.n, (
            robot.driver.map.offset if robot.driver else (0.0,) * robot.n
        )
        self.sign, self.offset = (np.array(sign), np.array(offset)) if mapped else (np.ones(robot.n), np.zeros(robot.n))
        self.coupling = np.array(robot.coupling.matrix) if robot.coupling is not None and mapped else None
        friction = self._friction(*self._dh(())[0][1:], ())
        self.floor = np.array([_left(friction[j], self._dh(())[1][:, j]) for j in range(robot.n)])
        self.floor = np.maximum(self.floor, 1e-9)

    # ------------------------------------------------------------ one hypothesis
    def _dh(self, edits: Sequence[Edit]) -> tuple[Floats, Floats]:
        """Return position, velocity, acceleration (3, N, n), and torques (N, n), in DH quantities under edits."""
        x, tau = self.motion.x.copy(), self.motion.tau
        sign, offset = self.sign.copy(), self.offset.copy()
        for edit in edits:
            if edit.kind == "order":
                order = [int(k) for k in edit.value]
                x, tau = x[:, :, order], tau[:, order]
            elif edit.kind == "unit":
                x = x * edit.value[0]
            elif edit.kind == "sign":
                sign[int(edit.value[0])] *= -1
            elif edit.kind == "offset":
                offset[int(edit.value[0])] += edit.value[1] * math.pi / 2
        if self.coupling is not None:
            x, tau = x @ np.linalg.inv(self.coupling).T, tau @ self.coupling
        x = x * sign
        x[0] += offset
        return x, tau * sign

    def _robot(self, edits: Sequence[Edit]) -> Robot:
        robot = self.robot
        for edit in edits:
            if edit.kind == "convention":
                robot = replace(robot, convention="modified" if robot.convention == "standard" else "standard")
            elif edit.kind == "gravity":
                robot = replace(robot, gravity=edit.value)  # type: ignore[arg-type]
        return replace(robot, gravity=(0.0, 0.0, 0.0)) if robot.torque.source == "gravity_free" else robot

    def _friction(self, qd: Floats, qdd: Floats, edits: Sequence[Edit]) -> list[Floats]:
        """Return the columns of rotor inertia and friction of each joint, n of (N, 4)."""
        slow = per_joint(MOVING_SPEED, self.robot)
        return [
            np.column_stack([np.ones(len(qd)), qd[:, j], np.tanh(qd[:, j] / slow[j]), qdd[:, j]])
            for j in range(self.robot.n)
        ]

    def fit(self, edits: tuple[Edit, ...]) -> Hypothesis:
        """Fit a robot file with edits; every joint counts by its own noise."""
        x, tau = self._dh(edits)
        robot = self._robot(edits)
        bodies = body_regressor(robot, *x)
        friction = self._friction(x[1], x[2], edits)
        if self.motion.apart:
            left = np.array([_left(np.hstack([friction[j], bodies[:, j]]), tau[:, j]) for j in range(robot.n)])
            theta = np.zeros(bodies.shape[2])
            own: list[Floats] = []
        else:
            left, theta, own = _shared(bodies, friction, tau)
        share = left / self.floor
        # Why the floor: a joint whose torque is friction alone has nothing that a robot file could explain.
        score = float(np.mean(np.log(np.maximum(share, 1e-4))))
        unexplained = float(np.sqrt(np.mean(np.minimum(share, 2.0) ** 2)))
        return Hypothesis(edits, score, unexplained, self._implausible(robot, x[0], theta, own))

    def _implausible(self, robot: Robot, q: Floats, theta: Floats, own: list[Floats]) -> float:
        """Return the share of joints with negative inertia (mean over poses) or negative friction."""
        if not own:
            return 0.0
        some = q[:: max(1, len(q) // 20)]
        free = replace(robot, gravity=(0.0, 0.0, 0.0))
        bad = 0.0
        for j in range(robot.n):
            push = np.zeros_like(some)
            push[:, j] = 1.0
            inertia = body_regressor(free, some, np.zeros_like(some), push)[:, j] @ theta + own[j][3]
            speed = own[j][1] + own[j][2]
            bad += 0.5 * float(np.mean(inertia < 0)) + 0.5 * float(speed < 0)
        return bad / robot.n

    # ------------------------------------------------------------ which edits
    def single(self) -> Iterator[Edit]:
        """Yield all single edits."""
        robot, n = self.robot, self.robot.n
        yield Edit("convention", ())
        gravity = np.array(robot.gravity)
        size = float(np.linalg.norm(gravity))
        if size and robot.torque.source != "gravity_free":
            for axis in range(3):
                for sign in (1.0, -1.0):
                    other = np.zeros(3)
                    other[axis] = sign * size
                    if not np.allclose(other, gravity, atol=0.1 * size):
                        yield Edit("gravity", tuple(other.tolist()))
        if not self.mapped:
            return
        for j in range(n):
            yield Edit("sign", (float(j),))
        for j in range(n):
            for quarter in (1.0, -1.0, 2.0):
                if robot.joints[j].revolute:
                    yield Edit("offset", (float(j), quarter))
        for factor in (math.pi / 180, 180 / math.pi):
            yield Edit("unit", (factor,))
        yield from self.orders()

    def orders(self) -> Iterator[Edit]:
        """Yield orders of the columns: every exchange of two, and whole ones that recorders and people make."""
        n = self.robot.n
        same = list(range(n))
        seen = {tuple(same)}
        whole = [same[::-1], [*same[1:], 0], [n - 1, *same[:-1]], self._sorted(), self._unsorted(), self._alike()]
        swaps = [
            [b if k == a else a if k == b else k for k in same] for a in range(n) for b in range(a + 1, n)
        ]
        for order in [*swaps, *whole]:
            if sorted(order) == same and tuple(order) not in seen:
                seen.add(tuple(order))
                yield Edit("order", tuple(float(k) for k in order))

    def _sorted(self) -> list[int]:
        return sorted(range(self.robot.n), key=lambda k: self.names[k])

    def _unsorted(self) -> list[int]:
        order = self._sorted()
        return [order.index(k) for k in range(self.robot.n)]

    def _alike(self) -> list[int]:
        """Return the assignment of columns to joints by range of motion, speed and size of the torque."""
        from scipy.optimize import linear_sum_assignment

        robot, x = self.robot, self.motion.x
        have = np.std(self.motion.tau, axis=0) + 1e-9
        carried = np.sqrt(np.mean(expected_torque(x[0], robot) ** 2, axis=0)) + 0.02
        rating = [joint.limits.torque for joint in robot.joints]
        size = np.array([value or np.nan for value in rating])
        wanted = size if np.isfinite(size).all() else carried
        cost = np.abs(np.log(have / have.mean())[None, :] - np.log(wanted / wanted.mean())[:, None])
        for j, joint in enumerate(robot.joints):
            if joint.limits.position is not None and self.coupling is None:
                low, high = sorted(
                    (np.array(joint.limits.position) - self.offset[j]) * self.sign[j]
                )
                outside = np.maximum(0, x[0].max(axis=0) - high) + np.maximum(0, low - x[0].min(axis=0))
                cost[j] += 3.0 * outside
        return [int(k) for k in linear_sum_assignment(cost)[1]]


def diagnose(log: Log, robot: Robot, *, always: bool = False) -> Diagnosis | None:
    """Return what a log says about a robot file; None where the file explains the log well, or nothing can be said.

    Args:
        log: raw, or in DH quantities; with increasing time and finite numbers.
        robot: the arm.
        always: whether hypotheses are also tried where the file explains the log well.
    """
    judge = _judge(log, robot)
    if judge is None:
        return None
    given = judge.fit(())
    if given.score < math.log(GOOD) and not always:
        return None
    found = {hypothesis.edits: hypothesis for hypothesis in map(judge.fit, ((edit,) for edit in judge.single()))}
    front = sorted(found.values(), key=lambda each: each.rank)[:BEAM]
    for _ in range(2):
        if not front or front[0].rank > given.rank - CLEAR:
            # Why: two mistakes may each hide what the repair of the other one gains.
            front = front[: BEAM // 2] if not front else front
        further: dict[tuple[Edit, ...], Hypothesis] = {}
        for start in front:
            for edit in judge.single():
                edits = _with(start.edits, edit)
                if edits is not None and edits not in found and edits not in further:
                    further[edits] = judge.fit(edits)
        found |= further
        best = min(front, key=lambda each: each.rank)
        front = sorted(further.values(), key=lambda each: each.rank)[:BEAM]
        if not front or front[0].rank > best.rank - FURTHER:
            break
    ranked = sorted(found.values(), key=lambda each: each.rank)
    return Diagnosis(given, tuple(ranked[:5]), ranked[0].rank < given.rank - CLEAR)


def _with(edits: tuple[Edit, ...], edit: Edit) -> tuple[Edit, ...] | None:
    """Return edits with one more, None where that says nothing new."""
    for before in edits:
        if before.kind == edit.kind and (
            edit.kind in ("convention", "gravity", "unit") or before.value[0] == edit.value[0] and edit.kind != "order"
        ):
            return None
    if edit.kind == "order":
        own = next((before for before in edits if before.kind == "order"), None)
        if own is not None:
            order = tuple(own.value[int(k)] for k in edit.value)
            if order == tuple(float(k) for k in range(len(order))):
                return None
            rest = tuple(before for before in edits if before is not own)
            return tuple(sorted((*rest, Edit("order", order)), key=_place))
    return tuple(sorted((*edits, edit), key=_place))


def _place(edit: Edit) -> tuple[str, tuple[float, ...]]:
    return edit.kind, edit.value


def _judge(log: Log, robot: Robot) -> _Judge | None:
    raw = in_si(robot_columns(log, robot), robot)
    names = [log.names[k] for k in matching_columns(log, robot)[0]] if log.names else list(robot.log_names)
    motion = _motion(raw, robot)
    if motion is None:
        return None
    return _Judge(robot, motion, names, not log.dh)


def _motion(log: Log, robot: Robot) -> _Motion | None:
    """Smooth, differentiate and thin a log in SI units; None where it hardly moves."""
    if len(log) < 50:
        return None
    first = max(0, (len(log) - MOST_SAMPLES) // 2)
    part = slice(first, first + MOST_SAMPLES)
    t, q, tau = log.t[part], log.q[part], log.tau[part]
    usual = float(np.median(np.diff(t)))
    fastest = bandwidth(log, robot)
    width = max(3, round(min(SMOOTHING, 0.33 / max(fastest, 0.1)) / usual))
    if len(t) < 6 * width + 20:
        return None
    kernel = np.hanning(width + 2) / np.hanning(width + 2).sum()
    turning = np.array([joint.revolute for joint in robot.joints])
    q = np.where(turning, np.unwrap(q, axis=0), q)

    def smooth(x: Floats) -> Floats:
        return np.apply_along_axis(np.convolve, 0, x, kernel, "valid")

    def slope(x: Floats) -> Floats:
        return np.asarray(np.gradient(x, clock, axis=0))

    clock = np.convolve(t, kernel, "valid")
    x0 = smooth(q)
    x1 = smooth(slope(x0))
    clock = np.convolve(clock, kernel, "valid")
    x2 = smooth(slope(x1))
    inner = slice(len(kernel) // 2, -(len(kernel) // 2) or None)
    twice = smooth(smooth(smooth(tau)))
    count = len(x2)
    edge = (len(x0) - count) // 2, (len(x1) - count) // 2
    position, velocity = x0[edge[0] : edge[0] + count], x1[edge[1] : edge[1] + count]
    del inner
    span = len(kernel)
    reach = t[3 * (span - 1) :][:count] - t[:count]
    whole = reach < 1.5 * 3 * (span - 1) * usual + 3 * usual
    alive = np.any(np.abs(velocity) > per_joint(MOVING_SPEED, robot), axis=1) & whole
    rows = np.flatnonzero(alive)
    if len(rows) < 50:
        return None
    rows = rows[:: max(1, len(rows) // SAMPLES)]
    unknown = log.tau_unit == "A" and (robot.torque.gain is None or any(g is None for g in robot.torque.gain))
    gain = np.array(robot.torque.gain, dtype=float) if log.tau_unit == "A" and not unknown else np.ones(log.n)
    return _Motion(np.stack([position[rows], velocity[rows], x2[rows]]), twice[:count][rows] * gain, unknown)


def _left(columns: Floats, tau: Floats) -> float:
    """Return the root mean square that least squares leaves of one joint's torque."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    G = scaled.T @ scaled
    value, vector = np.linalg.eigh(G)
    kept = value > RANK * value[-1]
    fit = vector[:, kept] @ ((vector[:, kept].T @ (scaled.T @ tau)) / value[kept])
    return float(np.sqrt(np.mean((tau - scaled @ fit) ** 2)))


def _shared(bodies: Floats, friction: list[Floats], tau: Floats) -> tuple[Floats, Floats, list[Floats]]:
    """Return what is left of each joint's torque, the bodies' parameters, and each joint's friction.

    Friction is taken out joint by joint; weights are found in three rounds, from what each joint leaves.
    """
    n, p = tau.shape[1], bodies.shape[2]
    rest, left, bases = [], [], []
    for j in range(n):
        Q, R = np.linalg.qr(friction[j])
        rest.append(bodies[:, j] - Q @ (Q.T @ bodies[:, j]))
        left.append(tau[:, j] - Q @ (Q.T @ tau[:, j]))
        bases.append((Q, R))
    grams = [a.T @ a for a in rest]
    sides = [a.T @ b for a, b in zip(rest, left, strict=True)]
    energies = np.array([float(b @ b) for b in left])
    rms = np.sqrt(np.maximum(energies / len(tau), 1e-18))
    theta = np.zeros(p)
    for _ in range(3):
        G = sum(gram / s**2 for gram, s in zip(grams, rms, strict=True))
        side = sum(side / s**2 for side, s in zip(sides, rms, strict=True))
        size = np.sqrt(np.maximum(np.diag(G), 1e-24))
        value, vector = np.linalg.eigh(G / np.outer(size, size))
        kept = value > RANK * value[-1]
        theta = (vector[:, kept] @ ((vector[:, kept].T @ (side / size)) / value[kept])) / size
        quads = np.array([float(theta @ gram @ theta - 2 * theta @ s) for gram, s in zip(grams, sides, strict=True)])
        rms = np.sqrt(np.maximum((energies + quads) / len(tau), 1e-12 * energies / len(tau) + 1e-18))
    own = [
        np.linalg.lstsq(R, Q.T @ (tau[:, j] - bodies[:, j] @ theta), rcond=1e-9)[0] for j, (Q, R) in enumerate(bases)
    ]
    return rms, theta, own
