"""``dynid trajectory ROBOT [PLAN.yaml]``: loop 2a, a motion that is optimal, safe, and seen before it runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask, can_ask, may_write
from dynid.cli.trajectory_files import reuse, review_stored, write
from dynid.cli.trajectory_options import inputs_of, waypoints_of, wishes_of, with_plan
from dynid.cli.trajectory_preview import shown, view
from dynid.cli.trajectory_summary import answer_of, search_facts, show
from dynid.errors import Declined

if TYPE_CHECKING:
    from dynid.cli.trajectory_preview import Verdict, View
    from dynid.files.planfile import Plan, Waypoints
    from dynid.model.store import BaseModel
    from dynid.robot import Robot
    from dynid.trajectory.planning import PlanningContext, Proposal


@dataclass(frozen=True)
class Task:
    """What one run was asked to do.

    Attributes:
        options: the command's options, with those of PLAN.yaml where the command line is silent.
        base: model and base parameters.
        plan: PLAN.yaml, empty without one.
        waypoints: points to go through; None to search.
        seed: of the search.
        inputs: hashes that the result depends on.
    """

    options: dict[str, Any]
    base: BaseModel
    plan: Plan
    waypoints: Waypoints | None
    seed: int
    inputs: dict[str, str] = field(default_factory=dict)


@dynid_command(
    "trajectory",
    examples=(
        "dynid trajectory kinova_gen2                     search, preview, ask; alpha 0.2 for the first run",
        "dynid trajectory kuka_lwr4plus --alpha 1 --duration 10 --segments 5",
        "dynid trajectory my_arm.yaml --from-waypoints points.csv",
        "dynid trajectory kinova_gen2 --from-trajectory slow.npz --alpha 0.5 -o next      the same path, faster",
        "dynid trajectory kinova_gen2 --review out/kinova_gen2/trajectory.npz",
    ),
)
@click.argument("robot")
@click.argument(
    "plan", required=False, metavar="[PLAN.yaml]", type=click.Path(path_type=Path, exists=True, dir_okay=False)
)
@click.option("--alpha", type=float, default=0.2, show_default=True, help="Speed factor: duration T/alpha.")
@click.option(
    "--duration", type=click.FloatRange(1, 3600), default=60.0, show_default=True, help="T at full speed [s]."
)
@click.option("--segments", type=click.IntRange(2, 200), default=20, show_default=True, help="Segments or harmonics.")
@click.option(
    "--basis", type=click.Choice(["quintic", "spline", "fourier"]), default="quintic", show_default=True, help="Family."
)
@click.option("--optimise/--no-optimise", default=True, show_default=True, help="Search, or take a random motion.")
@click.option(
    "--cost",
    type=click.Choice(["i", "d", "condition", "paper"]),
    default="i",
    show_default=True,
    help="Expected torque error, D-optimal, condition number, Eq. 14.",
)
@click.option("--normalise/--raw", default=False, show_default=True, help="Columns of equal length in the cost.")
@click.option("--weights", metavar="L1,L2", help="Weights of Eq. 14; chooses --cost paper.")
@click.option(
    "--restarts",
    type=click.IntRange(1),
    default=5,
    show_default=True,
    help="Starts; when all finish, equal seeds give equal plans.",
)
@click.option(
    "--seconds",
    type=click.FloatRange(0.1),
    default=60.0,
    show_default=True,
    help="Time limit; the best so far is kept.",
)
@click.option("--replay", metavar="START:N", help="Make the plan again that a search of this seed ended with.")
@click.option(
    "--margin", metavar="SHARE", default="10%", show_default=True, help="Share of every limit that stays free."
)
@click.option("--tool-speed", type=click.FloatRange(0, min_open=True), help="Largest speed of the tool [m/s].")
@click.option("--floor", metavar="Z|none", default="0", show_default=True, help="Height of the floor in the world [m].")
@click.option(
    "--obstacle", metavar="BOX", multiple=True, help="x0,y0,z0,x1,y1,z1 [m] that no link may touch; repeatable."
)
@click.option("--workspace", metavar="BOX", help="x0,y0,z0,x1,y1,z1 [m] that the tool stays in.")
@click.option(
    "--from-waypoints",
    metavar="CSV",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="Go through these points.",
)
@click.option(
    "--from-trajectory",
    metavar="NPZ",
    type=click.Path(path_type=Path, exists=True, dir_okay=False),
    help="The path of a motion planned before, at this --alpha.",
)
@click.option(
    "--earlier",
    metavar="FILE",
    multiple=True,
    type=click.Path(path_type=Path, exists=True),
    help="Logs, parameters.npz or trajectory.npz whose knowledge the motion completes.",
)
@click.option(
    "--noise", metavar="NM[,NM...]", help="Torque noise [N m] (default: the robot file's, or 0.3 % of the rating)."
)
@click.option(
    "--rate", type=click.FloatRange(1, 2000), default=100.0, show_default=True, help="Rate of samples and log [Hz]."
)
@click.option(
    "--select", type=click.FloatRange(0, min_open=True), metavar="ETA", help="Choose measurement points (Eq. 16)."
)
@click.option(
    "--preview",
    type=click.Choice(["auto", "gui", "video", "picture", "none"]),
    default="auto",
    show_default=True,
    help="How to look at the motion.",
)
@click.option(
    "--urdf", type=click.Path(path_type=Path, exists=True, dir_okay=False), metavar="FILE", help="Own URDF with meshes."
)
@click.option(
    "--review", type=click.Path(path_type=Path), metavar="FILE", help="Preview and accept a motion planned before."
)
@click.option("--accept", is_flag=True, help="Mark the motion as reviewed without being asked.")
def command(common: Common, robot: str, plan: Path | None, **options: Any) -> None:  # noqa: ANN401
    """Plan an excitation motion, prove it safe, preview it, and ask."""
    from dynid.files.robotfile import load_robot
    from dynid.trajectory.planning import planning_context

    arm = load_robot(robot)
    common.terminal.findings(arm.findings)
    written, options = with_plan(click.get_current_context(), plan, arm, options)
    path = common.folder(arm.slug) / "trajectory.npz"
    if options["review"] is not None:
        task = Task(options, model_of(common, arm), written, None, common.seed)
        review_stored(common, planning_context(task.base, wishes_of(common, task)), options["review"], options)
        return
    inputs = inputs_of(arm, plan, options, common.seed)
    if not may_write(common, path, inputs):
        reuse(common, path, options)
        return
    base, seed = model_of(common, arm), common.seed
    while True:
        task = Task(options, base, written, waypoints_of(written, options, arm), seed, inputs)
        if plan_once(common, task, path) is Answer.YES:
            return
        seed += 1
        inputs = inputs_of(arm, plan, options, seed)
        common.terminal.stage("again", f"planning another motion, seed {seed}; a changed waypoint file is read again")


def plan_once(common: Common, task: Task, path: Path) -> Answer:
    """Plan, judge, show, ask and write; NO when the person wants another motion."""
    from dynid.trajectory.planning import planning_context

    context = planning_context(task.base, wishes_of(common, task))
    look = view(common, task.options, path.parent)
    verdict = find(common, task, context, look)
    facts = answer_of(task, context, verdict)
    show(common, context, verdict, facts)
    with shown(common, context, verdict.trajectory, look, task.options["urdf"]):
        answer = accepted(common, task.options)
    if answer is Answer.QUIT:
        raise Declined("the motion was not accepted", why="nothing was written")
    if answer is Answer.NO and asked(common, task.options):
        return answer
    wrote = write(common, task, verdict, path, facts, reviewed=answer is Answer.YES)
    common.terminal.emit_json(facts | {"wrote": [str(p) for p in wrote], "reviewed": answer is Answer.YES})
    common.terminal.next(f"dynid record {task.base.robot.slug} {path}       (moves the arm; asks first)")
    return Answer.YES


def asked(common: Common, options: dict[str, Any]) -> bool:
    """Return whether a person answered P2."""
    return can_ask(common) and not common.yes and not options["accept"]


def accepted(common: Common, options: dict[str, Any]) -> Answer:
    """Ask P2."""
    return ask(common, "P2", given=True if options["accept"] else None)


def find(common: Common, task: Task, context: PlanningContext, look: View) -> Verdict:
    """Return the first motion that passes every judge."""
    from dynid.cli.trajectory_preview import judge_contact
    from dynid.trajectory.planning import first_accepted, proposals, require_safe, search_motions

    with common.terminal.progress() as progress:
        candidates, found = given_motions(task, context), None
        progress.stage("search" if candidates is None else "plan", "")
        if candidates is None:
            found = search_motions(context, progress)
            candidates = proposals(context, found)
        chosen, (_, judgement) = first_accepted(
            candidates,
            [
                lambda t: require_safe(context, t),
                lambda t: judge_contact(common, context, t, look, task.options["urdf"]),
            ],
        )
    verdict: Verdict = judgement  # type: ignore[assignment]
    verdict.check = context.check(chosen.trajectory)
    verdict.search = search_facts(task, chosen, found)
    return verdict


def given_motions(task: Task, context: PlanningContext) -> Iterator[Proposal] | None:
    """Return the motion through the person's waypoints, or on the path of an earlier motion; None to search."""
    from dynid.files.trajectoryfile import read_trajectory
    from dynid.trajectory.basis import basis_from
    from dynid.trajectory.plan import Trajectory, through_waypoints
    from dynid.trajectory.planning import Proposal

    alpha, path = task.options["alpha"], task.options["from_trajectory"]
    if path is not None:
        stored = read_trajectory(path, context.base.robot)
        return iter([Proposal(Trajectory(basis_from(dict(stored.basis)), stored.coefficients, alpha))])
    if task.waypoints is None:
        return None
    return iter([Proposal(through_waypoints(task.waypoints.q, context.limits, task.waypoints.times).slowed(alpha))])


def model_of(common: Common, arm: Robot) -> BaseModel:
    """Return the arm's base model, derived when it is not there yet or stale."""
    from dynid.workflows.model import base_model

    with common.terminal.progress() as progress:
        return base_model(arm, common.folder(arm.slug), progress)
