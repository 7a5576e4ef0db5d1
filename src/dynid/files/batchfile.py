"""The batch file: many robots and logs in one YAML list, each an identification with what is checked after it.

Keys of a job: name, robot, logs, options (long names of ``dynid identify``), validate, max_unexplained, fail_if,
baseline, tolerance. ``defaults`` at the top holds the same keys for all jobs. Paths are relative to the file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dynid.errors import WrongRobotFile
from dynid.files.yamlfile import Value, read_yaml

_JOB = (
    "name",
    "robot",
    "logs",
    "options",
    "validate",
    "max_unexplained",
    "fail_if",
    "baseline",
    "tolerance",
)


@dataclass(frozen=True)
class Job:
    """One identification and what is checked after it.

    Attributes:
        name: name of the job and of its results folder.
        robot: name or path of the robot file.
        logs: recordings to identify from.
        options: further options of ``dynid identify`` by long name.
        validate: recordings to validate on.
        max_unexplained: limit of the relative error there, such as ``"5%"``; "" for none.
        fail_if: limits of ``dynid identify --fail-if``.
        baseline: result to compare with, None for none.
        tolerance: largest change against it; "" for the test against noise.
    """

    name: str
    robot: str
    logs: tuple[Path, ...]
    options: dict[str, str] = field(default_factory=dict)
    validate: tuple[Path, ...] = ()
    max_unexplained: str = ""
    fail_if: tuple[str, ...] = ()
    baseline: Path | None = None
    tolerance: str = ""


def read_batch(path: Path) -> tuple[Job, ...]:
    """Read a batch file.

    Raises:
        WrongRobotFile: a key is missing or wrong, or two jobs have one name.
    """
    try:
        top = read_yaml(path).mapping(("defaults", "jobs"), required=("jobs",))
        shared = top["defaults"].mapping(_JOB) if "defaults" in top else {}
        jobs = tuple(_job(value, shared, path.parent) for value in top["jobs"].items())
        if not jobs:
            raise WrongRobotFile(f"{top['jobs'].where}: jobs is empty", where=top["jobs"].where)
        _unique(jobs, top["jobs"])
    except WrongRobotFile as error:
        error.why, error.fix = (
            "the job could not be run",
            "`dynid explain ci-regression` shows a batch file",
        )
        raise
    return jobs


def _job(value: Value, shared: dict[str, Value], folder: Path) -> Job:
    keys = {**shared, **value.mapping(_JOB)}
    for key in ("robot", "logs"):
        if key not in keys:
            raise WrongRobotFile(
                f"{value.where}: {value.path} lacks the key '{key}'", where=value.where
            )
    logs = _paths(keys["logs"], folder)
    robot = keys["robot"].text()
    robot = str(folder / robot) if robot.endswith((".yaml", ".yml")) else robot
    text: dict[str, Any] = {
        key: keys[key].text() for key in ("max_unexplained", "tolerance") if key in keys
    }
    return Job(
        name=keys["name"].text() if "name" in keys else f"{Path(robot).stem}-{Path(logs[0]).stem}",
        robot=robot,
        logs=logs,
        options=_options(keys["options"]) if "options" in keys else {},
        validate=_paths(keys["validate"], folder) if "validate" in keys else (),
        fail_if=_list(keys["fail_if"], Value.text) if "fail_if" in keys else (),
        baseline=folder / keys["baseline"].text() if "baseline" in keys else None,
        **text,
    )


def _list(value: Value, read: Callable[[Value], str]) -> tuple[str, ...]:
    return tuple(read(item) for item in value.items()) if value.is_list else (read(value),)


def _paths(value: Value, folder: Path) -> tuple[Path, ...]:
    found = tuple(folder / text for text in _list(value, Value.text))
    if not found:
        raise WrongRobotFile(f"{value.where}: {value.path} is empty", where=value.where)
    return found


def _options(value: Value) -> dict[str, str]:
    keys = [str(key.value) for key, _ in value.node.value] if value.is_mapping else []
    return {key: item.text() for key, item in value.mapping(keys).items()}


def _unique(jobs: tuple[Job, ...], value: Value) -> None:
    folders = [folder_name(job) for job in jobs]
    count = Counter(folders)
    for job, folder in zip(jobs, folders, strict=True):
        if count[folder] > 1:
            what = f"{value.where}: two jobs would write to the folder '{folder}' ('{job.name}'); give each a name"
            raise WrongRobotFile(what, where=value.where)


def folder_name(job: Job) -> str:
    """Return the name of a job's results folder."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in job.name).strip(".") or "job"
