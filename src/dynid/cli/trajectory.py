"""``dynid trajectory ROBOT [PLAN.yaml]``: loop 2a, a motion that is optimal, safe, and seen before it runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.loop3 import base_model, percent
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask, can_ask, input_hashes, may_write
from dynid.errors import Declined, WrongUsage

if TYPE_CHECKING:
    from dynid.cli.motionview import Verdict, View
    from dynid.files.planfile import Plan, Waypoints
    from dynid.files.trajectoryfile import StoredTrajectory
    from dynid.model.store import BaseModel
    from dynid.robot import Robot
    from dynid.trajectory.clearance import Box, Scene
    from dynid.trajectory.plan import Trajectory
    from dynid.trajectory.planning import Wishes, Workshop

#: Options that decide what motion comes out; the others only show or confirm it.
_DECIDING = (
    "alpha", "duration", "segments", "optimise", "restarts", "seconds", "weights", "cost", "normalise", "basis",
    "margin", "obstacle", "workspace", "floor", "tool_speed", "noise", "rate", "select",
)  # fmt: skip


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
@click.option("--restarts", type=click.IntRange(1), default=5, show_default=True, help="Starts of the search.")
@click.option(
    "--seconds", type=click.FloatRange(0.1), default=60.0, show_default=True, help="Time limit of the search."
)
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
@click.option("--noise", metavar="NM[,NM...]", help="Torque noise of the joints [N m] (default: 0.3 % of the rating).")
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
    from dynid.cli.motionview import review_stored
    from dynid.files.robotfile import load_robot
    from dynid.trajectory.planning import workshop

    arm = load_robot(robot)
    common.terminal.findings(arm.findings)
    written, options = with_plan(click.get_current_context(), plan, arm, options)
    path = common.folder(arm.slug) / "trajectory.npz"
    if options["review"] is not None:
        task = Task(options, base_model(common, arm), written, None, common.seed)
        review_stored(common, workshop(task.base, wishes_of(common, task)), options["review"], options)
        return
    inputs = inputs_of(arm, plan, options, common.seed)
    if not may_write(common, path, inputs):
        reuse(common, path, options)
        return
    base, seed = base_model(common, arm), common.seed
    while True:
        task = Task(options, base, written, waypoints_of(written, options, arm), seed, inputs)
        if plan_once(common, task, path) is Answer.YES:
            return
        seed += 1
        inputs = inputs_of(arm, plan, options, seed)
        common.terminal.stage("again", f"planning another motion, seed {seed}; a changed waypoint file is read again")


def inputs_of(robot: Robot, plan: Path | None, options: dict[str, Any], seed: int) -> dict[str, str]:
    """Return the hashes that a motion depends on."""
    files = {"plan": plan, "waypoints": options["from_waypoints"], "trajectory": options["from_trajectory"]}
    files |= {f"earlier {k + 1}": path for k, path in enumerate(options["earlier"])}
    decided = {key: options[key] for key in _DECIDING} | {"seed": seed}
    hashes = input_hashes({name: path for name, path in files.items() if path is not None}, decided)
    return {"robot": robot.model_key, "limits": limits_hash(robot), **hashes}


def with_plan(
    ctx: click.Context, path: Path | None, robot: Robot, options: dict[str, Any]
) -> tuple[Plan, dict[str, Any]]:
    """Return the plan file and the options with its values where the command line is silent."""
    from dynid.files.planfile import Plan, read_plan

    if path is None:
        return Plan(), options
    plan = read_plan(path, robot)
    chosen = dict(options)
    params = {param.name: param for param in ctx.command.params}
    for name, text in plan.options.items():
        if ctx.get_parameter_source(name) in (
            click.core.ParameterSource.COMMANDLINE,
            click.core.ParameterSource.ENVIRONMENT,
        ):
            continue
        try:
            chosen[name] = params[name].type_cast_value(ctx, text)
        except click.BadParameter as error:
            raise WrongUsage(f"{plan.places[name]}: {name}: {error.message}", where=plan.places[name]) from None
    return plan, chosen


def limits_hash(robot: Robot) -> str:
    """Return a hash of what a plan depends on beyond the model: limits, base pose, prior."""
    from dataclasses import asdict

    parts: list[Any] = [[asdict(joint.limits) for joint in robot.joints], robot.base_xyz, robot.base_rpy]
    parts += [asdict(robot.prior) if robot.prior else None, asdict(robot.tool) if robot.tool else None]
    return input_hashes({}, {"limits": parts})["options"]


def waypoints_of(plan: Plan, options: dict[str, Any], robot: Robot) -> Waypoints | None:
    """Return the points that the motion goes through; None to search."""
    from dynid.files.planfile import read_waypoints

    path = options["from_waypoints"]
    return plan.waypoints if path is None else read_waypoints(path, robot)


def plan_once(common: Common, task: Task, path: Path) -> Answer:
    """Plan, judge, show, ask and write; NO when the person wants another motion."""
    from dynid.cli.motionview import answer_of, show, shown, view
    from dynid.trajectory.planning import workshop

    shop = workshop(task.base, wishes_of(common, task))
    look = view(common, task.options, path.parent)
    verdict = find(common, task, shop, look)
    facts = answer_of(task, shop, verdict)
    show(common, shop, verdict, facts)
    with shown(common, shop, verdict.trajectory, look, task.options["urdf"]):
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


def find(common: Common, task: Task, shop: Workshop, look: View) -> Verdict:
    """Return the first motion that passes every judge."""
    from dynid.cli.motionview import judge_contact
    from dynid.trajectory.limits import check
    from dynid.trajectory.planning import first_accepted, judged, proposals

    with common.terminal.progress() as progress:
        candidates = given_motions(task, shop)
        progress.stage("search" if candidates is None else "plan", "")
        if candidates is None:
            candidates = proposals(shop, progress)
        trajectory, (_, verdict) = first_accepted(
            candidates,
            [lambda t: judged(shop, t), lambda t: judge_contact(common, shop, t, look, task.options["urdf"])],
        )
    found: Verdict = verdict  # type: ignore[assignment]
    assert found.trajectory is trajectory
    found.check = check(trajectory, shop.base.robot, shop.limits, shop.torque, shop.wishes.speed)
    return found


def given_motions(task: Task, shop: Workshop) -> Iterator[Trajectory] | None:
    """Return the motion through the person's waypoints, or on the path of an earlier motion; None to search."""
    from dynid.files.trajectoryfile import read_trajectory
    from dynid.trajectory.basis import basis_from
    from dynid.trajectory.plan import Trajectory, through

    alpha, path = task.options["alpha"], task.options["from_trajectory"]
    if path is not None:
        stored = read_trajectory(path, shop.base.robot)
        return iter([Trajectory(basis_from(dict(stored.basis)), stored.coefficients, alpha)])
    if task.waypoints is None:
        return None
    return iter([through(task.waypoints.q, shop.limits, task.waypoints.times).slowed(alpha)])


def wishes_of(common: Common, task: Task) -> Wishes:
    """Return what the options ask for."""
    from dynid.cli.knowledge import earlier_information, noise_of
    from dynid.trajectory.optimise import Search
    from dynid.trajectory.planning import Wishes

    options, base = task.options, task.base
    weights = pair(options["weights"]) if options["weights"] else (1.0, 100.0)
    noise = noise_of(base.robot, options["noise"], options["earlier"])
    search = Search(options["restarts"], options["seconds"], task.seed)
    return Wishes(
        duration=options["duration"],
        segments=options["segments"],
        family=options["basis"],
        cost="paper" if options["weights"] else options["cost"],
        normalised=options["normalise"],
        weights=weights,
        margin=percent(options["margin"], "--margin") if options["margin"] not in ("0", "0%") else 0.0,
        alpha=options["alpha"],
        speed=options["tool_speed"],
        scene=scene_of(task.plan, options),
        search=search if options["optimise"] else None,
        noise=noise,
        known=earlier_information(common, base, options["earlier"], noise),
        rate=options["rate"],
        seed=task.seed,
    )


def scene_of(plan: Plan, options: dict[str, Any]) -> Scene:
    """Return what surrounds the arm."""
    from dynid.trajectory.clearance import Box, Scene

    floor = None if options["floor"] == "none" else numbers(options["floor"], 1, "--floor")[0]
    boxes = [Box(*corners) for corners in plan.obstacles] + [box(text, "--obstacle") for text in options["obstacle"]]
    inside = box(options["workspace"], "--workspace") if options["workspace"] else None
    if inside is None and plan.workspace is not None:
        inside = Box(*plan.workspace)
    return Scene(floor=floor, obstacles=tuple(boxes), workspace=inside)


def numbers(text: str, count: int, option: str) -> list[float]:
    """Return so many numbers written with commas."""
    try:
        found = [float(part) for part in str(text).split(",")]
    except ValueError:
        found = []
    if len(found) != count or not all(abs(x) < float("inf") for x in found):
        raise WrongUsage(
            f"{option} '{text}' is not {count} number{'s' * (count > 1)}",
            fix=f"such as {option} {','.join(['0'] * count)}",
        )
    return found


def pair(text: str) -> tuple[float, float]:
    """Return the weights of Eq. 14."""
    first, second = numbers(text, 2, "--weights")
    return first, second


def box(text: str, option: str) -> Box:
    """Return a box from x0,y0,z0,x1,y1,z1."""
    from dynid.trajectory.clearance import Box

    a, b, c, d, e, f = numbers(text.removeprefix("box").strip(":, "), 6, option)
    return Box((min(a, d), min(b, e), min(c, f)), (max(a, d), max(b, e), max(c, f)))


def write(
    common: Common, task: Task, verdict: Verdict, path: Path, facts: dict[str, Any], *, reviewed: bool
) -> list[Path]:
    """Write trajectory.npz and its exports."""
    from dynid.cli.motionview import review_now
    from dynid.files.trajectoryfile import StoredTrajectory, write_csv, write_joint_trajectory, write_trajectory

    motion = verdict.trajectory.sampled(task.options["rate"])
    robot = task.base.robot
    stored: StoredTrajectory = StoredTrajectory(
        robot=robot.name,
        joints=robot.joint_names,
        motion=motion,
        alpha=verdict.trajectory.alpha,
        basis=verdict.trajectory.basis.facts,
        coefficients=verdict.trajectory.coefficients,
        review=review_now(motion) if reviewed else None,
        facts={"answer": facts, "inputs": task.inputs, "rate_hz": task.options["rate"], "seed": task.seed},
        selected=verdict.selected,
    )
    texts = [path.with_suffix(".csv"), path.with_suffix(".yaml")]
    write_csv(texts[0], robot.joint_names, motion)
    write_joint_trajectory(texts[1], robot, motion)
    write_trajectory(path, stored)
    common.terminal.wrote(path, "reviewed: yes" if reviewed else "reviewed: no")
    for text in texts:
        common.terminal.wrote(text)
    return [path, *texts, *verdict.pictures]


def reuse(common: Common, path: Path, options: dict[str, Any]) -> None:
    """Answer from a motion that was planned before with the same inputs; accept it when asked to."""
    from dynid.cli.motionview import accept_stored
    from dynid.files.trajectoryfile import read_trajectory

    stored = read_trajectory(path)
    wrote: list[Path] = []
    if options["accept"] and not stored.reviewed:
        stored, wrote = accept_stored(common, stored, path), [path]
    common.terminal.emit_json({**stored.facts["answer"], "wrote": wrote, "reviewed": stored.reviewed})
