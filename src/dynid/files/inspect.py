"""What a recording holds, without a robot file: topics, types, names, rates, likely units, and what to paste."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.drivers.interface import JOINT_STATE
from dynid.errors import Finding, LogLayout
from dynid.files import logs, tables, tuning
from dynid.files.bags import list_topics, read_topics
from dynid.files.columnwords import (
    in_amperes,
    members,
    numbered,
    snippet,
    suggested,
    template,
    usual_joints,
)
from dynid.files.messages import KINOVA_TYPES, MULTI_ARRAY, Topic
from dynid.files.texttable import text_table
from dynid.log import Log
from dynid.text import yaml_word


@dataclass(frozen=True)
class Joints:
    """Joint states of one topic, or of a file that has only one.

    Attributes:
        topic: topic, "" for tables and arrays.
        log: the numbers as they were recorded.
    """

    topic: str
    log: Log

    @property
    def has_torques(self) -> bool:
        """Whether any effort is a number."""
        return bool(np.isfinite(self.log.tau).any())

    @property
    def units(self) -> dict[str, str]:
        """Likely units of ``position`` and ``effort``."""
        q, tau = self.log.q, self.log.tau
        span = float(np.nanmax(np.ptp(q, axis=0))) if np.isfinite(q).any() else 0.0
        most = float(np.nanmax(np.abs(tau))) if np.isfinite(tau).any() else 0.0
        return {
            "position": "deg" if span > tuning.MOST_RADIANS else "rad",
            "effort": "mNm" if most > tuning.MOST_TORQUE_NM else self.log.tau_unit or "Nm",
        } | {key: unit for key, unit in self.log.units.items() if key != "velocity"}


@dataclass(frozen=True)
class Inspected:
    """What a recording holds.

    Attributes:
        path: the file or folder.
        topics: of a bag, by name.
        columns: of a table, in their order.
        joints: joint states that could be read.
        patterns: columns for ``driver: columns:``, {} where the usual names are used; where the names do not tell,
            words in capitals stand for what a person has to fill in.
        findings: what was noticed.
    """

    path: Path
    topics: dict[str, Topic]
    columns: tuple[str, ...]
    joints: tuple[Joints, ...]
    patterns: dict[str, str]
    findings: tuple[Finding, ...]

    def snippet(self) -> str:
        """Return the part of a robot file that reads this recording, "" if it cannot be recognised."""
        if not self.joints:
            return f"driver:\n  kind: generic\n  {snippet(self.patterns)}" if self.patterns else ""
        # Why torques first: commands are published as joint states too, and more often.
        chosen = max(self.joints, key=lambda each: (each.has_torques, len(each.log)))
        lines = ["driver:", "  kind: generic"]
        if chosen.topic:
            lines.append(f"  topic: {yaml_word(chosen.topic)}")
        arrays = [topic.name for topic in self.topics.values() if topic.type == MULTI_ARRAY]
        if chosen.topic and not chosen.has_torques and arrays:
            lines.append(f"  effort_topic: {yaml_word(arrays[0])}")
        position = self.patterns.get("position", "{name}")
        if chosen.log.names and ("name" in self.patterns or "{name}" in position):
            names = ", ".join(map(yaml_word, chosen.log.names))
            lines.append(f"  joint_names: [{names}]    # put them in the order base to tip")
        units = chosen.units
        if self.patterns:
            lines.append(f"  {snippet(self.patterns)}")
            if "effort" not in chosen.log.units and in_amperes(self.patterns["effort"]):
                units["effort"] = "A"
        if chosen.log.qd is not None and np.isfinite(chosen.log.qd).any():
            units["velocity"] = f"{units['position']}/s"
        order = ("position", "velocity", "effort")
        inside = ", ".join(f"{key}: {units[key]}" for key in order if key in units)
        lines.append(f"  units: {{{inside}}}")
        return "\n".join(lines)


def inspect(path: Path, rate: float | None = None) -> Inspected:
    """Return what a recording holds, without knowing its arm.

    Args:
        path: any recording.
        rate: sample rate of tables without time [Hz].

    Raises:
        DynidError: it is no recording, or nothing of it can be read.
    """
    kind = logs.format_of(path)
    if kind == "bag":
        topics = list_topics(path)
        filled = [topic for topic in topics.values() if topic.count]
        wanted = [topic.name for topic in filled if topic.type == JOINT_STATE]
        groups, findings = read_topics(path, wanted) if wanted else ({}, ())
        joints = tuple(
            Joints(name, log) for name in wanted for log in groups.get(name, []) if log.n
        )
        # Why not those of Kinova: they are read where the robot file names their driver.
        if not joints and not any(topic.type in KINOVA_TYPES for topic in filled):
            text = f"no topic of {path.name} holds joint states ({JOINT_STATE})"
            findings = (*findings, Finding("W333", "warning", text))
        return Inspected(path, topics, (), joints, {}, findings)
    if kind == "table":
        return _table(path, rate)
    log = logs.read_npz_log(path) if kind == "npz" else tables.read_folder(path, rate)
    return Inspected(path, {}, (), (Joints("", log),), {}, log.findings)


def _table(path: Path, rate: float | None) -> Inspected:
    columns = text_table(path).names
    patterns = {} if usual_joints(columns) else suggested(columns)
    position = patterns.get("position", "")
    names = members(position, columns) if "{name}" in position else []
    if "{i}" in position:
        names = [f"joint_{k + 1}" for k in range(len(numbered(position, columns)))]
    try:
        log = tables.read_table(path, names, patterns, rate)
    except LogLayout:
        if not columns or usual_joints(columns) or patterns:
            raise
        text = (
            f"{path.name}: which of {len(columns)} columns are positions and torques does not "
            f"follow from their names"
        )
        unknown = Finding("W330", "warning", text, {"columns": list(columns)})
        return Inspected(path, {}, columns, (), template(columns), (unknown,))
    return Inspected(path, {}, columns, (Joints("", log),), patterns, log.findings)
