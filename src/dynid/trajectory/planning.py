"""From options to a motion that may be shown: search, repair, and the checks in their order.

Joint limits hold by construction; torque, tool speed and contact are checked, and a motion that fails is drawn towards
a clear pose until it passes. PyBullet is asked last, because it is the slowest.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from dynid.arrays import Floats
from dynid.errors import Collision, Finding, LimitBroken, PackageMissing
from dynid.model.base_model import BaseModel
from dynid.model.parameters import DEFAULT_CYLINDERS
from dynid.motion import Motion
from dynid.progress import advance, stage
from dynid.robot import Robot
from dynid.trajectory import tuning
from dynid.trajectory.basis import Quintic
from dynid.trajectory.clearance import Capsules
from dynid.trajectory.cost import Cost
from dynid.trajectory.feasible import Bounds, bounds, coefficients, random_variables
from dynid.trajectory.limits import LimitCheck, check_trajectory, require_within_limits
from dynid.trajectory.objective import PlanProblem
from dynid.trajectory.optimise import SearchOutcome
from dynid.trajectory.options import PAPER_WEIGHTS, PlanOptions
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.predict import default_noise, held_out
from dynid.trajectory.preview import (
    FRAMES,
    STILLS,
    Draw,
    Drawing,
    measure_poses,
    photographs,
    poses_of,
    require_clear,
)
from dynid.trajectory.scene import Distance

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
        observer = self.base.observer
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
    """Prepare everything that motions are checked with.

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
        base.prior(unknown=0.0),
        held_out(base, bounds(base.robot)),
    )


def basis_of(options: PlanOptions) -> Quintic:
    """Return the family of motions that is wanted."""
    return Quintic.even(options.duration, options.segments, smooth=options.basis == "spline")


def plan_problem(context: PlanningContext) -> PlanProblem:
    """Return the search problem of what is wanted."""
    options = context.options
    kind = "paper" if options.weights else options.cost
    other = context.other if kind == "i" else None
    wide, passable = search_ranges(context.limits, context.capsules)
    return PlanProblem(
        context.base.model,
        context.base.reduction.base,
        basis_of(options),
        wide,
        Cost(kind, options.normalise, options.weights or PAPER_WEIGHTS, other),
        noise=context.noise if kind in ("i", "d") or context.known is not None else None,
        known=context.known,
        rate=options.rate,
        torque=context.theta if bool(np.isfinite(context.limits.torque).any()) else None,
        capsules=context.capsules,
        samples=max(tuning.LEAST_SAMPLES, tuning.SAMPLES_A_SEGMENT * options.segments),
        narrow=passable,
    )


def search_ranges(limits: Bounds, capsules: Capsules) -> tuple[Bounds, Bounds]:
    """Return the limits for starts of the search: narrowed to where the arm is often clear, and further to be passable.

    Every motion of the search reaches a limit of each joint. An arm whose joints all turn twice would sweep through
    itself and the floor all the time; so the range of the joint that helps most is narrowed until half the poses are
    clear. It also passes all values between, through an elbow folded onto itself: a range without a value at which the
    arm is hardly ever clear is safe, and a wider one may hold a better motion that never reaches its ends.
    """
    rng = np.random.default_rng(0)
    unit = rng.uniform(-1, 1, (tuning.RANGE_POSES, len(limits.lower)))

    def clear(middle: Floats, half: Floats) -> float:
        return float((capsules.margin(middle + unit * half) >= 0).mean())

    def around(half: Floats) -> Bounds:
        lower = np.maximum(middle - half, limits.lower)
        return replace(limits, lower=lower, upper=np.minimum(middle + half, limits.upper))

    middle, half = (limits.upper + limits.lower) / 2, (limits.upper - limits.lower) / 2
    if clear(middle, half) >= tuning.CLEAR_POSES_SHARE and half.max() <= np.pi:
        return limits, around(_passable(capsules, middle, half))
    half = np.minimum(half, np.pi)
    near = np.minimum(half, tuning.RANGE_MIDDLE_REACH_RAD)
    lower, upper = np.maximum(limits.lower, -np.pi), np.minimum(limits.upper, np.pi)
    middles = rng.uniform(lower, upper, (tuning.RANGE_MIDDLES, len(half)))
    middle = middles[int(np.argmax([clear(pose, near) for pose in middles]))]
    share = clear(middle, half)
    while share < tuning.CLEAR_POSES_SHARE and half.max() > tuning.NARROWEST_HALF_RANGE:
        tried = []
        for j in np.flatnonzero(half > tuning.NARROWEST_HALF_RANGE):
            less = np.where(np.arange(len(half)) == j, 0.8 * half, half)
            tried.append((clear(middle, less), j))
        share, j = max(tried)
        half[j] *= 0.8
    return around(half), around(_passable(capsules, middle, half))


def _passable(capsules: Capsules, middle: Floats, half: Floats) -> Floats:
    """Return half ranges, (n,), in which no joint has to pass a value at which the arm is hardly ever clear."""
    unit = np.random.default_rng(1).uniform(-1, 1, (tuning.SLICED_POSES, len(half)))
    slices = np.minimum(((unit + 1) / 2 * tuning.RANGE_SLICES).astype(int), tuning.RANGE_SLICES - 1)
    half = half.copy()
    while half.max() > tuning.NARROWEST_HALF_RANGE:
        clear = capsules.margin(middle + unit * half) >= 0
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


def proposals(context: PlanningContext, outcome: SearchOutcome | None) -> Iterator[Proposal]:
    """Yield motions at the wanted speed factor, the most promising first, their repaired versions after them.

    Args:
        context: the arm and what is wanted.
        outcome: of the search; None for random motions of the seed.
    """
    options, basis, limits = context.options, basis_of(context.options), context.limits
    draws = (np.random.default_rng((options.seed, k)) for k in range(tuning.RANDOM_MOTIONS))
    candidates = (
        outcome.candidates
        if outcome
        else [coefficients(basis, limits, random_variables(basis, limits, rng)) for rng in draws]
    )
    home = clear_pose(context)
    for share in tuning.SHRINK_SHARES:
        for one in candidates:
            drawn = share * one + (1 - share) * np.outer(basis.constant, home)
            yield Proposal(Trajectory(basis, drawn, options.alpha), share)


def clear_pose(context: PlanningContext) -> Floats:
    """Return a pose inside the limits with much room around the arm, (n,) [rad or m]."""
    lower, upper = np.maximum(context.limits.lower, -np.pi), np.minimum(context.limits.upper, np.pi)
    q = np.random.default_rng(0).uniform(lower, upper, (tuning.CLEAR_POSES, len(lower)))
    # One by one: where the nearest link is one that no joint lifts, rounding chooses, and many at once round otherwise.
    margins = [context.capsules.margin(pose[None])[0] for pose in q]
    return q[np.argmax(margins)]


def require_safe(context: PlanningContext, trajectory: Trajectory) -> LimitCheck:
    """Refuse a motion that breaks a limit or comes too near to something, as far as this process can tell.

    Returns:
        What the motion uses of the limits.

    Raises:
        LimitBroken: a joint limit, a torque, or the tool's speed.
        Collision: contact of the arm's capsules.
    """
    check = context.check(trajectory)
    require_within_limits(check, context.options.margin)
    near = _capsule_distances(context, trajectory)
    require_clear(near, fix=clearance_fix(context.robot, guessed=True))
    return check


def _capsule_distances(context: PlanningContext, trajectory: Trajectory) -> tuple[Distance, ...]:
    motion = trajectory.sampled(tuning.CONTACT_RATE_HZ * trajectory.alpha)
    return context.capsules.distances(motion.q, motion.t)


@dataclass(frozen=True)
class Clearance:
    """How far a motion stays away from everything.

    Attributes:
        measured: least distance of every watched pair, the closest pair first.
        pictures: files that were drawn.
        findings: what is worth a warning.
    """

    measured: tuple[Distance, ...]
    pictures: tuple[Path, ...] = ()
    findings: tuple[Finding, ...] = ()

    @property
    def distances(self) -> tuple[Distance, ...]:
        """Those of pairs that can keep clear."""
        return tuple(one for one in self.measured if not one.usual)

    @property
    def left_out(self) -> tuple[str, ...]:
        """Pairs of links that are near in usual poses because of their guessed thickness."""
        return tuple(sorted(one.pair for one in self.measured if one.usual))


def require_clear_motion(
    context: PlanningContext,
    trajectory: Trajectory,
    urdf: Path | None,
    drawing: Drawing,
    draw: Draw,
    *,
    given: bool = True,
) -> Clearance:
    """Let PyBullet measure and draw a motion; without PyBullet the distances of the capsules stand.

    Args:
        context: the arm and its surroundings.
        trajectory: the motion.
        urdf: the user's own shapes; cylinders along the DH table when None.
        drawing: what to draw.
        draw: draws it.
        given: whether a person gave the motion, who wants to see it also when it is refused.

    Raises:
        Collision: something comes too near.
        PackageMissing: PyBullet is missing and was asked for.
    """
    missing, capsules = False, context.capsules
    try:
        distances = measure_poses(*poses_of(trajectory), capsules, urdf)
    except PackageMissing:
        if drawing.needed:
            raise
        missing, distances = True, _capsule_distances(context, trajectory)
        drawing = replace(drawing, animation=None)
    paths = tuple(path for path in (drawing.picture, drawing.animation) if path is not None)

    def show() -> None:
        if paths:
            stage("draw")
            count = FRAMES if drawing.animation else STILLS
            pictures = [] if missing else photographs(trajectory, capsules, urdf, count)
            draw(drawing, trajectory, capsules, pictures)

    fix = clearance_fix(context.robot, guessed=urdf is None or missing)
    try:
        require_clear(distances, drawing.picture if given else None, fix)
    except Collision:
        if given:
            show()
        raise
    show()
    what = "PyBullet is missing: distances are those of capsules along the links, "
    what += "the picture is a drawing" if paths else "nothing was drawn"
    said = Finding("W605", "warning", what)
    return Clearance(distances, paths, (said,) if missing else ())


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
    test: Callable[[Trajectory], Judgement],
    until: float,
) -> tuple[Proposal, Judgement]:
    """Return the first motion that is not refused, with what the test returned.

    Args:
        candidates: motions, the most promising first.
        test: raises what is wrong with a motion.
        until: when the time is over, by ``time.monotonic``; the motion at hand is still checked [s].

    Raises:
        LimitBroken: no motion passed; this is why the last one failed.
        Collision: the same.
    """
    reason = None
    for k, candidate in enumerate(candidates):
        if reason is not None and time.monotonic() > until:
            break
        advance(k, 0, f"motion {k + 1}, {100 * candidate.share:.0f} % of its size")
        try:
            return candidate, test(candidate.trajectory)
        except (LimitBroken, Collision) as error:
            reason = error
    raise reason or LimitBroken(
        "the search found no motion", fix="give it more time with --seconds"
    )
