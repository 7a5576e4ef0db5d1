"""Gains of the drives from logs of motor currents, and answers in amperes where nothing tells the gains."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from dynid.arguments import public
from dynid.disk import write_text
from dynid.errors import WrongUsage
from dynid.estimation.drive_gains import Gains, find_gains, known_load
from dynid.estimation.stack import stack_logs
from dynid.files.robotfile import text_of
from dynid.loading import (
    LogLike,
    LogsLike,
    RobotLike,
    as_log,
    as_logs,
    as_robot,
    checked_log,
    condition_logs,
    load_robot,
)
from dynid.log import Log
from dynid.options import LogOptions
from dynid.progress import Progress
from dynid.robot import Robot
from dynid.signals.columns import in_amperes as holds_currents
from dynid.text import printable, yaml_text
from dynid.workflows.model import base_model


def needs_gains(robot: Robot, log: Log) -> bool:
    """Return whether a log as read holds motor currents whose gains are not all known."""
    if robot.torque.complete:
        return False
    return robot.torque.source == "motor_current" or holds_currents(log, robot)


@public
def find_drive_gains(
    robot: RobotLike,
    logs: LogsLike,
    options: LogOptions = LogOptions(),
    *,
    loaded: LogLike | None = None,
    load_mass: float | None = None,
    folder: str | Path | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Gains:
    """Find the gains of all drives [N m per A] from logs of motor currents.

    Args:
        robot: the arm, its name, or the path of its file; gains that it knows stay as they are.
        logs: logs of currents, or their paths.
        options: how they are checked and filtered.
        loaded: a further log with a body of known mass on the last link.
        load_mass: the mass of that body [kg]; None for the tool of the robot file.
        folder: where the model is kept.
        progress: reports how far the work is.
        changes: single options by name, such as ``cutoff=8``; see ``dynid.LogOptions``.

    Raises:
        WrongUsage: the gains cannot be found for this arm, the load is not known, or an argument is something else
            than what is wanted (E101).

    Example:
        dynid.find_drive_gains("my_arm.yaml", "empty.csv", loaded="loaded.csv", load_mass=2.0)
    """
    robot = as_robot(robot)
    given = as_logs(logs, robot, options)
    if loaded is not None:
        given.append(as_log(loaded, robot, options, "loaded"))
    if robot.coupling is not None or robot.identified_links != tuple(range(1, robot.n + 1)):
        raise WrongUsage(
            "gains cannot be found with coupled motors or with some links only",
            fix="give them in the robot file: `torque: {source: motor_current, gain: [...]}`",
        )
    robot = replace(robot, torque=replace(robot.torque, source="motor_current"))
    base = base_model(robot, folder)
    known = np.array(robot.torque.gain or (None,) * robot.n, dtype=float)
    checked = [checked_log(log, robot, options) for log in given]
    conditioned, load = condition_logs(checked, base.model, options), None
    if loaded is not None:
        load = known_load(base, stack_logs([conditioned.pop()], base), load_mass)
    return find_gains(stack_logs(conditioned, base), known, load, robot.torque.scale_error)


def write_robot(folder: Path, robot: Robot, gains: Gains) -> tuple[Path, Robot]:
    """Write a copy of the robot file with the gains, and return its path and the robot in it."""
    document = yaml.safe_load(text_of(robot, with_prior=False))
    # Why: what a load weighs with these gains is as uncertain as they are.
    share = min(0.99, float(np.sqrt(np.mean((gains.std_error / gains.gain) ** 2))))
    document["torque"] = {
        "source": "motor_current",
        "gain": [float(f"{value:.9g}") for value in gains.gain],
        **({"relative": True} if gains.relative else {"gain_error": float(f"{share:.2g}")}),
    }
    path = folder / f"{robot.slug}.yaml"
    what = "ratios of the gains; their size is unknown" if gains.relative else "gains"
    head = f"Made by dynid identify: {printable(robot.path.name if robot.path else robot.name)} with {what}."
    write_text(path, yaml_text(document, head, width=140, default_flow_style=False))
    return path, replace(load_robot(path), prior=robot.prior, known=robot.known)


def gain_facts(robot: Robot, gains: Gains) -> dict[str, Any]:
    """Return the gains for JSON."""
    pairs = zip(robot.joint_names, gains.gain.tolist(), gains.std_error.tolist(), strict=True)
    rows = [
        {"joint": joint, "gain_nm_per_a": gain, "std_error": error} for joint, gain, error in pairs
    ]
    return {"gains": rows, "gains_relative": gains.relative}


def in_amperes(facts: Any, robot: Robot) -> Any:  # noqa: ANN401
    """Return a JSON answer with torques in amperes where only ratios of the gains are known: ``_nm`` becomes ``_a``."""
    if not robot.torque.relative or robot.torque.gain is None:
        return facts
    scale = dict(zip(robot.joint_names, robot.torque.gain, strict=True))

    def renamed(value: Any, gain: float) -> Any:  # noqa: ANN401
        if isinstance(value, (list, tuple)):
            return [renamed(inner, gain) for inner in value]
        if not isinstance(value, dict):
            return value
        gain = scale.get(str(value.get("joint")), gain) or 1.0
        facts = {}
        for key, inner in value.items():
            torque = key.endswith("_nm")
            if key == "unit" and isinstance(inner, str) and "std_error" in value:
                inner = inner.replace("N m", "A") if "N m" in inner else f"{inner} A/(N m)"
            in_amperes = torque and isinstance(inner, float)
            facts[key[:-3] + "_a" if torque else key] = (
                inner / gain if in_amperes else renamed(inner, gain)
            )
        return facts

    return renamed(facts, 1.0)
