"""``dynid demo``: all four loops on data that ships with dynid, whose truth is known, and a page that shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import dynid_command, invoke
from dynid.cli.session import Session, program
from dynid.files import packaged
from dynid.reports.demo_page import Chapter, write_demo_page
from dynid.text import shell
from dynid.trajectory.preview import Drawing

if TYPE_CHECKING:
    from dynid.robot import Robot

#: The shipped logs and the robot of each.
ARMS = {"kuka_lwr4plus": "lwr4plus", "kinova_gen2": "kinova_gen2"}
#: What the page calls what a command does.
TITLES = {
    "model": "The model",
    "identify": "Identify",
    "validate": "Another motion",
    "gap": "A hidden effect: named, added, and the error before and after",
}
#: What the pictures of a search show.
CAPTIONS = {
    "where": "Where the error is, joint by joint.",
    "shrink": "The held-out error, before and after.",
}


@dynid_command(
    "demo",
    examples=(
        "dynid demo",
        "dynid demo --robot kinova_gen2",
        "dynid demo --effect random --seed 3",
    ),
)
@click.option(
    "--robot",
    type=click.Choice([*ARMS]),
    default="kuka_lwr4plus",
    show_default=True,
    help="The arm, whose logs come with dynid.",
)
@click.option(
    "--effect",
    metavar="NAME|random",
    help="Hide an effect in the simulated LWR4+, find it and add it.",
)
def command(session: Session, robot: str, effect: str | None) -> Answer:
    """Run all four loops on a simulated arm with known parameters, and show them on one page."""
    top = session.out or Path("out/demo")
    if effect:
        return find_hidden(session, effect, session.out or top / "effect")[0]
    arm = dynid.load_robot(robot)
    folder = session.out or top / arm.slug
    chapters, facts = all_loops(session, arm, robot, folder)
    if robot == workflows.demo.ROBOT:
        story, chapter = find_hidden(session, "random", top / "effect")
        session.show(story)
        chapters.append(chapter)
        facts |= {key: story.facts[key] for key in ("hidden", "right", "gap")}
    page = write_demo_page(top / "index.html", arm.name, chapters[-1].text[0], chapters, program())
    return Answer(
        {"schema": "dynid/demo/1", "robot": robot, **facts, "page": page},
        parts=(
            "",
            ("truth", chapters[2].text[-1].removesuffix(".")),
            ("page", str(page)),
            ("next", "dynid check my_arm.yaml, then dynid identify my_arm.yaml my_log.bag"),
        ),
    )


def all_loops(
    session: Session, arm: Robot, robot: str, folder: Path
) -> tuple[list[Chapter], dict[str, Any]]:
    """Derive the model, look at a motion, identify and validate; return chapters of the page and the facts."""
    model, first = step(session, ", loop 1", "model", (robot, "-o", folder), ("--reduce",))
    size = f"{model['n_parameters']} parameters, {model['rank']} base parameters"
    session.stage("model", size)
    shown = motion(session, arm, robot, folder)
    (log, unseen), truth = workflows.demo.shipped(ARMS[robot])
    what, words = ", loop 3, on a log simulated by PyBullet", (robot, log, "-o", folder)
    identified, third = step(session, what, "identify", words, ("-f", "--no-report"))
    validated, last = step(session, ", on another motion", "validate", (folder, unseen), ("-f",))
    counted = workflows.demo.against_truth(dynid.loading.load_run(folder), truth)
    inside = (
        "{inside_95_percent} of {parameters} true base parameters lie inside their 95 % interval."
    )
    torque = (folder / "validation" / unseen.stem / "torque.png", "Measured and predicted torque.")
    chapters = [
        replace(first, text=(f"{size} determine the torques of this arm.",)),
        shown,
        replace(third, text=(third.text[0], inside.format(**counted))),
        replace(last, pictures=(torque,)),
    ]
    return chapters, {"identify": identified, "validate": validated, "truth": counted}


def motion(session: Session, arm: Robot, robot: str, folder: Path) -> Chapter:
    """Judge the shipped motion of an arm; return what is said of it, with pictures."""
    session.say("--- dynid trajectory, loop 2: a motion that excites the parameters", "bold")
    file = packaged("trajectories") / f"{arm.slug}_alpha1.0.npz"
    base, drawing = workflows.model.base_model(arm, folder), Drawing(folder / "preview.png")
    judged = workflows.trajectory.review_trajectory(arm, file, base=base, drawing=drawing)
    facts, pictures = judged.stored.facts["answer"], judged.clearance.pictures
    size = f"condition number {facts['condition_number_scaled']:.3g}"
    said = [f"A motion of {facts['duration_s']:.0f} s inside all limits; {size}."]
    if facts["closest_m"] is not None:
        said.append(f"The links stay {1e3 * facts['closest_m']:.0f} mm apart.")
    session.stage("motion", " ".join(said))
    session.wrote(*pictures)
    return Chapter(
        "A motion that excites them",
        tuple(said),
        (shell("dynid", "trajectory", robot),),
        tuple((each, "The planned motion: the arm at several times.") for each in pictures),
    )


def find_hidden(session: Session, effect: str, folder: Path) -> tuple[Answer, Chapter]:
    """Simulate an arm with an effect hidden in it, identify, search, add and compare with what was hidden.

    Args:
        session: of the command; the seed chooses the effect when it is ``"random"``, the motions and the noise.
        effect: identifier, ``"nothing"``, something that is in no catalogue, or ``"random"``.
        folder: of the results.

    Returns:
        The answer, and the same for the page.
    """
    hidden = workflows.demo.hidden_effect(effect, session.seed)
    session.say(
        "--- a simulated LWR4+ with a hidden effect: three motions, each recorded twice", "bold"
    )
    robot, logs = workflows.demo.simulate_hidden(folder, hidden, session.seed)
    added, words = folder / "with_effect", (robot, *logs[:4], "-o", folder, "--no-feasible")
    what, flags = ", on the first two motions", ("--no-report", "-f")
    _, first = step(session, what, "identify", words, flags)
    searched = (folder / "parameters.npz", *logs, "-o", added, "--apply=best", "-f")
    what, copy = ", held out: the third motion", folder / "arm_with_effect.yaml"
    gap, chapter = step(session, what, "gap", searched, [f"--new-name={copy}"])
    right = workflows.demo.is_right_answer(hidden, gap)
    where = f" {hidden.size:g} on joint {hidden.joint + 1}" if hidden.size else ""
    verdict = "right" if right else "wrong"
    proof = f"{shell('dynid', 'validate', added, logs[-1])} --cutoff 10"
    chapter = replace(
        chapter,
        text=(*chapter.text, f"Hidden was {hidden.name}{where}: the answer is {verdict}."),
        commands=(*first.commands, *chapter.commands, *[proof] * bool(gap["named"])),
        pictures=tuple(
            (path, CAPTIONS.get(path.stem, "The named effect on the held-out motion."))
            for path in gap["wrote"]
            if path.suffix == ".png"
        ),
    )
    facts = {
        "schema": "dynid/demo/1",
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
    parts = (
        "",
        ("hidden", f"{hidden.name}{where} (seed {session.seed})"),
        ("verdict", f"{gap['verdict']}: {verdict}"),
        ("picture", str(folder / "gap" / "shrink.png")),
    )
    return Answer(facts, parts=parts, status=not right), chapter


def step(
    session: Session, what: str, name: str, words: Sequence[object], flags: Sequence[object] = ()
) -> tuple[dict[str, Any], Chapter]:
    """Run a command and print its answer, with -v all that it prints; return that for programs and for the page."""
    session.say(f"--- dynid {name}{what}", "bold")
    quiet = ["--json", *["--quiet"] * (not session.verbose)]
    answer = invoke(session, name, *words, *flags, *quiet)
    judgement = answer.get("judgement")
    said = (judgement["sentence"], *judgement["reasons"]) if judgement else ()
    for sentence in said:
        session.part(sentence)
    return answer, Chapter(TITLES[name], said, (shell("dynid", name, *words),))
