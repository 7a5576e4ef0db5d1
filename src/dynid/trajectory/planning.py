"""From options to a motion that may be shown: search, repair, and the judges in their order.

Joint limits hold by construction; torque, tool speed and contact are checked, and a motion that fails is drawn towards
a clear pose until it passes. PyBullet is asked last, because it is the slowest.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Collision, DynidError, Finding, LimitBroken, PackageMissing
from dynid.model.base_model import BaseModel, prior_base_parameters
from dynid.model.parameters import DEFAULT_CYLINDERS
from dynid.motion import Motion
from dynid.progress import SILENT, Progress
from dynid.robot import Robot
from dynid.trajectory import tuning
from dynid.trajectory.basis import Quintic
from dynid.trajectory.clearance import Capsules, Distance
from dynid.trajectory.cost import Cost
from dynid.trajectory.feasible import Bounds, bounds, coefficients, random_variables
from dynid.trajectory.limits import LimitCheck, check_trajectory, require_within_limits
from dynid.trajectory.objective import PlanProblem
from dynid.trajectory.optimise import SearchOutcome
from dynid.trajectory.options import PAPER_WEIGHTS, PlanOptions
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.predict import default_noise, held_out
from dynid.trajectory.preview import (
    Distances,
    Drawing,
    capsule_distances,
    draw_trajectory,
    measure_trajectory,
    require_clear,
    urdf_of,
)

Floats = NDArray[np.float64]
Result = TypeVar("Result")
Judgement = TypeVar("Judgement")


@dataclass(frozen=True)
class PlanningContext:
    """An arm with everything that judging its motions needs.

    Attributes:
        base: model and base parameters.
        limits: limits, margins taken off.
        capsules: the arm and its surroundings.
        options: what is wanted.
        noise: standard deviation of each joint's torque, (n,) [N m or N].
        known: information matrix of earlier logs in that noise, (p, p); None without any.
        believed: what predictions count as known: that and the prior of possible bodies, (p, p); None for nothing.
        theta: base parameters by the prior, before anything is measured, (p,).
        other: mean of P^T P over the motions that the model shall predict, (p, p).
    """

    base: BaseModel
    limits: Bounds
    capsules: Capsules
    options: PlanOptions
    noise: Floats
    known: Floats | None
    believed: Floats | None
    theta: Floats
    other: Floats

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.base.robot

    def torque(self, motion: Motion) -> Floats:
        """Return the torques that are predicted before anything is measured, (N, n) [N m or N]."""
        observer = self.base.model.observer(self.base.reduction.base)
        return observer.torque(self.theta, motion.q, motion.qd, motion.qdd)

    def check(self, trajectory: Trajectory) -> LimitCheck:
        """Return what a motion uses of the limits."""
        return check_trajectory(
            trajectory, self.robot, self.limits, self.torque, self.options.tool_speed
        )


def planning_context(
    base: BaseModel,
    options: PlanOptions,
    noise: Floats | None = None,
    known: Floats | None = None,
    believed: Floats | None = None,
) -> PlanningContext:
    """Prepare everything that motions are judged by.

    Args:
        base: model and base parameters.
        options: what is wanted.
        noise: standard deviation of each joint's torque, (n,) [N m or N]; assumed when None.
        known: information matrix of earlier logs, (p, p); None without any.
        believed: the same with the prior, (p, p); None for ``known``.
    """
    return PlanningContext(
        base,
        bounds(base.robot, options.margin),
        Capsules(base.robot, options.scene),
        options,
        default_noise(base.robot) if noise is None else noise,
        known,
        known if believed is None else believed,
        prior_base_parameters(base.model, base.reduction, unknown=0.0),
        held_out(base.model, base.reduction.base, bounds(base.robot)),
    )


def basis_of(options: PlanOptions) -> Quintic:
    """Return the family of motions that is wanted."""
    return Quintic.even(options.duration, options.segments, smooth=options.basis == "spline")


def plan_problem(context: PlanningContext) -> PlanProblem:
    """Return the search problem of what is wanted."""
    options = context.options
    kind = "paper" if options.weights else options.cost
    cost = Cost(
        kind,
        options.normalise,
        options.weights or PAPER_WEIGHTS,
        context.other if kind == "i" else None,
    )
    return PlanProblem(
        context.base.model,
        context.base.reduction.base,
        basis_of(options),
        collision_free_range(context),
        cost,
        noise=context.noise if kind in ("i", "d") or context.known is not None else None,
        known=context.known,
        rate=options.rate,
        torque=context.theta if bool(np.isfinite(context.limits.torque).any()) else None,
        penalties=(context.capsules,),
        samples=max(tuning.LEAST_SAMPLES, tuning.SAMPLES_A_SEGMENT * options.segments),
        narrow=collision_free_range(context, passable=True),
    )


def collision_free_range(context: PlanningContext, *, passable: bool = False) -> Bounds:
    """Return the limits for a start of the search, narrowed to where the arm is often clear.

    Args:
        context: the arm and what is wanted.
        passable: whether to narrow further, until every value of a joint can be passed; such a range is safe, and a
            wider one may hold a better motion that never reaches its ends.

    Every motion of the search reaches a limit of each joint. An arm whose joints all turn twice would sweep through
    itself and the floor all the time; so the range of the joint that helps most is narrowed until half the poses are
    clear.
    """
    limits, capsules = context.limits, context.capsules
    rng = np.random.default_rng(0)
    unit = rng.uniform(-1, 1, (tuning.RANGE_POSES, len(limits.lower)))
    middle, half = (limits.upper + limits.lower) / 2, (limits.upper - limits.lower) / 2
    share = float(capsules.keeps_clear(middle + unit * half).mean())
    if share >= tuning.CLEAR_POSES_SHARE and half.max() <= np.pi and not passable:
        return limits
    if share >= tuning.CLEAR_POSES_SHARE and half.max() <= np.pi:
        return _around(limits, middle, _passable(capsules, middle, half))
    half = np.minimum(half, np.pi)
    around = unit * np.minimum(half, tuning.RANGE_MIDDLE_REACH_RAD)
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    middles = rng.uniform(lower, upper, (tuning.RANGE_MIDDLES, len(half)))
    middle = middles[
        int(np.argmax([capsules.keeps_clear(pose + around).mean() for pose in middles]))
    ]
    share = float(capsules.keeps_clear(middle + unit * half).mean())
    while share < tuning.CLEAR_POSES_SHARE and half.max() > tuning.NARROWEST_HALF_RANGE:
        tried = []
        for j in np.flatnonzero(half > tuning.NARROWEST_HALF_RANGE):
            less = np.where(np.arange(len(half)) == j, 0.8 * half, half)
            tried.append((float(capsules.keeps_clear(middle + unit * less).mean()), j))
        share, j = max(tried)
        half[j] *= 0.8
    return _around(limits, middle, _passable(capsules, middle, half) if passable else half)


def _around(limits: Bounds, middle: Floats, half: Floats) -> Bounds:
    return replace(
        limits,
        lower=np.maximum(middle - half, limits.lower),
        upper=np.minimum(middle + half, limits.upper),
    )


def _passable(capsules: Capsules, middle: Floats, half: Floats) -> Floats:
    """Return half ranges, (n,), in which no joint has to pass a value at which the arm is hardly ever clear.

    A motion that reaches both ends of a joint's range passes all values between: through an elbow folded onto itself.
    """
    unit = np.random.default_rng(1).uniform(-1, 1, (tuning.SLICED_POSES, len(half)))
    slices = np.minimum(((unit + 1) / 2 * tuning.RANGE_SLICES).astype(int), tuning.RANGE_SLICES - 1)
    half = half.copy()
    while half.max() > tuning.NARROWEST_HALF_RANGE:
        clear = capsules.keeps_clear(middle + unit * half)
        least = np.array(
            [min(clear[at == k].mean() for k in range(tuning.RANGE_SLICES)) for at in slices.T]
        )
        worst = int(np.argmin(np.where(half > tuning.NARROWEST_HALF_RANGE, least, np.inf)))
        if least[worst] >= tuning.PASSABLE_SHARE:
            break
        half[worst] *= 0.8
    return half


@dataclass(frozen=True)
class Proposal:
    """A motion, and how much of it is left after it was drawn towards the clear pose.

    Attributes:
        trajectory: the motion.
        share: what is left, 1 for all.
    """

    trajectory: Trajectory
    share: float = 1.0


def search_time(seconds: float) -> float:
    """Return how much of the whole time is for the search [s]: checks, pictures and files need the rest."""
    return seconds - min(tuning.AFTER_SEARCH_SHARE * seconds, tuning.AFTER_SEARCH_S)


def proposals(context: PlanningContext, found: SearchOutcome | None) -> Iterator[Proposal]:
    """Yield motions at the wanted speed factor, the most promising first, their repaired versions after them.

    Args:
        context: the arm and what is wanted.
        found: what the search found; None for random motions.
    """
    options, basis = context.options, basis_of(context.options)
    candidates = _random(context, basis) if found is None else found.candidates
    home = once_more(lambda: clear_pose(context))
    for share in tuning.SHRINK_SHARES:
        for one in candidates:
            drawn = share * one + (1 - share) * np.outer(basis.constant, home)
            yield Proposal(Trajectory(basis, drawn, options.alpha), share)


def _random(context: PlanningContext, basis: Quintic) -> tuple[Floats, ...]:
    """Return the coefficients of motions of the seed, (k, n) each."""
    draws = (np.random.default_rng((context.options.seed, k)) for k in range(tuning.RANDOM_MOTIONS))
    return tuple(
        coefficients(basis, context.limits, random_variables(basis, context.limits, rng))
        for rng in draws
    )


def clear_pose(context: PlanningContext) -> Floats:
    """Return a pose inside the limits with much room around the arm, (n,) [rad or m]."""
    rng = np.random.default_rng(0)
    lower, upper = np.maximum(context.limits.lower, -np.pi), np.minimum(context.limits.upper, np.pi)
    q = rng.uniform(lower, upper, (tuning.CLEAR_POSES, len(lower)))
    room = [
        min((c.distance - c.wanted for c in context.capsules.contacts(pose[None])), default=0.0)
        for pose in q
    ]
    return np.asarray(q[int(np.argmax(room))])


def require_safe(context: PlanningContext, trajectory: Trajectory) -> LimitCheck:
    """Refuse a motion that breaks a limit or comes too near to something, as far as this process can tell.

    Returns:
        What the motion uses of the limits.

    Raises:
        LimitBroken: a joint limit, a torque, or the tool's speed.
        Collision: contact of the arm's capsules.
    """
    found = context.check(trajectory)
    require_within_limits(found, context.options.margin)
    _capsules_clear(context, trajectory)
    return found


def _capsules_clear(context: PlanningContext, trajectory: Trajectory) -> Distances:
    """Return the distances of the arm's capsules; refuse a motion that comes too near to something.

    Raises:
        Collision: contact of the arm's capsules.
    """
    found = capsule_distances(
        context.capsules, trajectory.sampled(tuning.CONTACT_RATE_HZ * trajectory.alpha)
    )
    require_clear((*found.least, *found.usual), fix=clearance_fix(context.robot, guessed=True))
    return found


@dataclass(frozen=True)
class Clearance:
    """How far a motion stays away from everything.

    Attributes:
        distances: least distance of every watched pair, the closest pair first.
        left_out: pairs of links that are near in usual poses because of their guessed thickness, and not watched.
        pictures: files that were drawn.
        findings: what is worth a warning.
    """

    distances: tuple[Distance, ...]
    left_out: tuple[str, ...] = ()
    pictures: tuple[Path, ...] = ()
    findings: tuple[Finding, ...] = ()


def require_clear_motion(
    context: PlanningContext,
    trajectory: Trajectory,
    urdf: Path | None,
    drawing: Drawing,
    progress: Progress = SILENT,
    *,
    given: bool = True,
) -> Clearance:
    """Let PyBullet measure and draw a motion; without PyBullet the distances of the capsules stand.

    Ctrl-C while PyBullet measures leaves the distances of the capsules, while it draws no pictures.

    Args:
        context: the arm and its surroundings.
        trajectory: the motion.
        urdf: the user's own shapes; cylinders along the DH table when None.
        drawing: what to draw.
        progress: told that pictures are drawn.
        given: whether a person gave the motion, who wants to see it also when it is refused.

    Raises:
        Collision: something comes too near.
        PackageMissing: PyBullet is missing and was asked for.
    """
    try:
        with urdf_of(context.robot, urdf) as shapes:
            return _judged_by_bullet(
                context, trajectory, shapes, drawing, progress, given=given, guessed=urdf is None
            )
    except PackageMissing:
        if drawing.needed:
            raise
    except KeyboardInterrupt:
        found = once_more(lambda: _capsules_clear(context, trajectory))
        text = "interrupted: distances were measured on capsules along the links only, and nothing was drawn"
        return Clearance(found.least, found.left_out, findings=(Finding("W607", "warning", text),))
    found = _capsules_clear(context, trajectory)
    pictures: tuple[Path, ...] = ()
    if (path := drawing.picture) is not None and (sketch := drawing.sketch) is not None:
        still = replace(drawing, animation=None)
        pictures = _drawn(
            still,
            lambda: sketch(path, trajectory, context.capsules, found.least, drawing.title),
            progress,
        )
    what = "the picture is a drawing" if pictures else "nothing was drawn"
    text = f"PyBullet is missing: distances are those of capsules along the links, {what}"
    return Clearance(found.least, found.left_out, pictures, (Finding("W605", "warning", text),))


def _judged_by_bullet(
    context: PlanningContext,
    trajectory: Trajectory,
    shapes: Path,
    drawing: Drawing,
    progress: Progress,
    *,
    given: bool,
    guessed: bool,
) -> Clearance:
    """Return what PyBullet measures, with pictures, which take seconds, of a motion that keeps clear or was given."""
    robot, scene = context.robot, context.options.scene
    found = measure_trajectory(trajectory, robot, shapes, scene, guessed=guessed)

    def pictures() -> tuple[Path, ...]:
        return _drawn(
            drawing, lambda: draw_trajectory(trajectory, robot, shapes, scene, drawing), progress
        )

    try:
        picture = drawing.picture if given else None
        require_clear((*found.least, *found.usual), picture, clearance_fix(robot, guessed=guessed))
    except Collision:
        if given:
            pictures()
        raise
    return Clearance(found.least, found.left_out, pictures())


def _drawn(drawing: Drawing, work: Callable[[], None], progress: Progress) -> tuple[Path, ...]:
    """Draw, and return which files there are; none when the person does not wait for them."""
    if not drawing.wanted:
        return ()
    progress.stage("draw")
    try:
        work()
    except KeyboardInterrupt:
        progress.stage("interrupt", "the motion is kept, but no picture was drawn")
        return ()
    return tuple(path for path in (drawing.picture, drawing.animation) if path is not None)


def once_more(work: Callable[[], Result]) -> Result:
    """Do short work to its end: the first Ctrl-C begins it anew, the second one ends."""
    try:
        return work()
    except KeyboardInterrupt:
        return work()


def clearance_fix(robot: Robot, *, guessed: bool) -> str:
    """Return what helps against a motion that comes too near; of guessed shapes, where their thickness is set."""
    usual = "plan again with another --seed, or move the waypoints, --floor or --obstacle"
    return f"{usual}; {thickness(robot)}; or give --urdf" if guessed else usual


def thickness(robot: Robot) -> str:
    """Say how thick the links are taken to be, and where that is set."""
    given = robot.prior.cylinders if robot.prior else None
    radius = (given or DEFAULT_CYLINDERS).radius
    where = f"`prior: {{cylinders: {{radius: ...}}}}` in {robot.editable}"
    return f"links are cylinders of radius {radius:g} m, {'set' if given else 'a guess; set it'} by {where}"


def first_accepted(
    candidates: Iterable[Proposal],
    judge: Callable[[Trajectory], Judgement],
    until: float = math.inf,
    progress: Progress = SILENT,
) -> tuple[Proposal, Judgement]:
    """Return the first motion that is not refused, with what the judge found.

    Args:
        candidates: motions, the most promising first.
        judge: raises what is wrong with a motion.
        until: when the time is over, by ``time.monotonic``; the motion at hand is still judged [s].
        progress: told which motion is judged.

    Raises:
        LimitBroken: no motion passed; this is why the last one failed.
        Collision: the same.
    """
    reason: DynidError | None = None
    for k, candidate in enumerate(candidates):
        if reason is not None and time.monotonic() > until:
            break
        progress.advance(k, 0, f"motion {k + 1}, {100 * candidate.share:.0f} % of its size")
        try:
            return candidate, judge(candidate.trajectory)
        except (LimitBroken, Collision) as error:
            reason = error
    raise reason or LimitBroken(
        "the search found no motion", fix="give it more time with --seconds"
    )
