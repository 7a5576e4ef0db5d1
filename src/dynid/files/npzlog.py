"""Reads the .npz log, which ``Log.save`` writes: arrays ``t, q, [qd], tau, [q_ref]`` and one JSON header.

Also plain .npz files of other people: without a header the order of the columns is assumed to be the robot's (finding
W320). ``q_motor`` and ``tau_motor`` in the place of ``q`` and ``tau`` say that the numbers are on the motor side.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dynid import limits
from dynid.errors import LogLayout, LogNotFound, NewerSchema
from dynid.log import SCHEMA, Log
from dynid.npz import HEADER, parse_json, read_npz
from dynid.text import whole_number
from dynid.version import __version__


def read_npz_log(path: Path) -> Log:
    """Read an .npz log; the columns of a plain file have no names.

    Raises:
        LogNotFound: not an .npz file, or a dynid result of another kind.
        NewerSchema: written by a newer dynid.
        TooLarge: it has more samples or columns than the limit.
        LogLayout: arrays are missing or their sizes differ.
    """
    try:
        arrays = read_npz(path)
        header: dict[str, Any] = dict(parse_json(str(arrays.pop(HEADER)), path)) if HEADER in arrays else {}
        units = {str(key): str(unit) for key, unit in dict(header.get("units") or {}).items()}
        names = tuple(str(name) for name in header.get("joint_names") or ())
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise LogNotFound(f"{path.name} is not an .npz log, or is damaged: {error}", where=str(path)) from error
    if header:
        _check_schema(path, header)
    motor = "q_motor" in arrays
    position, torque = ("q_motor", "tau_motor") if motor else ("q", "tau")
    for key in ("t", position, torque):
        if key not in arrays:
            have = ", ".join(sorted(arrays)) or "no arrays"
            raise LogLayout(f"{path.name} has no array '{key}'; it has {have}", where=str(path))
    log = Log(
        t=arrays["t"],
        q=arrays[position],
        tau=arrays[torque],
        names=names,
        qd=arrays.get("qd"),
        source=path,
        topic=str(header.get("topic", "")),
        tau_unit="" if "effort" not in units else "A" if units["effort"] in ("A", "mA") else "Nm",
        units=units,
        motor_side=motor or bool(header.get("motor_side", False)),
        dh=bool(header.get("dh", False)),
        extra={"q_ref": arrays["q_ref"]} if "q_ref" in arrays else {},
    )
    limits.check("samples", len(log), path)
    limits.check("columns", log.n, path)
    limits.check("name_length", max(map(len, names), default=0), path)
    if not log.q.size:
        raise LogLayout(f"{path.name}: array 'q' holds no numbers", where=str(path))
    return log


def _check_schema(path: Path, header: dict[str, Any]) -> None:
    schema = str(header.get("schema", ""))
    kind, _, number = schema.rpartition("/")
    if kind == "dynid/log" and whole_number(number) > 1:
        writer = header.get("dynid", "?")
        raise NewerSchema(
            f"{path.name} was written by dynid {writer} (schema {number}); this is {__version__}; upgrade",
            where=str(path),
        )
    if schema != SCHEMA:
        raise LogNotFound(f"{path.name} holds {schema or 'something else'}, not a log", where=str(path))
