"""``dynid demo``: all four loops on data that ships with dynid, whose truth is known, and a page that shows them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import dynid
from dynid import workflows
from dynid.answer import Answer, Facts
from dynid.cli.options import dynid_command, invoke
from dynid.cli.session import Session, program
from dynid.files import packaged
from dynid.options import option
from dynid.reports.demo_page import write_demo_page
from dynid.text import shell
from dynid.trajectory.preview import Drawing

if TYPE_CHECKING:
    from dynid.robot import Robot

#: The shipped logs and the robot of each.
ARMS = {"kuka_lwr4plus": "lwr4plus", "kinova_gen2": "kinova_gen2"}

KINEMATICS = ("position", "velocity", "acceleration")


@dynid_command("demo")
def command(
    session: Session,
    *,
    robot: str = option(
        "kuka_lwr4plus", "The arm, whose logs come with dynid.", choices=tuple(ARMS)
    ),
    effect: str | None = option(
        None, "Hide an effect in the simulated LWR4+, find it and add it.", metavar="NAME|random"
    ),
) -> Answer:
    """Run all four loops on a simulated arm with known parameters, and show them on one page.

    Examples:
      dynid demo
      dynid demo --robot kinova_gen2
      dynid demo --effect random --seed 3
    """
    top, told = session.out or Path("out/demo"), list[str | Path]()
    if effect:
        return find_hidden(session, told, effect, session.out or top / "effect")
    arm = dynid.load_robot(robot)
    facts = all_loops(session, told, arm, robot, session.out or top / arm.slug)
    counted = facts["truth"]
    inside = f"{counted['inside_95_percent']} of {counted['parameters']}"
    told.append(truth := f"{inside} true base parameters lie inside their 95 % interval")
    if robot == workflows.demo.ROBOT:
        story = find_hidden(session, told, "spring", top / "effect")
        session.show(story)
        facts |= {key: story.facts[key] for key in ("hidden", "right", "gap")}
    page = write_demo_page(top / "index.html", arm.name, told, program())
    return Answer(
        {"robot": robot, **facts, "page": page},
        parts=(
            "",
            ("truth", truth),
            ("page", str(page)),
            ("next", "dynid check my_arm.yaml, then dynid identify my_arm.yaml my_log.bag"),
        ),
    )


def all_loops(
    session: Session, told: list[str | Path], arm: Robot, robot: str, folder: Path
) -> Facts:
    """Derive the model, look at a motion, identify and validate, compare with the truth; return the facts."""
    model = step(session, told, ", loop 1", "model", (robot, "-o", folder), ("--reduce",))
    size = f"{model['n_parameters']} parameters, {model['rank']} base parameters"
    session.stage("model", size)
    title = "--- dynid trajectory, loop 2: a motion that excites the parameters"
    session.say(title, "bold")
    file = packaged("trajectories") / f"{arm.slug}_alpha1.0.npz"
    base, drawing = dynid.base_model(arm, folder), Drawing(folder / "preview.png")
    judged = workflows.trajectory.review_trajectory(arm, file, base=base, drawing=drawing)
    facts, pictures = judged.stored.facts["answer"], judged.clearance.pictures
    number = f"{facts['condition_number_scaled']:.3g}"
    motion = (
        f"A motion of {facts['duration_s']:.0f} s inside all limits; condition number {number}."
    )
    session.stage("motion", motion)
    session.wrote(*pictures)
    told += [size, title, motion, *pictures]
    (log, unseen), truth = workflows.demo.shipped(ARMS[robot])
    what, words = ", loop 3, on a log simulated by PyBullet", (robot, log, "-o", folder)
    identified = step(session, told, what, "identify", words, ("-f", "--no-report"))
    validated = step(session, told, ", on another motion", "validate", (folder, unseen), ("-f",))
    counted = workflows.demo.against_truth(dynid.loading.load_run(folder), truth)
    return {"identify": identified, "validate": validated, "truth": counted}


def find_hidden(session: Session, told: list[str | Path], effect: str, folder: Path) -> Answer:
    """Simulate an arm with an effect hidden in it, identify, search, add and compare with what was hidden.

    Args:
        session: of the command; the seed chooses the effect when it is ``"random"``, the motions and the noise.
        told: lines of the page.
        effect: identifier, ``"nothing"``, something that is in no catalogue, or ``"random"``.
        folder: of the results.
    """
    hidden = workflows.demo.hidden_effect(effect, session.seed)
    session.say(
        "--- a simulated LWR4+ with a hidden effect: three motions, each recorded twice", "bold"
    )
    robot, logs = workflows.demo.simulate_hidden(folder, hidden, session.seed)
    words, flags = (robot, *logs[:4], "-o", folder, "--no-feasible"), ("--no-report", "-f")
    step(session, told, ", on the first two motions", "identify", words, flags)
    words = (folder / "parameters.npz", *logs, "-o", folder / "with_effect", "--apply=best", "-f")
    copy = [f"--new-name={folder / 'arm_with_effect.yaml'}"]
    gap = step(session, told, ", held out: the third motion", "gap", words, copy)
    right = workflows.demo.is_right_answer(hidden, gap)
    verdict = "right" if right else "wrong"
    where = f" {hidden.size:g} on joint {hidden.joint + 1}" if hidden.size else ""
    told.append(f"Hidden was {hidden.name}{where}: the answer is {verdict}.")
    facts = {
        "robot": workflows.demo.ROBOT,
        "hidden": {
            "effect": hidden.name,
            "joint": hidden.joint + 1,
            "size": hidden.size,
            "seed": session.seed,
        },
        "right": right,
        "gap": gap,
    }
    return Answer(
        facts,
        parts=(
            "",
            ("hidden", f"{hidden.name}{where} (seed {session.seed})"),
            ("verdict", f"{gap['verdict']}: {verdict}"),
            ("picture", str(folder / "gap" / "shrink.png")),
        ),
        status=not right,
    )


def step(
    session: Session,
    told: list[str | Path],
    what: str,
    name: str,
    words: Sequence[object],
    flags: Sequence[object],
) -> Facts:
    """Run a command, print its answer, with -v all that it prints, and tell it on the page."""
    title, quiet = f"--- dynid {name}{what}", ["--quiet"] * (not session.verbose)
    session.say(title, "bold")
    answer = invoke(session, name, *words, *flags, "--json", *quiet)
    judgement = answer.get("judgement")
    said = [judgement["sentence"], *judgement["reasons"]] if judgement else []
    for sentence in said:
        session.part(sentence)
    told += [title, shell("dynid", name, *words), *said]
    # Why not all: measured positions and their derivatives are the same with any model.
    told += [x for x in answer["wrote"] if x.suffix == ".png" and x.stem not in KINEMATICS]
    return answer
