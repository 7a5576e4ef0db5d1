"""``dynid trajectory ROBOT [PLAN.yaml]``: loop 2a, a motion that is optimal, safe, and seen before it runs."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import click

from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import (
    INPUT,
    PATH,
    dynid_command,
    options_from,
    robot_argument,
    take_defaults,
)
from dynid.cli.prompt import ATTEMPTS, Reply, ask, ask_line, can_ask, may_write
from dynid.cli.session import Session
from dynid.errors import Declined, Finding, NoDisplay, WrongUsage
from dynid.files.yamlfile import read_yaml
from dynid.judgement.rules import Step
from dynid.text import shell
from dynid.trajectory.options import PlanOptions

if TYPE_CHECKING:
    from dynid.files.trajectoryfile import StoredTrajectory
    from dynid.robot import Robot
    from dynid.trajectory.preview import Drawing
    from dynid.workflows.trajectory import Plan, Reviewed

#: Names of the still and of the animation, beside trajectory.npz.
PICTURES = ("preview.png", "preview.gif")
#: What is said of a motion that nobody has accepted, that was accepted after somebody saw it, and unseen.
MARKS = {None: "no", True: "yes", False: "accepted unseen"}


class View(NamedTuple):
    """How a motion will be looked at: what is drawn, whether PyBullet's window opens, whether --accept was given."""

    drawing: Drawing
    window: bool
    accept: bool


def take_options(ctx: click.Context, param: click.Parameter, plan: Path | None) -> Path | None:
    """Take options of PLAN.yaml as defaults, before those of other files."""
    from dynid.files.planfile import OPTIONS

    if plan is not None:
        keys = read_yaml(plan).entries()
        given = {key: keys[key] for key in OPTIONS if key in keys and not keys[key].is_null}
        take_defaults(ctx, given)
    return plan


@dynid_command(
    "trajectory",
    examples=(
        "dynid trajectory kinova_gen2                     search, preview, ask; alpha 0.2 for the first run",
        "dynid trajectory kuka_lwr4plus --alpha 1 --duration 10 --segments 5",
        "dynid trajectory my_arm.yaml --from-waypoints points.csv",
        "dynid trajectory kinova_gen2 --for-gap out/kinova_gen2/gap.npz -o next          the next experiment",
        "dynid trajectory kinova_gen2 --review out/kinova_gen2/trajectory.npz",
    ),
)
@robot_argument
@click.argument(
    "plan", required=False, metavar="[PLAN.yaml]", type=INPUT, is_eager=True, callback=take_options
)
@options_from(PlanOptions, without=("processes",))
@click.option(
    "--from-waypoints",
    metavar="CSV",
    type=INPUT,
    help="Go through these points, one per row, instead of searching.",
)
@click.option(
    "--earlier",
    metavar="FILE",
    multiple=True,
    type=click.Path(path_type=Path, exists=True),
    help="Log, parameters.npz or trajectory.npz whose information the motion completes; may be repeated.",
)
@click.option(
    "--for-gap",
    type=INPUT,
    metavar="GAP.npz",
    help="Plan the motion that decides between the explanations of a dynid gap search.",
)
@click.option(
    "--preview",
    type=click.Choice(["auto", "gui", "video", "picture", "none"]),
    default="auto",
    show_default=True,
    help="How to preview the motion.",
)
@click.option("--urdf", type=INPUT, metavar="FILE", help="URDF of the arm with its own meshes.")
@click.option(
    "--review", type=PATH, metavar="FILE", help="Preview and accept a motion planned before."
)
@click.option("--accept", is_flag=True, help="Mark the motion as reviewed without being asked.")
def command(
    session: Session,
    robot: Robot,
    plan: Path | None,
    options: PlanOptions,
    urdf: Path | None,
    review: Path | None,
    preview: str,
    accept: bool,
    **files: Any,  # noqa: ANN401
) -> Answer:
    """Plan an exciting motion, check limits and collisions, preview it, ask for approval."""
    from dynid.files.planfile import PlanFile, read_plan

    written = PlanFile() if plan is None else read_plan(plan, robot)
    changes: dict[str, Any] = {
        "obstacles": (*((*low, *high) for low, high in written.obstacles), *options.obstacles)
    }
    if written.workspace is not None and options.workspace is None:
        changes["workspace"] = (*written.workspace[0], *written.workspace[1])
    options = replace(options, **changes)
    path = session.folder(robot.slug) / "trajectory.npz"
    if review is not None:
        look = view(session, preview, review.parent, accept=accept)
        return reviewed(session, robot, review, options, urdf, look)
    inputs = plan_inputs(robot, options, plan, files)
    if not may_write(session, path, inputs):
        return reused(session, robot, path, accept=accept)
    while True:
        look = view(session, preview, path.parent, accept=accept)
        planned = workflows.trajectory.plan_trajectory(
            robot,
            options,
            waypoints=files["from_waypoints"] or written.waypoints,
            earlier=files["earlier"],
            for_gap=files["for_gap"],
            urdf=urdf,
            base=workflows.model.base_model(robot, path.parent),
            drawing=look.drawing,
        )
        session.show(planned.answer())
        reply = asked(session, planned, look)
        if reply is Reply.QUIT:
            remove(planned.clearance.pictures)
            raise Declined("the motion was not accepted", why="nothing was written")
        if reply is Reply.YES or not can_ask(session) or session.yes:
            return saved(session, path, planned, inputs, look if reply is Reply.YES else None)
        options, files["from_waypoints"] = changed(session, options, files["from_waypoints"])
        inputs = plan_inputs(robot, options, plan, files)


def plan_inputs(
    robot: Robot, options: PlanOptions, plan: Path | None, files: dict[str, Any]
) -> dict[str, str]:
    """Return what a plan depends on, for its header."""
    used = {"plan": plan, "waypoints": files["from_waypoints"], "gap": files["for_gap"]}
    used |= {f"earlier {k}": file for k, file in enumerate(files["earlier"], start=1)}
    there = {name: file for name, file in used.items() if file is not None}
    return workflows.trajectory.plan_inputs(robot, options, there)


def changed(
    session: Session, options: PlanOptions, waypoints: Path | None
) -> tuple[PlanOptions, Path | None]:
    """Ask what to change in a motion that did not look safe."""
    seed = options.seed + 1
    question = f"change what? such as alpha {options.alpha / 2:g}, seed {seed}, points.csv; Enter means seed {seed}"
    for _ in range(ATTEMPTS):
        words = ask_line(session, question).replace("=", " ").removeprefix("--").split()
        try:
            match words:
                case []:
                    options = replace(options, seed=seed)
                case ["seed", number]:
                    options = replace(options, seed=int(number))
                case ["alpha", number]:
                    options = replace(options, alpha=float(number))
                case [*_, file] if len(words) <= 2 and Path(file).is_file():
                    waypoints = Path(file)
                case _:
                    what = f"'{' '.join(words)}' is neither alpha, seed nor a file of waypoints"
                    raise WrongUsage(what)
        except ValueError:
            session.say(f"  {words[1]} is no number")
            continue
        except WrongUsage as error:
            session.say(f"  {error.what}")
            continue
        now = f"alpha {options.alpha:g}, seed {options.seed}"
        session.stage("again", f"{now}; a changed waypoint file is read again")
        return options, waypoints
    raise Declined("the motion was not accepted", why="nothing was written")


def saved(
    session: Session, path: Path, planned: Plan, inputs: dict[str, str], look: View | None
) -> Answer:
    """Write a plan, marked as accepted where a look is given."""
    pictures, seen = planned.clearance.pictures, None
    if look is not None:
        seen = bool(pictures) or look.window
        planned = planned.accepted(seen=seen)
    # Why: pictures of another motion beside this one would be taken for pictures of it.
    remove({path.parent / name for name in PICTURES} - set(pictures))
    wrote = planned.save(path, inputs)
    session.wrote(path, note=f"reviewed: {MARKS[seen]}")
    session.wrote(*wrote[1:])
    step = next_step(planned.robot, path, reviewed=look is not None)
    if any(finding.code == "W606" for finding in planned.findings):
        # Why: dynid record would refuse it.
        limits = f"write `limits:` of every joint into {planned.robot.editable}"
        step = Step("", f"{limits}, then plan with that file")
    facts = {"wrote": [*wrote, *pictures], "reviewed": look is not None}
    return Answer(planned.facts() | facts, next=[step])


def remove(pictures: Any) -> None:  # noqa: ANN401
    """Remove pictures of a motion that is not there any more."""
    for picture in pictures:
        picture.unlink(missing_ok=True)


def asked(session: Session, motion: Plan | Reviewed, look: View) -> Reply:
    """Ask P2 while the window shows the motion."""
    with motion.window() if look.window else nullcontext():
        if look.window:
            session.stage("preview", "PyBullet window opened; press space there to replay")
        return ask(session, "P2", given=look.accept or None)


def view(session: Session, wanted: str, folder: Path, *, accept: bool) -> View:
    """Decide how to look: a window where there is a display and a person, otherwise pictures.

    Raises:
        NoDisplay: a window was asked for and there is no display.
    """
    from dynid.trajectory.preview import Drawing, has_display

    picture, animation = (folder / name for name in PICTURES)
    window, auto = wanted == "gui", wanted == "auto"
    if not has_display():
        if window:
            raise NoDisplay("no display: PyBullet cannot open its window")
        text = f"no display: preview saved as {picture} and {animation} instead"
        session.findings([Finding("W604", "info", text)] * auto)
    elif auto:
        window = can_ask(session) and not accept
    folder.mkdir(parents=True, exist_ok=True)
    drawing = Drawing(
        picture=picture if wanted in ("auto", "video", "picture") else None,
        animation=animation if wanted in ("auto", "video") else None,
        needed=wanted in ("gui", "video"),
    )
    return View(drawing, window, accept)


# ---------------------------------------------------------------- motions planned before
def reused(session: Session, robot: Robot, path: Path, *, accept: bool) -> Answer:
    """Answer from a motion that was planned before with the same inputs; accept it when asked to."""
    from dynid.files.trajectoryfile import read_trajectory

    stored, seen = read_trajectory(path), None
    if accept and not stored.reviewed:
        drawn = stored.facts.get("pictures", [])
        seen = bool(drawn) and all((path.parent / name).is_file() for name in drawn)
        stored = stored.accepted(seen=seen)
    answer = marked(session, robot, path, stored, seen)
    facts = stored.facts.get("answer")
    sentence = workflows.trajectory.plan_sentence(robot, facts) if facts else ""
    return replace(answer, parts=[sentence] * bool(facts))


def reviewed(
    session: Session, robot: Robot, path: Path, options: PlanOptions, urdf: Path | None, look: View
) -> Answer:
    """Judge, preview and ask about a motion that was planned before, and mark it."""
    from dynid.files.trajectoryfile import read_trajectory

    stored, seen = read_trajectory(path, robot), None
    base = workflows.model.base_model(robot, session.folder(robot.slug))
    review = workflows.trajectory.review_trajectory(
        robot, stored, options, urdf=urdf, base=base, drawing=look.drawing
    )
    pictures = review.clearance.pictures
    session.findings(review.clearance.findings)
    for picture in pictures:
        session.stage("preview", str(picture))
    if asked(session, review, look) is Reply.YES:
        seen = bool(pictures) or look.window
        stored = review.accepted(seen=seen)
    return marked(session, robot, path, stored, seen, *pictures)


def marked(
    session: Session,
    robot: Robot,
    path: Path,
    stored: StoredTrajectory,
    seen: bool | None,
    *pictures: Path,
) -> Answer:
    """Write a motion that was accepted now, and answer with it and what to do with it."""
    from dynid.files.trajectoryfile import write_trajectory

    facts = {**stored.facts.get("answer", {}), "wrote": [*pictures], "reviewed": stored.reviewed}
    if seen is not None:
        write_trajectory(path, stored)
        session.wrote(path, note=f"reviewed: {MARKS[seen]}")
        facts["wrote"] = [path, *pictures]
    return Answer(facts, next=[next_step(robot, path, reviewed=stored.reviewed)])


def next_step(robot: Robot, path: Path, *, reviewed: bool) -> Step:
    """Return what to do with a motion: record it, or look at it before."""
    if reviewed:
        why = "Record it. This moves the arm and asks first."
        return Step(why, f"dynid record {robot.word} {shell(path)}")
    why = "Look at it and accept it: an arm plays no motion that nobody has seen."
    return Step(why, f"dynid trajectory {robot.word} {shell('--review', path)}")
