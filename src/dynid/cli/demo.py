"""``dynid demo``: all four loops on data that ships with dynid, whose truth is known, and a page that shows them."""

from __future__ import annotations

from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import dynid_command, invoke, load_robot
from dynid.cli.session import Session, program
from dynid.files import packaged
from dynid.reports.demo_page import Chapter, write_demo_page
from dynid.text import shell
from dynid.trajectory.options import PlanOptions
from dynid.trajectory.preview import Drawing

if TYPE_CHECKING:
    from dynid.robot import Robot
    from dynid.workflows.demo import KnownArm

#: The shipped logs and the robot of each.
ARMS = {"kuka_lwr4plus": "lwr4plus", "kinova_gen2": "kinova_gen2"}
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
def command(session: Session, robot: str, effect: str | None) -> Answer:
    """Run all four loops on a simulated arm with known parameters, and show them on one page."""
    top = session.out or Path("out/demo")
    if effect:
        facts, _ = find_hidden(session, effect, session.out or top / "effect")
        return Answer(facts, status=not facts["right"])
    arm = load_robot(session, robot, None)
    folder = session.out or top / arm.slug
    chapters, facts = all_loops(session, arm, robot, folder, top)
    if ARMS.get(robot) == "lwr4plus":
        # Why not a delay: it is corrected before anybody has searched.
        names = (workflows.demo.hidden_effect("random", session.seed + k).name for k in count())
        name = next(name for name in names if name != "torque_delay")
        story, chapter = find_hidden(session, name, top / "effect")
        chapters.append(chapter)
        facts |= {key: story[key] for key in ("hidden", "right", "gap")}
    page = write_demo_page(top / "index.html", arm.name, chapters[-1].text[0], chapters, program())
    own = "my_arm.yaml" if robot in ARMS else robot
    steps = f"{shell('dynid', 'check', own)}, then {shell('dynid', 'identify', own, 'my_log.bag')}"
    return Answer(
        {"schema": "dynid/demo/1", "robot": robot, **facts, "page": page},
        parts=(
            "",
            ("truth", chapters[2].text[-1].removesuffix(".")),
            ("page", str(page)),
            ("next", f"your robot and your log:  {steps}"),
        ),
    )


def all_loops(
    session: Session, arm: Robot, robot: str, folder: Path, top: Path
) -> tuple[list[Chapter], dict[str, Any]]:
    """Derive the model, plan a motion, identify and validate; return chapters of the page and the facts."""
    model = step(session, "loop 1: dynid model", "model", robot, "--reduce", "-o", folder)
    session.stage("model", f"{model['n_parameters']} parameters, {model['rank']} base parameters")
    wrote, planned = plan(session, arm, robot, folder)
    known = recordings(session, robot, arm, folder)
    log, unseen = known.logs
    title = f"loop 3: dynid identify, on a log simulated by {known.physics}"
    identified = step(session, title, "identify", robot, log, "-o", folder, "-f", "--no-report")
    validated = step(session, "dynid validate, on another motion", "validate", folder, unseen, "-f")
    counted = workflows.demo.against_truth(dynid.loading.load_run(folder), known.truth)
    inside = (
        "{inside_95_percent} of {parameters} true base parameters lie inside their 95 % interval."
    )
    number, judgement = len(identified["parameters"]), validated["judgement"]
    torque = folder / "validation" / unseen.stem / "torque.png"
    chapters = [
        Chapter(
            "The model",
            (f"{number} base parameters determine the torques of this arm.",),
            (shell("dynid", "model", robot, "-o", folder),),
        ),
        Chapter(
            "A motion that excites them",
            planned,
            (shell("dynid", "trajectory", robot, "-o", top / "motion"),),
            tuple((each, "The planned motion: the arm at several times.") for each in wrote),
        ),
        Chapter(
            "Identify",
            (identified["judgement"]["sentence"], inside.format(**counted)),
            (shell("dynid", "identify", robot, log, "-o", folder),),
        ),
        Chapter(
            "Another motion",
            (judgement["sentence"], *judgement["reasons"]),
            (shell("dynid", "validate", folder, unseen),),
            ((torque, "Measured and predicted torque."),),
        ),
    ]
    return chapters, {"identify": identified, "validate": validated, "truth": counted}


def plan(
    session: Session, arm: Robot, robot: str, folder: Path
) -> tuple[tuple[Path, ...], tuple[str, ...]]:
    """Judge the shipped motion of an arm, or plan a random one; return pictures, and what is said of it."""
    session.say("--- loop 2: dynid trajectory, a motion that excites the parameters", "bold")
    base = workflows.model.base_model(arm, folder)
    shown, work = Drawing(folder / "preview.png"), workflows.trajectory
    if robot in ARMS:
        shipped = packaged("trajectories") / f"{arm.slug}_alpha1.0.npz"
        motion = work.review_trajectory(arm, shipped, base=base, drawing=shown)
        facts, clearance = motion.stored.facts["answer"], motion.clearance
    else:
        options = PlanOptions(optimise=False, duration=10.0, seed=session.seed)
        planned = work.plan_trajectory(arm, options, base=base, drawing=shown)
        facts, clearance = planned.facts(), planned.clearance
    size = f"condition number {facts['condition_number_scaled']:.3g}"
    said = [f"A motion of {facts['duration_s']:.0f} s inside all limits; {size}."]
    if facts["closest_m"] is not None:
        said.append(f"The links stay {1e3 * facts['closest_m']:.0f} mm apart.")
    session.stage("motion", " ".join(said))
    session.wrote(*clearance.pictures)
    return clearance.pictures, tuple(said)


def recordings(session: Session, robot: str, arm: Robot, folder: Path) -> KnownArm:
    """Return a log to identify from, an unseen one, and what is true of the arm."""
    if robot in ARMS:
        return workflows.demo.shipped(ARMS[robot])
    what = "with bodies up to 20 % off those of its file, friction, noise"
    session.say(f"--- two motions of the arm, {what}", "bold")
    folder.mkdir(parents=True, exist_ok=True)
    return workflows.demo.simulate_own(arm, folder, session.seed)


def find_hidden(session: Session, effect: str, folder: Path) -> tuple[dict[str, Any], Chapter]:
    """Simulate an arm with an effect hidden in it, identify, search, add and compare with what was hidden.

    Args:
        session: of the command; the seed chooses the effect when it is ``"random"``, the motions and the noise.
        effect: identifier, ``"nothing"``, something that is in no catalogue, or ``"random"``.
        folder: of the results.

    Returns:
        The JSON answer, and the same for the page.
    """
    hidden = workflows.demo.hidden_effect(effect, session.seed)
    what = "three motions, each recorded twice"
    session.say(f"--- a simulated LWR4+ with a hidden effect: {what}", "bold")
    robot, logs = workflows.demo.simulate_hidden(folder, hidden, session.seed)
    title, identify = "dynid identify, on the first two motions", (robot, *logs[:4], "-o", folder)
    step(session, title, "identify", *identify, "--no-feasible", "--no-report", "-f")
    added, result = folder / "with_effect", folder / "parameters.npz"
    search, copy = (result, *logs, "-o", added), folder / "arm_with_effect.yaml"
    apply = ("--apply=best", f"--new-name={copy}", "-f")
    answer = step(session, "dynid gap, held out: the third motion", "gap", *search, *apply)
    right = workflows.demo.is_right_answer(hidden, answer)
    where = f" {hidden.size:g} on joint {hidden.joint + 1}" if hidden.size else ""
    verdict = "right" if right else "wrong"
    for part in (
        "",
        ("hidden", f"{hidden.name}{where} (seed {session.seed})"),
        ("verdict", f"{answer['verdict']}: {verdict}"),
        ("picture", str(folder / "gap" / "shrink.png")),
    ):
        session.part(part)
    judgement = answer["judgement"]
    truth = f"Hidden was {hidden.name}{where}: the answer is {verdict}."
    proof = f"{shell('dynid', 'validate', added, logs[-1])} --cutoff 10"
    pictures = [path for path in answer["wrote"] if path.suffix == ".png"]
    known = "The named effect on the held-out motion."
    chapter = Chapter(
        "A hidden effect: named, added, and the error before and after",
        (judgement["sentence"], *judgement["reasons"], truth),
        (
            f"{shell('dynid', 'identify', *identify)} --no-feasible",
            f"{shell('dynid', 'gap', *search)} --apply best -f",
            *[proof] * bool(answer["named"]),
        ),
        tuple((path, CAPTIONS.get(path.stem, known)) for path in pictures),
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
        "gap": answer,
    }
    return facts, chapter


def step(session: Session, title: str, name: str, *words: object) -> dict[str, Any]:
    """Run a command and print its answer, with -v all that it prints; return its JSON answer."""
    session.say(f"--- {title}", "bold")
    answer = invoke(session, name, *words, *["--json"], *["--quiet"] * (not session.verbose))
    if judgement := answer.get("judgement"):
        for sentence in (judgement["sentence"], *judgement["reasons"]):
            session.part(sentence)
    return answer
