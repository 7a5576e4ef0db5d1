"""A driver's columns -> DH quantities of one robot: by name, in SI units, with sign, offset and coupling.

Also what keeps some of a log's samples.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from difflib import get_close_matches
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats
from dynid.drivers.interface import driver_of
from dynid.errors import JointCountDiffers, JointNamesDiffer, LogLayout
from dynid.log import COLUMNS, Log
from dynid.robot import USUAL_UNITS, Robot
from dynid.signals import tuning
from dynid.text import yaml_word


def matching_columns(log: Log, robot: Robot) -> list[int]:
    """Return the column of each joint of the robot.

    Raises:
        JointCountDiffers: the log has fewer columns than the robot has joints.
        JointNamesDiffer: names of the robot file are not in the log.
    """
    if not log.names and log.n == robot.n:
        return list(range(robot.n))
    for names in (robot.log_names, robot.joint_names):
        if set(names) <= set(log.names):
            return [log.names.index(name) for name in names]
    raise _differ(log, robot)


def _differ(log: Log, robot: Robot) -> JointCountDiffers | JointNamesDiffer:
    driver = driver_of(robot)
    joints = [name for name in log.names if not driver.ignores(name)]
    if len(joints) < robot.n:
        count = f"{len(joints)} joints ({_short(joints)})" if log.names else f"{log.n} joints"
        text = f"{log.name} has {count}, {robot.name} has {robot.n}"
        return JointCountDiffers(text, where=log.name)
    missing = [name for name in robot.log_names if name not in log.names]
    lost = f"; missing: {_short(missing)}" if len(missing) < robot.n else ""
    return JointNamesDiffer(
        f"{log.name} names {_short(joints)}; the robot file expects {_short(robot.log_names)}{lost}",
        where=log.name,
        fix=f"under `driver:` in {robot.editable}: joint_names: {_in_chain_order(joints, robot)}",
    )


def _in_chain_order(names: Sequence[str], robot: Robot) -> str:
    """Return the list to paste: by number or likeness in chain order, else with places to fill in."""
    alike = [get_close_matches(own, names, 1, tuning.ALIKE_NAMES) for own in robot.joint_names]
    numbered = all(map(str.isdecimal, names))
    order = sorted(names, key=int) if numbered else [*chain.from_iterable(alike)]
    if len(set(order)) == robot.n:
        return f"[{', '.join(map(yaml_word, order))}]"
    places = ", ".join(f"<the column of {name}>" for name in robot.joint_names)
    return f"[{places}]   (the log's own order need not be that of the chain)"


def _short(names: Sequence[str]) -> str:
    return ", ".join(names[:8]) + ", ..." * (len(names) > 8)


def units(log: Log, robot: Robot) -> dict[str, str]:
    """Return the units of the log's columns: its own, else the robot file's; SI for a log in DH quantities."""
    found = (USUAL_UNITS if log.dh else robot.columns.units) | log.units
    if log.tau_unit == "A" and found["effort"] not in ("A", "mA"):
        found["effort"] = "A"
    return found


def in_amperes(log: Log, robot: Robot) -> bool:
    """Return whether the effort column is a motor current."""
    if log.dh:
        return log.tau_unit == "A"
    return units(log, robot)["effort"] in ("A", "mA") or robot.torque.source == "motor_current"


def robot_columns(log: Log, robot: Robot) -> Log:
    """Return the log with the robot's columns only, in chain order, still in the driver's quantities."""
    columns = matching_columns(log, robot)
    named = tuple(log.names[k] for k in columns if log.names)
    # Why not always: a long log is not copied for nothing.
    if columns != list(range(log.n)):
        log = log.with_columns({key: x[:, columns] for key, x in log.columns.items()}, names=())
    extra = log.extra if log.dh else {**log.extra, "driver_columns": named}
    return replace(log, names=robot.joint_names, extra=extra)


def in_si(log: Log, robot: Robot) -> Log:
    """Return a log of the robot's columns in SI units (a current stays in A)."""
    factors = robot.unit_factors(units(log, robot))
    return log.with_columns(
        {key: _mapped(x, factors[COLUMNS[key]]) for key, x in log.columns.items() if COLUMNS[key]},
        tau_unit="A" if in_amperes(log, robot) else "Nm",
    )


def _mapped(x: Floats, factor: Floats, offset: Floats | float = 0.0) -> Floats:
    """Return factor x + offset; x itself where that is nothing: a long log is not copied for it."""
    return x if np.all(factor == 1.0) and np.all(offset == 0.0) else x * factor + offset


def to_dh(log: Log, robot: Robot) -> Log:
    """Return a log in SI units as DH quantities: gain, coupling, then sign and offset.

    q_motor = M q and tau_joint = M^T tau_motor undo the gears; q_dh = sign q + offset and
    tau_dh = sign torque_sign tau follow.

    Raises:
        LogLayout: motor-side numbers, but the robot file has no coupling.
    """
    if log.dh:
        return log
    columns = {key: x for key, x in log.columns.items() if COLUMNS[key]}
    unit, torque = log.tau_unit, robot.torque
    if unit == "A" and torque.complete:
        columns["tau"] = log.tau * np.array(torque.gain, dtype=float)
        # Of relative gains the size of a torque is not known.
        unit = "A" if torque.relative else "Nm"
    if robot.coupling is not None:
        matrix = np.array(robot.coupling.matrix)
        back = np.linalg.inv(matrix).T
        columns = {
            key: x @ (matrix if COLUMNS[key] == "effort" else back) for key, x in columns.items()
        }
    elif log.motor_side:
        raise LogLayout(
            f"{log.name} holds motor positions and torques, but the robot file has no gear ratios",
            where=log.name,
            fix="add `coupling: {reduction: [...]}` to the robot file",
        )
    joint_map = robot.columns.map
    sign = np.array(joint_map.sign)
    factors = {"position": sign, "velocity": sign, "effort": sign * joint_map.torque_signs}
    offsets = {"position": np.array(joint_map.offset)}
    columns = {
        key: _mapped(x, factors[COLUMNS[key]], offsets.get(COLUMNS[key], 0.0))
        for key, x in columns.items()
    }
    return log.with_columns(columns, tau_unit=unit, units={}, motor_side=False, dh=True)


def take_samples(log: Log, keep: NDArray[np.intp] | slice) -> Log:
    """Return the log with some of its rows, in the given order."""
    return log.with_columns({key: x.T[:, keep].T for key, x in log.columns.items()}, t=log.t[keep])
