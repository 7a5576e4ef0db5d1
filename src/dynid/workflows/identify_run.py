"""All that ``dynid identify`` does in a folder: gains, a result or the one that is there, load."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from dynid.disk import write_text
from dynid.errors import Finding, WrongUsage
from dynid.estimation.drive_gains import Gains
from dynid.estimation.payload import IdentifiedPayload
from dynid.estimation.result import Identification
from dynid.loading import load_run, read_log
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.progress import SILENT, Progress
from dynid.robot import Robot
from dynid.text import yaml_text
from dynid.workflows.drive_gains import (
    find_drive_gains,
    gain_facts,
    needs_gains,
    write_robot,
)
from dynid.workflows.identify import find_payload, identify, resolved
from dynid.workflows.inputs import identify_inputs, of_observations
from dynid.workflows.model import base_model
from dynid.workflows.options import Extras, IdentifyOptions
from dynid.workflows.parameters import load_observations, observe
from dynid.workflows.results import answer_of, save_result


@dataclass(frozen=True)
class IdentifyRun:
    """What an identification found and wrote in its folder.

    Attributes:
        result: the result, new or the one that was there.
        base: its base model.
        inputs: what it depends on.
        wrote: files of the result; () where it was there.
        beside: other files.
        gains: gains of the drives, where the logs hold currents and not all were known.
        payload: the load, where a result without it was given; payload.yaml is the last of ``beside`` then.
    """

    result: Identification
    base: BaseModel
    inputs: dict[str, str]
    wrote: tuple[Path, ...]
    beside: tuple[Path, ...]
    gains: Gains | None = None
    payload: IdentifiedPayload | None = None

    @property
    def folder(self) -> Path:
        """Where it lies."""
        return self.result.path.parent

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid identify`` says."""
        keys = ("delay_s", "delay_std_error_s", "delay_applied_s")
        facts = {
            **answer_of(self.result),
            "wrote": list(self.wrote),
            **{key: self.result.header.get(key) for key in keys},
            **(gain_facts(self.base.robot, self.gains) if self.gains else {}),
            "folder": self.folder,
            "inputs": self.inputs,
        }
        if self.payload is not None:
            facts["wrote"].append(self.beside[-1])
            facts["payload"] = self.payload.facts()
            facts["findings"] += map(asdict, self.payload.findings())
        return facts


@dataclass(frozen=True)
class _Logs:
    """The logs of a run, read from disk when they are first needed."""

    robot: Robot
    paths: Sequence[Path]
    options: IdentifyOptions
    progress: Progress

    @cached_property
    def read(self) -> list[Log]:
        """The logs as read."""
        self.progress.stage("read")
        return [read_log(path, self.robot, self.options) for path in self.paths]


def identify_run(
    robot: Robot,
    paths: Sequence[Path],
    options: IdentifyOptions,
    folder: Path,
    extras: Extras = Extras(),
    *,
    models: Path,
    may_write: Callable[[Path, Mapping[str, str]], bool] = lambda path, inputs: True,
    header: Callable[[Mapping[str, str]], dict[str, Any]],
    progress: Progress = SILENT,
) -> IdentifyRun:
    """Identify in a folder: with equal inputs the result that is there is the answer.

    Args:
        robot: the arm.
        paths: recordings; () for the observations that ``dynid parameters`` wrote.
        options: how to identify.
        folder: of the results.
        extras: what is asked besides.
        models: where the model is kept.
        may_write: tells whether a file may be written, given what it is made from; False keeps the one that is there.
        header: makes the facts of every header from the inputs.
        progress: reports how far the work is.

    Raises:
        WrongUsage: an option needs a log, or a load is given for logs that need none.
        DynidError: a log is unfit, or determines fewer parameters than the arm has.
    """
    both = (extras.payload_from, extras.update)
    unloaded, earlier = (load_run(path) if path else None for path in both)
    robot, options = resolved(robot, options, unloaded or earlier)
    logs = _Logs(robot, paths, options, progress)
    beside = []
    gains = _gains(logs, extras, models)
    if gains is not None:
        written, robot = write_robot(folder, robot, gains)
        beside.append(written)
    files = {"loaded": extras.loaded, "prior_file": options.prior, "holdout": options.holdout}
    files["update"] = earlier.path if earlier else None
    inputs = identify_inputs(robot, folder, paths, options, files, extras.load_mass)
    base, path = base_model(robot, models, progress), folder / "parameters.npz"
    updated = earlier is not None and path.exists() and path.samefile(earlier.path)
    wrote: list[Path] = []
    if not updated and not may_write(path, inputs):
        result = _stored(path, base, progress)
    else:
        if paths:
            seen = observe(robot, logs.read, options, base=base, progress=progress)
            beside.append(seen.save_stack(folder, header(of_observations(inputs))))
        else:
            seen = load_observations(folder / "fullnumericregressor.npz", base, progress)
        result = identify(robot, seen, options, update=earlier, progress=progress)
        wrote = save_result(folder, result, header(inputs))
    result = replace(result, path=path)
    payload = None
    if unloaded is not None:
        payload = find_payload(_with_rows(result, base, logs), unloaded)
        beside.append(_write_payload(folder / "payload.yaml", payload))
    return IdentifyRun(result, base, inputs, tuple(wrote), tuple(beside), gains, payload)


def _stored(path: Path, base: BaseModel, progress: Progress) -> Identification:
    """Return the result that is there, with the model that a result would derive, and say what was noticed."""
    result = replace(load_run(path), rigid=base.model.rigid)
    noticed = (Finding(**each) for each in result.header.get("log_findings", []))
    progress.findings((*noticed, *result.findings))
    return result


def _gains(logs: _Logs, extras: Extras, folder: Path) -> Gains | None:
    """Return the gains of the drives where the logs hold currents and not all gains are known."""
    robot, options = logs.robot, logs.options
    if robot.torque.complete or not logs.paths or not needs_gains(robot, logs.read[0]):
        if extras.loaded:
            what = "--loaded is for logs of motor currents with unknown gains; these logs have torques or known gains"
            raise WrongUsage(what, fix="to identify a load: --payload-from RESULT")
        return None
    return find_drive_gains(
        robot,
        logs.read,
        options,
        loaded=read_log(extras.loaded, robot, options) if extras.loaded else None,
        load_mass=extras.load_mass,
        folder=folder,
        progress=logs.progress,
    )


def _with_rows(result: Identification, base: BaseModel, logs: _Logs) -> Identification:
    """Return a result with the rows that it was made from, which its file does not keep."""
    if result.stack is not None or not logs.paths:
        return result
    options = replace(logs.options, cutoff=result.cutoff, delay=result.delay)
    seen = observe(result.robot, logs.read, options, base=base, progress=logs.progress)
    return replace(result, stack=seen.stack)


def _write_payload(path: Path, payload: IdentifiedPayload) -> Path:
    """Write what `tool:` of a robot file holds."""
    body = {"mass": payload.body.mass, "com": list(payload.body.com)}
    inertia = payload.facts()["inertia_com_kg_m2"]
    write_text(path, yaml_text({"tool": {**body, "inertia_com": inertia}}))
    return path
