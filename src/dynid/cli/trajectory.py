"""``dynid trajectory ROBOT [PLAN.yaml]``: loop 2a, a motion that is optimal, safe, and seen before it runs."""

from __future__ import annotations

from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

import dynid
from dynid import workflows
from dynid.answer import Answer
from dynid.cli.options import INPUT, Existing, Input, dynid_command, take_defaults
from dynid.cli.prompt import Reply, ask, can_ask, may_write
from dynid.cli.session import Session
from dynid.errors import Declined, Finding, NoDisplay
from dynid.files.yamlfile import read_yaml
from dynid.options import Options, option
from dynid.progress import notice
from dynid.trajectory.options import IN_PLAN_FILE, PlanOptions

if TYPE_CHECKING:
    from dynid.robot import Robot
    from dynid.trajectory.preview import Drawing
    from dynid.workflows.trajectory import Plan, SafeMotion

#: Names of the still and of the animation, beside trajectory.npz.
PICTURES = ("preview.png", "preview.gif")
#: What is said of a motion that nobody has accepted, that was accepted after somebody saw it, and unseen.
MARKS = {None: "no", True: "yes", False: "accepted unseen"}


@dataclass(frozen=True)
class Surroundings(Options):
    """What a motion is planned from besides its options, and how it is looked at."""

    from_waypoints: Input | None = option(
        None, "Go through these points, one per row, instead of searching.", metavar="CSV"
    )
    earlier: tuple[Existing, ...] = option(
        (),
        "Result whose information the motion completes; may be repeated.",
        metavar="RESULT",
        repeatable=True,
    )
    for_gap: Input | None = option(
        None,
        "Plan the motion that decides between the explanations of a dynid gap search.",
        metavar="GAP.npz",
    )
    preview: str = option(
        "auto",
        "How to preview the motion.",
        choices=("auto", "gui", "video", "picture", "none"),
    )
    urdf: Input | None = option(None, "URDF of the arm with its own meshes.")
    review: Path | None = option(
        None, "Preview and accept a motion planned before.", metavar="FILE"
    )
    accept: bool = option(False, "Mark the motion as reviewed without being asked.")


def take_options(ctx: click.Context, param: click.Parameter, plan: Path | None) -> Path | None:
    """Take options of PLAN.yaml as defaults, before those of other files."""
    if plan is not None:
        keys = read_yaml(plan).entries()
        take_defaults(
            ctx, {key: keys[key] for key in IN_PLAN_FILE if key in keys and not keys[key].is_null}
        )
    return plan


#: What may be answered: a slip of the keyboard is asked again, and ends nothing.
ALPHA = click.FloatRange(0, 1, min_open=True)


@dynid_command("trajectory", without=("processes",))
@click.argument(
    "plan", required=False, metavar="[PLAN.yaml]", type=INPUT, is_eager=True, callback=take_options
)
def command(
    session: Session,
    *,
    robot: Robot,
    plan: Path | None,
    options: PlanOptions,
    around: Surroundings,
) -> Answer:
    """Plan an exciting motion, check limits and collisions, preview it, ask for approval.

    Examples:
      dynid trajectory kinova_gen2                     search, preview, ask; alpha 0.2 for the first run
      dynid trajectory kuka_lwr4plus --alpha 1 --duration 10 --segments 5
      dynid trajectory my_arm.yaml --from-waypoints points.csv
      dynid trajectory kinova_gen2 --for-gap out/kinova_gen2/gap.npz -o next          the next experiment
      dynid trajectory kinova_gen2 --review out/kinova_gen2/trajectory.npz
    """
    work, path = workflows.trajectory, session.folder(robot.slug) / "trajectory.npz"
    waypoints, options = work.with_plan_file(plan, robot, options)
    if around.review is not None:
        return reviewed(session, robot, around.review, options, around)
    files = {"plan": plan, "waypoints": around.from_waypoints, "gap": around.for_gap}
    files |= {f"earlier {k}": file for k, file in enumerate(around.earlier, start=1)}
    if not may_write(session, path, work.plan_inputs(robot, options, files)):
        answer = work.stored_answer(robot, path)
        known = answer.facts["reviewed"] or not around.accept
        return answer if known else reviewed(session, robot, path, options, around)
    drawing, window = view(session, around, path.parent)
    while True:
        planned = dynid.plan_trajectory(
            robot,
            options,
            waypoints=around.from_waypoints or waypoints,
            earlier=around.earlier,
            for_gap=around.for_gap,
            urdf=around.urdf,
            base=dynid.base_model(robot, path.parent),
            drawing=drawing,
        )
        session.show(planned.answer())
        reply, seen = asked(session, planned, around, window=window)
        if reply == "quit":
            for picture in planned.clearance.pictures:
                picture.unlink(missing_ok=True)
            raise Declined("the motion was not accepted", why="nothing was written")
        if reply == "yes" or not can_ask(session) or session.yes:
            inputs = work.plan_inputs(robot, options, files)
            return saved(session, path, planned, inputs, seen if reply == "yes" else None)
        alpha = click.prompt("alpha", default=options.alpha, type=ALPHA, err=True)
        seed = click.prompt("seed", default=options.seed + 1, err=True)
        options = replace(options, alpha=alpha, seed=seed)
        session.stage("again", f"alpha {alpha:g}, seed {seed}; waypoints are read again")


def saved(
    session: Session, path: Path, planned: Plan, inputs: dict[str, str], seen: bool | None
) -> Answer:
    """Write a plan, with the mark of who has seen it; None where nobody accepted it."""
    pictures = planned.clearance.pictures
    # Why: pictures of another motion beside this one would be taken for pictures of it.
    for old in {path.parent / name for name in PICTURES} - {*pictures}:
        old.unlink(missing_ok=True)
    path, *others = planned.save(path, inputs, seen=seen)
    session.wrote(path, note=f"reviewed: {MARKS[seen]}")
    session.wrote(*others)
    step = workflows.trajectory.next_step(planned.robot, path, reviewed=seen is not None)
    session.written.extend(pictures)
    return Answer(planned.facts() | {"reviewed": seen is not None}, next=[step])


def reviewed(
    session: Session, robot: Robot, path: Path, options: PlanOptions, around: Surroundings
) -> Answer:
    """Judge, preview and ask about a motion that was planned before, and mark it."""
    work, (drawing, window) = workflows.trajectory, view(session, around, path.parent)
    base = dynid.base_model(robot, session.folder(robot.slug))
    motion = work.review_trajectory(
        robot, path, options, urdf=around.urdf, base=base, drawing=drawing
    )
    notice(motion.clearance.findings)
    session.written.extend(motion.clearance.pictures)
    for picture in motion.clearance.pictures:
        session.stage("preview", str(picture))
    reply, seen = asked(session, motion, around, window=window)
    if reply == "yes":
        motion.accept(seen=seen)
        session.wrote(path, note=f"reviewed: {MARKS[seen]}")
    return replace(work.stored_answer(robot, path), sentence="")


def asked(
    session: Session, motion: SafeMotion, around: Surroundings, *, window: bool
) -> tuple[Reply, bool]:
    """Ask P2 while the window shows the motion; return the reply, and whether there was something to see."""
    with motion.in_window() if window else nullcontext():
        if window:
            session.stage("preview", "PyBullet window opened; press space there to replay")
        reply = ask(session, "P2", given=around.accept or None)
    return reply, window or bool(motion.clearance.pictures)


def view(session: Session, around: Surroundings, folder: Path) -> tuple[Drawing, bool]:
    """Return what is drawn, and whether there is a window: where there are a display and a person.

    Raises:
        NoDisplay: a window was asked for and there is no display.
    """
    from dynid.trajectory.preview import Drawing, has_display

    wanted, (picture, animation) = around.preview, (folder / name for name in PICTURES)
    window, auto = wanted == "gui", wanted == "auto"
    if not has_display():
        if window:
            raise NoDisplay("no display: PyBullet cannot open its window")
        text = f"no display: preview saved as {picture} and {animation} instead"
        notice([Finding("W604", "info", text)] * auto)
    elif auto:
        window = can_ask(session) and not around.accept
    return Drawing(
        picture=picture if wanted in ("auto", "video", "picture") else None,
        animation=animation if wanted in ("auto", "video") else None,
        needed=wanted in ("gui", "video"),
    ), window
