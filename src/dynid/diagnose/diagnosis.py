"""Does the robot file describe the arm that made the log? If not: which edits would explain it far better.

Each hypothesis is a robot file with one to three edits: the other DH convention, reversed joints, positions or torques,
another order of the columns, offsets of multiples of 90 degrees, another unit, another direction of gravity. All are
fitted to a few hundred samples and compared by what they leave unexplained. Some edits make the same torques as others,
or as none, whatever the arm does: those are named together, or not at all.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.diagnose import tuning
from dynid.diagnose.fit import Judge, judge_of
from dynid.diagnose.gravity import check_gravity
from dynid.diagnose.mistakes import (
    OF_ALL,
    Edit,
    edits_of,
    pasted,
    said,
    unlikeliness,
    with_edits,
    with_one_more,
)
from dynid.errors import Finding, GravityRemoved, WrongMapping
from dynid.log import Log
from dynid.robot import Robot

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A robot file with edits, and how well it explains the log.

    Attributes:
        edits: what is changed.
        left: what bodies that can exist leave of each joint's torque, root mean square, (n,) [N m or N].
        floor: what a constant, friction and rotor inertia alone leave, (n,) [N m or N].
        outside: how many joints move far beyond their limits.
    """

    edits: tuple[Edit, ...]
    left: Floats
    floor: Floats
    outside: int = 0

    @property
    def unexplained(self) -> float:
        """Share that it leaves of what constant, friction and rotor inertia leave, over all joints."""
        return float(np.linalg.norm(self.left) / np.linalg.norm(self.floor))

    def misfit(self, noise: Floats) -> float:
        """Return the mean logarithm of the share that it leaves of each joint's torque.

        Args:
            noise: how well each joint's torque can be known, (n,) [N m or N].
        """
        return float(np.mean(np.log(np.hypot(self.left, noise) / np.hypot(self.floor, noise))))

    def alike(self, other: Hypothesis) -> bool:
        """Return whether both explain the log the same."""
        return bool(np.allclose(self.left, other.left, rtol=tuning.SAME_RESIDUAL, atol=1e-9))


@dataclass(frozen=True)
class Diagnosis:
    """What was found out about a robot file and a log.

    Attributes:
        given: the robot file as it is.
        best: the best hypotheses, the best first, each of another explanation.
        same: hypotheses that make the same torques as the best one, whatever the arm does.
        tied: further ones that explain this log as well as the best one.
        wrong: whether the best one is so much better that the file must be wrong.
        beyond: numbers of the joints that no file explains, which have no say.
    """

    given: Hypothesis
    best: tuple[Hypothesis, ...]
    same: tuple[Hypothesis, ...]
    tied: tuple[Hypothesis, ...]
    wrong: bool
    beyond: tuple[int, ...] = ()


class _Search:
    """Tries edits of a robot file on one log, and keeps what was found.

    Args:
        judge: fits robot files.
        names: names of the log's columns in chain order.
    """

    def __init__(self, judge: Judge, names: Sequence[str]) -> None:
        self.judge, self.names = judge, names
        self.single = tuple(edits_of(judge, names))
        self.depth = 0
        self.price = max(tuning.CLEAR, tuning.FREE_NUMBERS / judge.independent)
        self._begin()
        beyond = self._beyond()
        if any(beyond) and not all(beyond):
            self.judge = replace(judge, beyond=beyond)
            self._begin()

    def _begin(self) -> None:
        self.bounds: dict[tuple[Edit, ...], Hypothesis] = {}
        self.found: dict[tuple[Edit, ...], Hypothesis] = {}
        self.least_error = np.full(self.judge.robot.n, np.inf)
        self.given = self.fit(())

    def _beyond(self) -> tuple[bool, ...]:
        """Return which joints no robot file explains: whatever their signs are, their friction would not brake.

        No edit of a file but those of a joint's signs changes what its friction has to be.
        """
        noise, found = noise_of(self.judge.robot, self.given.floor), []
        for j, suspect in enumerate(self.given.left > self.given.floor):
            kinds = OF_ALL.values() if suspect and self.judge.mapped else ()
            signs = [(), *((Edit(kind, (float(j),)),) for kind in kinds)] if suspect else []
            files = [with_edits(self.judge.robot, edits) for edits in signs]
            left = np.array(
                [np.hypot(self.judge.alone(file, j), noise[j]) for file in files] or [[1.0, 1.0]]
            )
            found.append(bool(left[:, 1].min() > tuning.NOT_BRAKING * left[0, 0]))
        return tuple(found)

    @property
    def noise(self) -> Floats:
        """How well each joint's torque can be known, as far as it was found out, (n,) [N m or N]."""
        return np.asarray(np.hypot(noise_of(self.judge.robot, self.given.floor), self.least_error))

    def fit(self, edits: tuple[Edit, ...]) -> Hypothesis:
        """Return a hypothesis fitted with bodies that can exist."""
        if edits not in self.found:
            edited = with_edits(self.judge.robot, edits)
            found = Hypothesis(edits, *self.judge.possible(edited), self.judge.outside(edited))
            self.least_error = np.minimum(
                self.least_error, usual_error(self.judge.robot, found.left)
            )
            self.found[edits] = found
        return self.found[edits]

    def bound(self, edits: tuple[Edit, ...]) -> float:
        """Return a promise that a hypothesis cannot be better than."""
        return self.promise(self.bounds[edits])

    def find_bounds(self, several: Iterable[tuple[Edit, ...]]) -> None:
        """Find out what hypotheses leave at least, together, for their columns are much the same."""
        new = [edits for edits in several if edits not in self.bounds]
        files = [with_edits(self.judge.robot, edits) for edits in new]
        for edits, file, least in zip(new, files, self.judge.least(files), strict=True):
            self.bounds[edits] = Hypothesis(edits, *least, self.judge.outside(file))

    def same(self, one: Hypothesis, other: Hypothesis) -> bool:
        """Return whether two hypotheses make the same torques whatever the arm does."""
        return self.judge.same(*(with_edits(self.judge.robot, each.edits) for each in (one, other)))

    def promise(self, hypothesis: Hypothesis) -> float:
        """Return what hypotheses are taken further by, lower is better: as ``rank``, but small errors count as well."""
        return self._rank(hypothesis, noise_of(self.judge.robot, self.given.floor))

    def rank(self, hypothesis: Hypothesis) -> float:
        """Return what hypotheses are ordered by in the end, lower is better: fit, likelihood and number of edits."""
        return self._rank(hypothesis, self.noise)

    def _rank(self, hypothesis: Hypothesis, noise: Floats) -> float:
        return hypothesis.misfit(noise) + self._cost(hypothesis)

    def _cost(self, hypothesis: Hypothesis) -> float:
        """Return what has to be gained by a hypothesis before it is the best, whatever it explains."""
        unlikely = tuning.CLEAR * (
            sum(map(unlikeliness, hypothesis.edits))
            + tuning.OUT_OF_RANGE * min(hypothesis.outside, tuning.MOST_OUTSIDE)
        )
        return unlikely + self.price * len(hypothesis.edits)

    @cached_property
    def _noises(self) -> tuple[Floats, Floats]:
        """How well each joint's torque can be known at best and at worst, whatever else is found out, (n,) each."""
        least = noise_of(self.judge.robot, self.given.floor)
        return least, np.asarray(np.hypot(least, usual_error(self.judge.robot, self.given.left)))

    def beaten(self, edits: tuple[Edit, ...]) -> bool:
        """Return whether edits, by what they leave at least, stay behind the robot file."""
        bound, given = self.bounds[edits], self.given
        # Why the ends: a ratio comes nearer to one, and never crosses it, as the noise grows.
        left, floor = (
            np.minimum(*(np.log(np.hypot(a, noise) / np.hypot(b, noise)) for noise in self._noises))
            for a, b in ((bound.left, given.left), (given.floor, bound.floor))
        )
        return float(np.mean(left + floor)) + self._cost(bound) > self._cost(given)

    @property
    def well(self) -> bool:
        """Whether the robot file explains so much that it has no two mistakes that hide each other."""
        return (
            self.given.misfit(noise_of(self.judge.robot, self.given.floor)) < tuning.WELL_EXPLAINED
        )

    def unrivalled(self) -> bool:
        """Return whether the robot file explains the log well, and all single edits stay behind it."""
        return self.well and all(self.beaten(edits) for edits in self.more([()]))

    def ranked(self) -> list[Hypothesis]:
        """Return what was fitted, the best first."""
        return sorted(self.found.values(), key=self.rank)

    def promising(self) -> list[tuple[Edit, ...]]:
        """Return edits that may become the best with one more, the most promising first.

        Two mistakes can hide each other: where little is explained, many are taken further by what they leave at least.
        """
        lost = not self.well and self.depth == 1
        values = [*(self.bounds if lost else self.found).values()]
        places = sorted(values, key=self.promise)[: tuning.BEAM_LOST if lost else tuning.BEAM]
        return [
            each.edits
            for each in places
            if self.promise(each) < self.promise(places[0]) + tuning.NEAR_BEST
        ]

    def more(self, starts: Iterable[tuple[Edit, ...]]) -> list[tuple[Edit, ...]]:
        """Return what has one edit more than a start and is not fitted yet, with what it leaves at least found out."""
        tried = (
            more
            for start in starts
            for edit in self.single
            if (more := with_one_more(start, edit)) is not None
        )
        # Why in this order: equally good ones are tried as they were written, in every run.
        new = [edits for edits in dict.fromkeys(tried) if edits not in self.found]
        self.find_bounds(new)
        return new

    def widen(self, starts: Iterable[tuple[Edit, ...]]) -> None:
        """Add one edit to each start, and fit those that can be among the best."""
        self.depth += 1
        for edits in sorted(self.more(starts), key=self.bound):
            places = sorted(map(self.promise, self.found.values()))[: tuning.BEAM]
            if len(places) == tuning.BEAM and self.bound(edits) > places[-1]:
                break
            self.fit(edits)


def find_mistake(
    log: Log, robot: Robot, names: Sequence[str] = (), *, mapped: bool = True
) -> Diagnosis | None:
    """Return what a log says about a robot file; None where it hardly moves.

    Args:
        log: the robot's columns in SI units, with increasing time and finite numbers.
        robot: the arm.
        names: names of the columns in the log, in chain order; () where it names none.
        mapped: whether signs, offsets and order of the columns have a say: not where the log was in DH quantities.
    """
    judge = judge_of(log, robot, mapped=mapped)
    if judge is None:
        return None
    names = names or robot.log_names
    search = _Search(judge, names)
    beyond = tuple(np.flatnonzero(search.judge.beyond).tolist())
    if search.unrivalled():
        return Diagnosis(search.given, (search.given,), (), (), False, beyond)
    search.widen([()])
    for _ in range(2):
        before = search.ranked()[0]
        if before is search.given and search.well:
            break
        search.widen(search.promising())
        if search.ranked()[0] is before:
            break
    ranked = search.ranked()
    best = ranked[0]
    wrong = best is not search.given
    alike = (
        [each for each in ranked[1:] if len(each.edits) <= len(best.edits) and each.alike(best)]
        if wrong
        else []
    )
    same = [each for each in alike if search.same(each, best)]
    others = [each for each in ranked[1:] if each not in same]
    few = (
        [each for each in others if len(each.edits) <= len(best.edits) and each is not search.given]
        if wrong
        else []
    )
    tied = [each for each in few if search.rank(each) < search.rank(best) + tuning.TIED]
    return Diagnosis(search.given, (best, *others[:4]), tuple(same), tuple(tied[:2]), wrong, beyond)


def noise_of(robot: Robot, floor: Floats) -> Floats:
    """Return how well each joint's torque can be known, (n,) [N m or N].

    Args:
        robot: the arm.
        floor: what constant, friction and rotor inertia leave of each joint's torque, (n,) [N m or N].
    """
    turning = np.array([joint.revolute for joint in robot.joints])
    return np.asarray(
        tuning.MODEL_ERROR * np.where(turning, np.max(floor * turning), np.max(floor * ~turning))
    )


def usual_error(robot: Robot, left: Floats) -> Floats:
    """Return what a robot file that fits leaves of a joint of this kind, (n,) [N m or N].

    Sensors behind the gear are wrong by the same at all joints, for they feel what passes sideways; motors by a share
    of their rating. A joint that fits badly shows that, and no mistake of the robot file.
    """
    turning = np.array([joint.revolute for joint in robot.joints])
    rated = [joint.limits.torque for joint in robot.joints]
    scale = np.array([each or 1.0 for each in rated])
    if robot.torque.source in ("joint_sensor", "unknown", "gravity_free") or None in rated:
        scale = np.ones(robot.n)
    found = np.zeros(robot.n)
    for kind in (turning, ~turning):
        if kind.any():
            found[kind] = np.median(left[kind] / scale[kind]) * scale[kind]
    return found


def driver_columns(log: Log, robot: Robot) -> tuple[Log, tuple[str, ...]]:
    """Return a checked log as ``find_mistake`` takes it, before the driver's map, and the names of its columns."""
    names = tuple(log.extra.get("driver_columns", ()))
    if robot.driver is None or "driver_columns" not in log.extra:
        return log, names
    map_ = robot.driver.map
    to_q, to_tau = (
        np.diag(np.asarray(map_.sign, dtype=float)),
        np.diag(np.multiply(map_.sign, map_.torque_signs) * 1.0),
    )
    if robot.coupling is not None:
        matrix = np.array(robot.coupling.matrix)
        to_q, to_tau = to_q @ matrix.T, to_tau @ np.linalg.inv(matrix)
    # Why piece by piece: a log of hours lives in a file.
    q = (log.q - np.array(map_.offset)) @ to_q
    tau = log.tau @ to_tau
    return replace(log, q=q, tau=tau, qd=None), names


def diagnose(log: Log, robot: Robot, *, anyway: bool = False) -> tuple[Finding, ...]:
    """Ask whether the torques of a log have their weight, and whether another robot file explains them far better.

    Args:
        log: a checked log.
        robot: the arm that it was checked for.
        anyway: whether to go on with finding W329 where another robot file does.

    Returns:
        Findings W329 and W334, or none.

    Raises:
        GravityRemoved: the torques do not change with the weight of the arm.
        WrongMapping: names the likeliest mistake, with the edit that repairs the robot file.
    """
    try:
        check_gravity(log, robot)
    except GravityRemoved:
        # Why: torques that seem not to change with the weight may only be mapped wrongly.
        found = _explained(log, robot, anyway=anyway, least_gain=tuning.GAIN_OVER_GRAVITY)
        if not any(finding.code == "W329" for finding in found):
            raise
        return found
    return _explained(log, robot, anyway=anyway)


def _explained(
    log: Log, robot: Robot, *, anyway: bool, least_gain: float = 1.0
) -> tuple[Finding, ...]:
    """Raise, or return W329, where another robot file leaves a share unexplained that is smaller by ``least_gain``.

    W334 where no robot file explains some joints.
    """
    columns, names = driver_columns(log, robot)
    found = find_mistake(columns, robot, names, mapped="driver_columns" in log.extra)
    beyond = () if found is None else _unexplained(found, robot)
    if (
        found is None
        or not found.wrong
        or found.given.unexplained < least_gain * found.best[0].unexplained
    ):
        return beyond
    best = found.best[0]
    what = f"{_improvement(found.given, best, robot)} with {said(best.edits, robot)}"
    if found.same:
        what += f" (the same torques result with {' or '.join(said(e.edits, robot) for e in found.same)})"
    if found.tied:
        what += (
            f" (this log fits as well with {' or '.join(said(e.edits, robot) for e in found.tied)})"
        )
    evidence = {
        "unexplained": found.given.unexplained,
        "hypotheses": [_evidence(each, robot) for each in found.best],
        "same": [_evidence(each, robot) for each in found.same],
        "tied": [_evidence(each, robot) for each in found.tied],
    }
    if anyway:
        return (Finding("W329", "warning", what, evidence), *beyond)
    next_best = [each for each in found.best[1:3] if each.edits and each not in found.tied]
    others = [f"{said(each.edits, robot)} ({100 * each.unexplained:.0f} %)" for each in next_best]
    edits = [pasted(each.edits, robot, bool(names)) for each in (best, *found.same, *found.tied)]
    raise WrongMapping(
        what,
        why="with this robot file, no physically possible arm makes these torques"
        + (f"; next likely: {'; '.join(others)}" if others else "")
        + "".join(f"; {finding.text}" for finding in beyond),
        fix=f"in {robot.editable}: {', or '.join(edits)}; or continue with --anyway",
    )


def _unexplained(found: Diagnosis, robot: Robot) -> tuple[Finding, ...]:
    """Return W334 where no robot file explains the torques of some joints."""
    if not found.beyond:
        return ()
    names = [robot.joint_names[j] for j in found.beyond]
    good = ", ".join(name for name in robot.joint_names if name not in names)
    text = (
        f"no edit of the robot file explains the torques of {', '.join(names)}: their friction would not brake with "
        f"either sign, so these are not all of the torque; the file is judged by {good}"
    )
    return (Finding("W334", "warning", text, {"joints": names}),)


def _improvement(given: Hypothesis, best: Hypothesis, robot: Robot) -> str:
    """Return what the robot file leaves unexplained and what would be left, of all joints or of the one that gains."""
    before, after, whose = given.unexplained, best.unexplained, "the torques"
    if before < 2 * after:
        shares = given.left / given.floor, best.left / best.floor
        j = int(np.argmax(shares[0] / np.maximum(shares[1], 1e-3)))
        before, after, whose = (
            float(shares[0][j]),
            float(shares[1][j]),
            f"the torque of {robot.joint_names[j]}",
        )
    return (
        f"with this robot file, {100 * before:.0f} % of {whose} beyond friction is unexplained; "
        f"it would be {100 * after:.0f} %"
    )


def _evidence(hypothesis: Hypothesis, robot: Robot) -> dict[str, object]:
    edits = [said([edit], robot) for edit in hypothesis.edits]
    return {"edits": edits, "unexplained": hypothesis.unexplained}
