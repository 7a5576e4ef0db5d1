"""Everything a report is made from, read from the folder of one run; sections ask for nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.estimation import prediction
from dynid.estimation.prediction import EstimatedMotion
from dynid.estimation.result import Identification
from dynid.estimation.stack import load_factors
from dynid.files.artifact import reading
from dynid.files.gapfile import read_record
from dynid.judgement.gap import GapRecord
from dynid.judgement.rules import Judgement
from dynid.robot import Robot
from dynid.runs import RunFolder
from dynid.sim.comparison import SimulatorGap


@dataclass(frozen=True)
class ValidatedLog:
    """A validation on a held-out log.

    Attributes:
        name: of the recording.
        motion: estimated and measured motion.
        percent: relative error of all joints [%].
        joint_percent: relative error of each joint, (n,) [%].
        same_motion: whether it repeats a fitted motion, which tells the noise and not what other motions show.
    """

    name: str
    motion: EstimatedMotion
    percent: float
    joint_percent: Floats
    same_motion: bool = False


@dataclass(frozen=True)
class Gathered:
    """One run.

    Attributes:
        result: the result.
        judgement: lights, answer and next steps.
        motion: estimated and measured motion of the fitted logs; None when its file is gone.
        validations: those in the folder of the result.
        singular_values: of the normalised stack of the fitted logs, None when its file is gone.
        gap: what ``dynid gap`` stored, None when it was not run.
        driven: exported files in a simulator, without and with what it named; None where nothing was added.
    """

    result: Identification
    judgement: Judgement
    motion: EstimatedMotion | None = None
    validations: tuple[ValidatedLog, ...] = ()
    singular_values: Floats | None = None
    gap: GapRecord | None = None
    driven: SimulatorGap | None = None

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.result.robot


def gather(result: Identification) -> Gathered:
    """Return what a report shows of a result: from the files in its folder, or from memory if it was not saved.

    Raises:
        JointCountDiffers: a file in its folder is of another arm.
        NotAnArtifact: one is damaged.
    """
    if not result.path.name:
        if result.stack is None:
            return Gathered(result, result.judgement)
        fitted = prediction.predict(result.stack, result.theta, result.model_error)
        return Gathered(result, result.judgement, fitted, (), _spectrum(result.stack.factors))
    run, robot = RunFolder.of(result.path), result.robot
    record = read_record(run.search) if run.search.is_file() else None
    if record is not None:
        robot.require_joints(record.joint_names, run.search)
    return Gathered(
        result=result,
        motion=_motion(run.motion, robot)[0] if run.motion.is_file() else None,
        validations=tuple(_validated(file, robot) for file in run.validations),
        singular_values=_singular_values(run.stack, result) if run.stack.is_file() else None,
        gap=record,
        driven=SimulatorGap.load(run.simulated, robot) if run.simulated.is_file() else None,
        # Why last: it takes the files in the folder for those of this arm.
        judgement=result.judgement,
    )


def _motion(path: Path, robot: Robot) -> tuple[EstimatedMotion, dict[str, Any]]:
    motion, header = prediction.load(path)
    robot.require_joints(header["joints"], path)
    return motion, header


def _singular_values(path: Path, result: Identification) -> Floats | None:
    """Return those of the stack in the folder of a result; None if it is that of another model of the arm."""
    factors, header = load_factors(path)
    result.robot.require_joints(header["joints"], path)
    return _spectrum(factors) if tuple(header["base"]) == result.names else None


def _validated(path: Path, robot: Robot) -> ValidatedLog:
    motion, header = _motion(path, robot)
    checks, percent = prediction.check(motion, motion.tau_measured, robot.joint_names)
    shares = np.array([joint.relative_percent for joint in checks])
    with reading(path):
        seen = header["unseen"]
        return ValidatedLog(seen["name"], motion, percent, shares, seen["same_motion"])


def _spectrum(factors: Floats) -> Floats:
    """Return the singular values, (p,), of a stack with columns of unit length.

    Args:
        factors: triangular factor of [W tau] of each joint, (n, p + 1, p + 1).
    """
    rows = factors[:, :, :-1].reshape(-1, factors.shape[2] - 1)
    size = np.linalg.norm(rows, axis=0)
    return np.asarray(np.linalg.svd(rows / np.where(size > 0, size, 1.0), compute_uv=False))
