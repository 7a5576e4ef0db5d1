"""Is it another arm? Asked where most joints miss several times their noise: which shipped arm explains the logs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.progress import SILENT, Progress

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.log import Log
    from dynid.robot import Robot


def other_arm(found: Identification, logs: Sequence[Log], progress: Progress = SILENT) -> dict[str, Any] | None:
    """Return the shipped arm whose link lengths explain logs far better: name, and both errors [%]; None for none.

    Args:
        found: a result.
        logs: the checked logs that it was made from.
        progress: reports that other arms are tried.
    """
    from dynid.estimation.evidence import evidence_of
    from dynid.judgement import tuning
    from dynid.judgement.judge import suspects_other_arm

    if not logs or not suspects_other_arm(evidence_of(found)):
        return None
    progress.stage("arm", "most joints miss several times their noise: the link lengths of other arms are tried")
    own = _error(found.robot, logs, found.cutoff)
    tried = [(_error(arm, logs, found.cutoff), name) for name, arm in _other_lengths(found.robot)]
    percent, name = min(tried, default=(own, ""))
    return {"name": name, "percent": percent, "own": own} if percent < tuning.OTHER_ARM_GAIN * own else None


def _other_lengths(robot: Robot) -> Iterator[tuple[str, Robot]]:
    """Yield shipped arms of the same kind: their lengths and twists on the joints of the robot file."""
    from dynid.files import packaged
    from dynid.files.robotfile import load_robot

    for path in sorted(Path(packaged("robots")).glob("*.yaml")):
        other = load_robot(path)
        if other.n != robot.n or other.convention != robot.convention:
            continue
        joints = tuple(
            replace(own, a=one.a, d=one.d, twist=one.twist, theta_offset=one.theta_offset, type=one.type)
            for own, one in zip(robot.joints, other.joints, strict=True)
        )
        if joints != robot.joints:
            yield path.stem, replace(robot, joints=joints, prior=None, effects=())


def _error(robot: Robot, logs: Sequence[Log], cutoff: float) -> float:
    """Return what is unexplained of logs with the links of an arm [%]."""
    from dynid.estimation.estimators import wls
    from dynid.estimation.least_squares import relative_error
    from dynid.estimation.stack import stack_logs
    from dynid.model.parameters import prior_base_parameters
    from dynid.signals.conditioned_log import condition_logs
    from dynid.workflows.model import base_model

    base = base_model(replace(robot, prior=None))
    stack = stack_logs(condition_logs(logs, base.model, cutoff=cutoff or None), base)
    fit = wls(stack, prior_base_parameters(base.model, base.reduction))
    return relative_error(stack.whole[0], fit.theta)
