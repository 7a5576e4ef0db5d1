"""trajectory.npz on its way to and from disk: writing with its exports, the review by a person, using it again."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common
from dynid.cli.prompt import Answer, ask
from dynid.cli.trajectory_preview import judge_contact, shown, view

if TYPE_CHECKING:
    from dynid.cli.trajectory import Task
    from dynid.cli.trajectory_preview import Verdict
    from dynid.files.trajectoryfile import Review, StoredTrajectory
    from dynid.motion import Motion
    from dynid.trajectory.clearance import Scene
    from dynid.trajectory.planning import PlanningContext


def write(
    common: Common, task: Task, verdict: Verdict, path: Path, facts: dict[str, Any], *, reviewed: bool
) -> list[Path]:
    """Write trajectory.npz and its exports."""
    from dynid.cli.trajectory_options import scene_of
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
        facts={
            "answer": facts,
            "inputs": task.inputs,
            "rate_hz": task.options["rate"],
            "seed": task.seed,
            "scene": scene_facts(scene_of(task.plan, task.options), task.options["urdf"]),
        },
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
    from dynid.files.trajectoryfile import read_trajectory

    stored = read_trajectory(path)
    wrote: list[Path] = []
    if options["accept"] and not stored.reviewed:
        stored, wrote = accept_stored(common, stored, path), [path]
    common.terminal.emit_json({**stored.facts["answer"], "wrote": wrote, "reviewed": stored.reviewed})


def review_now(motion: Motion) -> Review:
    """Return the mark of a review by the person at this machine."""
    import getpass
    from datetime import datetime

    from dynid.files.trajectoryfile import Review, motion_hash

    try:
        who = getpass.getuser()
    except (KeyError, OSError):
        who = "unknown"
    return Review(who, datetime.now().astimezone().isoformat(timespec="seconds"), motion_hash(motion))


def scene_facts(scene: Scene, urdf: Path | None) -> dict[str, Any]:
    """Return in which surroundings a motion was judged, and with which shapes of the arm; for ``dynid record``."""
    return {**scene.facts, "urdf": None if urdf is None else str(urdf.resolve())}


def accept_stored(
    common: Common, stored: StoredTrajectory, path: Path, scene: dict[str, Any] | None = None
) -> StoredTrajectory:
    """Mark a stored motion as reviewed, in other surroundings than those it was planned for when they are given."""
    from dynid.files.trajectoryfile import write_trajectory

    facts = dict(stored.facts) if scene is None else {**stored.facts, "scene": scene}
    accepted = replace(stored, review=review_now(stored.motion), facts=facts)
    write_trajectory(path, accepted)
    common.terminal.wrote(path, "reviewed: yes")
    return accepted


def review_stored(common: Common, context: PlanningContext, path: Path, options: dict[str, Any]) -> None:
    """Judge, preview and ask about a motion that was planned before, and mark it.

    Raises:
        LimitBroken: it breaks a limit of today's robot file.
        Collision: something comes too near.
    """
    from dynid.files.trajectoryfile import read_trajectory
    from dynid.trajectory.basis import basis_from
    from dynid.trajectory.limits import require_within_limits
    from dynid.trajectory.plan import Trajectory

    stored = read_trajectory(path, context.base.robot)
    trajectory = Trajectory(basis_from(dict(stored.basis)), stored.coefficients, stored.alpha)
    look = view(common, options, path.parent)
    require_within_limits(context.check(trajectory), context.options.margin)
    verdict = judge_contact(common, context, trajectory, look, options["urdf"])
    common.terminal.findings(verdict.findings)
    for picture in verdict.pictures:
        common.terminal.stage("preview", str(picture))
    with shown(common, context, trajectory, look, options["urdf"]):
        answer = ask(common, "P2", given=True if options["accept"] else None)
    if answer is Answer.YES:
        stored = accept_stored(common, stored, path, scene_facts(context.options.scene, options["urdf"]))
    wrote = [path, *verdict.pictures] if answer is Answer.YES else list(verdict.pictures)
    common.terminal.emit_json({**stored.facts["answer"], "wrote": wrote, "reviewed": stored.reviewed})
