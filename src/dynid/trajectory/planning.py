"""From options to a motion that may be shown: search, repair, and the judges in their order.

Joint limits hold by construction; torque, tool speed and contact are checked, and a motion that fails is drawn towards
a clear pose until it passes. PyBullet is asked last, because it is the slowest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Collision, DynidError, LimitBroken
from dynid.model.prior import prior_base_parameters
from dynid.model.store import BaseModel
from dynid.motion import Motion
from dynid.progress import SILENT, Progress
from dynid.trajectory.basis import Basis, Fourier, Quintic
from dynid.trajectory.clearance import Scene, Spheres
from dynid.trajectory.cost import Cost, Kind
from dynid.trajectory.feasible import CONTINUOUS, Bounds, Shaping, bounds
from dynid.trajectory.limits import LimitCheck, check_trajectory, require_within_limits
from dynid.trajectory.objective import PlanProblem
from dynid.trajectory.optimise import MotionCandidate, SearchOptions, SearchOutcome, optimise
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.predict import held_out

Floats = NDArray[np.float64]

FAMILIES = ("quintic", "spline", "fourier")
#: How far a motion is drawn towards the clear pose, step by step, until all judges agree.
SHRINK = (1.0, 0.9, 0.8, 0.65, 0.5, 0.35, 0.2)
#: Samples along the path for each segment, and at least.
SAMPLES_A_SEGMENT, SAMPLES = 12, 200
#: Rate at which contact is checked on the spheres [Hz] and random poses among which a clear one is looked for.
CONTACT_RATE, CLEAR_POSES = 50.0, 400
#: Random motions among which one is taken without a search.
RANDOM_STARTS = 20


@dataclass(frozen=True)
class PlanOptions:
    """What a person wants of a motion.

    Attributes:
        duration: at full speed [s].
        segments: number of quintic segments, or of harmonics.
        family: one of ``FAMILIES``.
        cost: ``"i"``, ``"d"``, ``"condition"`` or ``"paper"``.
        normalised: columns of equal length for ``condition`` and ``paper``.
        weights: l1 and l2 of the paper's Eq. 14.
        margin: share of every limit that stays free.
        alpha: speed factor of the run.
        speed: largest speed of the tool [m/s]; None for any.
        scene: what surrounds the arm.
        search: how hard to search; None for a random motion.
        noise: torque noise of each joint, (n,).
        known: information matrix of earlier logs; None without any.
        rate: sample rate of the coming log [Hz].
        seed: of the random motions without a search.
    """

    duration: float
    segments: int
    family: str
    cost: Kind
    noise: Floats
    normalised: bool = False
    weights: tuple[float, float] = (1.0, 100.0)
    margin: float = 0.1
    alpha: float = 1.0
    speed: float | None = None
    scene: Scene = field(default_factory=Scene)
    search: SearchOptions | None = None
    known: Floats | None = None
    rate: float = 100.0
    seed: int = 0


@dataclass(frozen=True)
class PlanningContext:
    """An arm with everything that judging its motions needs.

    Attributes:
        base: model and base parameters.
        limits: limits, margins taken off.
        spheres: the arm and its surroundings.
        options: what is wanted.
        theta: base parameters by the prior, before anything is measured, (p,).
        other: mean of P^T P over the motions that the model shall predict, (p, p).
    """

    base: BaseModel
    limits: Bounds
    spheres: Spheres
    options: PlanOptions
    theta: Floats
    other: Floats

    def torque(self, motion: Motion) -> Floats:
        """Return the torques that are predicted before anything is measured, (N, n) [N m or N]."""
        observer = self.base.model.observer(self.base.reduction.base)
        return observer.torque(self.theta, motion.q, motion.qd, motion.qdd)

    def check(self, trajectory: Trajectory) -> LimitCheck:
        """Return what a motion uses of the limits."""
        return check_trajectory(trajectory, self.base.robot, self.limits, self.torque, self.options.speed)


def planning_context(base: BaseModel, options: PlanOptions) -> PlanningContext:
    """Prepare the judges."""
    limits = bounds(base.robot, options.margin)
    return PlanningContext(
        base,
        limits,
        Spheres(base.robot, options.scene),
        options,
        prior_base_parameters(base.model, base.reduction, unknown=0.0),
        held_out(base.model, base.reduction.base, bounds(base.robot)),
    )


def basis_of(options: PlanOptions) -> Basis:
    """Return the family of motions that is wanted."""
    if options.family == "fourier":
        return Fourier(options.duration, options.segments)
    return Quintic.even(options.duration, options.segments, smooth=options.family == "spline")


def plan_problem(context: PlanningContext, basis: Basis) -> PlanProblem:
    """Return the search problem of what is wanted."""
    options = context.options
    finite = bool(np.isfinite(context.limits.torque).any())
    return PlanProblem(
        context.base.model,
        context.base.reduction.base,
        basis,
        context.limits,
        Cost(options.cost, options.normalised, options.weights, context.other if options.cost == "i" else None),
        noise=options.noise if options.cost in ("i", "d") or options.known is not None else None,
        known=options.known,
        rate=options.rate,
        torque=context.theta if finite else None,
        penalties=(context.spheres,),
        samples=max(SAMPLES, SAMPLES_A_SEGMENT * options.segments),
    )


@dataclass(frozen=True)
class Proposal:
    """A motion with where it comes from.

    Attributes:
        trajectory: the motion.
        start: number of the start that led to it; None when a person gave the path.
        evaluation: evaluation of that start at which it was met; None without a search.
        share: how much of it is left after it was drawn towards the clear pose.
    """

    trajectory: Trajectory
    start: int | None = None
    evaluation: int | None = None
    share: float = 1.0


def search_motions(context: PlanningContext, progress: Progress = SILENT) -> SearchOutcome | None:
    """Search for the best motions; None when no search is wanted."""
    search = context.options.search
    return None if search is None else optimise(plan_problem(context, basis_of(context.options)), search, progress)


def proposals(context: PlanningContext, found: SearchOutcome | None) -> Iterator[Proposal]:
    """Yield motions at the wanted speed factor, the most promising first, each with its repaired versions after it.

    Args:
        context: the arm and what is wanted.
        found: what the search found; None for random motions.
    """
    options, basis = context.options, basis_of(context.options)
    candidates = list(_random(context, basis)) if found is None else found.candidates
    home = clear_pose(context)
    for one in candidates:
        for share in SHRINK:
            drawn = share * one.coefficients + (1 - share) * np.outer(basis.constant, home)
            yield Proposal(Trajectory(basis, drawn, options.alpha), one.start, one.evaluation or None, share)


def _random(context: PlanningContext, basis: Basis) -> Iterator[MotionCandidate]:
    shaping = Shaping(basis, context.limits, np.zeros(1))
    for start in range(RANDOM_STARTS):
        x = shaping.random(np.random.default_rng((context.options.seed, start)))
        yield MotionCandidate(np.inf, shaping.coefficients(x), start, 0)


def clear_pose(context: PlanningContext) -> Floats:
    """Return a pose inside the limits with much room around the arm, (n,)."""
    rng = np.random.default_rng(0)
    lower, upper = np.maximum(context.limits.lower, CONTINUOUS[0]), np.minimum(context.limits.upper, CONTINUOUS[1])
    q = rng.uniform(lower, upper, (CLEAR_POSES, len(lower)))
    room = [min((c.distance - c.wanted for c in context.spheres.contacts(pose[None])), default=0.0) for pose in q]
    return np.asarray(q[int(np.argmax(room))])


def require_safe(context: PlanningContext, trajectory: Trajectory) -> None:
    """Refuse a motion that breaks a limit or comes too near to something, as far as this process can tell.

    Raises:
        LimitBroken: a joint limit, a torque, or the tool's speed.
        Collision: contact of the arm's spheres.
    """
    require_within_limits(context.check(trajectory), context.options.margin)
    motion = trajectory.sampled(CONTACT_RATE * trajectory.alpha)
    for contact in context.spheres.contacts(motion.q):
        if contact.distance < contact.wanted:
            what = f"{contact.what}: {1000 * contact.distance:.0f} mm at t = {motion.t[contact.index]:.1f} s"
            raise Collision(f"{what}; wanted are {1000 * contact.wanted:.0f} mm")


def first_accepted(
    candidates: Iterator[Proposal], judges: list[Callable[[Trajectory], object]]
) -> tuple[Proposal, list[object]]:
    """Return the first motion that no judge refuses, with what the judges found.

    Raises:
        LimitBroken: no motion passed; this is why the last one failed.
        Collision: the same.
    """
    reason: DynidError | None = None
    for candidate in candidates:
        try:
            return candidate, [judge(candidate.trajectory) for judge in judges]
        except (LimitBroken, Collision) as error:
            reason = error
    raise reason or LimitBroken("the search found no motion", fix="give it more time with --seconds")
