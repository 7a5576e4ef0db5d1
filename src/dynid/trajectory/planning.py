"""From wishes to a motion that may be shown: search, repair, and the judges in their order.

Joint limits hold by construction; torque, tool speed and contact are checked, and a motion that fails is drawn towards
a clear pose until it passes. PyBullet is asked last, because it is the slowest.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Collision, DynidError, LimitBroken
from dynid.model.store import BaseModel
from dynid.motion import Motion
from dynid.progress import SILENT, Progress
from dynid.trajectory.basis import Basis, Fourier, Quintic
from dynid.trajectory.clearance import Scene, Spheres
from dynid.trajectory.cost import Cost, Kind
from dynid.trajectory.feasible import CONTINUOUS, Bounds, Shaping, bounds
from dynid.trajectory.limits import check, require
from dynid.trajectory.objective import Problem
from dynid.trajectory.optimise import Candidate, Found, Search, optimise
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.predict import believed, held_out

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
class Wishes:
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
    search: Search | None = None
    known: Floats | None = None
    rate: float = 100.0
    seed: int = 0


@dataclass(frozen=True)
class Workshop:
    """An arm with everything that judging its motions needs.

    Attributes:
        base: model and base parameters.
        limits: limits, margins taken off.
        spheres: the arm and its surroundings.
        wishes: what is wanted.
        theta: base parameters believed before measuring, (p,).
        other: mean of P^T P over the motions that the model shall predict, (p, p).
    """

    base: BaseModel
    limits: Bounds
    spheres: Spheres
    wishes: Wishes
    theta: Floats
    other: Floats

    def torque(self, motion: Motion) -> Floats:
        """Return the torques that are predicted before anything is measured, (N, n) [N m or N]."""
        observer = self.base.model.observer(self.base.reduction.base)
        return observer.torque(self.theta, motion.q, motion.qd, motion.qdd)


def workshop(base: BaseModel, wishes: Wishes) -> Workshop:
    """Prepare the judges."""
    limits = bounds(base.robot, wishes.margin)
    return Workshop(
        base,
        limits,
        Spheres(base.robot, wishes.scene),
        wishes,
        believed(base.model, base.reduction),
        held_out(base.model, base.reduction.base, bounds(base.robot)),
    )


def family(wishes: Wishes) -> Basis:
    """Return the family of motions that is wanted."""
    if wishes.family == "fourier":
        return Fourier(wishes.duration, wishes.segments)
    return Quintic.even(wishes.duration, wishes.segments, smooth=wishes.family == "spline")


def problem(shop: Workshop, basis: Basis) -> Problem:
    """Return the search problem of what is wanted."""
    wishes = shop.wishes
    finite = bool(np.isfinite(shop.limits.torque).any())
    return Problem(
        shop.base.model,
        shop.base.reduction.base,
        basis,
        shop.limits,
        Cost(wishes.cost, wishes.normalised, wishes.weights, shop.other if wishes.cost == "i" else None),
        noise=wishes.noise if wishes.cost in ("i", "d") or wishes.known is not None else None,
        known=wishes.known,
        rate=wishes.rate,
        torque=shop.theta if finite else None,
        penalties=(shop.spheres,),
        samples=max(SAMPLES, SAMPLES_A_SEGMENT * wishes.segments),
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


def searched(shop: Workshop, progress: Progress = SILENT) -> Found | None:
    """Search for the best motions; None when no search is wanted."""
    wishes = shop.wishes
    return None if wishes.search is None else optimise(problem(shop, family(wishes)), wishes.search, progress)


def proposals(shop: Workshop, found: Found | None) -> Iterator[Proposal]:
    """Yield motions at the wanted speed factor, the most promising first, each with its repaired versions after it.

    Args:
        shop: the arm and what is wanted.
        found: what the search found; None for random motions.
    """
    wishes, basis = shop.wishes, family(shop.wishes)
    candidates = list(_random(shop, basis)) if found is None else found.candidates
    home = clear_pose(shop)
    for one in candidates:
        for share in SHRINK:
            drawn = share * one.coefficients + (1 - share) * np.outer(basis.constant, home)
            yield Proposal(Trajectory(basis, drawn, wishes.alpha), one.start, one.evaluation or None, share)


def _random(shop: Workshop, basis: Basis) -> Iterator[Candidate]:
    shaping = Shaping(basis, shop.limits, np.zeros(1))
    for start in range(RANDOM_STARTS):
        x = shaping.random(np.random.default_rng((shop.wishes.seed, start)))
        yield Candidate(np.inf, shaping.coefficients(x), start, 0)


def clear_pose(shop: Workshop) -> Floats:
    """Return a pose inside the limits with much room around the arm, (n,)."""
    rng = np.random.default_rng(0)
    lower, upper = np.maximum(shop.limits.lower, CONTINUOUS[0]), np.minimum(shop.limits.upper, CONTINUOUS[1])
    q = rng.uniform(lower, upper, (CLEAR_POSES, len(lower)))
    room = [min((c.distance - c.wanted for c in shop.spheres.contacts(pose[None])), default=0.0) for pose in q]
    return np.asarray(q[int(np.argmax(room))])


def judged(shop: Workshop, trajectory: Trajectory) -> None:
    """Refuse a motion that breaks a limit or comes too near to something, as far as this process can tell.

    Raises:
        LimitBroken: a joint limit, a torque, or the tool's speed.
        Collision: contact of the arm's spheres.
    """
    require(check(trajectory, shop.base.robot, shop.limits, shop.torque, shop.wishes.speed), shop.wishes.margin)
    motion = trajectory.sampled(CONTACT_RATE * trajectory.alpha)
    for contact in shop.spheres.contacts(motion.q):
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
