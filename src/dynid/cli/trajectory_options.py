"""From the options and PLAN.yaml of ``dynid trajectory`` to what is wanted of a motion."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common
from dynid.cli.prompt import input_hashes
from dynid.errors import WrongUsage
from dynid.options import share

if TYPE_CHECKING:
    from dynid.cli.trajectory import Task
    from dynid.files.planfile import Plan, Waypoints
    from dynid.robot import Robot
    from dynid.trajectory.clearance import Box, Scene
    from dynid.trajectory.planning import PlanOptions

#: Options that decide what motion comes out; the others only show or confirm it.
_DECIDING = (
    "alpha", "duration", "segments", "optimise", "restarts", "seconds", "replay", "weights", "cost", "normalise",
    "basis", "margin", "obstacle", "workspace", "floor", "tool_speed", "noise", "rate", "select",
)  # fmt: skip


def inputs_of(robot: Robot, plan: Path | None, options: dict[str, Any], seed: int) -> dict[str, str]:
    """Return the hashes that a motion depends on."""
    files = {"plan": plan, "waypoints": options["from_waypoints"], "trajectory": options["from_trajectory"]}
    files |= {f"earlier {k + 1}": path for k, path in enumerate(options["earlier"])}
    decided = {key: options[key] for key in _DECIDING} | {"seed": seed}
    hashes = input_hashes({name: path for name, path in files.items() if path is not None}, decided)
    return {"robot": robot.model_key, "limits": limits_hash(robot), **hashes}


def limits_hash(robot: Robot) -> str:
    """Return a hash of what a plan depends on beyond the model: limits, base pose, prior, noise."""
    from dataclasses import asdict

    parts: list[Any] = [[asdict(joint.limits) for joint in robot.joints], robot.base_xyz, robot.base_rpy]
    parts += [asdict(robot.prior) if robot.prior else None, asdict(robot.tool) if robot.tool else None]
    parts.append(robot.torque.noise)
    return input_hashes({}, {"limits": parts})["options"]


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


def waypoints_of(plan: Plan, options: dict[str, Any], robot: Robot) -> Waypoints | None:
    """Return the points that the motion goes through; None to search."""
    from dynid.files.planfile import read_waypoints

    path = options["from_waypoints"]
    return plan.waypoints if path is None else read_waypoints(path, robot)


def wishes_of(common: Common, task: Task) -> PlanOptions:
    """Return what the options ask for."""
    from dynid.cli.prior_information import earlier_information, noise_of
    from dynid.trajectory.optimise import SearchOptions
    from dynid.trajectory.planning import PlanOptions

    options, base = task.options, task.base
    weights = pair(options["weights"]) if options["weights"] else (1.0, 100.0)
    noise = noise_of(base.robot, options["noise"], options["earlier"])
    replay = replay_of(options["replay"]) if options["replay"] else None
    search = SearchOptions(options["restarts"], options["seconds"], task.seed, replay=replay)
    return PlanOptions(
        duration=options["duration"],
        segments=options["segments"],
        family=options["basis"],
        cost="paper" if options["weights"] else options["cost"],
        normalised=options["normalise"],
        weights=weights,
        margin=share(options["margin"], "--margin") if options["margin"] not in ("0", "0%") else 0.0,
        alpha=options["alpha"],
        speed=options["tool_speed"],
        scene=scene_of(task.plan, options),
        search=search if options["optimise"] else None,
        noise=noise,
        known=earlier_information(common, base, options["earlier"], noise),
        rate=options["rate"],
        seed=task.seed,
    )


def replay_of(text: str) -> tuple[int, int]:
    """Return start and evaluation from START:N."""
    start, _, evaluation = text.partition(":")
    if not (start.isdecimal() and evaluation.isdecimal() and int(evaluation) > 0):
        raise WrongUsage(
            f"--replay '{text}' is not START:N", fix="copy what the search printed, such as --replay 3:412"
        )
    return int(start), int(evaluation)


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
