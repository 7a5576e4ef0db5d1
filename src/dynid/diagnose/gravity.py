"""Are the torques those of an arm that carries its own weight, or did the driver take gravity out of them?"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dynid.arrays import Floats
from dynid.diagnose import tuning
from dynid.diagnose.fit import middle, smoother
from dynid.drivers.interface import driver_of
from dynid.errors import GravityRemoved
from dynid.log import Log
from dynid.model.regressor import expected_torque
from dynid.robot import Robot
from dynid.signals import tuning as signal_tuning
from dynid.signals.motion import any_moves, per_joint


def check_gravity(log: Log, robot: Robot) -> None:
    """Raise when the torques of a log in N m do not change with the pose as the weight of the arm does.

    Raises:
        GravityRemoved: its fix says how the driver publishes the whole torque.
    """
    if robot.torque.source == "gravity_free" or log.tau_unit == "A":
        return
    if not any_moves(log, robot).any():
        return
    q, tau, besides = _in_motion(log, robot)
    load = expected_torque(q, robot)
    change, known = np.ptp(load, axis=0), robot.prior is not None
    carries = (change > tuning.SIGNIFICANT_LOAD * change.max()) & (change > tuning.LEAST_LOAD_NM)
    if known:
        carries |= change > max(tuning.LIGHTER_JOINT * change.max(), tuning.LIGHTER_LOAD_NM)
    compared = {
        j: seen
        for j in np.flatnonzero(carries).tolist()
        if (seen := _share(load[:, j], tau[:, j], [part[:, j] for part in besides]))
    }
    largest = tuning.WEIGHT_SHARE_KNOWN if known else tuning.WEIGHT_SHARE_UNKNOWN
    # Why the errors: friction and noise of a motion that hardly lifts the arm hide its weight, whatever came out.
    most = [(share + 2.0 * error) / tuning.LEAST_WEIGHT for share, error, _ in compared.values()]
    seen_most = max(compared.values(), default=(np.inf,))[0]
    if seen_most >= largest or min(most) >= largest:
        return
    heaviest = max(compared, key=lambda j: change[j])
    share, _, likeness = compared[heaviest]
    if likeness > tuning.ALIKE:
        raise GravityRemoved(
            f"torques follow the weight at {100 * seen_most:.2g} % of its size: their scale is unknown",
            where=log.topic,
            why="readings of motors come in units of their maker, such as parts of the rated current",
            fix="`torque: {source: motor_current, relative: true}`, or the unit under `driver: {units: ...}`",
        )
    raise GravityRemoved(
        "torques do not follow the pose: gravity was already removed ("
        f"{robot.joint_names[heaviest]} shows {100 * share:.2g} % of its weight's {change[heaviest]:.0f} N m)",
        where=log.topic,
        fix=driver_of(robot).gravity_fix,
    )


def _in_motion(log: Log, robot: Robot) -> tuple[Floats, Floats, list[Floats]]:
    """Return positions, torques and what else makes torque, (N, n) each, at some thousand instants of a motion."""
    raw = middle(log)
    # Why at most: a log so short has fewer samples than the smoothing would take.
    width = round(tuning.SMOOTHING_S * (len(log) - 1) / float(np.ptp(log.t)))
    t, q, tau = map(smoother(max(3, min(width, len(raw[0]) // 3))), raw)

    def slope(x: Floats) -> Floats:
        return np.gradient(x, t, axis=0)

    # Why: a long log says it no better than a thousand samples of it do; the ends have no second derivative.
    some = slice(2, -2, max(1, len(q) // 1000))
    q, tau, v, a = (x[some] for x in (q, tau, slope(q), slope(slope(q))))
    inertia = expected_torque(q, replace(robot, gravity=(0.0, 0.0, 0.0)), v, a)
    return q, tau, [v, np.tanh(v / per_joint(signal_tuning.MOVING_SPEED, robot)), a, inertia]


def _without(values: Floats, besides: list[Floats]) -> Floats:
    """Return what a constant and what else makes torque do not explain of a column, (N,)."""
    rest = np.column_stack([np.ones(len(values)), *besides])
    rest = rest / np.maximum(np.linalg.norm(rest, axis=0), 1e-12)
    return values - rest @ np.linalg.lstsq(rest, values, rcond=1e-9)[0]


def _share(load: Floats, tau: Floats, besides: list[Floats]) -> tuple[float, float, float] | None:
    """Return the measured change with the load over the expected one, its standard error, and how alike both are.

    Likeness is from 0 to 1, whatever the scale of the torque. None where the rest could explain the load as well.

    Args:
        load: expected torque, (N,).
        tau: measured torque, (N,).
        besides: what else makes torque, (N,) each.
    """
    own, seen = _without(load, besides), _without(tau, besides)
    size = float(np.linalg.norm(own))
    if size < tuning.DISTINCT_LOAD * np.linalg.norm(load - load.mean()):
        return None
    share = float(own @ seen) / size**2
    free = max(1.0, len(load) / tuning.SAMPLES_ALIKE - 2 - len(besides))
    error = float(np.linalg.norm(seen - share * own)) / size / np.sqrt(free)
    return abs(share), error, abs(share) * size / max(float(np.linalg.norm(seen)), 1e-300)
