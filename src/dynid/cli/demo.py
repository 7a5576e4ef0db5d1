"""``dynid demo``: the whole job on a log that ships with dynid, whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus

if TYPE_CHECKING:
    from dynid.estimation.result import Identification

#: The shipped logs and the robot of each.
ARMS = {"kuka_lwr4plus": "lwr4plus", "kinova_gen2": "kinova_gen2"}
#: Half width of a 95 % interval in standard errors.
TWO_SIDED_95 = 1.96


@dynid_command("demo", examples=("dynid demo", "dynid demo --robot kinova_gen2", "dynid demo --effect random --seed 3"))
@click.option(
    "--robot", type=click.Choice(list(ARMS)), default="kuka_lwr4plus", show_default=True, help="The simulated arm."
)
@click.option("--effect", metavar="NAME|random", help="Hide an effect in the simulated LWR4+, find it and add it.")
def command(common: Common, robot: str, effect: str | None) -> ExitStatus:
    """Run model, identify and validate on a simulated arm, and compare the result with the truth."""
    if effect:
        from dynid.cli.effect_demo import tell

        return tell(common, effect)
    from dynid.cli.identify import run_identify
    from dynid.cli.model import derive, reduce
    from dynid.cli.validate import run_validate
    from dynid.estimation import result
    from dynid.files.robotfile import load_robot, packaged

    logs = packaged("trajectories")
    common = replace(common, out=common.out or Path("out") / "demo" / robot, force=True)
    terminal = common.terminal
    terminal.say("--- loop 1: dynid model", "bold")
    reduce(common, derive(common, load_robot(robot)))
    terminal.say("--- loop 3: dynid identify, on a log simulated by PyBullet", "bold")
    identified = run_identify(common, robot, (logs / f"{ARMS[robot]}_identify.bag",), final=False)
    terminal.say("--- dynid validate, on another motion", "bold")
    path = common.folder(robot) / "parameters.npz"
    unseen = logs / f"{ARMS[robot]}_validate.bag"
    validated = run_validate(common, path, unseen)
    truth = against_truth(result.load(path), logs / f"{ARMS[robot]}_truth.yaml")
    terminal.answer()
    inside = (
        f"{truth['inside_95_percent']} of {truth['parameters']} true base parameters lie inside their 95 % interval"
    )
    terminal.fact("truth", f"{inside} ({logs / (ARMS[robot] + '_truth.yaml')})")
    terminal.fact("figures", "  ".join(str(p) for p in validated["wrote"] if p.suffix == ".png"))
    terminal.fact("next", "your robot:  dynid check my_arm.yaml;  your log:  dynid identify my_arm.yaml my_log.bag")
    terminal.emit_json(
        {"schema": "dynid/demo/1", "robot": robot, "identify": identified, "validate": validated, "truth": truth}
    )
    return ExitStatus.DONE


def against_truth(stored: Identification, path: Path) -> dict[str, Any]:
    """Count how many true base parameters the intervals hold."""
    import numpy as np

    from dynid.sim.plant import read_plant

    gamma = read_plant(path).parameters()
    true = stored.reduction.K @ np.array([gamma[name] for name in stored.reduction.names])
    inside = np.abs(stored.theta - true) <= TWO_SIDED_95 * stored.std_error
    return {"parameters": len(true), "inside_95_percent": int(inside.sum())}
