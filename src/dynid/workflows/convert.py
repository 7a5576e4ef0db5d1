"""A recording as .npz or .csv, with or without the robot file of its arm."""

from __future__ import annotations

from pathlib import Path

from dynid.answer import Answer
from dynid.errors import WrongMessageType, located
from dynid.files.convert import write_log
from dynid.files.inspect import inspect
from dynid.loading import read_log
from dynid.options import LogOptions
from dynid.robot import Robot
from dynid.workflows.options import ConvertOptions


def convert(
    path: Path, target: Path, robot: Robot | None = None, options: ConvertOptions = ConvertOptions()
) -> Answer:
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
        findings = log.findings
    else:
        with located(str(path)):
            contents = inspect(path, options.rate)
            logs = [log for log in contents.logs if options.topic in (None, log.topic)]
            if not logs:
                there = [*map(str, contents.topics.values())] or contents.columns or ["nothing"]
                what = f"{path} has no topic that dynid can read as joint states; it has {', '.join(there)}"
                raise WrongMessageType(what, fix="give --robot")
        log, findings = max(logs, key=len), contents.findings
    facts = {
        "schema": "dynid/convert/1",
        "samples": len(log),
        "duration_s": log.duration,
        "joints": list(log.names),
    }
    size = f"{len(log)} samples, {log.duration:.1f} s, {log.n} joints"
    return Answer(facts, parts=(*findings, ("log", size)), wrote=[write_log(log, target)])
