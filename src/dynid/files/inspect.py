"""What a recording holds, without a robot file: topics, types, names, rates, likely units, and what to paste."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from dynid.drivers.interface import JOINT_STATE
from dynid.errors import Finding, LogLayout
from dynid.files import logs, tables, tuning
from dynid.files.bags import read_bag
from dynid.files.columnwords import (
    in_amperes,
    joints_of,
    snippet,
    suggested,
    template,
    usual_joints,
)
from dynid.files.messages import Topic
from dynid.files.texttable import text_table
from dynid.log import Log
from dynid.text import yaml_word
from dynid.units import FACTORS


def has_torques(log: Log) -> bool:
    """Return whether any effort of a recording is a number."""
    return bool(np.isfinite(log.tau).any())


def likely_units(log: Log) -> dict[str, str]:
    """Return the units of ``position`` and ``effort`` that a recording has by what it says, else by its numbers."""
    span = np.fmax.reduce(np.fmax.reduce(log.q) - np.fmin.reduce(log.q), initial=0.0)
    most = np.fmax.reduce(np.abs(log.tau), axis=None, initial=0.0)
    return {
        "position": "deg" if span > tuning.MOST_RADIANS else "rad",
        "effort": log.tau_unit or ("mNm" if most > tuning.MOST_TORQUE_NM else "Nm"),
    } | {key: unit for key, unit in log.units.items() if key != "velocity"}


@dataclass(frozen=True)
class Inspected:
    """What a recording holds.

    Attributes:
        logs: joint states that could be read, as they were recorded: one per topic and set of joints.
        findings: what was noticed.
        topics: of a bag, by name.
        columns: of a table, in their order.
        patterns: columns for ``driver: columns:``, {} where the usual names are used; where the names do not tell,
            words in capitals stand for what a person has to fill in.
    """

    logs: tuple[Log, ...]
    findings: tuple[Finding, ...]
    topics: dict[str, Topic] = field(default_factory=dict)
    columns: tuple[str, ...] = ()
    patterns: dict[str, str] = field(default_factory=dict)

    def snippet(self) -> str:
        """Return the part of a robot file that reads this recording, "" if it cannot be recognised."""
        lines = ["driver:", "  kind: generic"]
        columns = [f"  {snippet(self.patterns)}"] if self.patterns else []
        if not self.logs:
            return "\n".join([*lines, *columns]) if columns else ""
        # Why torques first: commands are published as joint states too, and more often.
        log = max(self.logs, key=lambda each: (has_torques(each), len(each)))
        if log.topic:
            lines.append(f"  topic: {yaml_word(log.topic)}")
        numbered = "{i}" in self.patterns.get("position", "") and "name" not in self.patterns
        if log.names and not numbered:
            names = ", ".join(map(yaml_word, log.names))
            lines.append(f"  joint_names: [{names}]    # put them in the order base to tip")
        units = likely_units(log)
        if log.qd is not None and np.isfinite(log.qd).any():
            units["velocity"] = f"{units['position']}/s"
        inside = ", ".join(f"{key}: {units[key]}" for key in FACTORS if key in units)
        return "\n".join([*lines, *columns, f"  units: {{{inside}}}"])


def inspect(path: Path, rate: float | None = None) -> Inspected:
    """Return what a recording holds, without knowing its arm.

    Args:
        path: any recording.
        rate: sample rate of tables without time [Hz].

    Raises:
        DynidError: it is no recording, or nothing of it can be read.
    """
    kind = logs.format_of(path)
    if kind == "table":
        return _table(path, rate)
    if kind != "bag":
        log = logs.read_npz_log(path) if kind == "npz" else tables.read_folder(path, rate)
        return Inspected((log,), log.findings)
    topics, every, findings = read_bag(path)
    found = tuple(log for log in every if log.n)
    if not found:
        text = f"no topic of {path.name} holds joint states ({JOINT_STATE})"
        findings = (*findings, Finding("W333", "warning", text))
    return Inspected(found, findings, topics)


def _table(path: Path, rate: float | None) -> Inspected:
    columns = tuple(text_table(path).names)
    usual = usual_joints(columns)
    patterns = {} if usual else suggested(columns)
    joints = joints_of(patterns["position"], columns) if patterns else ()
    try:
        log = tables.read_table(path, joints, patterns, rate)
    except LogLayout:
        if not columns or usual or patterns:
            raise
        text = f"{path.name}: names of {len(columns)} columns do not say which are positions and torques"
        unknown = Finding("W330", "warning", text, {"columns": columns})
        return Inspected(logs=(), findings=(unknown,), columns=columns, patterns=template(columns))
    if patterns and in_amperes(patterns["effort"]):
        log = replace(log, tau_unit="A")
    return Inspected(logs=(log,), findings=log.findings, columns=columns, patterns=patterns)
