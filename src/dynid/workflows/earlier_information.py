"""What is known before a motion is planned: torque noise, and the information of earlier logs, results and motions."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.errors import WrongUsage
from dynid.estimation.least_squares import weighted
from dynid.estimation.posterior import parameter_posterior, prior_information
from dynid.estimation.result import Identification
from dynid.estimation.stack import stack_logs
from dynid.files.artifact import read_header
from dynid.files.trajectoryfile import StoredTrajectory, read_trajectory
from dynid.loading import checked_log, condition_logs, load_run, parameters_of, read_log
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.options import LogOptions
from dynid.progress import SILENT, Progress
from dynid.robot import Robot
from dynid.trajectory.predict import default_noise, information_of

Floats = NDArray[np.float64]
#: A recording, what was identified from recordings, or a motion that was planned and not yet recorded.
Earlier = Log | Identification | StoredTrajectory


def read_earlier(path: Path, robot: Robot) -> Earlier:
    """Return what a file holds: parameters.npz, trajectory.npz, or else a log.

    Raises:
        DynidError: it is of another arm, or damaged.
    """
    # Why: a recording of rosbag2 is a folder as well.
    path = parameters_of(path) if parameters_of(path).is_file() else path
    header = read_header(path) if path.suffix == ".npz" else None
    kind = str((header or {}).get("schema", "")).rpartition("/")[0]
    if kind == "dynid/identification":
        return load_run(path)
    return read_trajectory(path, robot) if kind == "dynid/trajectory" else read_log(path, robot)


def require_same_arm(earlier: Sequence[Earlier], robot: Robot) -> None:
    """Raise when results or motions are of another arm; a log has its columns looked up.

    Raises:
        JointCountDiffers: one is.
    """
    for known in earlier:
        if isinstance(known, Identification):
            robot.require_joints(known.robot.joint_names, known.label)
        elif isinstance(known, StoredTrajectory):
            robot.require_joints(known.joints, known.source or "the earlier motion")


def torque_noise(
    robot: Robot, given: Sequence[float] | None, earlier: Sequence[Earlier], rate: float
) -> tuple[Floats, str]:
    """Return each joint's torque noise from the first of its sources that there is, and that source in words.

    Args:
        robot: the arm.
        given: one number or one per joint [N m or N]; None to look further.
        earlier: an identification among them has found the noise.
        rate: of the coming log's samples [Hz].

    Returns:
        Standard deviation of each joint's torque, (n,) [N m or N], and where it comes from. White noise is meant: of an
        identification, that which tells as little as its coloured residuals.
    """
    if given is not None:
        if len(given) not in (1, robot.n):
            what = f"--noise '{','.join(f'{sigma:g}' for sigma in given)}'"
            one = f"one positive number, or {robot.n} of them"
            raise WrongUsage(f"{what} must be {one}", fix="such as --noise 0.1")
        return np.broadcast_to(np.array(given), (robot.n,)).copy(), "given with --noise"
    for known in earlier:
        if isinstance(known, Identification):
            noise = parameter_posterior(known).sample_noise(rate)
            return noise, "as an earlier identification found it"
    assumed = "assumed (0.3 % of the rating, 0.1 N m without one)"
    return default_noise(robot), assumed if robot.torque.noise is None else "from the robot file"


def earlier_information(
    base: BaseModel, earlier: Sequence[Earlier], noise: Floats, progress: Progress = SILENT
) -> Floats | None:
    """Return the information matrix that earlier files hold about the base parameters, (p, p); None without any.

    Args:
        base: model and base parameters.
        earlier: logs, results and motions.
        noise: standard deviation of each joint's torque, for motions that were not recorded, (n,) [N m or N].
        progress: reports each.
    """
    total = None
    for known in earlier:
        if isinstance(known, Identification):
            information, name = _of_result(base, known), str(known.path)
        elif isinstance(known, StoredTrajectory):
            columns, name = base.reduction.base, str(known.source)
            information = information_of(base.model, columns, known.motion, noise)[1]
        else:
            information, name = _of_log(base, known, progress), str(known.source)
        total = information if total is None else total + information
        progress.stage("earlier", f"{name}: the new motion is planned to complete it")
    return total


def believed(base: BaseModel, earlier: Sequence[Earlier], known: Floats | None) -> Floats:
    """Return what is known of the base parameters before a motion, the prior of possible bodies included, (p, p).

    Args:
        base: model and base parameters.
        earlier: logs, results and motions; the posterior of a physical set holds the prior already.
        known: their information, from ``earlier_information``.
    """
    if known is None:
        return prior_information(base)
    held = any(isinstance(each, Identification) and each.in_force == "physical" for each in earlier)
    return known if held else known + prior_information(base)


def unexplained(earlier: Sequence[Earlier]) -> float | None:
    """Return what no parameter explains by the first identification, rms of all joints [N m or N]; None without one."""
    for known in earlier:
        if isinstance(known, Identification) and known.expected is not None:
            return float(np.sqrt(np.mean(known.expected.noise**2)))
    return None


def _of_result(base: BaseModel, found: Identification) -> Floats:
    names = {name: k for k, name in enumerate(found.names)}
    if not set(base.reduction.base_names) <= set(names):
        what = f"{found.path} has different base parameters from the robot file"
        raise WrongUsage(what, fix="identify again with this robot file")
    # Why some: a motion is planned without the effects of the robot file, whatever they are.
    some = [names[name] for name in base.reduction.base_names]
    others = [k for k in names.values() if k not in some]
    information = parameter_posterior(found).information
    known, shared = information[np.ix_(some, some)], information[np.ix_(some, others)]
    if others:
        rest = np.linalg.pinv(information[np.ix_(others, others)], hermitian=True)
        known = known - shared @ rest @ shared.T
    return np.asarray(known)


def _of_log(base: BaseModel, log: Log, progress: Progress) -> Floats:
    options = LogOptions(delay=0.0)
    conditioned = condition_logs([checked_log(log, base.robot)], base.model, options, progress)
    factors, rows = stack_logs(conditioned, base, progress).whole
    found, p = weighted(factors, rows).noise, base.reduction.rank
    return np.asarray(
        sum(R[:, :p].T @ R[:, :p] / sigma**2 for R, sigma in zip(factors, found, strict=True))
    )
