"""Replay a log that was not used to identify, and compare predicted with measured torques."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.answer import Answer, Facts, Judged, judged, picked
from dynid.arguments import public
from dynid.arrays import Floats
from dynid.errors import LogTooShort, SameRecording
from dynid.estimation import prediction
from dynid.estimation.estimate import log_motion
from dynid.estimation.evidence import evidence_of, fingerprint, here
from dynid.estimation.prediction import EstimatedMotion, JointCheck
from dynid.estimation.residual_model import ModelError, shapes_in, torque_variance
from dynid.estimation.result import Identification
from dynid.estimation.rows import Rows, rows_of
from dynid.estimation.stack import Stack, scaled
from dynid.exporters import FORMATS
from dynid.files.artifact import read_header
from dynid.files.convert import write_replay
from dynid.judgement.evidence import Evidence, Unseen
from dynid.loading import (
    LogLike,
    ResultLike,
    as_log,
    as_result,
    check_weight,
    checked_log,
)
from dynid.progress import Progress, stage
from dynid.reports.figures import motion_figure, write_motion_figures
from dynid.robot import Robot
from dynid.runs import RunFolder
from dynid.signals.conditioned_log import condition_logs
from dynid.signals.motion import same_motion
from dynid.table import Table
from dynid.workflows.export import identified_arm
from dynid.workflows.options import ValidateOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure


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
        broken: limits of the options that are not met, in words.
    """

    robot: Robot
    log: str
    log_sha256: str
    joints: tuple[JointCheck, ...]
    relative_error_percent: float
    baseline: str
    motion: EstimatedMotion
    cutoff: float
    expected_percent: float | None
    same_motion: bool
    start_ns: int
    of: str
    known: Evidence
    broken: tuple[str, ...]

    @property
    def title(self) -> str:
        """Arm and log."""
        return f"{self.robot.name}, {Path(self.log).name}"

    @property
    def unseen(self) -> Unseen:
        """What it says of the model."""
        errors = zip(self.joints, self.robot.shown_gains, strict=True)
        return Unseen(
            name=Path(self.log).name,
            percent=self.relative_error_percent,
            rms=tuple(joint.rms / gain for joint, gain in errors),
            same_motion=self.same_motion,
            expected=self.expected_percent,
            replayed=True,
            log=self.log,
        )

    @property
    def evidence(self) -> Evidence:
        """What is known of the model with this log."""
        seen = replace(self.unseen, log=here(self.log))
        earlier = tuple(each for each in self.known.unseen if each.log != seen.log)
        return replace(self.known, asked="replay", unseen=(*earlier, seen))

    def table(self) -> Table:
        """Return one row per joint: rms error and rms torque [N m, N or A], relative error [%], and the baseline."""
        return Table(
            [
                {
                    "joint": each.joint,
                    "rms error": each.rms / gain,
                    "torque rms": each.torque_rms / gain,
                    "error %": each.relative_percent,
                    "rms of baseline": each.baseline_rms / gain,
                    "unit": known.unit,
                }
                for each, gain, known in zip(
                    self.joints, self.robot.shown_gains, self.known.joints, strict=True
                )
            ]
        )

    def answer(self) -> Answer:
        """Return what ``dynid validate`` answers."""
        text = (
            f"total relative error {self.relative_error_percent:.2f} %; baseline: {self.baseline}"
        )
        return replace(judged(self.judgement, self.facts(), self.table(), text), limits=self.broken)

    def plot_residual(self, joint: int | str) -> Figure:
        """Return a figure of what the model leaves of the torque of one joint.

        Args:
            joint: number from 1, or name.

        Raises:
            WrongUsage: there is no such joint.
        """
        joints = (self.robot.joint_name(joint),)
        return motion_figure(self.motion, self.robot, joints, self.title, residual_only=True)

    def facts(self) -> Facts:
        """Return what the JSON answer of ``dynid validate`` says."""
        return {
            "robot": self.robot.name,
            **picked(self, "relative_error_percent", "same_motion", "baseline"),
            **picked(self, expected_relative_error_percent="expected_percent", cutoff_hz="cutoff"),
            "joints": [joint.facts(self.robot) for joint in self.joints],
            "judgement": self.judgement.facts(),
            "passed": not self.broken,
        }

    def folder(self, parent: Path) -> Path:
        """Return where its files go: named after the log, and after its hash where another log has that name."""
        name, own = Path(self.log).stem, [self.log_sha256]
        other = read_header(RunFolder(parent / name).motion).get("log_sha256", own) != own
        return parent / (f"{name}_{self.log_sha256[:8]}" if other else name)

    def save(self, folder: Path) -> Path:
        """Write estimatedmotion.npz."""
        path = RunFolder(folder).motion
        header = {
            "robot": self.robot.name,
            "joints": self.robot.joint_names,
            "log_sha256": [self.log_sha256],
            "torque_from": "identified",
            "unseen": asdict(self.unseen),
            "of": self.of,
        }
        prediction.save(path, self.motion, header)
        return path

    def save_mcap(self, path: Path, urdf: str) -> Path:
        """Write measured, predicted and residual motion and torques for Foxglove, PlotJuggler and Rerun.

        Args:
            path: the MCAP file.
            urdf: text of the arm's URDF, with the robot file's joint names and angles.

        Raises:
            CannotWrite: the file cannot be written.
        """
        m = self.motion
        torque = np.where(m.usable, m.tau_estimated, np.nan)
        topics = {
            "/measured/joint_states": (m.q_measured, m.qd_measured, m.tau_measured),
            "/predicted/joint_states": (m.q_estimated, m.qd_estimated, torque),
            "/residual/joint_states": (
                m.q_measured - m.q_estimated,
                m.qd_measured - m.qd_estimated,
                m.tau_measured - torque,
            ),
        }
        stamps = self.start_ns + np.round(m.t * 1e9).astype(np.int64)
        return write_replay(path, stamps, self.robot.joint_names, topics, urdf)

    def write_figures(self, folder: Path) -> list[Path]:
        """Draw measured and estimated motion and torques of each joint."""
        return write_motion_figures(folder, self.motion, self.robot, self.title)


@public
def validate(
    result: ResultLike,
    log: LogLike,
    options: ValidateOptions = ValidateOptions(),
    *,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Validation:
    """Compare predicted with measured torques on a recording that the model has not seen.

    Args:
        result: identified parameters, their folder or their file.
        log: the recording, or its path.
        options: how it is checked and filtered.
        progress: reports how far the work is.
        changes: single options by name, such as ``cutoff=5``; see ``dynid.ValidateOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).
        SameRecording: the result was identified from this log.
        DynidError: the first serious fault of the log.

    Example:
        dynid.validate("out/kuka_lwr4plus", "run2.bag", cutoff=5)
    """
    result = as_result(result)
    log = as_log(log, result.robot, options)
    where = str(log.source or log.name)
    if log.sha256 and log.sha256 in result.log_sha256 and not options.allow_training_data:
        raise SameRecording(f"{where} was used to identify {result.path}", where=where)
    base, known = result.base, evidence_of(result)
    delay = result.delay if options.delay is None else options.delay
    options = replace(options, cutoff=options.cutoff or result.cutoff, delay=delay)
    checked = checked_log(log, base.robot, options, identify=False)
    check_weight(checked, base.robot)
    (replayed,) = scaled(condition_logs([checked], base.model, options), base, result.theta)
    stage("replay")
    rows = rows_of(replayed, base.observer)
    error = None if options.residual_model is False else result.model_error
    motion = prediction.predict(Stack(base, (replayed,), rows), result.theta, error)
    if not motion.usable.any():
        raise LogTooShort(f"{where} has no sample in motion: there is nothing to predict")
    columns = rows.W
    if error is not None:
        columns = error.columns(rows.W, shapes_in(replayed, base.observer, error.speed))
    simpler, baseline = rows.torque(np.nan_to_num(result.prior)), "the prior of the robot file"
    if base.robot.prior is None or base.robot.torque.relative:
        measured, baseline = motion.tau_measured, "a constant torque"
        simpler = np.broadcast_to(measured.mean(axis=0), measured.shape)
    joints, total = prediction.check(motion, simpler, base.robot.joint_names)
    return Validation(
        robot=base.robot,
        log=where,
        log_sha256=log.sha256,
        joints=tuple(joints),
        relative_error_percent=total,
        baseline=baseline,
        motion=motion,
        cutoff=replayed.filter.cutoff,
        expected_percent=_expected(result, rows, error, columns),
        same_motion=any(same_motion(one, log_motion(replayed)) for one in result.motions),
        start_ns=int(log.extra.get("start_ns", 0)),
        of=fingerprint(result),
        known=known,
        broken=tuple(_broken(joints, total, options, base.robot, known)),
    )


def _broken(
    joints: Sequence[JointCheck],
    total: float,
    options: ValidateOptions,
    robot: Robot,
    known: Evidence,
) -> Iterator[str]:
    """Yield limits that errors of joints, as they are shown, and the total error [%] do not meet."""
    most, share = options.max_rms, options.max_unexplained
    for joint, gain, own in zip(joints, robot.shown_gains, known.joints, strict=True):
        if most is not None and joint.rms / gain > most:
            yield f"{joint.joint}: rms error {joint.rms / gain:.3g} {own.unit} > {most:g}"
    if share is not None and total > 100 * share:
        yield f"total relative error {total:.2f} % > {100 * share:g} %"


def _expected(
    result: Identification, rows: Rows, error: ModelError | None, columns: Floats
) -> float | None:
    """Return the relative error that the posterior of a result expects on rows [%]; None without one."""
    torque = np.sum(rows.tau[rows.use] ** 2)
    if not np.isfinite(result.std_error).all() or not torque:
        return None
    spread = torque_variance(columns, result.covariance, error)
    errors = (spread + result.expected.noise**2)[rows.use]
    return float(100.0 * np.sqrt(errors.sum() / torque))


def urdf_of(result: Identification) -> str:
    """Return the URDF of an arm with its identified bodies, for viewers: also where no body has the parameters."""
    return FORMATS["urdf"].text(identified_arm(result, ("urdf",)))
