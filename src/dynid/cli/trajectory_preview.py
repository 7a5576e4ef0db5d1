"""What a person sees of a planned motion before it runs: the judges' findings, pictures, a window, and the review."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common
from dynid.errors import Finding, NoDisplay, PackageMissing

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.trajectory.limits import LimitCheck
    from dynid.trajectory.plan import Trajectory
    from dynid.trajectory.planning import PlanningContext
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
        search: how it was found; None when a person gave the path.
    """

    trajectory: Trajectory
    distances: tuple[Distance, ...]
    pictures: tuple[Path, ...] = ()
    check: LimitCheck | None = None
    selected: NDArray[Any] | None = None
    search: dict[str, Any] | None = None
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
def urdf_of(context: PlanningContext, own: Path | None) -> Iterator[Path]:
    """Give the user's URDF, or one made from the DH table."""
    from dynid.sim.urdf import write_urdf

    if own is not None:
        yield own
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{context.base.robot.slug}.urdf"
        write_urdf(context.base.robot, None, path)
        yield path


def judge_contact(
    common: Common, context: PlanningContext, trajectory: Trajectory, look: View, own: Path | None
) -> Verdict:
    """Let PyBullet measure and draw a motion; without PyBullet the spheres' distances stand.

    Raises:
        Collision: something comes too near.
        PackageMissing: PyBullet is missing and was asked for.
    """
    from dynid.trajectory.preview import Distance, Drawing, measure_trajectory, require_clear

    robot, scene = context.base.robot, context.options.scene
    title = f"{robot.name}, alpha {trajectory.alpha:g}, {trajectory.duration:.1f} s"
    try:
        with urdf_of(context, own) as urdf:
            found = measure_trajectory(trajectory, robot, urdf, scene, Drawing(look.picture, look.animation, title))
    except PackageMissing:
        if look.needed:
            raise
        motion = trajectory.sampled(50.0 * trajectory.alpha)
        near = sorted(context.spheres.contacts(motion.q), key=lambda c: c.distance)
        distances = tuple(Distance(c.what, c.distance, float(motion.t[c.index])) for c in near)
        text = "PyBullet is missing: distances were measured on spheres along the links, and nothing was drawn"
        return Verdict(trajectory, distances, findings=[Finding("W605", "warning", text)])
    require_clear(found, scene, look.picture)
    pictures = tuple(path for path in (look.picture, look.animation) if path is not None)
    return Verdict(trajectory, found, pictures)


@contextmanager
def shown(
    common: Common, context: PlanningContext, trajectory: Trajectory, look: View, own: Path | None
) -> Iterator[None]:
    """Show a motion in PyBullet's window while the question is asked."""
    from dynid.trajectory.preview import window

    if not look.window:
        yield
        return
    with urdf_of(context, own) as urdf, window(trajectory, context.base.robot, urdf, context.options.scene):
        common.terminal.stage("preview", "PyBullet window opened; press space there to replay")
        yield
