"""Predict the torques of a log, and keep estimated beside measured motion (the paper's Figures 3 to 6)."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from dynid.arrays import Floats, Ints, Mask
from dynid.estimation.residual_model import ModelError, residuals
from dynid.estimation.rows import at_rows
from dynid.estimation.stack import Stack
from dynid.files.artifact import read_artifact, reading
from dynid.npz import write_artifact
from dynid.robot import Robot
from dynid.signals.conditioned_log import ConditionedLog, Segment

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
        log: number of the log, (M,).
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
    log: Ints


def predict(stack: Stack, theta: Floats, error: ModelError | None = None) -> EstimatedMotion:
    """Predict the torques of all logs of a stack.

    Args:
        stack: all rows of the logs.
        theta: base parameters, (p,), each in its unit.
        error: the model error whose mean is part of the prediction; None without.
    """
    rows = stack.rows
    raw_q, raw_qd, raw_qdd = np.split(stack.along(_raw), 3, axis=1)
    q, qd, qdd = np.split(stack.along(_filtered), 3, axis=1)
    tau = rows.tau - residuals(stack, theta, error)
    return EstimatedMotion(
        rows.t, raw_q, q, raw_qd, qd, raw_qdd, qdd, rows.tau, tau, rows.use, rows.log
    )


def _filtered(log: ConditionedLog, t: Floats) -> Floats:
    """Return q, qd and qdd under the filter of the torques at the times of rows, (M, 3 n)."""
    return at_rows(log, lambda part: np.hstack([part.q, part.qd, part.qdd]).T, t)


def _raw(log: ConditionedLog, t: Floats) -> Floats:
    """Return q, qd and qdd without filters at the times of rows, (M, 3 n)."""

    def motion(part: Segment) -> Floats:
        qdd = np.gradient(np.gradient(part.raw_q, part.t, axis=0), part.t, axis=0)
        return np.hstack([part.raw_q, part.raw_qd, qdd])[np.isin(part.t, t)]

    return np.concatenate([motion(part) for part in log.segments])


def save(path: Path, motion: EstimatedMotion, header: dict[str, Any]) -> None:
    """Write estimatedmotion.npz; several logs follow each other, ``log`` says which is which."""
    write_artifact(path, SCHEMA, header, vars(motion))


def load(path: Path) -> tuple[EstimatedMotion, dict[str, Any]]:
    """Read estimatedmotion.npz, and its header."""
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
