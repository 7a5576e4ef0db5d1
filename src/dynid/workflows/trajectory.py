"""Plan an excitation motion that is optimal, safe, and seen before it runs (Paper Eqs. 14-19)."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from dynid.answer import Answer, Answered, Facts, picked
from dynid.arguments import instance, public
from dynid.arrays import Floats
from dynid.disk import sha256
from dynid.errors import Finding, PlanTeachesLittle, WrongUsage
from dynid.estimation.posterior import information_of as known_of
from dynid.estimation.posterior import prior_information, sample_noise
from dynid.estimation.result import Identification
from dynid.files.artifact import reading
from dynid.files.gapfile import read_record
from dynid.files.planfile import Waypoints, read_plan, read_waypoints
from dynid.files.robotfile import robot_text
from dynid.files.trajectoryfile import (
    StoredTrajectory,
    read_trajectory,
    write_csv,
    write_joint_trajectory,
    write_trajectory,
)
from dynid.gap.verdict import joints_text
from dynid.judgement.gap import GapRecord
from dynid.judgement.rules import Step
from dynid.loading import ResultLike, RobotLike, as_result, as_robot, load_run, parameters_of
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import CATALOGUE
from dynid.motion import Motion
from dynid.options import MOST
from dynid.progress import Progress, stage
from dynid.reports.motion_drawing import draw_motion
from dynid.robot import Robot
from dynid.table import Table
from dynid.text import shell
from dynid.trajectory.basis import basis_from
from dynid.trajectory.feasible import assumed_limits, unsafe_to_play
from dynid.trajectory.limits import LimitCheck, require_within_limits
from dynid.trajectory.optimise import optimise
from dynid.trajectory.options import IN_PLAN_FILE, PlanOptions
from dynid.trajectory.plan import Trajectory, through_waypoints
from dynid.trajectory.planning import (
    Clearance,
    PlanningContext,
    Proposal,
    first_accepted,
    plan_problem,
    planning_context,
    proposals,
    require_clear_motion,
    require_safe,
    search_time,
    thickness,
)
from dynid.trajectory.predict import (
    AlphaRow,
    Prediction,
    alpha_table,
    default_noise,
    predict,
)
from dynid.trajectory.preview import Drawing, window
from dynid.trajectory.scene import Box
from dynid.trajectory.separation import GapQuestion, Rivalry, run_of, separate, separation
from dynid.workflows.model import base_model
from dynid.workflows.parameters import torque_unit

#: PyBullet measures no distance beyond this [m].
FAR = 0.3
#: How many of the closest pairs the JSON answer lists.
CLOSEST = 5


@dataclass(frozen=True)
class SafeMotion:
    """A motion that keeps all limits and stays clear of everything.

    Attributes:
        context: the arm, the limits and the surroundings that it was judged with.
        trajectory: the motion as coefficients of its family, at its speed factor.
        clearance: how far it stays away from the arm itself, the floor and obstacles.
        urdf: shapes of the arm that distances were measured with; None for cylinders along the DH table.
    """

    context: PlanningContext
    trajectory: Trajectory
    clearance: Clearance
    urdf: Path | None

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.context.robot

    @property
    def scene_facts(self) -> Facts:
        """In which surroundings it was judged, and with which shapes of the arm; for ``dynid record``."""
        urdf = None if self.urdf is None else str(self.urdf.resolve())
        return {**self.context.options.scene.facts, "urdf": urdf}

    def in_window(self) -> AbstractContextManager[None]:
        """Show it in PyBullet's window for the length of a ``with`` block.

        Raises:
            NoDisplay: there is no display.
        """
        return window(self.trajectory, self.context.capsules, self.urdf)


@dataclass(frozen=True, repr=False)
class Plan(Answered, SafeMotion):
    """A motion that keeps all limits and stays clear of everything, with what it will teach.

    Attributes:
        motion: its samples at ``PlanOptions.rate``.
        check: what the motion uses of the limits.
        prediction: expected standard errors and torque error of a log of it.
        alphas: what each speed factor costs.
        noise_from: where the noise of the torques comes from, in words.
        search: how the motion was found, as the JSON answer says it; None when a person gave the path.
        outlook: how much better a second gap search will be, in words.
        unexplained: rms torque that an earlier result leaves whatever the parameters [N m or N]; None without one.
    """

    motion: Motion
    check: LimitCheck
    prediction: Prediction
    alphas: tuple[AlphaRow, ...]
    noise_from: str
    search: Facts | None
    outlook: tuple[str, ...]
    unexplained: float | None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is worth a warning."""
        assumed, findings = assumed_limits(self.robot), [*self.clearance.findings]
        if unsafe_to_play(assumed):
            text = f"the robot file has no limits for {'; '.join(assumed)} is assumed"
            text += "; dynid record refuses assumed rates"
            findings.append(Finding("W606", "warning", text, {"assumed": assumed}))
        if text := self.too_little:
            error = {"expected_torque_error_nm": self.at_full_speed.torque_error}
            findings.append(Finding("W608", "warning", text, error))
        return tuple(findings)

    @property
    def too_little(self) -> str:
        """Why a log of it would predict other motions worse than one sample measures; empty where it would not."""
        error, noise = self.at_full_speed.torque_error, self.noise_rms
        if error <= noise:
            return ""
        text = f"expected torque error on other motions {error:.2g} {torque_unit(self.robot)} even at full speed"
        return f"{text}, more than the noise of one sample ({noise:.2g}); weakest: {self.weakest}"

    @property
    def weakest(self) -> str:
        """The base parameter whose error costs the most torque on other motions."""
        costs = self.prediction.std_error * np.sqrt(np.diag(self.context.other))
        return self.context.base.names[int(np.argmax(costs))]

    @property
    def noise_rms(self) -> float:
        """The noise of one sample, rms of all joints [N m or N]."""
        return float(np.sqrt(np.mean(self.context.noise**2)))

    @property
    def at_full_speed(self) -> AlphaRow:
        """What the motion costs and teaches at full speed."""
        return next(row for row in self.alphas if row.alpha == 1.0)

    def facts(self) -> Facts:
        """Return what the JSON answer of ``dynid trajectory`` says."""
        figures, distances = self.prediction.figures, self.clearance.distances
        return {
            "robot": self.robot.name,
            **picked(self.trajectory, "alpha", duration_s="duration"),
            **picked(figures, condition_number="condition", smallest_singular_value="smallest"),
            "condition_number_scaled": figures.condition_scaled,
            "peak": [
                picked(
                    each,
                    "joint",
                    position_rad="position",
                    velocity_rad_s="velocity",
                    acceleration_rad_s2="acceleration",
                    torque_nm="torque",
                    limit_share="share",
                )
                for each in self.check.peaks
            ],
            "tool_speed_m_s": self.check.tool_speed,
            "collisions": [],
            "closest_m": min((each.distance for each in distances), default=None),
            "closest": [
                picked(each, "pair", distance_m="distance", time_s="time")
                for each in distances[:CLOSEST]
            ],
            "left_out_pairs": self.clearance.left_out,
            "assumed_limits": assumed_limits(self.robot),
            "predicted_std_error": dict(
                zip(self.context.base.names, self.prediction.std_error.tolist(), strict=True)
            ),
            "expected_torque_error_nm": self.prediction.torque_error,
            "ladder": [asdict(row) for row in self.alphas],
            "torque_noise_nm": self.context.noise,
            **picked(self, "weakest", "search", torque_noise_from="noise_from"),
            **picked(self, unexplained_torque_nm="unexplained"),
            "outlook": list(self.outlook),
        }

    def save(
        self,
        path: Path | str,
        inputs: Mapping[str, str] | None = None,
        *,
        seen: bool | None = None,
    ) -> list[Path]:
        """Write trajectory.npz, and the same motion as CSV and for ROS beside it.

        For ROS: a JointTrajectory as ROS 1 and as ROS 2 spell it, and the goal of a FollowJointTrajectory of ROS 2.

        Args:
            path: the .npz file.
            inputs: what the plan was made from, for the header.
            seen: whether the person at this machine, who accepts the motion, has seen it; None where nobody accepts it.
        """
        path, answer = Path(path), self.facts()
        endings = (".csv", ".yaml", "_ros2.yaml", "_ros2_goal.yaml")
        table, *for_ros = (path.with_name(f"{path.stem}{ending}") for ending in endings)
        write_csv(table, self.robot.joint_names, self.motion)
        for file, ros, goal in zip(for_ros, (1, 2, 2), (False, False, True), strict=True):
            write_joint_trajectory(file, self.robot, self.motion, ros=ros, goal=goal)
        stored = StoredTrajectory(
            robot=self.robot.name,
            joints=self.robot.joint_names,
            motion=self.motion,
            alpha=self.trajectory.alpha,
            basis=self.trajectory.basis.facts,
            coefficients=self.trajectory.coefficients,
            facts={
                "answer": answer,
                "inputs": dict(inputs or {}),
                **picked(self.context.options, "seed", rate_hz="rate"),
                "scene": self.scene_facts,
                "assumed_limits": answer["assumed_limits"],
            },
        )
        write_trajectory(path, stored if seen is None else stored.accepted(seen=seen))
        return [path, table, *for_ros]

    def table(self) -> Table:
        """Return the largest values of each joint, and the share of the nearest limit that they use."""
        return Table(
            [
                picked(peak, "joint", "position", "velocity", "acceleration", "torque")
                | {"unit": "rad, s, N m" if joint.revolute else "m, s, N", "share": peak.share}
                for peak, joint in zip(self.check.peaks, self.robot.joints, strict=True)
            ]
        )

    def answer(self) -> Answer:
        """Return what ``dynid trajectory`` answers."""
        facts = self.facts()
        said = plan_sentence(self.robot, facts)
        return Answer(facts, said, (*self.findings, self.table()), notes=self.lines())

    def lines(self) -> list[tuple[str, str]]:
        """Return the lines of the summary, each as a label and a sentence."""
        run, figures, full = self.trajectory, self.prediction.figures, self.at_full_speed
        basis = run.basis.facts
        kind = f"{len(basis['knots']) - 1} {basis['kind']} segments, {run.basis.duration:.1f} s at full speed"
        slow = f"{run.duration:.1f} s at alpha {run.alpha:g} (speed x{run.alpha:g}, acceleration x{run.alpha**2:.2g})"
        most = max(peak.share for peak in self.check.peaks)
        used = f"all inside, at most {100 * most:.0f} % of them less their margin"
        lines = [
            ("plan", f"{kind}; {slow}"),
            ("limits", f"{used}; tool up to {self.check.tool_speed:.2f} m/s"),
        ]
        if self.search is not None:
            text = "{finished_starts} starts finished (end: {ended}); seed {seed}".format(
                **self.search
            )
            lines.append(("search", text))
        for near in self.clearance.distances[:1]:
            size = f"{'at least ' * (near.distance >= FAR)}{1000 * near.distance:.0f} mm"
            lines.append(
                ("collision", f"none; nearest {near.pair} at {size}, t = {near.time:.1f} s")
            )
        if self.clearance.left_out and self.urdf is None:
            pairs = f"{', '.join(self.clearance.left_out)}; {thickness(self.robot)}"
            lines += [("left out", f"always close to each other, so not checked: {pairs}")]
        scaled = f"columns of equal length: {figures.condition_scaled:.3g}"
        noise = f"{self.noise_rms:.2g} {torque_unit(self.robot)} rms per sample"
        lines += [
            (
                "excitation",
                f"condition number {figures.condition:.3g} ({scaled}); weakest: {self.weakest}",
            ),
            *(("gap", text) for text in self.outlook),
            ("noise", f"{noise}, {self.noise_from}"),
        ]
        if run.alpha < 1:
            # So that nobody identifies from a first, slow run by mistake.
            times = self.prediction.torque_error / full.torque_error
            slower = f"at full speed {full.duration:.0f} s, and an expected torque error"
            lines.append(("alpha", f"{slower} {times:.3g} times smaller"))
        return [*lines, *(("preview", str(picture)) for picture in self.clearance.pictures)]


def plan_sentence(robot: Robot, facts: Mapping[str, Any]) -> str:
    """Return what a motion is worth, in one sentence.

    Args:
        robot: the arm.
        facts: of the motion, as ``Plan.facts`` says them.
    """
    error = f"{facts['expected_torque_error_nm']:.2g} {torque_unit(robot)}"
    return (
        f"This motion of {facts['duration_s']:.1f} s keeps all limits of {robot.name}. "
        f"With a recording of it the model should predict other motions to {error}."
    )


# ---------------------------------------------------------------- what is known before
def _torque_noise(
    robot: Robot, given: Sequence[float] | None, results: Sequence[Identification], rate: float
) -> tuple[Floats, str]:
    """Return each joint's torque noise, (n,) [N m or N], from the first source that there is, and that in words.

    White noise at the rate of the coming log [Hz] is meant: of an identification, that which tells as little as its
    coloured residuals.
    """
    if given is not None:
        if len(given) not in (1, robot.n):
            shown = ",".join(f"{sigma:g}" for sigma in given)
            what = f"--noise '{shown}' must be one positive number, or {robot.n} of them"
            raise WrongUsage(what, fix="such as --noise 0.1")
        return np.broadcast_to(np.array(given), (robot.n,)).copy(), "given with --noise"
    if results:
        return sample_noise(results[0], rate), "as an earlier identification found it"
    assumed = "assumed (0.3 % of the rating, 0.1 N m without one)"
    return default_noise(robot), assumed if robot.torque.noise is None else "from the robot file"


def _information(
    base: BaseModel, results: Sequence[Identification]
) -> tuple[Floats | None, Floats]:
    """Return the information about the base parameters of earlier results, and with the prior of possible bodies.

    The posterior of a physical set holds the prior already.

    Returns:
        Both as matrices, (p, p); the first is None without any result.
    """
    for result in results:
        base.robot.require_joints(result.robot.joint_names, result.label)
        if tuple(result.names) != base.names:
            what = f"{result.path} has other base parameters than the motion is planned with"
            fix = "identify again with this robot file, without `effects:`, or leave out --earlier"
            raise WrongUsage(what, fix=fix)
        stage("earlier", f"{result.path}: the new motion is planned to complete it")
    known = [known_of(result)[0] for result in results]
    held = any(result.in_force == "physical" for result in results)
    prior = [] if held else [prior_information(base)]
    return np.sum(known, axis=0) if known else None, np.sum([*known, *prior], axis=0)


# ---------------------------------------------------------------- what is asked
def _waypoints_of(given: Waypoints | ArrayLike | str | Path, robot: Robot) -> Waypoints:
    """Return waypoints given by themselves, as rows, or by the path of a CSV file."""
    if isinstance(given, Waypoints):
        return given
    if isinstance(given, (str, Path)):
        return read_waypoints(Path(given), robot)
    try:
        points = np.asarray(given, dtype=float)
    except (TypeError, ValueError):
        points = np.empty(0)
    if points.shape[1:] != (robot.n,) or len(points) < 2 or not np.all(np.abs(points) <= MOST):
        raise WrongUsage(f"waypoints must be at least 2 rows of {robot.n} numbers")
    return Waypoints(points)


def with_plan_file(
    plan: Path | None, robot: Robot, options: PlanOptions
) -> tuple[Waypoints | None, PlanOptions]:
    """Return the waypoints of a plan file, if there are any, and options with its surroundings."""
    if plan is None:
        return None, options
    written, workspace = read_plan(plan, robot, IN_PLAN_FILE), options.workspace
    if written.workspace is not None:
        workspace = workspace or Box(*written.workspace)
    obstacles = (*(Box(*corners) for corners in written.obstacles), *options.obstacles)
    return written.waypoints, replace(options, obstacles=obstacles, workspace=workspace)


@public
def plan_trajectory(
    robot: RobotLike,
    options: PlanOptions = PlanOptions(),
    *,
    waypoints: Waypoints | ArrayLike | str | Path | None = None,
    earlier: Sequence[ResultLike] = (),
    urdf: str | Path | None = None,
    base: BaseModel | None = None,
    drawing: Drawing | None = None,
    for_gap: GapRecord | str | Path | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> Plan:
    """Plan a motion that keeps all limits and stays clear, and predict what a log of it will tell.

    Args:
        robot: the arm, its name, or the path of its file.
        options: what is wanted.
        waypoints: points that the motion goes through instead of a search, (K, n) [rad or m].
        earlier: results whose information the motion completes.
        urdf: the arm's own shapes; cylinders along the DH table when None.
        base: the arm's base model, where it is there already.
        drawing: pictures that PyBullet must draw; without it PyBullet is used where it is installed.
        for_gap: a gap search; the motion answers what it left open.
        progress: reports how far the search is.
        changes: single options by name, such as ``duration=10.0``; see ``dynid.PlanOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).
        LimitBroken: no motion keeps all limits (E501).
        Collision: something comes too near (E502).
        PlanTeachesLittle: what the search found excites too little (E511).

    Example:
        dynid.plan_trajectory("kuka_lwr4plus", duration=20.0, seconds=30.0)
    """
    robot, begin = as_robot(robot), time.monotonic()
    through = None if waypoints is None else _waypoints_of(waypoints, robot)
    urdf = None if urdf is None else Path(urdf)
    drawing = drawing or Drawing()
    if isinstance(for_gap, (str, Path)):
        for_gap = read_record(Path(for_gap))
    base = _without_effects(base or base_model(robot))
    robot.require_joints(base.robot.joint_names, "base")
    results = [as_result(each, "earlier") for each in earlier]
    noise, source = _torque_noise(robot, options.noise, results, options.rate)
    context = planning_context(base, options, noise, *_information(base, results))
    question = None
    if for_gap is not None:
        wanted = "a gap search: its gap.npz, or what dynid.find_gap returns"
        record = instance(for_gap, GapRecord, "for_gap", wanted)
        question = question_of(record, base, context.theta)
    outcome, until, search = None, begin + options.seconds, None
    stage("plan" if through else "search")
    if through is not None:
        path, until = through_waypoints(through.q, context.limits, through.times), np.inf
        candidates: Iterable[Proposal] = [Proposal(path.slowed(options.alpha))]
    else:
        limit = search_time(until - time.monotonic())
        if question is not None:
            outcome = separate(plan_problem(context), base, question, options, limit)
        elif options.optimise:
            outcome = optimise(plan_problem(context), options, limit)
        candidates = proposals(context, outcome)
    stage("clearance")

    def safe(motion: Trajectory) -> tuple[LimitCheck, Clearance]:
        check, given = require_safe(context, motion), through is not None
        return check, require_clear_motion(context, motion, urdf, drawing, draw_motion, given=given)

    chosen, (check, clearance) = first_accepted(candidates, safe, until)
    stage("predict")
    if through is None:
        ended, finished = (outcome.ended, outcome.finished) if outcome else ("no search", 0)
        search = {
            "seed": options.seed,
            "ended": ended,
            "finished_starts": finished,
            "share": chosen.share,
        }
    expected = [float(np.sqrt(np.mean(each.expected.noise**2))) for each in results[:1]]
    motion = chosen.trajectory.sampled(options.rate)
    samples = len(chosen.trajectory.slowed(1.0).sampled(options.rate))
    other, known = context.other, context.believed
    plan = Plan(
        context=context,
        trajectory=chosen.trajectory,
        clearance=clearance,
        urdf=urdf,
        motion=motion,
        check=check,
        prediction=predict(context.base, motion, noise, other, known),
        alphas=alpha_table(chosen.trajectory, context.base, noise, other, samples, known),
        noise_from=source,
        search=search,
        unexplained=expected[0] if expected else None,
        outlook=tuple(outlook(base, question, chosen.trajectory)) if question else (),
    )
    if outcome is not None and question is None and not results and plan.too_little:
        raise PlanTeachesLittle(plan.too_little)
    return plan


def _without_effects(base: BaseModel) -> BaseModel:
    """Return the base model that motions are planned with: without the effects of the robot file.

    Why: some effects follow the whole motion, and none has a slope that a search could go down.
    """
    if not base.robot.effects:
        return base
    stage("effects", "the motion is planned without those of the robot file")
    return base_model(replace(base.robot, effects=()))


# ---------------------------------------------------------------- motions planned before
@dataclass(frozen=True)
class Reviewed(SafeMotion):
    """A motion that was planned before and passed the checks once more.

    Attributes:
        stored: what its file holds.
    """

    stored: StoredTrajectory

    def accept(self, *, seen: bool) -> None:
        """Write its file with the mark of the person at this machine, who has seen it in these surroundings."""
        accepted = self.stored.accepted(seen=seen, scene=self.scene_facts)
        assert accepted.source is not None
        write_trajectory(accepted.source, accepted)


def review_trajectory(
    robot: Robot,
    path: Path,
    options: PlanOptions = PlanOptions(),
    *,
    urdf: Path | None = None,
    base: BaseModel,
    drawing: Drawing,
) -> Reviewed:
    """Judge a motion that was planned before by the robot file as it is today.

    Args:
        robot: the arm.
        path: trajectory.npz.
        options: margin, tool speed and surroundings; what concerns planning does not count.
        urdf: the arm's own shapes; cylinders along the DH table when None.
        base: the arm's base model.
        drawing: pictures that PyBullet must draw.

    Raises:
        LimitBroken: it breaks a limit (E501).
        Collision: something comes too near (E502).
    """
    stored = read_trajectory(path, robot)
    with reading(path):
        basis, count = basis_from(dict(stored.basis)), len(stored.coefficients)
        if count != basis.size:
            raise ValueError(f"it has {count} coefficients of each joint, expected {basis.size}")
    trajectory = Trajectory(basis, stored.coefficients, stored.alpha)
    context = planning_context(_without_effects(base), options)
    require_within_limits(context.check(trajectory), options.margin)
    clearance = require_clear_motion(context, trajectory, urdf, drawing, draw_motion)
    return Reviewed(context, trajectory, clearance, urdf, stored)


def stored_answer(robot: Robot, path: Path) -> Answer:
    """Return the answer of a motion that is there already, and what to do with it."""
    stored = read_trajectory(path, robot)
    facts = stored.facts.get("answer", {})
    return Answer(
        {**facts, "reviewed": stored.reviewed},
        plan_sentence(robot, facts) if facts else "",
        next=[next_step(robot, path, reviewed=stored.reviewed)],
    )


def next_step(robot: Robot, path: Path, *, reviewed: bool) -> Step:
    """Return what to do with a motion: record it, or look at it before."""
    if reviewed:
        command = f"dynid record {robot.word} {shell(path)}"
        return Step("Record it. This moves the arm and asks first.", command)
    why = "Look at it and accept it: an arm plays no motion that nobody has seen."
    return Step(why, f"dynid trajectory {robot.word} {shell('--review', path)}")


def plan_inputs(
    robot: Robot, options: PlanOptions, files: Mapping[str, Path | None]
) -> dict[str, str]:
    """Return what a plan depends on, for its header.

    Args:
        robot: the arm.
        options: what is wanted.
        files: further files by what they are; None for one that is not given.
    """
    return {
        "robot": robot.model_key,
        "robot file": hashlib.sha256(robot_text(robot).encode()).hexdigest(),
        # Why not the folder of a result: the plan is written into it.
        **{name: sha256(parameters_of(path)) for name, path in files.items() if path is not None},
        **options.texts(),
    }


#: Lead in evidence from which one explanation is better beyond doubt, and how many times as much a plan should promise.
CLEAR, SAFETY = 12.0, 3.0


def question_of(record: GapRecord, base: BaseModel, theta: Floats) -> GapQuestion | None:
    """Return what a gap search left open; None where nothing explains a residual, which any exciting motion shows.

    Args:
        record: the search.
        base: model and base parameters of the arm.
        theta: base parameters by the prior, where the searched result is not at hand, (p,).

    Raises:
        WrongUsage: it was another arm, or nothing is open.
    """
    if record.joint_names != base.robot.joint_names:
        what = f"the search was made for {record.robot}, whose joints differ from those of {base.robot.name}"
        raise WrongUsage(f"--for-gap: {what}", fix="give the robot file that was searched")
    rivalries = tuple(_rivalries(record))
    if not rivalries and record.verdict == "unexplained":
        stage(
            "gap",
            "no two explanations are left to separate: the motion is planned as without a gap search",
        )
        return None
    if not rivalries:
        verdict = record.verdict.replace("_", " ")
        raise WrongUsage(
            "--for-gap: the search left no question that a motion could answer",
            why=f"its verdict is {verdict}, and no two explanations fitted equally well",
            fix="plan without --for-gap; to test the model on a new log: dynid validate",
        )
    if record.made_from and Path(record.made_from).is_file():
        result = load_run(Path(record.made_from))
        if tuple(result.names) == base.names:
            theta = result.theta
    return GapQuestion(rivalries, np.asarray(record.improvement.floor), theta)


def _rivalries(record: GapRecord) -> Iterator[Rivalry]:
    """Yield each named effect beside each of its rivals."""
    for one in record.named:
        effect = CATALOGUE[one.effect]
        shape = {name: one.values[name] for name in effect.shape_units}
        for rival, joints in one.rival_keys:
            where = joints_text(joints, record.joint_names)
            yield Rivalry(
                effect=effect,
                joints=one.indices,
                shape=shape,
                amplitudes=np.array([one.values[name] for name in effect.amplitudes(shape)]),
                rival=CATALOGUE[rival],
                rival_joints=joints,
                text=f"{one.effect} on {one.where} and {rival} on {where}",
            )


def outlook(base: BaseModel, question: GapQuestion, trajectory: Trajectory) -> Iterator[str]:
    """Yield what the next search will tell with a log of a motion, a sentence for each open question."""
    leads = separation(base, question, run_of(trajectory))
    for pair, lead in zip(question.rivalries, leads, strict=True):
        sure = "will be separated" if lead > SAFETY * CLEAR else "may still fit equally well"
        yield f"{pair.text} {sure}: expected lead {lead:.2g}; {CLEAR:g} is clear"
