"""``dynid demo``: all four loops on data that ships with dynid, whose truth is known, and a page that shows them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.gap import run_gap
from dynid.cli.identify import run_identify
from dynid.cli.model import derive, reduce
from dynid.cli.options import Common, dynid_command
from dynid.cli.terminal import program
from dynid.cli.validate import run_validate
from dynid.errors import ExitStatus
from dynid.files import packaged
from dynid.files.trajectoryfile import read_trajectory
from dynid.reports.demo_page import Chapter, write_demo_page
from dynid.text import shell
from dynid.trajectory.options import PlanOptions
from dynid.trajectory.preview import Drawing
from dynid.workflows.options import IdentifyOptions

if TYPE_CHECKING:
    from dynid.reports.demo_page import Chapter
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
@click.option(
    "--effect",
    metavar="NAME|random",
    help="Hide an effect in the simulated LWR4+, find it and add it.",
)
def command(common: Common, robot: str, effect: str | None) -> ExitStatus:
    """Run all four loops on a simulated arm whose truth is known, and show them on one page."""
    if effect:
        story = find_hidden(common, effect)
        common.terminal.emit_json(story.facts)
        return ExitStatus.DONE if story.facts["right"] else ExitStatus.LIMIT_NOT_MET
    return all_loops(common, robot)


def all_loops(common: Common, robot: str) -> ExitStatus:
    """Derive the model, plan a motion, identify, validate, and search for an effect that was hidden at random."""
    arm = dynid.load_robot(robot)
    top = common.out or Path("out") / "demo"
    common = replace(common, out=common.out or top / arm.slug, force=True)
    terminal, folder = common.terminal, common.folder(arm.slug)
    terminal.findings(arm.findings)
    terminal.say("--- loop 1: dynid model", "bold")
    reduce(common, derive(common, arm))
    wrote, planned = plan(common, arm, robot)
    logs, unseen, truth, physics = _recordings(common, robot, arm)
    terminal.say(f"--- loop 3: dynid identify, on a log simulated by {physics}", "bold")
    identified = run_identify(common, robot, (logs,), final=False)
    terminal.say("--- dynid validate, on another motion", "bold")
    path = folder / "parameters.npz"
    validated = run_validate(common, path, unseen, final=False)
    counted = workflows.demo.against_truth(dynid.loading.load_run(path), truth)
    inside = "{inside_95_percent} of {parameters} true base parameters lie inside their 95 % interval".format(
        **counted
    )
    number = len(identified["parameters"])
    chapters = [
        Chapter(
            "The model",
            (f"{number} base parameters say everything about the torques of this arm.",),
            (shell("dynid", "model", robot, "-o", folder),),
        ),
        Chapter(
            "A motion that shows them",
            planned,
            (shell("dynid", "trajectory", robot, "-o", top / "motion"),),
            tuple((each, "The planned motion: the arm at several times.") for each in wrote),
        ),
        Chapter(
            "Identify",
            (identified["judgement"]["sentence"], f"{inside}."),
            (shell("dynid", "identify", robot, logs, "-o", folder),),
        ),
        Chapter(
            "Another motion",
            (validated["judgement"]["sentence"], *validated["judgement"]["reasons"]),
            (shell("dynid", "validate", folder, unseen),),
            (
                (
                    path.parent / "validation" / unseen.stem / "torque.png",
                    "Measured and predicted torque.",
                ),
            ),
        ),
    ]
    facts = {"identify": identified, "validate": validated, "truth": counted}
    if ARMS.get(robot) == "lwr4plus":
        story = find_hidden(replace(common, out=top / "effect"), random_effect(common.seed))
        chapters.append(story.chapter)
        facts |= {
            "hidden": story.facts["hidden"],
            "right": story.facts["right"],
            "gap": story.facts["gap"],
        }
    page = write_demo_page(top / "index.html", arm.name, chapters[-1].text[0], chapters, program())
    terminal.answer()
    terminal.fact("truth", inside)
    terminal.fact("page", str(page))
    last = f"your log:  {shell('dynid', 'identify', robot if robot not in ARMS else 'my_arm.yaml', 'my_log.bag')}"
    terminal.fact(
        "next", f"your robot:  dynid check my_arm.yaml;  {last}" if robot in ARMS else last
    )
    terminal.emit_json({"schema": "dynid/demo/1", "robot": robot, **facts, "page": page})
    return ExitStatus.DONE


def random_effect(seed: int) -> str:
    """Return the name of an effect that changes torques: a delay is corrected before anybody has searched."""
    names = (workflows.demo.hidden_effect("random", seed + k).name for k in count())
    return next(name for name in names if name != "torque_delay")


def plan(common: Common, arm: Robot, robot: str) -> tuple[list[Path], tuple[str, ...]]:
    """Judge the shipped motion of an arm, or plan a random one, and draw it.

    Returns:
        The pictures, and what is said of the motion.
    """
    terminal, folder = common.terminal, common.folder(arm.slug)
    terminal.say("--- loop 2: dynid trajectory, a motion that shows the parameters", "bold")
    with terminal.progress() as progress:
        base = workflows.model.base_model(arm, folder, progress)
        shown = Drawing(folder / "preview.png")
        if robot in ARMS:
            shipped = packaged("trajectories") / f"{arm.slug}_alpha1.0.npz"
            stored = read_trajectory(shipped, arm)
            facts = stored.facts["answer"]
            clearance = workflows.trajectory.review_trajectory(
                arm, stored, base=base, drawing=shown, progress=progress
            ).clearance
        else:
            options = PlanOptions(optimise=False, duration=10.0, seed=common.seed)
            found = workflows.trajectory.plan_trajectory(
                arm, options, base=base, drawing=shown, progress=progress
            )
            facts, clearance = found.facts(), found.clearance
    number, closest = facts["condition_number_scaled"], facts["closest_m"]
    said = [
        f"A motion of {facts['duration_s']:.0f} s inside all limits; condition number {number:.3g}."
    ]
    if closest is not None:
        said.append(f"The links stay {1e3 * closest:.0f} mm apart.")
    terminal.stage("motion", " ".join(said))
    terminal.wrote(*clearance.pictures)
    return list(clearance.pictures), tuple(said)


def _recordings(common: Common, name: str, arm: Robot) -> tuple[Path, Path, dict[str, float], str]:
    """Return a log to identify from, an unseen one, the true parameters, and what simulated them."""
    if name in ARMS:
        logs, word = packaged("trajectories"), ARMS[name]
        seen, unseen = (logs / f"{word}_{which}.bag" for which in ("identify", "validate"))
        return seen, unseen, workflows.demo.truth_of(logs / f"{word}_truth.yaml"), "PyBullet"
    common.terminal.say(
        "--- two motions of the arm, with bodies up to 20 % off those of its file, friction, noise",
        "bold",
    )
    folder = common.folder(arm.slug)
    folder.mkdir(parents=True, exist_ok=True)
    with common.terminal.progress() as progress:
        own = workflows.demo.simulate_own(arm, folder, common.seed, progress)
    return own.logs[0], own.logs[1], own.truth, own.physics


@dataclass(frozen=True)
class Story:
    """What came of an effect that was hidden.

    Attributes:
        facts: the JSON answer.
        chapter: the same for the page.
    """

    facts: dict[str, Any]
    chapter: Chapter


def find_hidden(common: Common, effect: str) -> Story:
    """Simulate an arm with an effect hidden in it, identify, search, add and compare with what was hidden.

    Args:
        common: the common options; the seed chooses the effect when it is ``"random"``, the motions and the noise.
        effect: identifier, ``"nothing"``, something that is in no catalogue, or ``"random"``.
    """
    hidden = workflows.demo.hidden_effect(effect, common.seed)
    folder = common.out or Path("out") / "demo" / "effect"
    common = replace(common, out=folder, force=True)
    terminal = common.terminal
    terminal.say(
        "--- a simulated LWR4+ with something hidden in it: three motions, each driven twice",
        "bold",
    )
    with terminal.progress() as progress:
        robot, logs = workflows.demo.simulate_hidden(folder, hidden, common.seed, progress)
    terminal.say("--- dynid identify, on the first two motions", "bold")
    run_identify(
        common, str(robot), logs[:4], IdentifyOptions(feasible=False), show=False, final=False
    )
    terminal.say("--- dynid gap, proved on the third motion", "bold")
    added, copy = replace(common, out=folder / "with_effect"), folder / "arm_with_effect.yaml"
    path = folder / "parameters.npz"
    answer = run_gap(added, path, logs, apply_="best", new_name=copy)
    right = workflows.demo.is_right_answer(hidden, answer)
    terminal.answer()
    where = f", {hidden.size:g} in size, at joint {hidden.joint + 1}" if hidden.size else ""
    terminal.fact("hidden", f"{hidden.name}{where} (seed {common.seed})")
    terminal.fact("verdict", f"{answer['verdict']}: {'right' if right else 'wrong'}")
    terminal.fact("picture", str(folder / "gap" / "shrink.png"))
    facts: dict[str, Any] = {
        "effect": hidden.name,
        "joint": hidden.joint + 1,
        "size": hidden.size,
        "seed": common.seed,
    }
    judged, shrunk = answer["judgement"], _shrunk(answer)
    proof = f"{shell('dynid', 'validate', folder / 'with_effect', logs[-1])} --cutoff 10"
    again = [proof] if answer["named"] else []
    chapter = Chapter(
        "Something is hidden in the arm: find it, add it, see the gap shrink",
        (
            judged["sentence"],
            *judged["reasons"],
            *shrunk,
            f"Hidden was {hidden.name}{where}: the answer is {'right' if right else 'wrong'}.",
        ),
        (
            f"{shell('dynid', 'identify', robot, *logs[:4], '-o', folder)} --no-feasible",
            f"{shell('dynid', 'gap', path, *logs, '-o', folder / 'with_effect')} --apply best -f",
            *again,
        ),
        tuple((each, _caption(each)) for each in answer["wrote"] if Path(each).suffix == ".png"),
    )
    facts = {
        "schema": "dynid/demo/1",
        "robot": workflows.demo.ROBOT,
        "hidden": facts,
        "right": right,
        "gap": answer,
    }
    return Story(facts, chapter)


def _shrunk(answer: dict[str, Any]) -> list[str]:
    """Return how much smaller the gap became where something was named, in torque and in the simulated motion."""
    gap = answer["gap"]
    if not answer["named"]:
        return []
    ratios = [
        after / before
        for before, after in zip(gap["heldout_before_nm"], gap["heldout_after_nm"], strict=True)
    ]
    best = ratios.index(min(ratios))
    before, after = (gap[f"heldout_{word}_nm"][best] for word in ("before", "after"))
    joint = gap["joints"][best]
    said = [
        f"With it the torque error of {joint} on unseen motion went from {before:.3g} to {after:.3g} N m."
    ]
    if gap["simulation_before"] is not None:
        before, after = (1e3 * gap[f"simulation_{word}"][best] for word in ("before", "after"))
        said.append(
            f"Simulated from its torques, {joint} is off by {before:.3g} mrad before and {after:.3g} mrad after."
        )
    return said


def _caption(picture: Path) -> str:
    """Return what a picture of a search shows."""
    known = {
        "where": "Where the error is, joint by joint.",
        "shrink": "The error on the motion held out, before and after.",
    }
    return known.get(Path(picture).stem, "The effect that was found, on the motion held out.")
