"""Logs of motor currents: gains found before anything is identified, answers in amperes where nothing tells them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.log_options import base_model, read_sources, reading_of, stack_sources
from dynid.cli.options import Common
from dynid.errors import WrongUsage

if TYPE_CHECKING:
    from dynid.estimation.drive_gains import Gains, Load
    from dynid.estimation.stack import Stack
    from dynid.model.store import BaseModel
    from dynid.robot import Robot

#: Relative standard error of a gain from which on it is called uncertain.
UNCERTAIN = 0.1


def with_gains(
    common: Common, robot: Robot, folder: Path, logs: tuple[Path, ...], options: dict[str, Any]
) -> tuple[Robot, dict[str, Any]]:
    """Return the robot with all gains, found from the logs where they are not known, and what to add to the answer.

    Raises:
        WrongUsage: a load is given for logs that need none, or the gains cannot be found for this arm.
    """
    if robot.torque.complete or not logs or not currents(robot, logs[0], options):
        if options["loaded"]:
            raise WrongUsage(
                "--loaded finds the gains of motor currents, and these logs have torques or known gains",
                fix="for the body of a load: --payload-from parameters.npz",
            )
        return robot, {}
    if robot.coupling is not None or robot.identified_links != tuple(range(1, robot.n + 1)):
        raise WrongUsage(
            "gains cannot be found with coupled motors or with some links only",
            fix="give them in the robot file: `torque: {source: motor_current, gain: [...]}`",
        )
    base = base_model(common, replace(robot, torque=replace(robot.torque, source="motor_current")))
    found = found_gains(common, base, logs, options)
    path = write_robot(folder, robot, found)
    common.terminal.wrote(path)
    tell(common, robot, found)
    from dynid.files.robotfile import load_robot

    gains = [
        {"joint": joint, "gain_nm_per_a": gain, "std_error": error}
        for joint, gain, error in zip(robot.joint_names, found.gain.tolist(), found.std_error.tolist(), strict=True)
    ]
    return replace(load_robot(path), prior=robot.prior, known=robot.known), {
        "gains": gains,
        "gains_relative": found.relative,
    }


def currents(robot: Robot, log: Path, options: dict[str, Any]) -> bool:
    """Return whether a log's effort column is a motor current."""
    from dynid.files.logs import read_log
    from dynid.signals.columns import in_amperes

    if robot.torque.source == "motor_current":
        return True
    return in_amperes(read_log(log, robot=robot, topic=options["topic"], rate=options["rate"]), robot)


def found_gains(common: Common, base: BaseModel, logs: tuple[Path, ...], options: dict[str, Any]) -> Gains:
    """Read the logs as currents and find the gains."""
    import numpy as np

    from dynid.estimation.drive_gains import find_gains

    given = base.robot.torque.gain or (None,) * base.robot.n
    known = np.array([np.nan if value is None else value for value in given])
    reading = reading_of(options)
    loaded = (Path(options["loaded"]),) if options["loaded"] else ()
    sources, _ = read_sources(common, base, (*logs, *loaded), reading)
    stack = stack_sources(common, base, sources[: len(logs)])
    load = loaded_by(base, stack_sources(common, base, sources[len(logs) :]), options) if loaded else None
    return find_gains(stack, known, load)


def loaded_by(base: BaseModel, stack: Stack, options: dict[str, Any]) -> Load:
    """Return the log with the load and what is known about it: --load-mass, else the robot file's tool."""
    from dynid.estimation.drive_gains import Load
    from dynid.estimation.payload import last_link

    K = base.reduction.K[:, last_link(base.reduction, base.robot.n)]
    mass, tool = options["load_mass"], base.robot.tool
    if mass is not None:
        return Load(stack, K[:, 0] * mass, K[:, 1:])
    if tool is None:
        raise WrongUsage("--loaded needs the mass of the load", fix="--load-mass KG, or `tool:` in the robot file")
    return Load(stack, K @ tool.parameters(), K[:, :0])


def write_robot(folder: Path, robot: Robot, found: Gains) -> Path:
    """Write a copy of the robot file with the gains."""
    import yaml

    from dynid.files.artifact import write_text

    document = yaml.safe_load(robot.path.read_text(encoding="utf-8")) if robot.path else {}
    torque: dict[str, Any] = {"source": "motor_current", "gain": [float(f"{value:.9g}") for value in found.gain]}
    document["torque"] = {**torque, "relative": True} if found.relative else torque
    path = folder / f"{robot.slug}.yaml"
    what = "ratios of the gains; their size is unknown" if found.relative else "gains"
    head = f"# Made by dynid identify: {robot.path.name if robot.path else robot.name} with {what}.\n"
    write_text(path, head + yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=140))
    return path


def tell(common: Common, robot: Robot, found: Gains) -> None:
    """Print the gains."""
    unit = "ratio" if found.relative else "N m/A"
    rows = [
        [joint, f"{gain:.4g}", f"{error:.2g}" if error else "given", unit]
        for joint, gain, error in zip(robot.joint_names, found.gain, found.std_error, strict=True)
    ]
    if not common.json:
        common.terminal.table(["joint", "gain", "std error", "unit"], rows)
    if found.relative:
        common.terminal.say("amperes    nothing tells the size of the gains: results are in A; see --loaded")
    worst = int((found.std_error / found.gain).argmax())
    if found.std_error[worst] > UNCERTAIN * found.gain[worst]:
        share = 100 * found.std_error[worst] / found.gain[worst]
        common.terminal.say(f"uncertain  gain of {robot.joint_names[worst]}: {share:.0f} %")


def in_amperes(facts: Any, robot: Robot) -> Any:  # noqa: ANN401
    """Return a JSON answer with torques in amperes where only ratios of the gains are known: ``_nm`` becomes ``_a``."""
    if not robot.torque.relative or robot.torque.gain is None:
        return facts
    scale = {joint: gain or 1.0 for joint, gain in zip(robot.joint_names, robot.torque.gain, strict=True)}

    def renamed(value: Any, gain: float) -> Any:  # noqa: ANN401
        if isinstance(value, dict):
            own = scale.get(str(value.get("joint")), gain)
            if isinstance(value.get("unit"), str) and "std_error" in value:
                unit = value["unit"]
                value = {**value, "unit": unit.replace("N m", "A") if "N m" in unit else f"{unit} A/(N m)"}
            return {
                (key[:-3] + "_a" if key.endswith("_nm") else key): (
                    inner / own if key.endswith("_nm") and isinstance(inner, float) else renamed(inner, own)
                )
                for key, inner in value.items()
            }
        return [renamed(inner, gain) for inner in value] if isinstance(value, (list, tuple)) else value

    return renamed(facts, 1.0)
