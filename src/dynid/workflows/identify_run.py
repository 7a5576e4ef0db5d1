"""All that ``dynid identify`` does in a folder: gains, a result or the one that is there, load."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

from dynid.disk import sha256, write_text
from dynid.errors import Finding, WrongUsage
from dynid.estimation.drive_gains import Gains
from dynid.estimation.payload import IdentifiedPayload
from dynid.estimation.result import Identification
from dynid.loading import load_run, read_log
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.progress import notice, stage
from dynid.robot import Robot
from dynid.text import yaml_text
from dynid.workflows.drive_gains import find_drive_gains, gain_facts, needs_gains, write_robot
from dynid.workflows.identify import answer_of, find_payload, identify, resolved, save_result
from dynid.workflows.model import base_model
from dynid.workflows.options import Extras, IdentifyOptions
from dynid.workflows.parameters import STACK, load_observations, log_inputs, observe, stored_key

#: Options of reading and filtering: without logs they are those of the stored observations.
READING = ("cutoff", "velocity", "exclude", "delay", "topic", "rate", "sort_time")


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
        delays = ("delay_s", "delay_std_error_s", "delay_applied_s")
        facts = {
            **answer_of(self.result),
            "wrote": list(self.wrote),
            **{key: self.result.header.get(key) for key in delays},
            **(gain_facts(self.base.robot, self.gains) if self.gains else {}),
            "folder": self.folder,
            "inputs": self.inputs,
        }
        if self.payload is not None:
            facts["wrote"].append(self.beside[-1])
            facts["payload"] = self.payload.facts()
            facts["findings"] += map(asdict, self.payload.findings())
        return facts


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

    Raises:
        WrongUsage: an option needs a log, or a load is given for logs that need none.
        DynidError: a log is unfit, or determines fewer parameters than the arm has.
    """
    unloaded = load_run(extras.payload_from) if extras.payload_from else None
    earlier = load_run(extras.update) if extras.update else None
    arm, options = resolved(robot, options, unloaded or earlier)

    @cache
    def logs() -> list[Log]:
        stage("read")
        return [read_log(path, arm, options) for path in paths]

    beside, wrote, payload = [], [], None
    gains, robot = _gains(arm, logs if paths else list, options, extras, models), arm
    if gains is not None:
        written, robot = write_robot(folder, arm, gains)
        beside.append(written)
    inputs = _inputs(robot, folder, paths, options, extras, earlier)
    base, path = base_model(robot, models), folder / "parameters.npz"
    updated = earlier is not None and path.exists() and path.samefile(earlier.path)
    if not updated and not may_write(path, inputs):
        result = _stored(path, base)
    else:
        if paths:
            seen = observe(robot, logs(), options, base=base)
            own = {
                k: text
                for k, text in inputs.items()
                if k in ("robot", *READING) or k.startswith("log ")
            }
            beside.append(seen.save_stack(folder, header(own)))
        else:
            seen = load_observations(folder / STACK, base)
        result = identify(robot, seen, options, update=earlier)
        wrote = save_result(folder, result, header(inputs))
    if unloaded is not None:
        rows = _with_rows(result, base, logs, options) if paths else result
        payload = find_payload(rows, unloaded)
        beside.append(_write_payload(folder, payload))
    result = replace(result, path=path)
    return IdentifyRun(result, base, inputs, tuple(wrote), tuple(beside), gains, payload)


def _stored(path: Path, base: BaseModel) -> Identification:
    """Return the result that is there, with the model that a result would derive, and say what was noticed."""
    result = replace(load_run(path), rigid=base.model.rigid)
    noticed = (Finding(**each) for each in result.header.get("log_findings", []))
    notice((*noticed, *result.findings))
    return result


def _with_rows(
    result: Identification,
    base: BaseModel,
    logs: Callable[[], list[Log]],
    options: IdentifyOptions,
) -> Identification:
    """Return a result with the rows that it was made from, which its file does not keep."""
    if result.stack is not None:
        return result
    options = replace(options, cutoff=result.cutoff, delay=result.delay)
    seen = observe(result.robot, logs(), options, base=base)
    return replace(result, stack=seen.stack)


def _inputs(
    robot: Robot,
    folder: Path,
    logs: Sequence[Path],
    options: IdentifyOptions,
    extras: Extras,
    earlier: Identification | None,
) -> dict[str, str]:
    """Return what an identification depends on; without logs, on the observations that are in its folder.

    Raises:
        WrongUsage: the stored observations were read with other options.
    """
    texts = {key: value for key, value in options.texts().items() if key != "prior"}
    if extras.load_mass:
        texts["load_mass"] = repr(extras.load_mass)
    files = {
        "loaded": extras.loaded,
        "prior_file": options.prior,
        "holdout": options.holdout,
        "update": earlier and earlier.path,
    }
    hashed = {
        key: sha256(path) for key, path in files.items() if isinstance(path, Path) and path.exists()
    }
    if logs:
        return log_inputs(robot, logs) | texts | hashed
    path, default = folder / STACK, IdentifyOptions().texts()
    inputs = dict(stored_key(path, robot).get("inputs", {}))
    for name in READING:
        text = texts.pop(name, None)
        if text not in (inputs.get(name), default.get(name)):
            raise WrongUsage(
                f"{name} is {inputs.get(name) or 'not set'} in {path}, not {text}",
                why="without logs, the stack that dynid parameters wrote is used as it is",
                fix=f"name the logs: dynid identify {robot.word} LOG --{name.replace('_', '-')} {text}",
            )
    return inputs | texts | hashed


def _gains(
    robot: Robot,
    logs: Callable[[], list[Log]],
    options: IdentifyOptions,
    extras: Extras,
    folder: Path,
) -> Gains | None:
    """Return the gains of the drives where the logs hold currents and not all gains are known."""
    if robot.torque.complete or not any(needs_gains(robot, log) for log in logs()[:1]):
        if extras.loaded:
            what = "--loaded is for logs of motor currents with unknown gains; these logs have torques or known gains"
            raise WrongUsage(what, fix="to identify a load: --payload-from RESULT")
        return None
    return find_drive_gains(
        robot,
        logs(),
        options,
        loaded=read_log(extras.loaded, robot, options) if extras.loaded else None,
        load_mass=extras.load_mass,
        folder=folder,
    )


def _write_payload(folder: Path, payload: IdentifiedPayload) -> Path:
    """Write what `tool:` of a robot file holds."""
    body = {"mass": payload.body.mass, "com": list(payload.body.com)}
    inertia = payload.facts()["inertia_com_kg_m2"]
    write_text(folder / "payload.yaml", yaml_text({"tool": {**body, "inertia_com": inertia}}))
    return folder / "payload.yaml"
