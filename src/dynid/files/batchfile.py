"""The batch file: many robots and logs in one YAML list, each an identification with what is checked after it.

Keys of a job: name, robot, logs, options (long names of ``dynid identify``), validate, max_unexplained, fail_if,
baseline, tolerance. ``defaults`` at the top holds the same keys for all jobs. Paths are relative to the file.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dynid.errors import WrongRobotFile
from dynid.files.robotkeys import TEXT, Keys
from dynid.files.yamlfile import Value, read_yaml
from dynid.text import file_name


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


def _path(value: Value) -> Path:
    return value.file.parent / value.text()


def _paths(value: Value) -> tuple[Path, ...]:
    paths = tuple(value.file.parent / text for text in value.texts())
    if not paths:
        raise value.wrong(" is empty")
    return paths


def _robot(value: Value) -> str:
    """Return a robot's name, or the path of its file, behind which a URDF may name its last link."""
    file = value.text().partition("#")[0].endswith((".yaml", ".yml", ".urdf"))
    return str(_path(value)) if file else value.text()


def _options(value: Value) -> dict[str, str]:
    return {key: item.text() for key, item in (value.entries() or value.mapping(())).items()}


_KEYS: Keys = {
    "name": TEXT,
    "robot": _robot,
    "logs": _paths,
    "options": _options,
    "validate": _paths,
    "max_unexplained": TEXT,
    "fail_if": Value.texts,
    "baseline": _path,
    "tolerance": TEXT,
}


def read_batch(path: Path) -> tuple[Job, ...]:
    """Read a batch file.

    Raises:
        WrongRobotFile: a key is missing or wrong, or two jobs have one name.
    """
    try:
        top = read_yaml(path).mapping(("defaults", "jobs"), required=("jobs",))
        shared = top["defaults"].read(_KEYS) if "defaults" in top else {}
        jobs = tuple(_job(value, {**shared, **value.read(_KEYS)}) for value in top["jobs"].items())
        if not jobs:
            raise top["jobs"].wrong(" is empty")
        count = Counter(map(folder_name, jobs))
        for job in jobs:
            if count[folder := folder_name(job)] > 1:
                raise top["jobs"].wrong(
                    f": two jobs would write to the folder '{folder}' ('{job.name}'); give each a name"
                )
    except WrongRobotFile as error:
        error.why = "the job could not be run"
        error.fix = "`dynid explain ci-regression` shows a batch file"
        raise
    return jobs


def _job(value: Value, given: dict[str, Any]) -> Job:
    for key in ("robot", "logs"):
        if key not in given:
            raise value.wrong(f" lacks the key '{key}'")
    name = f"{Path(given['robot']).stem}-{given['logs'][0].stem}"
    return Job(**{"name": name, **given})


def folder_name(job: Job) -> str:
    """Return the name of a job's results folder."""
    return file_name(job.name).replace(" ", "_")
