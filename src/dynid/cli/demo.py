"""``dynid demo``: the whole job on a log that ships with dynid, whose truth is known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus
from dynid.text import shell

if TYPE_CHECKING:
    from dynid.robot import Robot

#: The shipped logs and the robot of each.
ARMS = {"kuka_lwr4plus": "lwr4plus", "kinova_gen2": "kinova_gen2"}


@dynid_command(
    "demo",
    examples=(
        "dynid demo",
        "dynid demo --robot kinova_gen2",
        "dynid demo --robot my_arm.yaml     your own arm, simulated",
        "dynid demo --effect random --seed 3",
    ),
)
@click.option(
    "--robot",
    default="kuka_lwr4plus",
    show_default=True,
    metavar="ROBOT",
    help=f"The arm: {' or '.join(ARMS)} with shipped logs; any other, a robot file or a URDF, is simulated now.",
)
@click.option("--effect", metavar="NAME|random", help="Hide an effect in the simulated LWR4+, find it and add it.")
def command(common: Common, robot: str, effect: str | None) -> ExitStatus:
    """Run model, identify and validate on a simulated arm, and compare the result with the truth."""
    if effect:
        return find_hidden(common, effect)
    from dynid.cli.identify import run_identify
    from dynid.cli.model import derive, reduce
    from dynid.cli.validate import run_validate
    from dynid.workflows.demo import against_truth
    from dynid.workflows.results import load_run
    from dynid.workflows.robots import load_robot

    arm = load_robot(robot)
    common = replace(common, out=common.out or Path("out") / "demo" / arm.slug, force=True)
    terminal = common.terminal
    terminal.findings(arm.findings)
    terminal.say("--- loop 1: dynid model", "bold")
    reduce(common, derive(common, arm))
    logs, unseen, truth, physics = _recordings(common, robot, arm)
    terminal.say(f"--- loop 3: dynid identify, on a log simulated by {physics}", "bold")
    identified = run_identify(common, robot, (logs,), final=False)
    terminal.say("--- dynid validate, on another motion", "bold")
    path = common.folder(arm.slug) / "parameters.npz"
    validated = run_validate(common, path, unseen)
    counted = against_truth(load_run(path), truth)
    terminal.answer()
    inside = "{inside_95_percent} of {parameters} true base parameters lie inside their 95 % interval".format(**counted)
    terminal.fact("truth", inside)
    terminal.fact("figures", "  ".join(str(p) for p in validated["wrote"] if p.suffix == ".png"))
    last = f"your log:  {shell('dynid', 'identify', robot if robot not in ARMS else 'my_arm.yaml', 'my_log.bag')}"
    terminal.fact("next", f"your robot:  dynid check my_arm.yaml;  {last}" if robot in ARMS else last)
    terminal.emit_json(
        {"schema": "dynid/demo/1", "robot": robot, "identify": identified, "validate": validated, "truth": counted}
    )
    return ExitStatus.DONE


def _recordings(common: Common, name: str, arm: Robot) -> tuple[Path, Path, dict[str, float], str]:
    """Return a log to identify from, an unseen one, the true parameters, and what simulated them."""
    from dynid.files import packaged
    from dynid.workflows.demo import simulate_own, truth_of

    if name in ARMS:
        logs, word = packaged("trajectories"), ARMS[name]
        seen, unseen = (logs / f"{word}_{which}.bag" for which in ("identify", "validate"))
        return seen, unseen, truth_of(logs / f"{word}_truth.yaml"), "PyBullet"
    common.terminal.say(
        "--- two motions of the arm, with bodies up to 20 % off those of its file, friction, noise", "bold"
    )
    folder = common.folder(arm.slug)
    folder.mkdir(parents=True, exist_ok=True)
    with common.terminal.progress() as progress:
        own = simulate_own(arm, folder, common.seed, progress)
    return own.logs[0], own.logs[1], own.truth, own.physics


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
