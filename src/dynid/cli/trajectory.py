"""``dynid trajectory ROBOT [PLAN.yaml]``: loop 2a, a motion that is optimal, safe, and seen before it runs."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

import dynid
from dynid import workflows
from dynid.cli.arguments import options_from, options_of, robot_argument
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import ATTEMPTS, Answer, ask, ask_line, can_ask, may_write
from dynid.errors import Declined, Finding, NoDisplay, WrongUsage
from dynid.text import shell
from dynid.trajectory.options import PlanOptions

if TYPE_CHECKING:
    from dynid.files.planfile import PlanFile
    from dynid.robot import Robot
    from dynid.trajectory.preview import Drawing
    from dynid.workflows.plan import Plan
    from dynid.workflows.trajectory import Reviewed

#: Names of the still and of the animation, beside trajectory.npz.
PICTURES = ("preview.png", "preview.gif")
_FILE = click.Path(path_type=Path, exists=True, dir_okay=False)


@dataclass(frozen=True)
class View:
    """How a motion will be looked at.

    Attributes:
        drawing: what is drawn.
        window: whether PyBullet's window opens.
    """

    drawing: Drawing
    window: bool


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
@click.argument("plan", required=False, metavar="[PLAN.yaml]", type=_FILE)
@options_from(PlanOptions, without=("seed", "processes"))
@click.option(
    "--from-waypoints",
    metavar="CSV",
    type=_FILE,
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
    type=_FILE,
    metavar="GAP.npz",
    help="Plan the motion that decides between the explanations of a dynid gap search.",
)
@click.option(
    "--preview",
    type=click.Choice(["auto", "gui", "video", "picture", "none"]),
    default="auto",
    show_default=True,
    help="How to look at the motion.",
)
@click.option("--urdf", type=_FILE, metavar="FILE", help="URDF of the arm with its own meshes.")
@click.option(
    "--review",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="Preview and accept a motion planned before.",
)
@click.option("--accept", is_flag=True, help="Mark the motion as reviewed without being asked.")
def command(common: Common, robot: str, plan: Path | None, **values: Any) -> None:  # noqa: ANN401
    """Plan an excitation motion, prove it safe, preview it, and ask."""
    from dynid.files.planfile import PlanFile, read_plan

    arm = dynid.load_robot(robot)
    common.terminal.findings(arm.findings)
    written = PlanFile() if plan is None else read_plan(plan, arm)
    values = with_plan(click.get_current_context(), written, values)
    options = options_of(PlanOptions, values, seed=common.seed)
    path = common.folder(arm.slug) / "trajectory.npz"
    if values["review"] is not None:
        return review(common, arm, options, values)

    def inputs() -> dict[str, str]:
        files = {
            "plan": plan,
            "waypoints": values["from_waypoints"],
        }
        files["gap"] = values["for_gap"]
        files |= {f"earlier {k + 1}": earlier for k, earlier in enumerate(values["earlier"])}
        return workflows.trajectory.plan_inputs(
            arm, options, {name: file for name, file in files.items() if file is not None}
        )

    if not may_write(common, path, inputs()):
        return reuse(common, arm, path, accept=values["accept"])
    while plan_once(common, arm, written, options, values, path, inputs()) is Answer.NO:
        options, values = changed(common, options, values)
    return None


def changed(
    common: Common, options: PlanOptions, values: dict[str, Any]
) -> tuple[PlanOptions, dict[str, Any]]:
    """Ask what to change in a motion that did not look safe."""
    seed = options.seed + 1
    question = f"change what? such as alpha {options.alpha / 2:g}, seed {seed}, points.csv; Enter means seed {seed}"
    for _ in range(ATTEMPTS):
        words = ask_line(common, question).replace("=", " ").removeprefix("--").split()
        try:
            if not words or (words[0] == "seed" and len(words) == 2):
                options = replace(options, seed=int(words[1]) if words else seed)
            elif words[0] == "alpha" and len(words) == 2:
                options = replace(options, alpha=float(words[1]))
            elif len(words) <= 2 and Path(words[-1]).is_file():
                values = values | {"from_waypoints": Path(words[-1])}
            else:
                raise WrongUsage(
                    f"'{' '.join(words)}' is neither alpha, seed nor a file of waypoints"
                )
        except (ValueError, WrongUsage) as error:
            common.terminal.say(
                f"  {error.what if isinstance(error, WrongUsage) else f'{words[1]} is no number'}"
            )
            continue
        text = (
            f"alpha {options.alpha:g}, seed {options.seed}; a changed waypoint file is read again"
        )
        common.terminal.stage("again", text)
        return options, values
    raise Declined("the motion was not accepted", why="nothing was written")


def with_plan(ctx: click.Context, plan: PlanFile, values: dict[str, Any]) -> dict[str, Any]:
    """Return the values of the command line with those of PLAN.yaml where the command line is silent."""
    chosen = dict(values)
    params = {param.name: param for param in ctx.command.params}
    sources = (click.core.ParameterSource.COMMANDLINE, click.core.ParameterSource.ENVIRONMENT)
    for name, text in plan.options.items():
        if ctx.get_parameter_source(name) in sources:
            continue
        try:
            chosen[name] = params[name].type_cast_value(ctx, text)
        except click.BadParameter as error:
            raise WrongUsage(
                f"{plan.places[name]}: {name}: {error.message}", where=plan.places[name]
            ) from None
    chosen["obstacles"] = (
        *((*lower, *upper) for lower, upper in plan.obstacles),
        *chosen["obstacles"],
    )
    if plan.workspace is not None and chosen["workspace"] is None:
        chosen["workspace"] = (*plan.workspace[0], *plan.workspace[1])
    return chosen


def plan_once(
    common: Common,
    arm: Robot,
    written: PlanFile,
    options: PlanOptions,
    values: dict[str, Any],
    path: Path,
    inputs: dict[str, str],
) -> Answer:
    """Plan, show, ask and write; NO when the person wants another motion."""
    look = view(common, values, path.parent)
    with common.terminal.progress() as progress:
        found = workflows.trajectory.plan_trajectory(
            arm,
            options,
            waypoints=values["from_waypoints"] or written.waypoints,
            earlier=values["earlier"],
            urdf=values["urdf"],
            base=workflows.model.base_model(arm, path.parent, progress),
            drawing=look.drawing,
            for_gap=values["for_gap"],
            progress=progress,
        )
    show(common, found)
    answer = accepted(common, found, look, accept=values["accept"])
    if answer is Answer.QUIT:
        remove(found.clearance.pictures)
        raise Declined("the motion was not accepted", why="nothing was written")
    if answer is Answer.NO and can_ask(common) and not common.yes and not values["accept"]:
        return answer
    if answer is Answer.YES:
        seen = bool(found.clearance.pictures) or look.window
        found = found.accepted(seen=seen)
    # Why: pictures of another motion beside this one would be taken for pictures of it.
    remove({path.parent / name for name in PICTURES} - set(found.clearance.pictures))
    wrote = found.save(path, inputs)
    wrote_trajectory(
        common, path, reviewed=answer is Answer.YES, seen=answer is not Answer.YES or seen
    )
    for text in wrote[1:]:
        common.terminal.wrote(text)
    wrote += found.clearance.pictures
    common.terminal.emit_json(
        found.facts() | {"wrote": [str(p) for p in wrote], "reviewed": answer is Answer.YES}
    )
    if any(finding.code == "W606" for finding in found.findings):
        # Why: dynid record would refuse it.
        common.terminal.next(
            f"write `limits:` of every joint into {arm.editable}, then plan with that file"
        )
    else:
        show_next(common, arm, path, reviewed=answer is Answer.YES)
    return Answer.YES


def remove(pictures: Iterable[Path]) -> None:
    """Remove pictures of a motion that is not there any more."""
    for picture in pictures:
        picture.unlink(missing_ok=True)


def wrote_trajectory(common: Common, path: Path, *, reviewed: bool, seen: bool = True) -> None:
    """Say that trajectory.npz was written."""
    yes = "reviewed: yes" if seen else "reviewed: accepted unseen"
    common.terminal.wrote(path, note=yes if reviewed else "reviewed: no")


def show(common: Common, found: Plan) -> None:
    """Print the answer and the joints' peaks on stdout, and say on stderr why."""
    common.terminal.findings(found.findings)
    common.terminal.answer(found.sentence, style="bold", indent=2)
    for label, text in found.lines():
        common.terminal.stage(label, text)
    for picture in found.clearance.pictures:
        common.terminal.stage("preview", str(picture))
    rows = [
        (
            p.joint,
            f"{p.position:.3f}",
            f"{p.velocity:.3f}",
            f"{p.acceleration:.3f}",
            "-" if p.torque is None else f"{p.torque:.2f}",
            f"{100 * p.share:.0f} %",
        )
        for p in found.check.peaks
    ]
    names = ("position", "velocity", "accel.", "torque")
    heads = [f"{name} {unit}" for name, unit in zip(names, found.units, strict=True)]
    common.terminal.table(("joint", *heads, "of limit"), rows)


def accepted(common: Common, found: Plan | Reviewed, look: View, *, accept: bool) -> Answer:
    """Ask P2 while the window shows the motion."""
    shown: AbstractContextManager[None] = found.window() if look.window else nullcontext()
    with shown:
        if look.window:
            common.terminal.stage("preview", "PyBullet window opened; press space there to replay")
        return ask(common, "P2", given=True if accept else None)


def view(common: Common, values: dict[str, Any], folder: Path) -> View:
    """Decide how to look: a window where there is a display and a person, otherwise pictures.

    Raises:
        NoDisplay: a window was asked for and there is no display.
    """
    from dynid.trajectory.preview import Drawing, has_display

    wanted = values["preview"]
    if wanted == "gui" and not has_display():
        raise NoDisplay("no display: PyBullet cannot open its window")
    automatic_window = (
        wanted == "auto" and has_display() and can_ask(common) and not values["accept"]
    )
    if wanted == "auto" and not has_display():
        text = f"no display: preview saved as {folder / 'preview.png'} and {folder / 'preview.gif'} instead"
        common.terminal.finding(Finding("W604", "info", text))
    folder.mkdir(parents=True, exist_ok=True)
    drawing = Drawing(
        picture=folder / PICTURES[0] if wanted in ("auto", "video", "picture") else None,
        animation=folder / PICTURES[1] if wanted in ("auto", "video") else None,
        needed=wanted in ("gui", "video"),
    )
    return View(drawing, wanted == "gui" or automatic_window)


def reuse(common: Common, arm: Robot, path: Path, *, accept: bool) -> None:
    """Answer from a motion that was planned before with the same inputs; accept it when asked to."""
    from dynid.files.trajectoryfile import read_trajectory, write_trajectory

    stored = read_trajectory(path)
    if answer := stored.facts.get("answer"):
        common.terminal.sentence(workflows.plan.plan_sentence(arm, answer))
    wrote: list[Path] = []
    if accept and not stored.reviewed:
        drawn = stored.facts.get("pictures", [])
        seen = bool(drawn) and all((path.parent / name).is_file() for name in drawn)
        stored, wrote = stored.accepted(seen=seen), [path]
        write_trajectory(path, stored)
        wrote_trajectory(common, path, reviewed=True, seen=seen)
    common.terminal.emit_json(
        {**stored.facts.get("answer", {}), "wrote": wrote, "reviewed": stored.reviewed}
    )
    show_next(common, arm, path, reviewed=stored.reviewed)


def show_next(common: Common, arm: Robot, path: Path, *, reviewed: bool) -> None:
    """Say what to do with a motion: record it, or look at it before."""
    if reviewed:
        common.terminal.next(
            shell("dynid", "record", arm.word, path),
            "Record it. This moves the arm and asks first.",
        )
    else:
        command = shell("dynid", "trajectory", arm.word, "--review", path)
        common.terminal.next(
            command, "Look at it and accept it: an arm plays no motion that nobody has seen."
        )


def review(common: Common, arm: Robot, options: PlanOptions, values: dict[str, Any]) -> None:
    """Judge, preview and ask about a motion that was planned before, and mark it."""
    from dynid.files.trajectoryfile import read_trajectory, write_trajectory

    path: Path = values["review"]
    stored, look = read_trajectory(path, arm), view(common, values, path.parent)
    with common.terminal.progress() as progress:
        base = workflows.model.base_model(arm, common.folder(arm.slug), progress)
        found = workflows.trajectory.review_trajectory(
            arm,
            stored,
            options,
            urdf=values["urdf"],
            base=base,
            drawing=look.drawing,
            progress=progress,
        )
    common.terminal.findings(found.clearance.findings)
    for picture in found.clearance.pictures:
        common.terminal.stage("preview", str(picture))
    wrote = list(found.clearance.pictures)
    if accepted(common, found, look, accept=values["accept"]) is Answer.YES:
        seen = bool(found.clearance.pictures) or look.window
        stored, wrote = found.accepted(seen=seen), [path, *wrote]
        write_trajectory(path, stored)
        wrote_trajectory(common, path, reviewed=True, seen=seen)
    common.terminal.emit_json(
        {**stored.facts.get("answer", {}), "wrote": wrote, "reviewed": stored.reviewed}
    )
    show_next(common, arm, path, reviewed=stored.reviewed)
