"""What a result depends on, as texts for its header: with equal inputs it need not be made again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dynid.disk import sha256
from dynid.errors import WrongUsage
from dynid.loading import read_log
from dynid.robot import Robot
from dynid.workflows.options import IdentifyOptions
from dynid.workflows.parameters import stored_key

#: Options of reading and filtering: without logs they are those of the stored observations.
READING = ("cutoff", "velocity", "exclude", "delay", "topic", "rate", "sort_time")


def log_inputs(robot: Robot, logs: Sequence[Path]) -> dict[str, str]:
    """Return the hashes of robot and logs.

    Raises:
        LogNotFound: a log is not there.
    """
    for log in logs:
        if not log.exists():
            read_log(log, robot)  # ends with the message that a missing log gets
    return {
        "robot": robot.model_key,
        **{f"log {k}": sha256(log) for k, log in enumerate(logs, start=1)},
    }


def identify_inputs(
    robot: Robot,
    folder: Path,
    logs: Sequence[Path],
    options: IdentifyOptions,
    files: dict[str, Any],
    load_mass: float | None = None,
) -> dict[str, str]:
    """Return what an identification depends on; without logs, on the observations that are in its folder.

    Args:
        robot: the arm.
        folder: of the result.
        logs: recordings; () for the stored observations.
        options: how it is identified.
        files: further inputs by name; those that are paths of files are hashed.
        load_mass: mass of a known load [kg].

    Raises:
        WrongUsage: the stored observations were read with other options.
    """
    texts = {key: value for key, value in options.texts().items() if key != "prior"}
    texts |= {"load_mass": repr(load_mass)} if load_mass else {}
    hashed = {
        key: sha256(path) for key, path in files.items() if isinstance(path, Path) and path.exists()
    }
    if logs:
        return log_inputs(robot, logs) | texts | hashed
    path = folder / "fullnumericregressor.npz"
    inputs = dict(stored_key(path, robot).get("inputs", {}))
    default = IdentifyOptions().texts()
    for name in READING:
        text = texts.get(name)
        if text not in (inputs.get(name), default.get(name)):
            raise WrongUsage(
                f"{name} is {inputs.get(name) or 'not set'} in {path}, not {text}",
                why="without logs, the stack that dynid parameters wrote is used as it is",
                fix=f"name the logs: dynid identify {robot.word} LOG --{name.replace('_', '-')} {text}",
            )
    return inputs | {key: value for key, value in texts.items() if key not in READING} | hashed


def of_observations(inputs: dict[str, str]) -> dict[str, str]:
    """Return those inputs that stacked logs depend on."""
    return {
        key: value
        for key, value in inputs.items()
        if key in ("robot", *READING) or key.startswith("log ")
    }
