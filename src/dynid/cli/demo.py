"""``dynid demo``: the whole job on a log that ships with dynid, whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus
from dynid.text import shell

#: The shipped logs and the robot of each.
ARMS = {"kuka_lwr4plus": "lwr4plus", "kinova_gen2": "kinova_gen2"}


@dynid_command("demo", examples=("dynid demo", "dynid demo --robot kinova_gen2", "dynid demo --effect random --seed 3"))
@click.option(
    "--robot", type=click.Choice(list(ARMS)), default="kuka_lwr4plus", show_default=True, help="The simulated arm."
)
@click.option("--effect", metavar="NAME|random", help="Hide an effect in the simulated LWR4+, find it and add it.")
def command(common: Common, robot: str, effect: str | None) -> ExitStatus:
    """Run model, identify and validate on a simulated arm, and compare the result with the truth."""
    if effect:
        return find_hidden(common, effect)
    from dynid.cli.identify import run_identify
    from dynid.cli.model import derive, reduce
    from dynid.cli.validate import run_validate
    from dynid.files.robotfile import load_robot, packaged
    from dynid.workflows.demo import against_truth
    from dynid.workflows.results import load_run

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
    truth = against_truth(load_run(path), logs / f"{ARMS[robot]}_truth.yaml")
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


def find_hidden(common: Common, effect: str) -> ExitStatus:
    """Simulate an arm with an effect hidden in it, identify, search, add and compare with what was hidden.

    Args:
        common: the common options; the seed chooses the effect when it is ``"random"``, the motions and the noise.
        effect: identifier, ``"nothing"``, something that is in no catalogue, or ``"random"``.
    """
    from dynid.cli.gap import run_gap
    from dynid.cli.identify import run_identify
    from dynid.workflows.demo import ROBOT, hidden_effect, is_right_answer, simulate_hidden
    from dynid.workflows.identify import IdentifyOptions

    hidden = hidden_effect(effect, common.seed)
    folder = common.out or Path("out") / "demo" / "effect"
    common = replace(common, out=folder, force=True)
    terminal = common.terminal
    terminal.say("--- a simulated LWR4+ with something hidden in it: three motions, each driven twice", "bold")
    with terminal.progress() as progress:
        robot, logs = simulate_hidden(folder, hidden, common.seed, progress)
    terminal.say("--- dynid identify, on the first two motions", "bold")
    run_identify(common, str(robot), logs[:4], IdentifyOptions(feasible=False), show=False, final=False)
    terminal.say("--- dynid gap, proved on the third motion", "bold")
    added = replace(common, out=folder / "with_effect")
    answer = run_gap(added, folder / "parameters.npz", logs, apply_="best", new_name=folder / "arm_with_effect.yaml")
    right = is_right_answer(hidden, answer)
    terminal.answer()
    where = f", {hidden.size:g} in size, at joint {hidden.joint + 1}" if hidden.size else ""
    terminal.fact("hidden", f"{hidden.name}{where} (seed {common.seed})")
    terminal.fact("verdict", f"{answer['verdict']}: {'right' if right else 'wrong'}")
    terminal.fact("picture", str(folder / "gap" / "shrink.png"))
    if answer["named"]:
        terminal.fact("next", f"{shell('dynid', 'validate', folder / 'with_effect' / 'parameters.npz')} LOG")
    facts: dict[str, Any] = {"effect": hidden.name, "joint": hidden.joint + 1, "size": hidden.size, "seed": common.seed}
    terminal.emit_json({"schema": "dynid/demo/1", "robot": ROBOT, "hidden": facts, "right": right, "gap": answer})
    return ExitStatus.DONE if right else ExitStatus.LIMIT_NOT_MET
