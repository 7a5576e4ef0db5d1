"""What a person sees of a planned motion before it runs: the judges' findings, pictures, a window, and the review."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common
from dynid.cli.prompt import Answer, ask
from dynid.errors import Finding, NoDisplay, PackageMissing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.cli.trajectory import Task
    from dynid.files.trajectoryfile import Review, StoredTrajectory
    from dynid.model.store import BaseModel
    from dynid.motion import Motion
    from dynid.trajectory.limits import Check
    from dynid.trajectory.plan import Trajectory
    from dynid.trajectory.planning import Workshop
    from dynid.trajectory.preview import Distance


@dataclass(frozen=True)
class View:
    """How a motion will be looked at.

    Attributes:
        picture: path of the still; None for none.
        animation: path of the animated picture; None for none.
        window: whether PyBullet's window opens.
        needed: whether a missing PyBullet is an error.
    """

    picture: Path | None
    animation: Path | None
    window: bool
    needed: bool


@dataclass
class Verdict:
    """What the judges found about a motion.

    Attributes:
        trajectory: the motion.
        distances: least distance of every pair, the closest first.
        pictures: files that were drawn.
        check: what it uses of the limits.
        selected: samples chosen as measurement points; None for all.
    """

    trajectory: Trajectory
    distances: tuple[Distance, ...]
    pictures: tuple[Path, ...] = ()
    check: Check | None = None
    selected: NDArray[Any] | None = None
    findings: list[Finding] = field(default_factory=list)


def view(common: Common, options: dict[str, Any], folder: Path) -> View:
    """Decide how to look: a window where there is a display and a person, otherwise pictures.

    Raises:
        NoDisplay: a window was asked for and there is no display.
    """
    from dynid.cli.prompt import can_ask
    from dynid.trajectory.preview import has_display

    wanted = options["preview"]
    if wanted == "gui" and not has_display():
        raise NoDisplay("no display: PyBullet cannot open its window")
    automatic_window = wanted == "auto" and has_display() and can_ask(common) and not options["accept"]
    if wanted == "auto" and not has_display():
        text = f"no display: preview saved as {folder / 'preview.png'} and {folder / 'preview.gif'} instead"
        common.terminal.finding(Finding("W604", "info", text))
    drawn = wanted in ("auto", "video", "picture")
    folder.mkdir(parents=True, exist_ok=True)
    return View(
        folder / "preview.png" if drawn else None,
        folder / "preview.gif" if wanted in ("auto", "video") else None,
        wanted == "gui" or automatic_window,
        wanted in ("gui", "video", "picture"),
    )


@contextmanager
def urdf_of(shop: Workshop, own: Path | None) -> Iterator[Path]:
    """Give the user's URDF, or one made from the DH table."""
    from dynid.sim.urdf import write_urdf

    if own is not None:
        yield own
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{shop.base.robot.slug}.urdf"
        write_urdf(shop.base.robot, None, path)
        yield path


def judge_contact(common: Common, shop: Workshop, trajectory: Trajectory, look: View, own: Path | None) -> Verdict:
    """Let PyBullet measure and draw a motion; without PyBullet the spheres' distances stand.

    Raises:
        Collision: something comes too near.
        PackageMissing: PyBullet is missing and was asked for.
    """
    from dynid.trajectory.preview import Distance, Look, examine, require_clear

    robot, scene = shop.base.robot, shop.wishes.scene
    title = f"{robot.name}, alpha {trajectory.alpha:g}, {trajectory.duration:.1f} s"
    try:
        with urdf_of(shop, own) as urdf:
            found = examine(trajectory, robot, urdf, scene, Look(look.picture, look.animation, title))
    except PackageMissing:
        if look.needed:
            raise
        motion = trajectory.sampled(50.0 * trajectory.alpha)
        near = sorted(shop.spheres.contacts(motion.q), key=lambda c: c.distance)
        distances = tuple(Distance(c.what, c.distance, float(motion.t[c.index])) for c in near)
        text = "PyBullet is missing: distances were measured on spheres along the links, and nothing was drawn"
        return Verdict(trajectory, distances, findings=[Finding("W605", "warning", text)])
    require_clear(found, scene, look.picture)
    pictures = tuple(path for path in (look.picture, look.animation) if path is not None)
    return Verdict(trajectory, found, pictures)


@contextmanager
def shown(common: Common, shop: Workshop, trajectory: Trajectory, look: View, own: Path | None) -> Iterator[None]:
    """Show a motion in PyBullet's window while the question is asked."""
    from dynid.trajectory.preview import window

    if not look.window:
        yield
        return
    with urdf_of(shop, own) as urdf, window(trajectory, shop.base.robot, urdf, shop.wishes.scene):
        common.terminal.stage("preview", "PyBullet window opened; press space there to replay")
        yield


def answer_of(task: Task, shop: Workshop, verdict: Verdict) -> dict[str, Any]:
    """Return the JSON answer, the prediction included."""
    from dataclasses import asdict

    from dynid.trajectory.predict import ladder, predict

    assert verdict.check is not None
    base, wishes, trajectory = shop.base, shop.wishes, verdict.trajectory
    columns = base.reduction.base
    motion = trajectory.sampled(wishes.rate)
    found = predict(base.model, columns, motion, wishes.noise, shop.other, wishes.known)
    rungs = ladder(trajectory, base.model, columns, wishes.noise, shop.other, wishes.known)
    if task.options["select"] is not None:
        verdict.selected = _selected(task, base, motion)
    return {
        "schema": "dynid/trajectory/1",
        "robot": base.robot.name,
        "duration_s": trajectory.duration,
        "alpha": trajectory.alpha,
        "condition_number": found.figures.condition,
        "condition_number_scaled": found.figures.condition_scaled,
        "smallest_singular_value": found.figures.smallest,
        "peak": [
            {
                "joint": p.joint,
                "position_rad": p.position,
                "velocity_rad_s": p.velocity,
                "acceleration_rad_s2": p.acceleration,
                "torque_nm": p.torque,
                "limit_share": p.share,
            }
            for p in verdict.check.peaks
        ],
        "tool_speed_m_s": verdict.check.tool_speed,
        "collisions": [],
        "closest_m": min((d.distance for d in verdict.distances), default=None),
        "closest": [{"pair": d.pair, "distance_m": d.distance, "time_s": d.time} for d in verdict.distances[:5]],
        "predicted_std_error": dict(zip(base.reduction.base_names, found.std_error.tolist(), strict=True)),
        "expected_torque_error_nm": found.torque_error,
        "ladder": [asdict(rung) for rung in rungs],
        "torque_noise_nm": wishes.noise.tolist(),
        "selected_samples": None if verdict.selected is None else len(verdict.selected),
        "weakest": _weakest(shop, found.std_error),
    }


def _selected(task: Task, base: BaseModel, motion: Motion) -> NDArray[Any]:
    """Return the measurement points that Eqs. 15-16 choose."""
    from dynid.trajectory.selection import select

    W = base.model.observer(base.reduction.base).dense(motion.q, motion.qd, motion.qdd)
    return select(W, task.options["select"])


def _weakest(shop: Workshop, std_error: NDArray[Any]) -> str:
    """Return the base parameter whose error costs the most torque on other motions."""
    import numpy as np

    cost = std_error * np.sqrt(np.diag(shop.other))
    return shop.base.reduction.base_names[int(np.argmax(cost))]


def show(common: Common, shop: Workshop, verdict: Verdict, facts: dict[str, Any]) -> None:
    """Say on stderr what was found, and print the joints' peaks on stdout."""
    terminal, limits, trajectory = common.terminal, shop.limits, verdict.trajectory
    assert verdict.check is not None
    basis = trajectory.basis.facts
    kind = (
        f"{len(basis['knots']) - 1} {basis['kind']} segments" if "knots" in basis else f"{basis['harmonics']} harmonics"
    )
    alpha, full = trajectory.alpha, trajectory.basis.duration
    slow = f"{trajectory.duration:.1f} s at alpha {alpha:g} (speed x{alpha:g}, acceleration x{alpha**2:.2g})"
    terminal.stage("plan", f"{kind}, {full:.1f} s at full speed; {slow}")
    terminal.stage("limits", _shares(verdict.check, limits))
    near = verdict.distances[0] if verdict.distances else None
    if near is not None:
        words = f"at least {1000 * near.distance:.0f} mm" if near.distance >= 0.3 else f"{1000 * near.distance:.0f} mm"
        terminal.stage("collision", f"none; nearest {near.pair} at {words}, t = {near.time:.1f} s")
    terminal.findings(verdict.findings)
    condition, scaled, smallest = (
        facts[key] for key in ("condition_number", "condition_number_scaled", "smallest_singular_value")
    )
    words = f"condition number {condition:.3g} (columns of equal length: {scaled:.3g})"
    terminal.stage("excitation", f"{words}   smallest singular value {smallest:.2g}")
    error, weakest = facts["expected_torque_error_nm"], facts["weakest"]
    terminal.stage("predicted", f"torque error {error:.2g} N m on other motions; weakest: {weakest}")
    _show_ladder(common, facts)
    for path in verdict.pictures:
        terminal.stage("preview", str(path))
    rows = [
        (p.joint, f"{p.position:.3f}", f"{p.velocity:.3f}", f"{p.acceleration:.3f}",
         "-" if p.torque is None else f"{p.torque:.2f}", f"{100 * p.share:.0f} %")
        for p in verdict.check.peaks
    ]  # fmt: skip
    terminal.table(("joint", "position rad", "velocity rad/s", "accel. rad/s^2", "torque N m", "of limit"), rows)


def _shares(check: Check, limits: Any) -> str:  # noqa: ANN401
    import numpy as np

    middle, half = (limits.upper + limits.lower) / 2, (limits.upper - limits.lower) / 2
    peaks = check.peaks
    shares = {
        "position": np.max(np.abs(np.array([p.position for p in peaks]) - middle) / half),
        "speed": np.max(np.array([p.velocity for p in peaks]) / limits.velocity),
        "acceleration": np.max(np.array([p.acceleration for p in peaks]) / limits.acceleration),
        "torque": np.max(np.array([p.torque or 0.0 for p in peaks]) / limits.torque),
    }
    words = "   ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items())
    return f"{words}   of what the margin leaves: all inside; tool up to {check.tool_speed:.2f} m/s"


def _show_ladder(common: Common, facts: dict[str, Any]) -> None:
    """Say what slowing down costs, so that nobody identifies from a first, slow run by mistake."""
    rungs = facts["ladder"]
    full = next(rung for rung in rungs if rung["alpha"] == 1.0)
    here = next(rung for rung in rungs if rung["alpha"] == facts["alpha"])
    for rung in rungs:
        times = rung["torque_error"] / full["torque_error"]
        mark = "  <- this plan" if rung is here else ""
        common.terminal.stage(
            "ladder", f"alpha {rung['alpha']:g}: {rung['duration']:.0f} s, expected torque error x{times:.3g}{mark}"
        )
    if here["alpha"] < 1:
        times = here["torque_error"] / full["torque_error"]
        cost = f"at alpha {here['alpha']:g} the expected torque error is {times:.2g} times larger than at 1.0"
        common.terminal.stage("note", f"{cost} for equally many samples: a first, safe run; then 0.5, then 1.0")


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


def accept_stored(common: Common, stored: StoredTrajectory, path: Path) -> StoredTrajectory:
    """Mark a stored motion as reviewed."""
    from dynid.files.trajectoryfile import write_trajectory

    accepted = replace(stored, review=review_now(stored.motion))
    write_trajectory(path, accepted)
    common.terminal.wrote(path, "reviewed: yes")
    return accepted


def review_stored(common: Common, shop: Workshop, path: Path, options: dict[str, Any]) -> None:
    """Judge, preview and ask about a motion that was planned before, and mark it.

    Raises:
        LimitBroken: it breaks a limit of today's robot file.
        Collision: something comes too near.
    """
    from dynid.files.trajectoryfile import read_trajectory
    from dynid.trajectory.basis import basis_from
    from dynid.trajectory.limits import check, require
    from dynid.trajectory.plan import Trajectory

    stored = read_trajectory(path, shop.base.robot)
    trajectory = Trajectory(basis_from(dict(stored.basis)), stored.coefficients, stored.alpha)
    look = view(common, options, path.parent)
    found = check(trajectory, shop.base.robot, shop.limits, shop.torque, shop.wishes.speed)
    require(found, shop.wishes.margin)
    verdict = judge_contact(common, shop, trajectory, look, options["urdf"])
    common.terminal.findings(verdict.findings)
    for picture in verdict.pictures:
        common.terminal.stage("preview", str(picture))
    with shown(common, shop, trajectory, look, options["urdf"]):
        answer = ask(common, "P2", given=True if options["accept"] else None)
    if answer is Answer.YES:
        stored = accept_stored(common, stored, path)
    wrote = [path, *verdict.pictures] if answer is Answer.YES else list(verdict.pictures)
    common.terminal.emit_json({**stored.facts["answer"], "wrote": wrote, "reviewed": stored.reviewed})
