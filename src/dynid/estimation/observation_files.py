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
from numpy.typing import NDArray

from dynid import limits
from dynid.estimation.stack import Stack
from dynid.files.artifact import Artifact, read_artifact, reading, require_numbers, write_artifact
from dynid.longarrays import joined
from dynid.signals.conditioned_log import ConditionedLog
from dynid.signals.conditioning import Filter, Segment

SCHEMA = "dynid/fullnumericregressor/1"
#: Steps of thinning and seconds of delay are below this.
_MOST = 1e6
_ARRAYS = tuple(field.name for field in fields(Segment))
Floats = NDArray[np.float64]


def save(path: Path, stack: Stack, header: dict[str, Any]) -> None:
    """Write fullnumericregressor.npz."""
    segments = [(k, segment) for k, log in enumerate(stack.logs) for segment in log.segments]
    arrays = {name: joined(getattr(segment, name) for _, segment in segments) for name in _ARRAYS}
    factors, counts = stack.whole
    arrays |= {"R": factors, "rows": counts}
    facts = {
        **header,
        "base": list(stack.names),
        "joints": list(stack.joints),
        "lengths": [len(segment) for _, segment in segments],
        "source_of_segment": [k for k, _ in segments],
        "sources": [
            {"name": log.name, "path": log.path, "sha256": log.sha256, "delay": log.delay, **asdict(log.filter)}
            for log in stack.logs
        ],
    }
    write_artifact(path, Artifact(SCHEMA, facts, arrays))


def load(path: Path) -> tuple[list[ConditionedLog], dict[str, Any]]:
    """Read fullnumericregressor.npz: the conditioned logs and the header."""
    artifact = read_artifact(path, SCHEMA)
    h, a = dict(artifact.header), artifact.arrays
    with reading(path):
        _factors_in(a)
        edges = np.cumsum([0, *h["lengths"]]).tolist()
        segments = [Segment(**{name: a[name][i:j] for name in _ARRAYS}) for i, j in pairwise(edges)]
        owners: Sequence[int] = h["source_of_segment"]
        n = int(segments[0].q.shape[1])
        for segment in segments:
            N = len(segment.t)
            require_numbers((N, n), q=segment.q, qd=segment.qd, qdd=segment.qdd, tau=segment.tau)
            require_numbers((N, n), raw_q=segment.raw_q, raw_qd=segment.raw_qd, gaps=True)
            require_numbers((N, n), np.bool_, usable=segment.usable)
            require_numbers((N,), t=segment.t, elapsed=segment.elapsed)
            for name in ("command_q", "command_qd", "command_qdd", "coulomb_sign", "command_coulomb_sign"):
                part = getattr(segment, name)
                require_numbers((N, n if part.size else 0), **{name: part}, gaps=True)
            require_numbers((N, *segment.effects.shape[1:2]), effects=segment.effects)
            if not np.all(np.diff(segment.t) > 0):
                raise ValueError("its times do not rise")
        logs = []
        for k, s in enumerate(h["sources"]):
            chosen = Filter(float(s["rate"]), float(s["cutoff"]), int(s["first_step"]), int(s["second_step"]))
            steps, delay = (chosen.first_step, chosen.second_step), float(s["delay"])
            if not 0 < chosen.cutoff < chosen.rate <= limits.limit("rate_hz") or not all(0 < k < _MOST for k in steps):
                raise ValueError("its filter is none")
            if not abs(delay) < _MOST:
                raise ValueError("its torques are later than its motion")
            logs.append(
                ConditionedLog(
                    [segment for segment, owner in zip(segments, owners, strict=True) if owner == k],
                    chosen,
                    str(s["name"]),
                    str(s["path"]),
                    str(s["sha256"]),
                    delay,
                )
            )
        return logs, h


def load_factors(path: Path) -> Floats:
    """Return the triangular factor of [W tau] of each joint in fullnumericregressor.npz, (n, p + 1, p + 1)."""
    arrays = read_artifact(path, SCHEMA).arrays
    with reading(path):
        return _factors_in(arrays)


def _factors_in(arrays: Mapping[str, NDArray[Any]]) -> Floats:
    factors = arrays["R"]
    require_numbers((len(factors), *factors.shape[1:2] * 2), R=factors)
    return factors
