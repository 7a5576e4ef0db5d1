"""How wrong a prediction is, joint by joint, and beside what a simpler model reaches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.validate.predict import EstimatedMotion

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class JointCheck:
    """One joint on a log that was not fitted.

    Attributes:
        joint: name.
        rms: residual [N m].
        relative_percent: residual over measured torque [%].
        torque_rms: measured torque [N m].
        baseline_rms: residual of the baseline [N m].
    """

    joint: str
    rms: float
    relative_percent: float
    torque_rms: float
    baseline_rms: float


def check(motion: EstimatedMotion, baseline: Floats, joints: tuple[str, ...]) -> tuple[list[JointCheck], float]:
    """Return the errors of each joint and the total relative error 100 |tau - W theta| / |tau| [%].

    Args:
        motion: measured and predicted torques.
        baseline: torques of the simpler model, (M, n) [N m].
        joints: joint names.
    """
    usable = motion.usable
    residual = np.where(usable, motion.tau_measured - motion.tau_estimated, 0.0)
    torque = np.where(usable, motion.tau_measured, 0.0)
    other = np.where(usable, motion.tau_measured - baseline, 0.0)
    count = np.maximum(usable.sum(axis=0), 1)
    rms, size, base = (np.sqrt((x**2).sum(axis=0) / count) for x in (residual, torque, other))
    checks = [
        JointCheck(
            joint, float(rms[j]), float(100 * rms[j] / size[j]) if size[j] else 0.0, float(size[j]), float(base[j])
        )
        for j, joint in enumerate(joints)
    ]
    total = np.linalg.norm(torque)
    return checks, float(100 * np.linalg.norm(residual) / total) if total else 0.0
