"""fullnumericregressor.npz: the stacked observations before anything is identified.

It holds the conditioned motion that rows are made from and one triangular factor of [W tau] per joint: all that
least squares needs, and small however long the log was. The stacked matrix itself is never stored.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.stack import Stack
from dynid.files.artifact import read_artifact, reading
from dynid.npz import write_artifact
from dynid.signals.conditioned_log import ConditionedLog, Segment
from dynid.signals.filters import Filter, pulse_width

SCHEMA = "dynid/fullnumericregressor/1"
_ARRAYS = tuple(field.name for field in fields(Segment))


def save(path: Path, stack: Stack, header: dict[str, Any]) -> None:
    """Write fullnumericregressor.npz."""
    segments = [(k, segment) for k, log in enumerate(stack.logs) for segment in log.segments]
    arrays = {name: np.concatenate([getattr(s, name) for _, s in segments]) for name in _ARRAYS}
    arrays |= {"R": stack.factors, "rows": stack.counts}
    facts = {
        **header,
        "base": list(stack.names),
        "joints": list(stack.joints),
        "lengths": [len(segment) for _, segment in segments],
        "source_of_segment": [k for k, _ in segments],
        "sources": [
            {
                "name": log.name,
                "path": log.path,
                "sha256": log.sha256,
                "delay": log.delay,
                **asdict(log.filter),
            }
            for log in stack.logs
        ],
    }
    write_artifact(path, SCHEMA, facts, arrays)


def load(path: Path) -> tuple[list[ConditionedLog], dict[str, Any]]:
    """Read fullnumericregressor.npz: the conditioned logs and the header."""
    artifact = read_artifact(path, SCHEMA)
    h, a = dict(artifact.header), artifact.arrays
    with reading(path):
        edges = np.cumsum([0, *map(int, h["lengths"])]).tolist()
        owners = list(map(int, h["source_of_segment"]))
        if edges[-1] != len(a["t"]) or set(owners) != set(range(len(h["sources"]))) or not owners:
            raise ValueError("its segments do not match its logs")
        segments = [Segment(**{name: a[name][i:j] for name in _ARRAYS}) for i, j in pairwise(edges)]
        if not all(np.all(np.diff(segment.t) > 0) for segment in segments):
            raise ValueError("its times do not increase")
        return [_log(k, s, segments, owners) for k, s in enumerate(h["sources"])], h


def _log(
    number: int, source: Mapping[str, Any], segments: Sequence[Segment], owners: Sequence[int]
) -> ConditionedLog:
    """Return one of the logs from its facts and the segments of all."""
    steps = (int(source[key]) for key in ("first_step", "second_step"))
    chosen = Filter(float(source["rate"]), float(source["cutoff"]), *steps)
    own = [segment for segment, owner in zip(segments, owners, strict=True) if owner == number]
    taps = pulse_width(chosen.cutoff) * chosen.rate / chosen.first_step
    if not chosen.cutoff < chosen.rate or taps > sum(map(len, own)):
        raise ValueError("its filter is invalid or longer than its log")
    return ConditionedLog(
        own, chosen, source["name"], source["path"], source["sha256"], float(source["delay"])
    )


def load_factors(path: Path) -> tuple[Floats, dict[str, Any]]:
    """Return the triangular factors of [W tau] in fullnumericregressor.npz, (n, p + 1, p + 1), and its header."""
    artifact = read_artifact(path, SCHEMA)
    with reading(path):
        return artifact.arrays["R"], dict(artifact.header)
