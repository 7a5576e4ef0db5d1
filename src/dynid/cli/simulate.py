"""``dynid simulate ROBOT TRAJECTORY|LOG``: a log of an arm that follows a motion, without ROS."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import options_from, options_of, robot_argument
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import input_hashes, may_write
from dynid.text import shell
from dynid.workflows.options import SimulateOptions

if TYPE_CHECKING:
    from dynid.sim.comparison import SimulatorGap


@dynid_command(
    "simulate",
    examples=(
        "dynid simulate ur5e out/ur5e/trajectory.npz",
        "dynid simulate my_arm.yaml log.bag --payload 2 --delay 0.004",
        "dynid simulate my_arm.yaml trajectory.npz --effect torque_offset@2:c=3",
        "dynid simulate out/before out/after --compare run3.bag     exported files in MuJoCo beside a log",
    ),
)
@robot_argument
@click.argument("source", metavar="TRAJECTORY|LOG", type=click.Path(exists=True, path_type=Path))
@options_from(SimulateOptions, without=("seed",))
@click.option(
    "--compare",
    "log",
    type=click.Path(exists=True, path_type=Path),
    metavar="LOG",
    help="Drive the exported files of the two arguments, results of one arm, along this log and show the errors.",
)
@click.option(
    "--engine",
    type=click.Choice(["mujoco", "pybullet"]),
    default="mujoco",
    show_default=True,
    help="Simulator that --compare loads the exported files in.",
)
def command(
    common: Common,
    robot: str,
    source: Path,
    log: Path | None,
    engine: str,
    **values: Any,  # noqa: ANN401
) -> None:
    """Simulate the log of an arm that follows a motion: friction, noise, effects; no ROS is needed."""
    if log is not None:
        return compare(common, Path(robot), source, log, engine)

    arm, options = dynid.load_robot(robot), options_of(SimulateOptions, values, seed=common.seed)
    common.terminal.findings(arm.findings)
    target = common.folder(arm.slug) / "simulated.npz"
    inputs = {"robot": arm.model_key, **input_hashes({"motion": source}), **options.texts()}
    with common.terminal.progress() as progress:
        found = workflows.simulate.simulate(arm, source, options, progress=progress)
    common.terminal.stage("physics", f"{found.source}; the arm follows the motion exactly")
    wrote = []
    if may_write(common, target, inputs):
        target.parent.mkdir(parents=True, exist_ok=True)
        wrote.append(found.log.save(target, common.header(inputs)))
        common.terminal.wrote(target)
    common.terminal.emit_json({**found.facts(), "wrote": wrote})
    common.terminal.next(f"dynid identify {arm.word} {shell(target)}")
    return None


def compare(common: Common, before: Path, after: Path, log: Path, engine: str) -> None:
    """Drive the exported files of two results along a log and print the errors."""
    results = [dynid.loading.load_run(before), dynid.loading.load_run(after)]
    with common.terminal.progress() as progress:
        found = workflows.simulator_gap.compare_in_simulator(
            results, log, engine=engine, progress=progress
        )
        folder = common.out or results[1].path.parent
        wrote = [
            workflows.simulator_gap.save_figure(
                found, folder / "simulator" / f"{log.stem}_{engine}.png"
            )
        ]
    show_comparison(common, found)
    common.terminal.wrote(*wrote)
    common.terminal.emit_json({**found.facts(), "wrote": wrote})


def show_comparison(common: Common, found: SimulatorGap) -> None:
    """Print how far simulated arms stray from a log, with one model and with another."""
    common.terminal.sentence(found.sentence())
    common.terminal.show(found.table())
