"""Predict the torques of a log, and keep estimated beside measured motion (the paper's Figures 3 to 6)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from dynid.arrays import Floats, Mask
from dynid.estimation.residual_model import ModelError, shapes_in
from dynid.estimation.rows import Rows, at_rows
from dynid.estimation.stack import Stack
from dynid.files.artifact import read_artifact, reading
from dynid.model.regressor import Observer
from dynid.npz import write_artifact
from dynid.robot import Robot
from dynid.signals.conditioned_log import ConditionedLog, Segment
from dynid.signals.filters import Filter

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
    usable: Mask


def predict(
    log: ConditionedLog,
    rows: Rows,
    theta: Floats,
    error: ModelError | None,
    observer: Observer,
) -> EstimatedMotion:
    """Predict the torques of one log.

    Args:
        log: the conditioned log.
        rows: all its rows.
        theta: base parameters, (p,), each in its unit.
        error: the model error whose mean is part of the prediction; None without.
        observer: evaluator of the base columns.
    """
    tau = rows.torque(theta)
    if error is not None:
        tau = tau + error.torque(rows.W, shapes_in(log, observer, error.speed))
    q, qd, qdd = np.split(at_rows(log, lambda s: np.hstack([s.q, s.qd, s.qdd]).T), 3, axis=1)
    raw = zip(*(_raw(segment, log.filter) for segment in log.segments), strict=True)
    raw_q, raw_qd, raw_qdd = map(np.concatenate, raw)
    return EstimatedMotion(rows.t, raw_q, q, raw_qd, qd, raw_qdd, qdd, rows.tau, tau, rows.use)


def predict_logs(
    stack: Stack, theta: Floats, error: ModelError | None = None
) -> list[EstimatedMotion]:
    """Predict the torques of all logs of a stack from base parameters, (p,), each in its unit, and the model error."""
    rows = stack.rows
    return [
        predict(log, rows.take(rows.log == k), theta, error, stack.observer)
        for k, log in enumerate(stack.logs)
    ]


def _raw(segment: Segment, chosen: Filter) -> tuple[Floats, ...]:
    """Return raw q, qd, qdd of a segment at the instants of its rows."""
    half, q, t = (chosen.second_kernel.shape[1] - 1) // 2, segment.raw_q, segment.t
    qdd = np.gradient(np.gradient(q, t, axis=0), t, axis=0) if len(t) > 1 else 0.0 * q
    centres = slice(half, max(half, len(t) - half), chosen.second_step)
    return q[centres], segment.raw_qd[centres], qdd[centres]


def concatenated(motions: Sequence[EstimatedMotion]) -> EstimatedMotion:
    """Return motions one after the other as one, times as they are."""
    names = vars(motions[0])
    return EstimatedMotion(**{x: np.concatenate([vars(m)[x] for m in motions]) for x in names})


def save(path: Path, motions: Sequence[EstimatedMotion], header: dict[str, Any]) -> None:
    """Write estimatedmotion.npz; several logs follow each other, ``log`` says which is which."""
    log = np.repeat(np.arange(len(motions)), [len(motion.t) for motion in motions])
    write_artifact(path, SCHEMA, header, {**vars(concatenated(motions)), "log": log})


def load(path: Path) -> tuple[EstimatedMotion, dict[str, Any]]:
    """Read estimatedmotion.npz as one motion, and its header."""
    artifact = read_artifact(path, SCHEMA)
    with reading(path):
        arrays = {each.name: artifact.arrays[each.name] for each in fields(EstimatedMotion)}
    return EstimatedMotion(**arrays), dict(artifact.header)


# ---------------------------------------------------------------- how wrong a prediction is
@dataclass(frozen=True)
class JointError:
    """How well the torque of one joint is predicted.

    Attributes:
        joint: name.
        rms: root mean square of the residual [N m or N].
        relative_percent: residual over measured torque [%].
        torque_rms: root mean square of the measured torque [N m or N].
    """

    joint: str
    rms: float
    relative_percent: float
    torque_rms: float

    def facts(self, robot: Robot, **more: float | None) -> dict[str, Any]:
        """Return it for JSON with more torques, in amperes where only the ratios of the gains are known."""
        gain = robot.shown_gains[robot.joint_names.index(self.joint)]
        unit = "a" if robot.torque.relative else "nm"
        torques = {name: x for name, x in vars(self).items() if name.endswith("rms")} | more
        facts = {f"{name}_{unit}": x and x / gain for name, x in torques.items()}
        facts["relative_error_percent"] = self.relative_percent
        # Of a joint without torque in the log nothing is known.
        return {"joint": self.joint, **(facts if self.torque_rms else dict.fromkeys(facts))}


@dataclass(frozen=True)
class JointCheck(JointError):
    """One joint on a held-out log; ``baseline_rms`` is the residual of a simpler model [N m or N]."""

    baseline_rms: float


def check(
    motion: EstimatedMotion, baseline: Floats, joints: tuple[str, ...]
) -> tuple[list[JointCheck], float]:
    """Return the errors of each joint and the total relative error 100 |tau - W theta| / |tau| [%].

    Args:
        motion: measured and predicted torques.
        baseline: torques of the simpler model, (M, n) [N m].
        joints: joint names.
    """
    count = np.maximum(motion.usable.sum(axis=0), 1)
    measured = motion.tau_measured
    squares = np.array(
        [
            np.sum(np.where(motion.usable, x, 0.0) ** 2, axis=0)
            for x in (measured - motion.tau_estimated, measured, measured - baseline)
        ]
    )
    checks = [
        JointCheck(joint, rms, 100 * rms / size if size else 0.0, size, base)
        for joint, (rms, size, base) in zip(
            joints, np.sqrt(squares / count).T.tolist(), strict=True
        )
    ]
    residual, torque = np.sqrt(squares[:2].sum(axis=1)).tolist()
    return checks, 100 * residual / torque if torque else 0.0
