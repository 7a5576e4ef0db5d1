"""Predict the torques of a log, and keep estimated beside measured motion (the paper's Figures 3 to 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.files.artifact import Artifact, read_artifact, write_artifact
from dynid.identify.rows import Rows
from dynid.identify.stack import Source
from dynid.quality.filters import decimate

Floats = NDArray[np.float64]

SCHEMA = "dynid/estimatedmotion/1"


@dataclass(frozen=True)
class EstimatedMotion:
    """Measured and estimated motion on the grid of the fitted rows; M instants, n joints.

    Attributes:
        t: [s].
        q_measured: positions as logged, (M, n).
        q_estimated: positions after the filters, (M, n).
        qd_measured: velocities of the driver, or plain differences where it sends none, (M, n).
        qd_estimated: velocities from the filtered positions, (M, n).
        qdd_measured: plain second differences of the logged positions at the evaluated rate, (M, n).
        qdd_estimated: accelerations from the filtered positions, (M, n).
        tau_measured: torques after the parallel filter, (M, n).
        tau_estimated: torques of the model after the same filter, (M, n).
        usable: rows that count, (M, n).
    """

    t: Floats
    q_measured: Floats
    q_estimated: Floats
    qd_measured: Floats
    qd_estimated: Floats
    qdd_measured: Floats
    qdd_estimated: Floats
    tau_measured: Floats
    tau_estimated: Floats
    usable: NDArray[np.bool_]


def predict(source: Source, rows: Sequence[Rows], theta: Floats) -> EstimatedMotion:
    """Predict the torques of one log.

    Args:
        source: the conditioned log.
        rows: its rows, from ``rows_of`` or a stack.
        theta: base parameters, (p,).
    """
    kernel, step = source.chosen.second_kernel, source.chosen.second_step
    half = (kernel.shape[1] - 1) // 2
    motion: dict[str, list[Floats]] = {key: [] for key in ("q", "qd", "qdd", "raw_q", "raw_qd", "raw_qdd")}
    for segment in source.segments:
        count = (len(segment) - kernel.shape[1]) // step + 1
        if count <= 0:
            continue
        centres = slice(half, half + (count - 1) * step + 1, step)
        for key in ("q", "qd", "qdd"):
            motion[key].append(decimate(np.ascontiguousarray(getattr(segment, key).T), kernel, step)[0].T)
        motion["raw_q"].append(segment.raw_q[centres])
        motion["raw_qd"].append(segment.raw_qd[centres])
        raw_qdd = np.gradient(np.gradient(segment.raw_q, segment.t, axis=0), segment.t, axis=0)
        motion["raw_qdd"].append(raw_qdd[centres])
    joined = {key: np.concatenate(parts) for key, parts in motion.items()}
    return EstimatedMotion(
        t=np.concatenate([r.t for r in rows]),
        q_measured=joined["raw_q"],
        q_estimated=joined["q"],
        qd_measured=joined["raw_qd"],
        qd_estimated=joined["qd"],
        qdd_measured=joined["raw_qdd"],
        qdd_estimated=joined["qdd"],
        tau_measured=np.concatenate([r.tau for r in rows]),
        tau_estimated=np.concatenate([r.W @ theta for r in rows]),
        usable=np.concatenate([r.mask for r in rows]),
    )


def save(path: Path, motions: Sequence[EstimatedMotion], header: dict[str, Any]) -> None:
    """Write estimatedmotion.npz; several logs follow each other, ``log`` says which is which."""
    arrays: dict[str, NDArray[Any]] = {
        field.name: np.concatenate([getattr(m, field.name) for m in motions]) for field in fields(EstimatedMotion)
    }
    arrays["log"] = np.concatenate([np.full(len(m.t), k) for k, m in enumerate(motions)])
    write_artifact(path, Artifact(SCHEMA, header, arrays))


def load(path: Path) -> tuple[EstimatedMotion, dict[str, Any]]:
    """Read estimatedmotion.npz as one motion, and its header."""
    artifact = read_artifact(path, SCHEMA)
    arrays = {field.name: artifact.arrays[field.name] for field in fields(EstimatedMotion)}
    return EstimatedMotion(**arrays), dict(artifact.header)
