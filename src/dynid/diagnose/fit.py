"""How well a robot file with edits explains a log, by plain least squares and by bodies that can exist.

Plain least squares takes milliseconds and bounds from below what is left; it is what a first choice is made with.
A body that can exist is a sum of point masses inside a box around its link, so its parameters lie in a cone:
non-negative least squares over the corners of that cone leaves more where a robot file demands an impossible arm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Literal

import numpy as np

from dynid.arrays import Floats, Mask
from dynid.diagnose import tuning
from dynid.log import Log
from dynid.model.kinematics import link_frames
from dynid.model.parameters import prior_bodies, second_moments
from dynid.model.regressor import body_regressor
from dynid.robot import Body, Joint, Robot
from dynid.signals import tuning as signal_tuning
from dynid.signals.checks import beyond
from dynid.signals.filters import choose_cutoff
from dynid.signals.motion import per_joint
from dynid.units import POSITION

#: Eigenvalues below this share of the largest are combinations of parameters that the log does not show.
RANK = 1e-9
#: Columns of what a joint has of its own: constant, viscous and Coulomb friction, rotor inertia; and the friction.
OWN, FRICTION = 4, (1, 2)
#: Samples whose columns are formed together; more leave the cache.
TOGETHER = 2000


@dataclass(frozen=True)
class Columns:
    """What torques are made of when an arm moves as robot files say: K motions of N samples.

    Attributes:
        bodies: columns of the ten parameters of each link, (n, 10 n, K, N); those of links before a joint are zero.
        own: columns of constant, viscous and Coulomb friction and rotor inertia of each joint, (K, n, N, 4).
    """

    bodies: Floats
    own: Floats

    def of_joint(self, j: int) -> Floats:
        """Return the columns of the bodies that joint j moves, (K, N, 10 (n - j))."""
        return self.bodies[j, 10 * j :].transpose(1, 2, 0)

    @cached_property
    def basis(self) -> Floats:
        """Orthogonal columns of what each joint has of its own, (K, n, N, 4)."""
        return np.linalg.qr(self.own)[0]

    @cached_property
    def grams(self) -> Floats:
        """Products of the columns of bodies without what is a joint's own, (K, n, 10 n, 10 n)."""
        (K, n), p = self.own.shape[:2], self.bodies.shape[1]
        products = np.zeros((K, n, p, p))
        for j in range(n):
            B = self.of_joint(j).swapaxes(1, 2)
            own = B @ self.basis[:, j]
            products[:, j, 10 * j :, 10 * j :] = B @ B.swapaxes(1, 2) - own @ own.swapaxes(1, 2)
        return products

    def bodies_residual(self, tau: Floats, has_say: Mask, *, separate: bool) -> Floats:
        """Return the root mean square that any bodies leave of each joint's torque, (K, n) [N m or N].

        Args:
            tau: torques, (K, N, n) [N m or N].
            has_say: which joints have a say about the bodies, (K, n).
            separate: whether each joint may have bodies of its own.
        """
        if not separate:
            return _shared(self, tau, has_say)
        parts = [
            _left(np.concatenate([self.own[:, j], self.of_joint(j)], axis=2), tau[:, :, j])
            for j in range(tau.shape[2])
        ]
        return np.stack(parts, axis=1)

    def friction_residual(self, tau: Floats) -> Floats:
        """Return what a constant, friction and rotor inertia alone leave of each joint's torque, (K, n) [N m or N]."""
        return np.maximum(_left(self.own, tau.swapaxes(1, 2)), 1e-9)


@dataclass(frozen=True)
class RobotFileFit:
    """Fits robot files that differ from one by edits to some samples of one log.

    Attributes:
        robot: the arm as its file says.
        x: position, velocity, acceleration in the driver's columns and SI units, (3, N, n).
        tau: torques, (N, n).
        separate: whether torques are currents of unknown gains, so that each joint is fitted for itself.
        mapped: whether signs, offsets and order of the columns still have a say.
        independent: number of instants of the whole log that say something of their own: it was smoothed.
        without_say: which columns no robot file explains, so that they have no say, (n,); () for none.
    """

    robot: Robot
    x: Floats
    tau: Floats
    separate: bool
    mapped: bool
    independent: float = np.inf
    without_say: tuple[bool, ...] = ()

    def least_residuals(self, robots: Sequence[Robot]) -> list[tuple[Floats, Floats]]:
        """Return what any bodies leave of each joint's torque under edited files, and what friction alone leaves.

        The columns of several motions are formed together.

        Args:
            robots: the arm as the edited files say.

        Returns:
            Root mean squares, (n,) each [N m or N]; the second is what a constant, friction and rotor inertia leave.
        """
        moved = [self._dh(robot) for robot in robots]
        tables: dict[object, list[int]] = {}
        for k, robot in enumerate(robots):
            tables.setdefault((robot.convention, robot.gravity), []).append(k)
        errors: dict[int, tuple[Floats, Floats]] = {}
        together = max(1, TOGETHER // len(self.tau))
        for files in tables.values():
            for start in range(0, len(files), together):
                some = files[start : start + together]
                columns = self._columns(robots[some[0]], [moved[k][0] for k in some])
                tau = np.stack([moved[k][1] for k in some])
                has_say = np.stack([self.has_say(robots[k]) for k in some])
                floor = columns.friction_residual(tau)
                left = columns.bodies_residual(tau, has_say, separate=self.separate)
                left = np.where(has_say, left, floor)
                errors |= dict(zip(some, zip(left, floor, strict=True), strict=True))
        return [errors[k] for k in range(len(robots))]

    def possible_residuals(self, robot: Robot) -> tuple[Floats, Floats]:
        """Return what bodies that can exist leave of each joint's torque, and what friction alone leaves, (n,) each."""
        x, tau = self._dh(robot)
        columns, has_say = self._columns(robot, [x]), self.has_say(robot)
        parts = [_reduced(columns, tau, j, self._signed) for j in np.flatnonzero(has_say).tolist()]
        bodies = _corners(robot.convention, robot.joints, prior_bodies(robot))
        (floor,) = columns.friction_residual(tau[None])
        remaining = floor.copy()
        if self.separate:
            remaining[has_say] = [_cone([part], bodies, np.ones(1))[0] for part in parts]
        elif has_say.any():
            (left,) = columns.bodies_residual(tau[None], has_say[None], separate=False)
            remaining[has_say] = _cone(parts, bodies, 1.0 / np.maximum(left[has_say], 1e-9))
        return remaining, floor

    def braking_residuals(self, robot: Robot, joint: int) -> tuple[float, float]:
        """Return what a joint leaves under an edited file with bodies of its own.

        Args:
            robot: the arm as the edited file says.
            joint: its number.

        Returns:
            Root mean squares [N m or N] when its friction may have any sign, and when it has to brake.
        """
        x, tau = self._dh(robot)
        columns = self._columns(robot, [x])
        bodies = _corners(robot.convention, robot.joints, prior_bodies(robot))
        free, braking = (
            _cone([_reduced(columns, tau, joint, signed)], bodies, np.ones(1))[0]
            for signed in ((), self._signed)
        )
        return free, braking

    def has_say(self, robot: Robot) -> Mask:
        """Return which joints of an edited file have a say, (n,)."""
        silent = np.array(self.without_say or (False,) * robot.n)
        return np.asarray(~silent[self._order(robot)])

    @property
    def _signed(self) -> tuple[int, ...]:
        """Which columns of a joint's own are never negative; a sensor behind the gear sees no rotor."""
        motor = self.robot.torque.source in ("motor_torque", "motor_current")
        return (*FRICTION, OWN - 1) if motor else FRICTION

    def outside(self, robot: Robot) -> int:
        """Return how many joints move far beyond their limits under an edited file."""
        q = self._dh(robot)[0][0]
        return sum(
            beyond(joint, float(low), float(high)) > signal_tuning.BEYOND_LIMITS
            for joint, low, high in zip(robot.joints, q.min(axis=0), q.max(axis=0), strict=True)
        )

    def _columns(self, robot: Robot, motions: Sequence[Floats]) -> Columns:
        """Return the columns of an edited file on motions in DH quantities, (3, N, n) each."""
        slow = per_joint(signal_tuning.MOVING_SPEED, robot)
        if robot.torque.source == "gravity_free":
            robot = replace(robot, gravity=(0.0, 0.0, 0.0))
        bodies = body_regressor(robot, *np.concatenate(motions, axis=1)).transpose(1, 2, 0)
        v, a = (np.stack([x[k].T for x in motions]) for k in (1, 2))
        own = np.stack([np.ones_like(v), *_brakes(v / slow[:, None]), a], axis=3)
        return Columns(bodies.reshape(*bodies.shape[:2], len(motions), -1), own)

    def _dh(self, robot: Robot) -> tuple[Floats, Floats]:
        """Return position, velocity, acceleration (3, N, n), and torques (N, n), in DH quantities of an edited file."""
        if not self.mapped:
            return self.x, self.tau
        order, map_ = self._order(robot), robot.columns.map
        x, tau = self.x[:, :, order], self.tau[:, order]
        if self.robot.coupling is not None:
            matrix = np.array(self.robot.coupling.matrix)
            x, tau = x @ np.linalg.inv(matrix).T, tau @ matrix
        unit, before = (POSITION[arm.columns.units["position"]] for arm in (robot, self.robot))
        x = x * (np.array(map_.sign) * unit / before)
        x[0] += np.array(map_.offset)
        return x, tau * np.array(map_.sign) * np.array(map_.torque_signs)

    def _order(self, robot: Robot) -> list[int]:
        """Return which column of the log belongs to each joint of an edited file."""
        return [self.robot.log_names.index(name) for name in robot.log_names]


def _brakes(v: Floats) -> tuple[Floats, Floats]:
    """Return two laws of which every one of viscous and Coulomb friction that brakes at all speeds is a sum, (..., N).

    Why not each for itself: friction that falls with speed, or turns more sharply, brakes with less than no viscosity.

    Args:
        v: speeds over that at which the sign turns, (..., N).
    """
    fastest = np.maximum(np.abs(v).max(axis=-1, keepdims=True), 1e-9)
    return v - np.tanh(v), np.tanh(v) - v * np.tanh(fastest) / fastest


def middle(log: Log) -> tuple[Floats, Floats, Floats]:
    """Return time (N,), positions and torques (N, n) from the middle of a log."""
    first = max(0, (len(log) - tuning.MIDDLE_SAMPLES) // 2)
    part = slice(first, first + tuning.MIDDLE_SAMPLES)
    return log.t[part], log.q[part], log.tau[part]


def smoother(width: int) -> Callable[[Floats], Floats]:
    """Return what smooths columns over so many samples and takes as many, and one more, off their ends."""
    kernel = np.hanning(width + 2) / np.hanning(width + 2).sum()
    return lambda x: np.apply_along_axis(np.convolve, 0, x, kernel, "valid")


def robot_file_fit(log: Log, robot: Robot, *, mapped: bool = True) -> RobotFileFit | None:
    """Smooth, differentiate and thin a log for fits of robot files; None where it hardly moves.

    Args:
        log: the robot's columns in SI units, with known gains applied, before the driver's map or after it.
        robot: the arm.
        mapped: whether they are before it.
    """
    if len(log) < 50:
        return None
    t, q, tau = middle(log)
    usual = float(np.median(np.diff(t)))
    period = 1.65 / choose_cutoff([log], robot)
    width = max(3, round(min(tuning.SMOOTHING_S, period) / usual))
    if len(t) < 6 * width + 20:
        return None
    smooth, span = smoother(width), 3 * (width + 1)
    # Each is smoothed once more than the one before it, and so is shorter at both ends.
    position = smooth(np.where(robot.turning, np.unwrap(q, axis=0), q))
    velocity = smooth(np.gradient(position, clock := smooth(t), axis=0))
    acceleration = smooth(np.gradient(velocity, smooth(clock), axis=0))
    torque, count = smooth(smooth(smooth(tau))), len(acceleration)
    position, velocity = (x[(len(x) - count) // 2 :][:count] for x in (position, velocity))
    without_gaps = t[span:][:count] - t[:count] < 1.5 * span * usual + 3 * usual
    # Why: a log in rad that the robot file takes for degrees seems to stand still.
    unit = POSITION[robot.columns.units["position"]]
    slow = unit * per_joint(signal_tuning.MOVING_SPEED, robot)
    rows = np.flatnonzero(np.any(np.abs(velocity) > slow, axis=1) & without_gaps)
    if len(rows) < 50:
        return None
    independent = len(rows) / width
    rows = rows[:: max(1, len(rows) // tuning.SAMPLES)]
    motion = np.stack([position, velocity, acceleration])[:, rows]
    unknown = log.tau_unit == "A" and not robot.torque.complete
    return RobotFileFit(robot, motion, torque[rows], unknown, mapped, independent)


def _left(columns: Floats, tau: Floats) -> Floats:
    """Return the root mean square that least squares leaves of torques, (...,).

    Args:
        columns: (..., N, c).
        tau: (..., N).
    """
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=-2, keepdims=True), 1e-12)
    value, vector = np.linalg.eigh(np.swapaxes(scaled, -1, -2) @ scaled)
    kept = value > RANK * value[..., -1:]
    side = np.swapaxes(vector, -1, -2) @ (np.swapaxes(scaled, -1, -2) @ tau[..., None])
    fit = vector @ np.where(kept[..., None], side / np.where(kept, value, 1.0)[..., None], 0.0)
    return np.sqrt(np.mean((tau - (scaled @ fit)[..., 0]) ** 2, axis=-1))


def _shared(columns: Columns, tau: Floats, has_say: Mask) -> Floats:
    """Return what is left of each joint's torque when all joints share the bodies, (K, n).

    Friction is taken out joint by joint; weights are found in three rounds, from what each joint leaves.

    Args:
        columns: of K motions.
        tau: torques, (K, N, n) [N m or N].
        has_say: which joints have a say about the bodies, (K, n).
    """
    grams, basis, torque = columns.grams, columns.basis, tau.swapaxes(1, 2)[..., None]
    (K, n, p), count = grams.shape[:3], tau.shape[1]
    left = (torque - basis @ (basis.swapaxes(2, 3) @ torque))[..., 0]
    sides = np.zeros((K, n, p))
    for j in range(n):
        sides[:, j, 10 * j :] = (left[:, j, None] @ columns.of_joint(j))[:, 0]
    energy = np.sum(left**2, axis=2) / count
    rms = np.sqrt(np.maximum(energy, 1e-18))
    ridge = np.tile(tuning.USUAL_BODY**-2.0, p // 10)
    for _ in range(3):
        weight = has_say[:, None] / (tuning.SAMPLES_ALIKE * rms[:, None] ** 2)
        G, side = (weight @ grams.reshape(K, n, -1)).reshape(K, p, p), weight @ sides
        G[:, range(p), range(p)] += ridge
        theta = _solved(G, side.swapaxes(1, 2))[:, None]
        quads = ((grams @ theta)[..., 0] - 2.0 * sides)[:, :, None] @ theta
        rms = np.sqrt(np.maximum(energy + quads[:, :, 0, 0] / count, 1e-12 * energy + 1e-18))
        rms = np.maximum(rms, tuning.MODELLED * np.sqrt(energy))
    return np.asarray(rms)


def _solved(G: Floats, side: Floats) -> Floats:
    """Return the solutions of K systems of equations, (K, p, 1)."""
    try:
        return np.asarray(np.linalg.solve(G, side))
    except np.linalg.LinAlgError:  # numbers so far apart that the ridge is lost beside them
        return np.stack(
            [np.linalg.lstsq(A, b, rcond=None)[0] for A, b in zip(G, side, strict=True)]
        )


def _reduced(
    columns: Columns, torques: Floats, joint: int, signed: Sequence[int]
) -> tuple[Floats, Floats, Floats]:
    """Return columns of bodies, (N, 10 n), those of the joint's own that must not be negative, (N, m), and the torque.

    What may have any sign is taken out of all three.

    Args:
        columns: of one motion.
        torques: (N, n) [N m or N].
        joint: its number.
        signed: which columns of its own must not be negative, m of them.
    """
    own, p = columns.own[0, joint], columns.bodies.shape[1]
    Q = np.linalg.qr(own[:, [k for k in range(OWN) if k not in signed]])[0]
    bodies = np.zeros((len(own), p))
    bodies[:, 10 * joint :] = columns.of_joint(joint)[0]
    kept = np.column_stack([bodies, own[:, list(signed)], torques[:, joint]])
    kept = kept - Q @ (Q.T @ kept)
    return kept[:, :p], kept[:, p:-1], kept[:, -1]


def _cone(
    parts: Sequence[tuple[Floats, Floats, Floats]], bodies: Sequence[Floats], weights: Floats
) -> Floats:
    """Return what non-negative least squares over the cone of bodies leaves of some joints, (m,).

    Args:
        parts: columns of bodies and of friction, and the torque, of m joints.
        bodies: corners of the cone of each link's parameters, n of (10, points).
        weights: of the joints, (m,).
    """
    # Here: help must be fast.
    from scipy.linalg import block_diag
    from scipy.optimize import nnls

    columns, friction, tau = zip(*parts, strict=True)
    stacked = np.column_stack([np.concatenate(columns), block_diag(*friction), np.concatenate(tau)])
    stacked *= np.repeat(weights, len(tau[0]))[:, None]
    R = np.asarray(np.linalg.qr(stacked, mode="r"))
    cone = block_diag(*bodies, np.eye(stacked.shape[1] - 1 - 10 * len(bodies)))
    corners = R[:, :-1] @ cone
    scale = np.maximum(np.linalg.norm(corners, axis=0), 1e-12)
    solution = nnls(corners / scale, R[:, -1], maxiter=10 * corners.shape[1])[0] / scale
    left = stacked[:, -1] - stacked[:, :-1] @ (cone @ solution)
    return np.sqrt(np.mean(left.reshape(len(parts), -1) ** 2, axis=1)) / weights


@lru_cache(maxsize=16)
def _corners(
    convention: Literal["standard", "modified"], joints: tuple[Joint, ...], prior: tuple[Body, ...]
) -> tuple[Floats, ...]:
    """Return the parameters of point masses of 1 kg inside the box of each link, n of (10, points).

    The box is around the link's own frame and those of its neighbours, with a margin: generous, because the DH frames
    of many arms lie outside the link, and what counts is that masses are positive and levers no longer than the arm.
    Bodies of the prior may exist, too, however far they reach: a long tool, or the inertias of a public URDF, with
    which simulated logs are made and of which some are those of bodies as large as the arm.
    """
    robot = Robot("", convention, joints)
    frames = link_frames(robot, np.zeros((1, robot.n)))
    R, p = frames.R[0], np.concatenate([np.zeros((1, 3)), frames.p[0]])
    corners = []
    for i in range(robot.n):
        ends = (p[i : i + 3] - p[i + 1]) @ R[i]
        reach = tuning.BOX_MARGIN_M + tuning.BOX_MARGIN_SHARE * np.abs(ends).max()
        axes = [
            np.unique([*np.linspace(low, high, tuning.BOX_POINTS), 0.0])
            for low, high in zip(ends.min(axis=0) - reach, ends.max(axis=0) + reach, strict=True)
        ]
        grid = np.stack(np.meshgrid(*axes, indexing="ij")).reshape(3, -1)
        x, y, z = np.hstack([grid, _points(prior[i]).T])
        tensor = [y**2 + z**2, -x * y, -x * z, x**2 + z**2, -y * z, x**2 + y**2]
        corners.append(np.stack([np.ones_like(x), x, y, z, *tensor]))
    return tuple(corners)


def _points(body: Body) -> Floats:
    """Return places of equal masses that have a body's second moments about its centre, and the centre, (7, 3) [m]."""
    value, axes = np.linalg.eigh(second_moments(body.tensor) / max(body.mass, 1e-9))
    reach = np.sqrt(3.0 * np.maximum(value, 0.0)) * axes
    return np.array(body.com) + np.vstack([reach.T, -reach.T, np.zeros((1, 3))])
