"""From logs to the stacked observation matrix, before anything is identified (Paper Eq. 23); gains of drives."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from dynid.answer import Answer, Answered, Facts, picked
from dynid.arguments import one_thread, public
from dynid.disk import sha256, write_text
from dynid.errors import Finding, LogNotFound, WrongUsage
from dynid.estimation import prediction
from dynid.estimation.drive_gains import Gains, find_gains, known_load
from dynid.estimation.estimate import weakly_excited
from dynid.estimation.friction_step import with_coulomb, with_estimated_step
from dynid.estimation.least_squares import merge, solve
from dynid.estimation.stack import (
    SCHEMA,
    Stack,
    load_logs,
    on_time,
    settled,
    stack_logs,
)
from dynid.files.artifact import read_artifact, read_header, reading, unpacked
from dynid.files.robotfile import robot_text
from dynid.loading import (
    LogsLike,
    RobotLike,
    as_logs,
    as_robot,
    checked_log,
    load_robot,
    read_log,
)
from dynid.log import Log
from dynid.model.base_model import BaseModel, in_memory
from dynid.options import LogOptions
from dynid.progress import Progress, notice, stage
from dynid.robot import Coulomb, Robot, TorqueSource
from dynid.runs import RunFolder
from dynid.signals.columns import in_amperes as holds_currents
from dynid.signals.conditioned_log import condition_logs
from dynid.signals.motion import check_amount
from dynid.signals.stamps import without_copies
from dynid.workflows.model import base_model
from dynid.workflows.options import IdentifyRunOptions


@dataclass(frozen=True, repr=False)
class Observations(Answered):
    """Logs stacked for one arm, ready to be identified from.

    Attributes:
        stack: the stacked rows, as triangular factors.
        delay: the estimated delay of the torques and its standard error [s], None when nobody asked.
        findings: what was noticed in the logs.
        checked: the checked logs, for questions about the robot file; () when read from a file.
    """

    stack: Stack
    delay: tuple[float, float] | None = None
    findings: tuple[Finding, ...] = ()
    checked: tuple[Log, ...] = ()

    @property
    def base(self) -> BaseModel:
        """Model and base parameters."""
        return self.stack.base

    @property
    def applied_delay(self) -> float:
        """By how much the torques were moved back [s]."""
        return self.stack.logs[0].delay

    @property
    def cutoff(self) -> float:
        """Cut-off of the filter over torques and columns [Hz]."""
        return self.stack.logs[0].filter.cutoff

    def header(self) -> Facts:
        """Return what the headers of results made from these observations say."""
        robot, coulomb = self.base.robot, self.base.robot.estimated_coulomb
        return {
            **picked(robot, robot="name", key="model_key"),
            "log_sha256": [log.sha256 for log in self.stack.logs],
            "logs": [log.path for log in self.stack.logs],
            **picked(self.stack.logs[0].filter, kept_rate_hz="kept_rate", cutoff_hz="cutoff"),
            "log_findings": [asdict(finding) for finding in self.findings],
            "delay_s": self.delay[0] if self.delay else self.applied_delay or None,
            "delay_std_error_s": self.delay[1] if self.delay else None,
            "delay_applied_s": self.applied_delay,
            "coulomb": None if coulomb is None else asdict(coulomb),
        }

    def facts(self) -> Facts:
        """Return what the JSON answer of ``dynid parameters`` says."""
        solution, header = solve(merge(self.stack.factors)), self.header()
        return {
            **{
                key: header[key]
                for key in (
                    "robot",
                    "cutoff_hz",
                    "kept_rate_hz",
                    "delay_s",
                    "delay_std_error_s",
                    "delay_applied_s",
                )
            },
            "samples": self.stack.samples,
            "rate_hz": self.stack.logs[0].filter.rate,
            **picked(solution, "rank", "condition_number", "condition_number_scaled"),
            "structural_rank": self.base.rank,
            "findings": [*self.findings, *weakly_excited(self.stack)],
        }

    def answer(self) -> Answer:
        """Return what ``dynid parameters`` answers."""
        facts = self.facts()
        ranks = f"rank {facts['rank']} of {facts['structural_rank']}"
        condition = (
            f"condition number {facts['condition_number_scaled']:.3g} with normalised columns"
        )
        note = "excites", f"{ranks}, {condition}"
        return Answer(facts, parts=weakly_excited(self.stack), notes=(note,))

    def save(self, folder: Path, facts: Facts | None = None) -> list[Path]:
        """Write fullnumericregressor.npz and, with the torques of the prior, estimatedmotion.npz.

        Args:
            folder: where to.
            facts: further facts for the headers, such as the inputs that they depend on.
        """
        motion = RunFolder(folder).motion
        prior = self.base.prior(unknown=0.0)
        words = "the prior; dynid identify puts the identified torque here"
        header = {"joints": self.stack.joints, "torque_from": words}
        predicted = prediction.predict(self.stack, prior)
        wrote = self.save_stack(folder, facts)
        prediction.save(motion, predicted, {**(facts or {}), **self.header(), **header})
        return [wrote, motion]

    def save_stack(self, folder: Path, facts: Facts | None = None) -> Path:
        """Write fullnumericregressor.npz alone."""
        path = RunFolder(folder).stack
        self.stack.save(path, {**(facts or {}), **self.header()})
        return path


@public
def observe(
    robot: RobotLike,
    logs: LogsLike,
    options: LogOptions = LogOptions(),
    *,
    base: BaseModel | None = None,
    drop_weak: bool = False,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Observations:
    """Filter logs, stack the base regressor over them, and correct the delay of the torques when it is clear.

    Args:
        robot: the arm, its name, or the path of its file.
        logs: one or several logs, or their paths.
        options: how they are checked and filtered.
        base: the arm's base model, where it is there already.
        drop_weak: take logs that are short, or in which a joint stands still.
        progress: reports how far the work is.
        changes: single options by name, such as ``cutoff=8``; see ``dynid.LogOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).
        DynidError: the first serious fault of a log.

    Example:
        dynid.observe("kuka_lwr4plus", ["run1.bag", "run2.bag"])
    """
    robot = as_robot(robot)
    several = as_logs(logs, robot, options)
    if base is None:
        stage("model")
        base = in_memory(robot)
    base = with_coulomb(base, robot.estimated_coulomb)
    alone = len(several) == 1
    given = [
        checked_log(log, base.robot, options, identify=alone and not drop_weak) for log in several
    ]
    few = () if alone or drop_weak else check_amount(given, base.robot)
    checked, copies = without_copies(given)
    notice((*few, *copies))
    stack = stack_logs(condition_logs(checked, base.model, options), base)
    noticed = [finding for log in stack.logs for finding in log.findings]
    stack = settled(stack)
    delay: tuple[float, float] | None = None
    late: Sequence[Finding] = ()
    if base.robot.coulomb is None and base.robot.estimated_coulomb is None:
        stack = with_estimated_step(stack, checked)
    if options.delay is None:
        stack, delay, late = on_time(stack)
    return Observations(stack, delay, (*noticed, *late, *few, *copies), tuple(given))


@one_thread
def load_observations(path: Path, base: BaseModel) -> Observations:
    """Read what ``Observations.save`` wrote for this arm.

    Raises:
        NotAnArtifact: it is damaged, or not there.
        JointCountDiffers: it is of another arm.
    """
    conditioned, header = load_logs(path)
    base.robot.require_joints(header["joints"], path)
    stage("log", f"from {path}: {', '.join(log.path for log in conditioned)}")
    with reading(path):
        base = with_coulomb(base, unpacked(Coulomb | None, header["coulomb"], {}))
        error = header["delay_std_error_s"]
        delay = None if error is None else (float(header["delay_s"]), error)
        findings = unpacked(tuple[Finding, ...], header["log_findings"], {})
        stack = settled(stack_logs(conditioned, base))
    return Observations(stack, delay, findings)


def stored_key(path: Path, robot: Robot) -> Facts:
    """Return the header of fullnumericregressor.npz of an arm.

    Raises:
        LogNotFound: the file is not there, or belongs to another version of the robot file.
        NotAnArtifact: it is damaged.
    """
    if not path.is_file():
        raise LogNotFound(
            f"no log given, and there is no {path}", fix=f"dynid identify {robot.word} LOG"
        )
    header = read_header(path) or dict(read_artifact(path, SCHEMA).header)
    if header.get("key") != robot.model_key:
        what = f"{path} belongs to another version of the robot file"
        raise LogNotFound(what, fix=f"dynid parameters {robot.word} LOG")
    return header


def log_inputs(robot: Robot, logs: Sequence[Path]) -> dict[str, str]:
    """Return the hashes of robot and logs, which results depend on.

    Raises:
        LogNotFound: a log is not there.
    """
    for log in logs:
        if not log.exists():
            read_log(log, robot)  # ends with the message that a missing log gets
    hashes = {f"log {k}": sha256(log) for k, log in enumerate(logs, start=1)}
    return {"robot": robot.model_key, **hashes}


def gains_of(
    robot: Robot,
    logs: Sequence[Log],
    options: IdentifyRunOptions,
    folder: Path,
) -> Gains | None:
    """Return the gains of all drives [N m per A] where logs hold currents and not all gains are known.

    Args:
        robot: the arm; gains that it knows stay as they are.
        logs: the logs as they were recorded.
        options: how they are checked and filtered; a further log with a body of known mass on the last link, and that
            mass; the robot file's tool without.
        folder: where the model is kept.

    Raises:
        WrongUsage: the gains cannot be found for this arm, or a load is given for logs that need none.
    """
    current, loaded = robot.torque.source == "motor_current", options.loaded
    if robot.torque.complete or not any(current or holds_currents(log, robot) for log in logs[:1]):
        if loaded:
            what = "--loaded is for logs of motor currents with unknown gains; these logs have torques or known gains"
            raise WrongUsage(what, fix="to identify a load: --payload-from RESULT")
        return None
    if robot.coupling is not None or robot.identified_links != tuple(range(1, robot.n + 1)):
        raise WrongUsage(
            "gains cannot be found with coupled motors or with some links only",
            fix="give them in the robot file: `torque: {source: motor_current, gain: [...]}`",
        )
    given = [*logs, *([read_log(loaded, robot, options)] if loaded else [])]
    robot = replace(robot, torque=replace(robot.torque, source="motor_current"))
    base = base_model(robot, folder)
    known = np.array(robot.torque.gain or (None,) * robot.n, dtype=float)
    checked = [checked_log(log, robot, options) for log in given]
    conditioned, load = condition_logs(checked, base.model, options), None
    if loaded:
        load = known_load(base, stack_logs([conditioned.pop()], base), options.load_mass)
    return find_gains(stack_logs(conditioned, base), known, load, robot.torque.scale_error)


def write_robot(folder: Path, robot: Robot, gains: Gains) -> tuple[Path, Robot]:
    """Write a robot file of the arm with the gains, and return its path and the robot in it."""
    # Why: what a load weighs with these gains is as uncertain as they are.
    share = min(0.99, float(np.sqrt(np.mean((gains.std_error / gains.gain) ** 2))))
    error = None if gains.relative else float(f"{share:.2g}")
    gain = tuple(float(f"{value:.9g}") for value in gains.gain)
    torque = TorqueSource("motor_current", gain, gains.relative, gain_error=error)
    path = folder / f"{robot.slug}.yaml"
    what = "ratios of the gains; their size is unknown" if gains.relative else "gains"
    head = f"Made by dynid identify: {robot.path.name if robot.path else robot.name} with {what}."
    write_text(path, robot_text(replace(robot, torque=torque), head))
    return path, load_robot(path)


def gain_facts(robot: Robot, gains: Gains) -> Facts:
    """Return the gains for JSON; where only their ratios are known, these, with a mean of 1."""
    pairs = zip(robot.joint_names, gains.gain.tolist(), gains.std_error.tolist(), strict=True)
    rows = [
        {"joint": joint, "gain_nm_per_a": gain, "std_error": error} for joint, gain, error in pairs
    ]
    return {"gains": rows, "gains_relative": gains.relative}


def torque_unit(robot: Robot) -> str:
    """Return the unit of torques; both where joints turn and slide."""
    if robot.torque.relative:
        return "A"
    return " or ".join(dict.fromkeys(joint.torque_unit for joint in robot.joints))
