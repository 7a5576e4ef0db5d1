"""``dynid check PATH...``: look for mistakes in robot files, results and logs before anything is built on them."""

from __future__ import annotations

import zipfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus, Finding

if TYPE_CHECKING:
    from dynid.robot import Robot

ROBOT_SUFFIXES = (".yaml", ".yml")


@dataclass(frozen=True)
class Checked:
    """What was found in one file.

    Attributes:
        path: the file.
        kind: ``"robot"``, ``"result"`` or ``"log"``.
        lines: label and sentence, for people.
        facts: the same for programs.
        findings: what is worth a warning.
        wrote: files that were written.
    """

    path: str
    kind: str
    lines: tuple[tuple[str, str], ...]
    facts: dict[str, Any] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    wrote: tuple[Path, ...] = ()

    @property
    def warnings(self) -> int:
        """Number of warnings."""
        return sum(finding.level == "warning" for finding in self.findings)

    def answer(self) -> dict[str, Any]:
        """Return the file's part of the JSON answer."""
        findings = [asdict(finding) for finding in self.findings]
        return {"path": self.path, "kind": self.kind, **self.facts, "findings": findings, "wrote": list(self.wrote)}


def check_robot(robot: Robot) -> Checked:
    """Describe a robot file that could be read."""
    import numpy as np

    from dynid.model.kinematics import tool_pose

    x, y, z = (float(value) for value in tool_pose(robot, np.zeros(robot.n))[:3, 3])
    turning = sum(joint.revolute for joint in robot.joints)
    kinds = [f"{count} {kind}" for count, kind in ((turning, "revolute"), (robot.n - turning, "prismatic")) if count]
    gravity = ", ".join(f"{value:g}" for value in robot.gravity)
    lines = [
        ("robot", f"{robot.name}, {' and '.join(kinds)} joints, {robot.convention} DH"),
        ("tool", f"at q = 0: x {x:.3f}  y {y:.3f}  z {z:.3f} m   (compare with a ruler)"),
        ("gravity", f"{gravity} m/s^2 in frame 0"),
        ("links", f"identified: {', '.join(str(number) for number in robot.identified_links)}"),
        ("limits", _limits(robot)),
        ("driver", _driver(robot)),
        ("prior", _prior(robot)),
    ]
    if robot.effects:
        lines.append(("effects", ", ".join(f"{e.effect} on {', '.join(e.joints)}" for e in robot.effects)))
    facts = {
        "robot": robot.name,
        "n_joints": robot.n,
        "joints": list(robot.joint_names),
        "convention": robot.convention,
        "tool_at_zero_m": [x, y, z],
        "gravity_m_s2": list(robot.gravity),
        "key": robot.model_key,
    }
    return Checked(str(robot.path), "robot", tuple(lines), facts, robot.findings)


def _limits(robot: Robot) -> str:
    words = []
    for name in ("position", "velocity", "acceleration", "torque"):
        without = [joint.name for joint in robot.joints if getattr(joint.limits, name) is None]
        missing = f" (not for {', '.join(without)})" if 0 < len(without) < robot.n else ""
        words.append(f"{name} {'none' if len(without) == robot.n else 'given'}{missing}")
    return "   ".join(words)


def _driver(robot: Robot) -> str:
    if robot.driver is None:
        return "none: logs must have the robot file's joint names, rad and Nm"
    topic = robot.driver.topic or "the driver's usual topic"
    return f"{robot.driver.kind}, {topic}, torque from {robot.torque.source}"


def _prior(robot: Robot) -> str:
    if robot.prior is None:
        return "none"
    return "uniform cylinders" if robot.prior.cylinders else f"{len(robot.prior.links)} links with numbers"


def check_result(path: Path) -> Checked:
    """Describe a result file by its header."""
    from dynid.files.artifact import read_artifact

    artifact = read_artifact(path)
    lines = [("result", f"{artifact.schema}, written by dynid {artifact.header.get('dynid', '?')}")]
    for key in ("robot", "command", "seed", "convention", "method", "rank", "key"):
        if key in artifact.header:
            lines.append((key, str(artifact.header[key])))
    inputs = artifact.header.get("inputs")
    if isinstance(inputs, dict):
        lines += [
            ("input" if not i else "", f"{name}  sha256 {str(inputs[name])[:12]}") for i, name in enumerate(inputs)
        ]
    shapes = {name: list(array.shape) for name, array in artifact.arrays.items()}
    sizes = (f"{name} {' x '.join(map(str, shape)) or 'scalar'}" for name, shape in shapes.items())
    lines.append(("arrays", ", ".join(sizes)))
    facts = {"result": artifact.schema, "header": artifact.header, "arrays": shapes}
    return Checked(str(path), "result", tuple(lines), facts)


def kind_of(path: str) -> str:
    """Return what a path is taken for: ``"robot"``, ``"result"`` or ``"log"``."""
    from dynid.files.artifact import read_header

    file = Path(path)
    if file.suffix == ".npz" and file.is_file():
        header = read_header(file)
        plain = header is None and zipfile.is_zipfile(file)
        return "log" if plain or str((header or {}).get("schema", "")).startswith("dynid/log/") else "result"
    return "log" if file.is_dir() or file.suffix not in (*ROBOT_SUFFIXES, "") else "robot"


@dynid_command(
    "check",
    examples=(
        "dynid check my_arm.yaml                           a robot file",
        "dynid check log.bag --robot my_arm.yaml           a log of that arm",
        "dynid check log.bag --robot my_arm --convert      the same, and write out/my_arm/log.npz",
        "dynid check out/my_arm/parameters.npz             the header of a result",
    ),
)
@click.argument("paths", metavar="PATH...", nargs=-1, required=True)
@click.option("--robot", metavar="ROBOT", help="The arm of the logs; by default the robot file among the paths.")
@click.option("--topic", help="ROS topic of the joint states.")
@click.option("--rate", type=float, metavar="HZ", help="Sample rate of text logs without a time column.")
@click.option("--exclude", metavar="T0-T1", multiple=True, help="Leave out this stretch of the log, in seconds.")
@click.option("--sort-time", is_flag=True, help="Put shuffled samples in the order of their stamps.")
@click.option("--convert", is_flag=True, help="Write log.npz: all columns as they were recorded.")
@click.option("--fix", is_flag=True, help="Write log.npz after the repairs that lose nothing, and list them.")
@click.option("--strict", is_flag=True, help="Exit with 1 when there are warnings.")
def command(common: Common, paths: Sequence[str], robot: str | None, strict: bool, **options: Any) -> ExitStatus:  # noqa: ANN401
    """Look for mistakes in robot files, logs and results."""
    from dynid.cli.checklog import LogOptions, check_log
    from dynid.files.robotfile import load_robot

    kinds = [kind_of(path) for path in paths]
    robots = {path: load_robot(path) for path, kind in zip(paths, kinds, strict=True) if kind == "robot"}
    arm = load_robot(robot) if robot else next(iter(robots.values()), None)
    found = []
    for path, kind in zip(paths, kinds, strict=True):
        if kind == "robot":
            found.append(check_robot(robots[path]))
        elif kind == "result":
            found.append(check_result(Path(path)))
        else:
            found.append(check_log(common, Path(path), arm, LogOptions(**options)))
    return _tell(common, found, strict)


def _tell(common: Common, found: Sequence[Checked], strict: bool) -> ExitStatus:
    terminal = common.terminal
    for i, checked in enumerate(found):
        if i:
            terminal.answer()
        for label, text in checked.lines:
            terminal.fact(label, text)
        terminal.findings(checked.findings)
        for path in checked.wrote:
            terminal.wrote(path)
    warnings = sum(checked.warnings for checked in found)
    verdict = "usable" + (f", {warnings} warning{'s' if warnings > 1 else ''}" if warnings else "")
    terminal.fact("verdict", verdict)
    terminal.emit_json(
        {
            "schema": "dynid/check/1",
            "checked": [checked.answer() for checked in found],
            "findings": [asdict(finding) for checked in found for finding in checked.findings],
            "warnings": warnings,
            "usable": True,
            "wrote": [path for checked in found for path in checked.wrote],
        }
    )
    return ExitStatus.LIMIT_NOT_MET if strict and warnings else ExitStatus.DONE
