"""fullnumericregressor.npz: the stacked observations before anything is identified.

It holds the conditioned motion that rows are made from and one triangular factor of [W tau] per joint: all that
least squares needs, and small however long the log was. The stacked matrix itself is never stored.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.stack import Stack
from dynid.files.artifact import packed, read_artifact, reading, unpacked
from dynid.npz import write_artifact
from dynid.signals.conditioned_log import ConditionedLog

SCHEMA = "dynid/fullnumericregressor/1"


def save(path: Path, stack: Stack, header: dict[str, Any]) -> None:
    """Write fullnumericregressor.npz."""
    arrays = {"R": stack.factors, "rows": stack.counts}
    facts = {
        **header,
        "base": list(stack.names),
        "joints": list(stack.joints),
        "conditioned": packed(stack.logs, arrays, "log"),
    }
    write_artifact(path, SCHEMA, facts, arrays)


def load(path: Path) -> tuple[tuple[ConditionedLog, ...], dict[str, Any]]:
    """Read fullnumericregressor.npz: the conditioned logs and the header."""
    artifact = read_artifact(path, SCHEMA)
    header = dict(artifact.header)
    with reading(path):
        kind, stored = tuple[ConditionedLog, ...], header.pop("conditioned")
        logs: tuple[ConditionedLog, ...] = unpacked(kind, stored, artifact.arrays)
        times = [segment.t for log in logs for segment in log.segments]
        if not times or not all(np.all(np.diff(t) > 0) for t in times):
            raise ValueError("it has no logs whose time increases")
    return logs, header


def load_factors(path: Path) -> tuple[Floats, dict[str, Any]]:
    """Return the triangular factors of [W tau] in fullnumericregressor.npz, (n, p + 1, p + 1), and its header."""
    artifact = read_artifact(path, SCHEMA)
    with reading(path):
        return artifact.arrays["R"], dict(artifact.header)
