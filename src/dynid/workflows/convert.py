"""A recording as .npz or .csv, with or without the robot file of its arm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dynid.errors import Finding, WrongMessageType, located
from dynid.files.convert import write_log
from dynid.files.inspect import inspect
from dynid.loading import read_log
from dynid.log import Log
from dynid.options import LogOptions
from dynid.robot import Robot
from dynid.workflows.options import ConvertOptions


@dataclass(frozen=True)
class Converted:
    """What was written.

    Attributes:
        path: the new file.
        log: its numbers.
        findings: what was noticed while reading.
    """

    path: Path
    log: Log
    findings: tuple[Finding, ...]

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer says."""
        return {
            "schema": "dynid/convert/1",
            "wrote": [self.path],
            "samples": len(self.log),
            "duration_s": self.log.duration,
            "joints": list(self.log.names),
        }


def convert(
    path: Path | str,
    target: Path | str,
    robot: Robot | None = None,
    options: ConvertOptions = ConvertOptions(),
) -> Converted:
    """Write a recording in the format of another file's suffix; every number stays as it was recorded.

    Args:
        path: the recording.
        target: the file to write: .npz or .csv.
        robot: the arm, whose file says which topic and columns; None to take what is there.
        options: which joint states.

    Raises:
        DynidError: the recording cannot be read, or the file cannot be written.
    """
    if robot is not None:
        log = read_log(path, robot, LogOptions(topic=options.topic, rate=options.rate))
        return Converted(write_log(log, Path(target)), log, log.findings)
    with located(str(path)):
        contents = inspect(Path(path), options.rate)
        logs = [log for log in contents.logs if options.topic in (None, log.topic)]
        if not logs:
            have = ", ".join([*map(str, contents.topics.values())] or contents.columns) or "nothing"
            what = f"{path} has no topic that dynid can read as joint states; it has {have}"
            raise WrongMessageType(what, fix="give --robot")
    log = max(logs, key=len)
    return Converted(write_log(log, Path(target)), log, contents.findings)
