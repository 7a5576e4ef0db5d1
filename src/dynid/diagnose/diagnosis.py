"""Does the robot file describe the arm that made the log? If not: which edits would explain it far better.

Each hypothesis is a robot file with one to three edits: the other DH convention, reversed joints, positions or torques,
another order of the columns, offsets of multiples of 90 degrees, another unit, another direction of gravity. All are
fitted to a few hundred samples and compared by what they leave unexplained. Some edits make the same torques as others,
or as none, whatever the arm does: those are named together, or not at all.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.arrays import Floats
from dynid.diagnose import tuning
from dynid.diagnose.fit import RobotFileFit, robot_file_fit
from dynid.diagnose.gravity import check_gravity
from dynid.diagnose.mistakes import (
    OF_ALL,
    Edit,
    as_robot_file_lines,
    edited,
    edits_of,
    in_words,
    unlikeliness,
    with_edits,
    with_one_more,
)
from dynid.errors import Finding, GravityRemoved, WrongMapping
from dynid.log import Log
from dynid.robot import Robot


@dataclass(frozen=True, eq=False)
class Hypothesis:
    """A robot file with edits, and how well it explains the log.

    Attributes:
        edits: what is changed.
        residual: what bodies that can exist leave of each joint's torque, root mean square, (n,) [N m or N].
        friction_residual: what a constant, friction and rotor inertia alone leave, (n,) [N m or N].
        outside: how many joints move far beyond their limits.
    """

    edits: tuple[Edit, ...]
    residual: Floats
    friction_residual: Floats
    outside: int = 0

    @property
    def unexplained(self) -> float:
        """Share that it leaves of what constant, friction and rotor inertia leave, over all joints."""
        return float(np.linalg.norm(self.residual) / np.linalg.norm(self.friction_residual))

    def misfit(self, noise: Floats) -> float:
        """Return the mean logarithm of the share that it leaves of each joint's torque.

        Args:
            noise: how well each joint's torque can be known, (n,) [N m or N].
        """
        return float(
            np.mean(
                np.log(np.hypot(self.residual, noise) / np.hypot(self.friction_residual, noise))
            )
        )

    def alike(self, other: Hypothesis) -> bool:
        """Return whether both explain the log the same."""
        return np.allclose(self.residual, other.residual, rtol=tuning.SAME_RESIDUAL, atol=1e-9)


@dataclass(frozen=True)
class Diagnosis:
    """What was found out about a robot file and a log.

    Attributes:
        as_written: the robot file as it is.
        best: the best hypothesis.
        tied: further ones that explain this log as well: some make the same torques whatever the arm does.
        wrong: whether the best one is so much better that the file must be wrong.
        without_say: numbers of the joints that no file explains, which have no say.
    """

    as_written: Hypothesis
    best: Hypothesis
    tied: tuple[Hypothesis, ...]
    wrong: bool
    without_say: tuple[int, ...] = ()


class _Search:
    """Tries edits of a robot file on one log, and keeps what was found.

    Args:
        judge: fits robot files.
        names: names of the log's columns in chain order.
    """

    def __init__(self, judge: RobotFileFit, names: Sequence[str]) -> None:
        self.single = tuple(edits_of(judge, names))
        self.depth = 0
        self.price = max(tuning.CLEAR, tuning.FREE_NUMBERS / judge.independent)
        self._begin(judge)
        without_say = self._without_say()
        if any(without_say) and not all(without_say):
            self._begin(replace(judge, without_say=without_say))

    def _begin(self, judge: RobotFileFit) -> None:
        self.judge = judge
        self.bounds: dict[tuple[Edit, ...], Hypothesis] = {}
        self.found: dict[tuple[Edit, ...], Hypothesis] = {}
        self.least_error = np.full(judge.robot.n, np.inf)
        self.as_written = self.fit(())
        #: How well each joint's torque can be known, whatever the robot file is, (n,) [N m or N].
        self.noise = noise_of(judge.robot, self.as_written.friction_residual)
        #: Whether the robot file explains so much that it has no two mistakes that hide each other.
        self.explains_well = self.as_written.misfit(self.noise) < tuning.WELL_EXPLAINED

    def _without_say(self) -> tuple[bool, ...]:
        """Return which joints no robot file explains: whatever their signs are, their friction would not brake.

        No edit of a file but those of a joint's signs changes what its friction has to be.
        """
        judge = self.judge
        # Why not what possible bodies leave alone: huge ones, held by friction that drives, follow any short log.
        ((least, _),) = judge.least_residuals([judge.robot])
        kinds = OF_ALL.values() if judge.mapped else ()

        def drives(j: int) -> bool:
            files = [judge.robot, *(edited(judge.robot, Edit(kind, (float(j),))) for kind in kinds)]
            left = [np.hypot(judge.braking_residuals(file, j), self.noise[j]) for file in files]
            free = max(left[0][0], np.hypot(least[j], self.noise[j]))
            return bool(min(braking for _, braking in left) > tuning.NOT_BRAKING * free)

        suspects = self.as_written.residual > self.as_written.friction_residual
        return tuple(suspect and drives(j) for j, suspect in enumerate(suspects.tolist()))

    def fit(self, edits: tuple[Edit, ...]) -> Hypothesis:
        """Return a hypothesis fitted with bodies that can exist."""
        if edits not in self.found:
            robot = with_edits(self.judge.robot, edits)
            hypothesis = Hypothesis(
                edits, *self.judge.possible_residuals(robot), self.judge.outside(robot)
            )
            error = usual_error(self.judge.robot, hypothesis.residual)
            self.least_error = np.minimum(self.least_error, error)
            self.found[edits] = hypothesis
        return self.found[edits]

    def search_rank(self, hypothesis: Hypothesis) -> float:
        """Return what hypotheses are taken further by, lower is better: as ``rank``, but small errors count as well."""
        return hypothesis.misfit(self.noise) + self._cost(hypothesis)

    def rank(self, hypothesis: Hypothesis) -> float:
        """Return what hypotheses are ordered by in the end, lower is better: fit, likelihood and number of edits."""
        noise = np.asarray(np.hypot(self.noise, self.least_error))
        return hypothesis.misfit(noise) + self._cost(hypothesis)

    def _cost(self, hypothesis: Hypothesis) -> float:
        """Return what has to be gained by a hypothesis before it is the best, whatever it explains."""
        unlikely = sum(map(unlikeliness, hypothesis.edits))
        unlikely += tuning.OUT_OF_RANGE * min(hypothesis.outside, tuning.MOST_OUTSIDE)
        return tuning.CLEAR * unlikely + self.price * len(hypothesis.edits)

    def ranked(self) -> list[Hypothesis]:
        """Return what was fitted, the best first."""
        return sorted(self.found.values(), key=self.rank)

    def next_starts(self) -> list[tuple[Edit, ...]]:
        """Return edits that may become the best with one more, the most promising first.

        Two mistakes can hide each other: where little is explained, many are taken further by what they leave at least.
        """
        lost = not self.explains_well and self.depth == 1
        values = sorted((self.bounds if lost else self.found).values(), key=self.search_rank)
        most = self.search_rank(values[0]) + tuning.NEAR_BEST
        places = values[: tuning.BEAM_LOST if lost else tuning.BEAM]
        return [each.edits for each in places if self.search_rank(each) < most]

    def more(self, starts: Iterable[tuple[Edit, ...]]) -> list[tuple[Edit, ...]]:
        """Return what has one edit more than a start and is not fitted yet, with what it leaves at least found out."""
        tried = (with_one_more(start, edit) for start in starts for edit in self.single)
        # Why no set: equally good ones are tried in the same order in every run.
        more = [edits for edits in dict.fromkeys(tried) if edits and edits not in self.found]
        new = [edits for edits in more if edits not in self.bounds]
        # Why together: their columns are much the same.
        files = [with_edits(self.judge.robot, edits) for edits in new]
        for edits, file, least in zip(new, files, self.judge.least_residuals(files), strict=True):
            self.bounds[edits] = Hypothesis(edits, *least, self.judge.outside(file))
        return more

    def widen(self, starts: Iterable[tuple[Edit, ...]]) -> None:
        """Add one edit to each start, and fit those that can be among the best."""
        self.depth += 1
        # Why: a file that explains so much is taken no further, and only what may beat it is asked for.
        most = self.search_rank(self.as_written) if self.explains_well else np.inf
        for least, edits in sorted(
            (self.search_rank(self.bounds[x]), x) for x in self.more(starts)
        ):
            ranks = sorted(map(self.search_rank, self.found.values()))
            if least > min([most, *ranks[tuning.BEAM - 1 :]]):
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
    judge = robot_file_fit(log, robot, mapped=mapped)
    if judge is None:
        return None
    search = _Search(judge, names or robot.log_names)
    as_written = search.as_written
    search.widen([()])
    for _ in range(2):
        before = search.ranked()[0]
        if before is as_written and search.explains_well:
            break
        search.widen(search.next_starts())
        if search.ranked()[0] is before:
            break
    best, *others = search.ranked()
    most = search.rank(best) + tuning.TIED
    near = (each for each in others if each.edits and len(each.edits) <= len(best.edits))
    tied = tuple(each for each in near if each.alike(best) or search.rank(each) < most)
    return Diagnosis(
        as_written=as_written,
        best=best,
        tied=tied[: tuning.MOST_TIED],
        wrong=best is not as_written,
        without_say=tuple(np.flatnonzero(search.judge.without_say).tolist()),
    )


def noise_of(robot: Robot, floor: Floats) -> Floats:
    """Return how well each joint's torque can be known, (n,) [N m or N].

    Args:
        robot: the arm.
        floor: what constant, friction and rotor inertia leave of each joint's torque, (n,) [N m or N].
    """
    turning = robot.turning
    return np.asarray(
        tuning.MODEL_ERROR * np.where(turning, np.max(floor * turning), np.max(floor * ~turning))
    )


def usual_error(robot: Robot, left: Floats) -> Floats:
    """Return what a robot file that fits leaves of a joint of this kind, (n,) [N m or N].

    Sensors behind the gear are wrong by the same at all joints, for they feel what passes sideways; motors by a share
    of their rating. A joint that fits badly shows that, and no mistake of the robot file.
    """
    turning = robot.turning
    rated = [joint.limits.torque for joint in robot.joints]
    behind_gear = robot.torque.source in ("joint_sensor", "unknown", "gravity_free")
    scale = np.array(rated) if all(rated) and not behind_gear else np.ones(robot.n)
    error = np.zeros(robot.n)
    for kind in (turning, ~turning):
        if kind.any():
            error[kind] = np.median(left[kind] / scale[kind]) * scale[kind]
    return error


def driver_columns(log: Log, robot: Robot) -> tuple[Log, tuple[str, ...]]:
    """Return a checked log as ``find_mistake`` takes it, before the driver's map, and the names of its columns."""
    if "driver_columns" not in log.extra:
        return log, ()
    map_, matrix = robot.columns.map, np.eye(robot.n)
    if robot.coupling is not None:
        matrix = np.array(robot.coupling.matrix)
    q = ((log.q - np.array(map_.offset)) * map_.sign) @ matrix.T
    tau = (log.tau * np.multiply(map_.sign, map_.torque_signs)) @ np.linalg.inv(matrix)
    return replace(log, q=q, tau=tau, qd=None), tuple(log.extra["driver_columns"])


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
    # Why: where a joint has no torque, any other order of the columns fits as well, and its weight is not seen.
    if np.any(np.all(log.extra.get("clipped", False), axis=0)):
        return ()
    try:
        check_gravity(log, robot)
    except GravityRemoved:
        # Why: torques that seem not to change with the weight may only be mapped wrongly.
        findings = _explained(log, robot, anyway=anyway, least_gain=tuning.GAIN_OVER_GRAVITY)
        if "W329" not in [finding.code for finding in findings]:
            raise
        return findings
    return _explained(log, robot, anyway=anyway)


def _explained(
    log: Log, robot: Robot, *, anyway: bool, least_gain: float = 1.0
) -> tuple[Finding, ...]:
    """Raise, or return W329, where another robot file leaves a share unexplained that is smaller by ``least_gain``.

    W334 where no robot file explains some joints.
    """
    columns, names = driver_columns(log, robot)
    diagnosis = find_mistake(columns, robot, names, mapped="driver_columns" in log.extra)
    if diagnosis is None:
        return ()
    unexplained = _unexplained(diagnosis, robot)
    written, best = diagnosis.as_written, diagnosis.best
    if not diagnosis.wrong or written.unexplained < least_gain * best.unexplained:
        return unexplained
    j = int(np.argmax(written.residual / best.residual))
    what = (
        f"with this robot file, {written.residual[j]:.2g} {robot.joints[j].torque_unit} of the torque "
        f"of {robot.joint_names[j]} is not explained; it would be {best.residual[j]:.2g} with "
        f"{in_words(best.edits, robot)}"
    )
    if diagnosis.tied:
        tied = " or ".join(in_words(each.edits, robot) for each in diagnosis.tied)
        what += f" (this log fits as well with {tied})"
    named = (best, *diagnosis.tied)
    if anyway:
        evidence = {"unexplained": diagnosis.as_written.unexplained}
        return (Finding("W329", "warning", what, evidence), *unexplained)
    edits = [as_robot_file_lines(each.edits, robot, bool(names)) for each in named]
    fix = f"in {robot.editable}: {', or '.join(edits)}"
    if best.unexplained > tuning.HARDLY_EXPLAINED:
        what += ", which explains little"
        fix = "compare lengths, units and the order of the torque columns with the arm"
    raise WrongMapping(
        what,
        why="with this robot file, no physically consistent parameters make these torques"
        + "".join(f"; {finding.text}" for finding in unexplained),
        fix=f"{fix}; or continue with --anyway",
    )


def _unexplained(diagnosis: Diagnosis, robot: Robot) -> tuple[Finding, ...]:
    """Return W334 where no robot file explains the torques of some joints."""
    if not diagnosis.without_say:
        return ()
    names = [robot.joint_names[j] for j in diagnosis.without_say]
    good = ", ".join(name for name in robot.joint_names if name not in names)
    text = (
        f"no edit of the robot file explains the torques of {', '.join(names)}: their friction would not brake with "
        f"either sign, so these are not all of the torque; the file is checked with {good}"
    )
    return (Finding("W334", "warning", text, {"joints": names}),)
