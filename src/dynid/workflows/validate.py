"""Replay a log that was not used to identify, and compare predicted with measured torques."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid import arguments
from dynid.answer import Judged
from dynid.arguments import public
from dynid.errors import SameRecording
from dynid.estimation import prediction
from dynid.estimation.estimate import log_motion
from dynid.estimation.evidence import evidence_of, fingerprint, here
from dynid.estimation.prediction import EstimatedMotion, JointCheck
from dynid.estimation.residual_model import ModelError, shapes_in, torque_variance
from dynid.estimation.result import Identification
from dynid.estimation.rows import Rows, rows_of
from dynid.estimation.stack import scaled
from dynid.exporters import FORMATS
from dynid.files.artifact import read_header
from dynid.files.convert import JointStates, write_replay
from dynid.judgement.evidence import Evidence, Unseen
from dynid.loading import LogLike, ResultLike, as_base_model, as_log, as_result, checked_log
from dynid.model.base_model import BaseModel
from dynid.model.regressor import Observer
from dynid.progress import Progress
from dynid.reports.figures import motion_figure, write_motion_figures
from dynid.robot import Robot
from dynid.signals.conditioned_log import ConditionedLog
from dynid.signals.motion import same_motion
from dynid.table import Table
from dynid.workflows.drive_gains import in_amperes
from dynid.workflows.export import identified_arm
from dynid.workflows.logs import check_weight, condition_logs
from dynid.workflows.options import ExportOptions, ValidateOptions
from dynid.workflows.results import base_model_of

if TYPE_CHECKING:
    import numpy as np
    from matplotlib.figure import Figure
    from numpy.typing import NDArray


@dataclass(frozen=True, repr=False)
class Validation(Judged):
    """Predicted and measured torques of a log that was not used to identify.

    Attributes:
        robot: the arm.
        log: the log's name.
        log_sha256: hash of its file.
        joints: errors of each joint.
        relative_error_percent: 100 |tau - W theta| / |tau| over all joints [%].
        baseline: what the simpler model is that the errors are compared with.
        motion: predicted and measured motion and torques.
        cutoff: cut-off of the filter over torques and columns [Hz].
        expected_percent: the relative error that the result's posterior expects on this motion [%]; None without one.
        same_motion: whether the log repeats a fitted motion, which tells the noise and not what other motions show.
        start_ns: what the time of the log counts from [ns since 1970], 0 where it does not say.
        of: tells the parameters that predicted from others.
        known: what is known of the model without this log.
    """

    robot: Robot
    log: str
    log_sha256: str
    joints: tuple[JointCheck, ...]
    relative_error_percent: float
    baseline: str
    motion: EstimatedMotion
    cutoff: float
    expected_percent: float | None = None
    same_motion: bool = False
    start_ns: int = 0
    of: str = ""
    known: Evidence = field(default_factory=Evidence)

    @property
    def seen(self) -> Unseen:
        """The log as evidence."""
        torque = self.robot.torque
        gains = torque.gain if torque.relative and torque.gain else (1.0,) * self.robot.n
        rms = tuple(
            joint.rms / (gain or 1.0) for joint, gain in zip(self.joints, gains, strict=True)
        )
        percent, name = self.relative_error_percent, Path(self.log).name
        return Unseen(
            name, percent, rms, self.same_motion, self.expected_percent, True, here(self.log)
        )

    @property
    def evidence(self) -> Evidence:
        """What is known of the model with this log."""
        seen = self.seen
        earlier = tuple(each for each in self.known.unseen if each.log != seen.log)
        return replace(self.known, asked="replay", unseen=(*earlier, seen))

    def table(self) -> Table:
        """Return one row per joint: rms error and rms torque [N m or N], what is unexplained [%], and the baseline."""
        rows = [
            {
                "joint": quality.joint,
                "rms error": quality.rms,
                "rms torque": quality.torque_rms,
                "unexplained %": quality.relative_percent,
                "rms of baseline": quality.baseline_rms,
                "unit": joint.torque_unit,
            }
            for quality, joint in zip(self.joints, self.robot.joints, strict=True)
        ]
        judged = self.judgement
        total = (
            f"total relative error {self.relative_error_percent:.2f} %, baseline: {self.baseline}"
        )
        return Table(
            rows,
            f"{self.robot.name}, {Path(self.log).name}",
            (judged.sentence, *judged.reasons, total),
        )

    def plot_torque(self) -> Figure:
        """Return a figure of measured and estimated torque and their difference, one panel per joint."""
        return self._figure(self.robot.joint_names)

    def plot_residual(self, joint: int | str) -> Figure:
        """Return a figure of what the model leaves of the torque of one joint.

        Args:
            joint: number from 1, or name.

        Raises:
            WrongUsage: there is no such joint.
        """
        return self._figure((self.robot.joint_name(joint),), residual_only=True)

    def _figure(self, joints: tuple[str, ...], *, residual_only: bool = False) -> Figure:

        title = f"{self.robot.name}, {Path(self.log).name}"
        return motion_figure(self.motion, self.robot, joints, title, residual_only=residual_only)

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid validate`` says."""
        answer = {
            "schema": "dynid/validate/1",
            "robot": self.robot.name,
            "relative_error_percent": self.relative_error_percent,
            "expected_relative_error_percent": self.expected_percent,
            "same_motion": self.same_motion,
            "joints": [
                {
                    "joint": j.joint,
                    "rms_nm": j.rms,
                    "relative_error_percent": j.relative_percent,
                    "baseline_rms_nm": j.baseline_rms,
                }
                for j in self.joints
            ],
            "baseline": self.baseline,
            "cutoff_hz": self.cutoff,
            "judgement": self.judgement.facts(),
        }
        found: dict[str, Any] = in_amperes(answer, self.robot)
        return found

    def broken_limits(self, max_rms: float | None, max_unexplained: float | None) -> list[str]:
        """Return a sentence per limit that is not met.

        Args:
            max_rms: largest rms error of a joint [N m or N].
            max_unexplained: largest total relative error, as a share.
        """
        found = [
            f"{joint.joint}: rms error {joint.rms:.3g} N m > {max_rms:g}"
            for joint in self.joints
            if max_rms is not None and joint.rms > max_rms
        ]
        if max_unexplained is not None and self.relative_error_percent > 100 * max_unexplained:
            found.append(
                f"total relative error {self.relative_error_percent:.2f} % > {100 * max_unexplained:g} %"
            )
        return found

    def folder(self, parent: Path) -> Path:
        """Return where its files go below a folder: named after the log, and after its hash where another log has that.

        Args:
            parent: the folder of all validations of a result.
        """
        name = Path(self.log).stem
        there = parent / name / "estimatedmotion.npz"
        header = (read_header(there) if there.is_file() else None) or {}
        taken = header.get("log_sha256", [self.log_sha256]) != [self.log_sha256]
        return parent / (f"{name}_{self.log_sha256[:8]}" if taken else name)

    def save(self, folder: Path) -> Path:
        """Write estimatedmotion.npz."""
        path = folder / "estimatedmotion.npz"
        header = {
            "robot": self.robot.name,
            "joints": list(self.robot.joint_names),
            "log": self.log,
            "log_sha256": [self.log_sha256],
            "torque_from": "identified",
            "same_motion": self.same_motion,
            "expected_percent": self.expected_percent,
            "of": self.of,
        }
        prediction.save(path, [self.motion], header)
        return path

    def save_mcap(self, path: Path, urdf: str) -> Path:
        """Write measured, predicted and residual motion and torques for Foxglove, PlotJuggler and Rerun.

        Args:
            path: the MCAP file.
            urdf: text of the arm's URDF, with the robot file's joint names and angles.

        Raises:
            CannotWrite: the file cannot be written.
        """
        import numpy as np

        m = self.motion
        torque = np.where(m.usable, m.tau_estimated, np.nan)
        topics = {
            "/measured/joint_states": JointStates(m.q_measured, m.qd_measured, m.tau_measured),
            "/predicted/joint_states": JointStates(m.q_estimated, m.qd_estimated, torque),
            "/residual/joint_states": JointStates(
                m.q_measured - m.q_estimated,
                m.qd_measured - m.qd_estimated,
                m.tau_measured - torque,
            ),
        }
        stamps = self.start_ns + np.round(m.t * 1e9).astype(np.int64)
        return write_replay(path, stamps, self.robot.joint_names, topics, urdf)

    def write_figures(self, folder: Path) -> list[Path]:
        """Draw measured and estimated motion and torques of each joint."""
        return write_motion_figures(
            folder, self.motion, self.robot, f"{self.robot.name}, {Path(self.log).name}"
        )


@public
def validate(
    result: ResultLike,
    log: LogLike,
    options: ValidateOptions | None = None,
    *,
    base: BaseModel | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Validation:
    """Compare predicted with measured torques on a recording that the model has not seen.

    Args:
        result: identified parameters, their folder or their file.
        log: the recording, or its path.
        options: how it is checked and filtered.
        base: the result's base model, where it is there already.
        progress: reports how far the work is.
        changes: single options by name, such as ``cutoff=5``; see ``dynid.ValidateOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).
        SameRecording: the result was identified from this log.
        DynidError: the first serious fault of the log.

    Example:
        dynid.validate("out/kuka_lwr4plus", "run2.bag", cutoff=5)
    """
    options, progress = (
        arguments.options(ValidateOptions, options, changes),
        arguments.progress(progress),
    )
    result = as_result(result)
    log = as_log(log, result.robot, options)
    refuse_training_log(result, log.sha256, str(log.source or "log"), options)
    base = as_base_model(base) or base_model_of(result)
    theta = result.theta
    options = replace(
        options,
        cutoff=result.cutoff if options.cutoff is None else options.cutoff,
        delay=result.delay if options.delay is None else options.delay,
    )
    checked = checked_log(log, base.robot, options, identify=False)
    check_weight(checked, base.robot)
    replayed = scaled(condition_logs([checked], base.model, options, progress), base, theta)[0]
    progress.stage("replay")
    observer = base.model.observer(base.reduction.base)
    rows = rows_of(replayed, observer)
    error = None if options.residual_model is False else result.model_error
    motion = prediction.predict(replayed, rows, theta, error, observer)
    again = any(same_motion(fitted, log_motion(replayed)) for fitted in result.motions)
    expected = expected_on(result, error, replayed, rows, observer)
    baseline, what = baseline_torque(base, result, rows, motion)
    joints, total = prediction.check(motion, baseline, base.robot.joint_names)
    where = str(log.source or log.name)
    cutoff, start = replayed.filter.cutoff, int(log.extra.get("start_ns", 0))
    return Validation(
        base.robot,
        where,
        log.sha256,
        tuple(joints),
        total,
        what,
        motion,
        cutoff,
        expected,
        again,
        start,
        fingerprint(result),
        evidence_of(result),
    )


def urdf_of(result: Identification, base: BaseModel) -> str:
    """Return the URDF of an arm with its identified bodies, for viewers: also where no body has the parameters."""
    return FORMATS["urdf"].text(identified_arm(result, ("urdf",), ExportOptions(), base))


def refuse_training_log(
    result: Identification, sha256: str, where: str, options: ValidateOptions
) -> None:
    """Refuse a recording that the result was identified from.

    Raises:
        SameRecording: it was, and training data are not allowed.
    """
    if sha256 and sha256 in result.log_sha256 and not options.allow_training_data:
        raise SameRecording(f"{where} was used to identify {result.path}", where=where)


def expected_on(
    result: Identification,
    error: ModelError | None,
    log: ConditionedLog,
    rows: Rows,
    observer: Observer,
) -> float | None:
    """Return the relative error that the posterior expects on rows of a log [%]; None where it expects nothing."""
    import numpy as np

    if result.expected is None or not np.isfinite(result.std_error).all():
        return None
    shapes = None if error is None else shapes_in(log, observer, error.speed)
    spread = torque_variance(rows.W, result.covariance, error, shapes)
    variance = float(np.sum((spread + result.expected.noise**2)[rows.use]))
    torque = float(np.sum(rows.tau[rows.use] ** 2))
    return float(100.0 * np.sqrt(variance / torque)) if torque else None


def baseline_torque(
    base: BaseModel,
    result: Identification,
    rows: Rows,
    motion: EstimatedMotion,
) -> tuple[NDArray[np.float64], str]:
    """Return what a simpler model predicts, (M, n) [N m]: the prior of the robot file, else a constant torque."""
    import numpy as np

    if base.robot.prior is None:
        return np.broadcast_to(
            motion.tau_measured.mean(axis=0), motion.tau_measured.shape
        ), "a constant torque"
    prior = np.nan_to_num(result.prior)
    return rows.torque(prior), "the prior of the robot file"
