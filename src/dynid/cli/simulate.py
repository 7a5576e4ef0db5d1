"""``dynid simulate ROBOT TRAJECTORY|LOG``: a log of an arm that follows a motion, without ROS."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from dynid.cli.arguments import options_from, options_of, robot_argument
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import input_hashes, may_write
from dynid.text import shell
from dynid.workflows.simulate import SimulateOptions


@dynid_command(
    "simulate",
    examples=(
        "dynid simulate ur5e out/ur5e/trajectory.npz",
        "dynid simulate my_arm.yaml log.bag --payload 2 --delay 0.004",
        "dynid simulate my_arm.yaml trajectory.npz --effect torque_offset@2:c=3",
    ),
)
@robot_argument
@click.argument("source", metavar="TRAJECTORY|LOG", type=click.Path(exists=True, path_type=Path))
@options_from(SimulateOptions, without=("seed",))
def command(common: Common, robot: str, source: Path, **values: Any) -> None:  # noqa: ANN401
    """Simulate the log of an arm that follows a motion: friction, noise, effects; no ROS is needed."""
    from dynid.workflows.robots import load_robot
    from dynid.workflows.simulate import simulate

    arm, options = load_robot(robot), options_of(SimulateOptions, values, seed=common.seed)
    common.terminal.findings(arm.findings)
    target = common.folder(arm.slug) / "simulated.npz"
    inputs = {"robot": arm.model_key, **input_hashes({"motion": source}), **options.texts()}
    with common.terminal.progress() as progress:
        found = simulate(arm, source, options, progress=progress)
    common.terminal.stage("physics", f"{found.source}; the arm follows the motion exactly")
    wrote = []
    if may_write(common, target, inputs):
        target.parent.mkdir(parents=True, exist_ok=True)
        wrote.append(found.log.save(target, common.header(inputs)))
        common.terminal.wrote(target)
    common.terminal.emit_json({**found.facts(), "wrote": wrote})
    common.terminal.next(f"dynid identify {arm.word} {shell(target)}")
