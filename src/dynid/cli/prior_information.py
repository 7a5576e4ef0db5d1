"""What is known before a motion is planned: torque noise, and the information of earlier logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from dynid.cli.options import Common
from dynid.errors import WrongUsage

if TYPE_CHECKING:
    from dynid.model.store import BaseModel
    from dynid.robot import Robot

Floats = NDArray[np.float64]

RESULT, TRAJECTORY = "dynid/identification", "dynid/trajectory"


def kind_of(path: Path) -> str:
    """Return the schema of a file without its number, or "log"."""
    from dynid.files.artifact import read_header

    header = read_header(path) if path.suffix == ".npz" else None
    return str((header or {}).get("schema", "log")).rsplit("/", 1)[0]


def noise_source(robot: Robot, text: str | None, earlier: Sequence[Path]) -> str:
    """Return where the torque noise comes from, in words."""
    if text is not None:
        return "given with --noise"
    if any(kind_of(path) == RESULT for path in earlier):
        return "as an earlier identification found it"
    known = robot.torque.noise is not None
    return "from the robot file" if known else "assumed (0.3 % of the rating, 0.1 N m without one)"


def noise_of(robot: Robot, text: str | None, earlier: Sequence[Path]) -> Floats:
    """Return every joint's torque noise from the first of its sources that there is (``noise_source``), (n,)."""
    from dynid.trajectory.predict import default_noise

    if text is not None:
        try:
            values = [float(part) for part in text.split(",")]
        except ValueError:
            values = []
        if len(values) not in (1, robot.n) or not all(0 < value < np.inf for value in values):
            raise WrongUsage(
                f"--noise '{text}' is neither one positive number nor {robot.n}", fix="such as --noise 0.1"
            )
        return np.broadcast_to(np.array(values), (robot.n,)).copy()
    for path in earlier:
        if kind_of(path) == RESULT:
            from dynid.estimation.result import load

            return np.asarray(load(path).identification.noise)
    return default_noise(robot)


def earlier_information(common: Common, base: BaseModel, files: Sequence[Path], noise: Floats) -> Floats | None:
    """Return the information matrix that earlier files hold about the base parameters, (p, p); None without any."""
    total = None
    for path in files:
        kind = kind_of(path)
        if kind == RESULT:
            known = _of_result(base, path)
        elif kind == TRAJECTORY:
            known = _of_trajectory(base, path, noise)
        else:
            known = _of_log(common, base, path)
        total = known if total is None else total + known
        common.terminal.stage("earlier", f"{path}: the new motion completes what it tells")
    return total


def _of_result(base: BaseModel, path: Path) -> Floats:
    from dynid.estimation.result import load

    found = load(path).identification
    if tuple(found.names) != base.reduction.base_names:
        raise WrongUsage(
            f"{path} has other base parameters than the robot file", fix="identify again with this robot file"
        )
    scale = 1 / np.sqrt(np.diag(found.covariance))
    return np.asarray(np.linalg.pinv(found.covariance * np.outer(scale, scale)) * np.outer(scale, scale))


def _of_trajectory(base: BaseModel, path: Path, noise: Floats) -> Floats:
    from dynid.files.trajectoryfile import read_trajectory
    from dynid.trajectory.predict import information_of

    return information_of(base.model, base.reduction.base, read_trajectory(path, base.robot).motion, noise)[1]


def _of_log(common: Common, base: BaseModel, path: Path) -> Floats:
    from dynid.estimation.least_squares import weighted
    from dynid.workflows.logs import LogOptions, load_log
    from dynid.workflows.parameters import stack_logs

    with common.terminal.progress() as progress:
        stack = stack_logs([load_log(path, base.robot)], base, LogOptions(delay=0.0), progress)[0]
    factors, rows = stack.joint_factors(np.ones(stack.blocks, dtype=bool))
    found = weighted(factors, rows).noise
    p = base.reduction.rank
    return np.asarray(sum(R[:, :p].T @ R[:, :p] / sigma**2 for R, sigma in zip(factors, found, strict=True)))
