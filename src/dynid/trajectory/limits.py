"""Is a planned motion safe? Joint limits, predicted torque and tool speed, checked on the final polynomial at 1 kHz.

Positions, speeds and accelerations are compared by their exact extrema, torques and tool speed on the 1 kHz grid.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from dynid.arrays import Floats
from dynid.errors import LimitBroken
from dynid.motion import Motion
from dynid.robot import Robot
from dynid.trajectory import tuning
from dynid.trajectory.clearance import tool_speed
from dynid.trajectory.feasible import Bounds
from dynid.trajectory.plan import Trajectory
from dynid.units import joint_unit

Torque = Callable[[Motion], Floats]


@dataclass(frozen=True)
class Peak:
    """The largest values of one joint.

    Attributes:
        joint: its name.
        position: the position nearest to a limit [rad or m].
        velocity: [rad/s or m/s].
        acceleration: [rad/s^2 or m/s^2].
        torque: predicted, [N m or N]; None where nothing is predicted.
        share: largest share of a limit that is used.
    """

    joint: str
    position: float
    velocity: float
    acceleration: float
    torque: float | None
    share: float


@dataclass(frozen=True)
class Violation:
    """A limit that a motion breaks.

    Attributes:
        joint: name of the joint, or ``"tool"``.
        quantity: position, velocity, acceleration, torque or speed.
        value: largest value.
        limit: what is allowed, margins taken off.
        time: when [s].
        alpha: largest speed factor that keeps this limit; None when slowing down does not help.
        revolute: whether the joint turns; one that slides counts in metres.
    """

    joint: str
    quantity: str
    value: float
    limit: float
    time: float
    alpha: float | None
    revolute: bool = True


@dataclass(frozen=True)
class LimitCheck:
    """What a motion uses of the limits.

    Attributes:
        peaks: one per joint.
        violations: broken limits, () for a motion that may run.
        tool_speed: largest speed of the last frame [m/s].
    """

    peaks: tuple[Peak, ...]
    violations: tuple[Violation, ...]
    tool_speed: float


def check_trajectory(
    trajectory: Trajectory,
    robot: Robot,
    limits: Bounds,
    torque: Torque | None = None,
    speed: float | None = None,
) -> LimitCheck:
    """Compare a motion with all limits.

    Args:
        trajectory: the motion.
        robot: the arm.
        limits: limits, margins taken off.
        torque: predicted torques of a motion, (N, n); None to leave torques out.
        speed: largest speed of the tool [m/s]; None for any.
    """
    alpha, middle = trajectory.alpha, (limits.upper + limits.lower) / 2
    motion = trajectory.sampled(tuning.CHECK_RATE_HZ * alpha)
    extremes = [trajectory.stationary(order) for order in range(3)]
    series = dict(zip(("position", "velocity", "acceleration"), extremes, strict=True))
    violations, peaks = joint_violations(robot, limits, series, alpha), np.empty((3, robot.n))
    for (order, j), _ in np.ndenumerate(peaks):
        away = extremes[order][j][1] - (0.0 if order else middle[j])
        peaks[order, j] = np.abs(away).max() if order else middle[j] + away[np.abs(away).argmax()]
    shares = [
        np.abs(peaks[0] - middle) / ((limits.upper - limits.lower) / 2),
        peaks[1] / limits.velocity,
        peaks[2] / limits.acceleration,
    ]
    largest = [None] * robot.n
    if torque is not None:
        tau, slower = torque(motion), None
        if np.any(np.abs(tau) > limits.torque * (1 + tuning.LIMIT_ROUNDING_SHARE)):
            path = trajectory.slowed(1.0).sampled(tuning.CHECK_RATE_HZ / 10)
            slower = fitting_alpha(path, limits.torque, torque, alpha)
        drives = {"torque": [(motion.t, own) for own in tau.T]}
        violations += joint_violations(robot, limits, drives, slower)
        shares.append(np.abs(tau).max(axis=0) / limits.torque)
        largest = np.abs(tau).max(axis=0).tolist()
    moving = tool_speed(robot, motion.q, motion.qd)
    fastest, time = float(moving.max()), float(motion.t[moving.argmax()])
    if speed is not None and fastest > speed * (1 + tuning.LIMIT_ROUNDING_SHARE):
        violations.append(Violation("tool", "speed", fastest, speed, time, alpha * speed / fastest))
    columns = (robot.joint_names, *peaks.tolist(), largest, np.max(shares, axis=0).tolist())
    largest_of_joints = tuple(Peak(*row) for row in zip(*columns, strict=True))
    return LimitCheck(largest_of_joints, tuple(violations), fastest)


def joint_violations(
    robot: Robot,
    limits: Bounds,
    series: Mapping[str, Sequence[tuple[Floats, Floats]]],
    alpha: float | None,
) -> list[Violation]:
    """Return by how much joints leave their limits at worst.

    Args:
        robot: the arm.
        limits: limits, margins taken off.
        series: of position, velocity, acceleration or torque, times [s] and values of each joint, (N,) each.
        alpha: speed factor of the motion; that at which torques fit, None where they never do.
    """
    violations = []
    for quantity, of_joints in series.items():
        if quantity == "position":
            lowest, highest = limits.lower, limits.upper
        else:
            highest = getattr(limits, quantity)
            lowest = -highest
        for joint, lower, upper, (t, values) in zip(
            robot.joints, lowest.tolist(), highest.tolist(), of_joints, strict=True
        ):
            beyond = np.maximum(values - upper, lower - values)
            worst = int(beyond.argmax())
            if not beyond[worst] > tuning.LIMIT_ROUNDING_SHARE * max(1.0, upper - lower):
                continue
            value, time = float(values[worst]), float(t[worst])
            limit, slower = upper if value > upper else lower, alpha
            if quantity == "position":
                slower = None
            elif slower is not None and quantity != "torque":
                slower *= (limit / value) ** (0.5 if quantity == "acceleration" else 1.0)
            if quantity != "position":
                value, limit = abs(value), abs(limit)
            violations.append(
                Violation(joint.name, quantity, value, limit, time, slower, joint.revolute)
            )
    return violations


def require_within_limits(check: LimitCheck, margin: float = 0.0) -> None:
    """Refuse a motion that breaks a limit.

    Raises:
        LimitBroken: with the worst violation, and the speed factor or change that would pass.
    """
    raise_worst(check.violations, margin, lambda alpha: f"--alpha {floor2(alpha):g}")


def raise_worst(
    violations: Sequence[Violation], margin: float, slower: Callable[[float], str]
) -> None:
    """Raise when there are violations.

    Args:
        violations: broken limits.
        margin: share that was taken off the limits.
        slower: returns the option that sets a speed factor, for the advice.

    Raises:
        LimitBroken: with the worst violation, and the speed factor or change that would pass.
    """
    if not violations:
        return
    worst = max(violations, key=lambda v: v.value / v.limit if v.limit else np.inf)
    others = len(violations) - 1
    more = f"; {others} more limit{'s are' if others > 1 else ' is'} broken" * bool(others)
    kept = f" with {100 * margin:g} % margin" if margin else ""
    helps = [v.alpha for v in violations if v.alpha is not None]
    if len(helps) == len(violations):
        fix = slower(min(helps))
    elif worst.quantity == "torque":
        fix = "slower does not help: this pose is too heavy for the joint; use waypoints nearer to the base"
    else:
        fix = "slower does not help: move the waypoints away from the limit, or try another --seed"
    verb, unit = _VERB[worst.quantity]
    size = f"{worst.value:.3g} {joint_unit(unit, revolute=worst.revolute)}"
    done = f"{worst.joint} {verb} {size} at t = {worst.time:.1f} s"
    raise LimitBroken(f"{done}; limit {worst.limit:.3g}{kept}{more}", fix=fix)


_VERB = {
    "position": ("reaches", "rad"),
    "velocity": ("moves at", "rad/s"),
    "acceleration": ("accelerates at", "rad/s^2"),
    "torque": ("needs", "N m"),
    "speed": ("moves at", "m/s"),
}


def floor2(value: float) -> float:
    """Round down to two significant digits, so that the advice itself passes."""
    # Why not a power of ten: of the least numbers that there are, it is none any more.
    digits, _, exponent = f"{value * (1 + 1e-10):.17e}".partition("e")
    return float(f"{digits[:3]}e{exponent}")


def fitting_alpha(path: Motion, limit: Floats, torque: Torque, high: float = 1.0) -> float | None:
    """Return a speed factor of a path at which all torques fit, by bisection; None when even standing is too much.

    Args:
        path: the motion at speed factor 1.
        limit: (n,) [N m or N].
        torque: predicted torques of a motion.
        high: a factor at which they do not fit.
    """

    def fits(alpha: float) -> bool:
        return bool(np.all(np.abs(torque(path.at_speed(alpha))) <= limit * (1 - 1e-3)))

    low = 1e-3
    if not fits(low):
        return None
    for _ in range(tuning.ALPHA_BISECTIONS):
        middle = np.sqrt(low * high)
        low, high = (middle, high) if fits(middle) else (low, middle)
    return float(low)
