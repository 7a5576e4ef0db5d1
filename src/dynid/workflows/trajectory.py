"""Plan an excitation motion that is optimal, safe, and seen before it runs (Paper Eqs. 14-19)."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid import arguments
from dynid.arguments import public
from dynid.disk import sha256
from dynid.errors import PlanTeachesLittle, WrongUsage
from dynid.estimation.least_squares import weighted
from dynid.estimation.posterior import parameter_posterior, prior_information
from dynid.estimation.result import Identification
from dynid.estimation.stack import stack_logs
from dynid.files.artifact import read_header, reading
from dynid.files.planfile import Waypoints, read_waypoints
from dynid.files.trajectoryfile import StoredTrajectory, read_trajectory
from dynid.gap.record import GapRecord, read_record
from dynid.loading import (
    RobotLike,
    as_robot,
    checked_log,
    condition_logs,
    load_run,
    parameters_of,
    read_log,
)
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.options import LogOptions
from dynid.progress import Progress, stage
from dynid.reports.motion_drawing import draw_motion
from dynid.robot import Robot
from dynid.trajectory.basis import basis_from
from dynid.trajectory.limits import require_within_limits
from dynid.trajectory.optimise import optimise
from dynid.trajectory.options import PlanOptions
from dynid.trajectory.plan import Trajectory, through_waypoints
from dynid.trajectory.planning import (
    Clearance,
    PlanningContext,
    Proposal,
    first_accepted,
    once_more,
    plan_problem,
    planning_context,
    proposals,
    require_clear_motion,
    require_safe,
    search_time,
)
from dynid.trajectory.predict import alpha_table, default_noise, information_of, predict
from dynid.trajectory.preview import Drawing, window
from dynid.workflows.gap_experiment import GapExperiment
from dynid.workflows.model import base_model
from dynid.workflows.plan import Plan, SearchRecord, scene_facts

Floats = NDArray[np.float64]
#: A recording, what was identified from recordings, or a motion that was planned and not yet recorded.
Earlier = Log | Identification | StoredTrajectory
EarlierLike: TypeAlias = Earlier | Plan | str | Path

#: A motion shorter than this at full speed is named as too short when it teaches little [s].
SHORT = 10.0


# ---------------------------------------------------------------- what is known before
def _read_earlier(path: Path, robot: Robot) -> Earlier:
    """Return what a file holds: parameters.npz, trajectory.npz, or else a log."""
    # Why: a recording of rosbag2 is a folder as well.
    path = parameters_of(path) if parameters_of(path).is_file() else path
    header = read_header(path) if path.suffix == ".npz" else None
    kind = str((header or {}).get("schema", "")).rpartition("/")[0]
    if kind == "dynid/identification":
        return load_run(path)
    return read_trajectory(path, robot) if kind == "dynid/trajectory" else read_log(path, robot)


def _torque_noise(
    robot: Robot, given: Sequence[float] | None, earlier: Sequence[Earlier], rate: float
) -> tuple[Floats, str]:
    """Return each joint's torque noise from the first of its sources that there is, and that source in words.

    Args:
        robot: the arm.
        given: one number or one per joint [N m or N]; None to look further.
        earlier: an identification among them has found the noise.
        rate: of the coming log's samples [Hz].

    Returns:
        Standard deviation of each joint's torque, (n,) [N m or N], and where it comes from. White noise is meant: of an
        identification, that which tells as little as its coloured residuals.
    """
    if given is not None:
        if len(given) not in (1, robot.n):
            what = f"--noise '{','.join(f'{sigma:g}' for sigma in given)}'"
            one = f"one positive number, or {robot.n} of them"
            raise WrongUsage(f"{what} must be {one}", fix="such as --noise 0.1")
        return np.broadcast_to(np.array(given), (robot.n,)).copy(), "given with --noise"
    for known in earlier:
        if isinstance(known, Identification):
            noise = parameter_posterior(known).sample_noise(rate)
            return noise, "as an earlier identification found it"
    assumed = "assumed (0.3 % of the rating, 0.1 N m without one)"
    return default_noise(robot), assumed if robot.torque.noise is None else "from the robot file"


def _information(
    base: BaseModel, earlier: Sequence[Earlier], noise: Floats
) -> tuple[Floats | None, Floats]:
    """Return the information about the base parameters of earlier files, and with the prior of possible bodies.

    Args:
        base: model and base parameters.
        earlier: logs, results and motions; the posterior of a physical set holds the prior already.
        noise: standard deviation of each joint's torque, for motions that were not recorded, (n,) [N m or N].

    Returns:
        Both as matrices, (p, p); the first is None without any file.
    """
    total: Floats | None = None
    prior = prior_information(base)
    for known in earlier:
        if isinstance(known, Identification):
            information, name = _of_result(base, known), str(known.path)
            prior = prior * (known.in_force != "physical")
        elif isinstance(known, StoredTrajectory):
            columns, name = base.reduction.base, str(known.source)
            information = information_of(base.model, columns, known.motion, noise)[1]
        else:
            information, name = _of_log(base, known), str(known.source)
        total = information if total is None else total + information
        stage("earlier", f"{name}: the new motion is planned to complete it")
    return total, prior if total is None else total + prior


def _of_result(base: BaseModel, found: Identification) -> Floats:
    names = {name: k for k, name in enumerate(found.names)}
    if not set(base.reduction.base_names) <= set(names):
        what = f"{found.path} has different base parameters from the robot file"
        raise WrongUsage(what, fix="identify again with this robot file")
    # Why some: a motion is planned without the effects of the robot file, whatever they are.
    some = [names[name] for name in base.reduction.base_names]
    others = [k for k in names.values() if k not in some]
    information = parameter_posterior(found).information
    known, shared = information[np.ix_(some, some)], information[np.ix_(some, others)]
    if others:
        rest = np.linalg.pinv(information[np.ix_(others, others)], hermitian=True)
        known = known - shared @ rest @ shared.T
    return np.asarray(known)


def _of_log(base: BaseModel, log: Log) -> Floats:
    options = LogOptions(delay=0.0)
    conditioned = condition_logs([checked_log(log, base.robot)], base.model, options)
    factors, rows = stack_logs(conditioned, base).whole
    found, p = weighted(factors, rows).noise, base.reduction.rank
    return np.asarray(
        sum(R[:, :p].T @ R[:, :p] / sigma**2 for R, sigma in zip(factors, found, strict=True))
    )


# ---------------------------------------------------------------- what is asked
def _earlier_of(given: EarlierLike | Sequence[EarlierLike], robot: Robot) -> list[Earlier]:
    """Return logs, results and motions, each given by itself or by its path."""
    kinds, wanted = (Log, Identification, StoredTrajectory, Plan), "a log, a result or a motion"
    found: list[Earlier] = []
    single, several = (*kinds, str, Path), f"{wanted}; or a list of them"
    for each in arguments.several(given, single, "earlier", several, empty=True):
        if isinstance(each, (str, Path)):
            found.append(_read_earlier(arguments.path(each, "earlier"), robot))
        elif not isinstance(each, kinds):
            raise arguments.refused("earlier", several, each)
        else:
            found.append(each.stored() if isinstance(each, Plan) else each)
        # Of a log the columns are looked up.
        if isinstance(found[-1], Identification):
            robot.require_joints(found[-1].robot.joint_names, found[-1].label)
        elif isinstance(found[-1], StoredTrajectory):
            where = found[-1].source or "the earlier motion"
            robot.require_joints(found[-1].joints, where)
    return found


def _waypoints_of(given: Waypoints | ArrayLike, robot: Robot) -> Waypoints:
    """Return waypoints given by themselves, as rows, or by the path of a CSV file."""
    if isinstance(given, Waypoints):
        return given
    if isinstance(given, (str, Path)):
        return read_waypoints(arguments.path(given, "waypoints"), robot)
    try:
        points = np.asarray(given, dtype=float)
    except (TypeError, ValueError, OverflowError):
        points = np.zeros(0)
    rows = points.ndim == 2 and points.shape[1] == robot.n and len(points) > 1
    if not rows or not np.all(np.isfinite(points)):
        raise arguments.refused("waypoints", f"at least 2 rows of {robot.n} numbers", given)
    return Waypoints(points)


@public
def plan_trajectory(
    robot: RobotLike,
    options: PlanOptions = PlanOptions(),
    *,
    waypoints: Waypoints | ArrayLike | None = None,
    earlier: EarlierLike | Sequence[EarlierLike] = (),
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
        earlier: logs, results and motions, or their paths, whose information the motion completes.
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
    robot = as_robot(robot)
    before = _earlier_of(earlier, robot)
    through = None if waypoints is None else _waypoints_of(waypoints, robot)
    urdf = None if urdf is None else arguments.path(urdf, "urdf")
    known_drawing = "dynid.trajectory.preview.Drawing"
    drawing = arguments.optional(drawing, Drawing, "drawing", known_drawing) or Drawing()
    if isinstance(for_gap, (str, Path)):
        for_gap = read_record(arguments.path(for_gap, "for_gap"))
    wanted = "what dynid.find_gap returns, or the path of its gap.npz"
    for_gap = arguments.optional(for_gap, GapRecord, "for_gap", wanted)
    begin = time.monotonic()
    base = _plain(base or base_model(robot))
    noise, source = _torque_noise(robot, options.noise, before, options.rate)
    known, believed = _information(base, before, noise)
    context = planning_context(base, options, noise, known, believed)
    experiment = None if for_gap is None else GapExperiment.of(for_gap, context)
    found, until = None, begin + options.seconds
    if through is not None:
        stage("plan")
        path = through_waypoints(through.q, context.limits, through.times)
        candidates: Iterable[Proposal] = [Proposal(path.slowed(options.alpha))]
        until = np.inf
    else:
        stage("search")
        limit = search_time(until - time.monotonic())
        if experiment is not None:
            found = experiment.search(context, limit)
        elif options.optimise:
            found = optimise(plan_problem(context), options, limit)
        candidates = proposals(context, found)
    stage("clearance")

    def judged(motion: Trajectory) -> tuple[Any, Clearance]:
        given, shown = through is not None, _shown(drawing, context, motion)
        return (
            once_more(lambda: require_safe(context, motion)),
            require_clear_motion(context, motion, urdf, shown, given=given),
        )

    chosen, (check, clearance) = first_accepted(candidates, judged, until)
    search = None
    if through is None:
        ended, finished = ("no search", 0) if found is None else (found.ended, found.finished)
        search = SearchRecord(options.seed, ended, finished, chosen.share)
    stage("predict")
    results = [each for each in before if isinstance(each, Identification) and each.expected]
    left = [np.sqrt(np.mean(each.expected.noise**2)) for each in results if each.expected]
    plan = Plan(
        robot=context.robot,
        options=options,
        trajectory=chosen.trajectory,
        motion=chosen.trajectory.sampled(options.rate),
        limits=context.limits,
        check=check,
        clearance=clearance,
        names=base.reduction.base_names,
        **once_more(lambda: _predicted(context, chosen.trajectory)),
        noise=noise,
        noise_from=source,
        search=search,
        urdf=urdf,
        unexplained=float(left[0]) if left else None,
        outlook=() if experiment is None else experiment.outlook(chosen.trajectory),
    )
    if found is not None and experiment is None and not before:
        require_teaching(plan)
    return plan


def require_teaching(plan: Plan) -> None:
    """Refuse a plan whose log would predict other motions worse than one sample measures, even at full speed.

    Args:
        plan: what was found.

    Raises:
        PlanTeachesLittle: it teaches too little (E511); the message says what limits it.
    """
    noise, full, search = plan.noise_rms, plan.at_full_speed, plan.search
    if full.torque_error <= noise:
        return
    reasons = [f"weakest is {plan.weakest}"]
    if search is not None and search.share < 1:
        reasons.insert(0, f"to avoid collisions it was reduced to {100 * search.share:.0f} %")
    if search is not None and search.ended in ("time", "interrupt") and not search.finished_starts:
        reasons.insert(0, "the search ended before its first start was finished")
    if plan.options.duration < SHORT:
        reasons.insert(0, f"it has {plan.options.duration:g} s")
    error = f"expected torque error on other motions {full.torque_error:.2g} N m even at full speed"
    more = f"more than the noise of one sample ({noise:.2g} N m)"
    raise PlanTeachesLittle(f"{error}, {more}: {', '.join(reasons)}")


def _plain(base: BaseModel) -> BaseModel:
    """Return the base model that motions are planned with: without the effects of the robot file.

    Why: some effects follow the whole motion, and none has a slope that a search could go down.
    """
    if not base.robot.effects:
        return base
    stage("effects", "the motion is planned without those of the robot file")
    return base_model(replace(base.robot, effects=()))


def trajectory_of(stored: StoredTrajectory) -> Trajectory:
    """Return the motion of trajectory.npz as coefficients of its family."""
    with reading(Path(stored.source or "the trajectory")):
        basis = basis_from(dict(stored.basis))
        count = len(stored.coefficients)
        if count != basis.size:
            raise ValueError(f"it has {count} coefficients of each joint, expected {basis.size}")
    return Trajectory(basis, stored.coefficients, stored.alpha)


def _shown(drawing: Drawing, context: PlanningContext, trajectory: Trajectory) -> Drawing:
    """Return what to draw of a motion, with its title and how it is sketched."""
    title = f"{context.robot.name}, alpha {trajectory.alpha:g}, {trajectory.duration:.1f} s"
    return replace(drawing, title=title, sketch=draw_motion)


def _predicted(context: PlanningContext, trajectory: Trajectory) -> dict[str, Any]:
    """Return what of a plan says what it will teach, by name."""
    base, noise, options = context.base, context.noise, context.options
    columns, beliefs = base.reduction.base, (context.other, context.believed)
    full = replace(trajectory, alpha=1.0)
    prediction = predict(base.model, columns, trajectory.sampled(options.rate), noise, *beliefs)
    cost = prediction.std_error * np.sqrt(np.diag(context.other))
    samples = len(full.sampled(options.rate))
    alphas = alpha_table(
        trajectory, base.model, columns, noise, context.other, samples, context.believed
    )
    weakest = base.reduction.base_names[int(np.argmax(cost))]
    return {"prediction": prediction, "alphas": alphas, "weakest": weakest}


@dataclass(frozen=True)
class Reviewed:
    """A motion that was planned before and passed the checks once more.

    Attributes:
        robot: the arm.
        options: surroundings and margins that it was judged with.
        stored: what its file holds.
        clearance: how far it stays away from everything.
        urdf: shapes of the arm; None for cylinders along the DH table.
    """

    robot: Robot
    options: PlanOptions
    stored: StoredTrajectory
    clearance: Clearance
    urdf: Path | None

    def accepted(self, *, seen: bool = True) -> StoredTrajectory:
        """Return the motion with the mark of the person at this machine, who has seen it in these surroundings."""
        return self.stored.accepted(seen=seen, scene=scene_facts(self.options, self.urdf))

    def window(self) -> AbstractContextManager[None]:
        """Show the motion in PyBullet's window; see ``Plan.window``."""
        return window(trajectory_of(self.stored), self.robot, self.urdf, self.options.scene)


def review_trajectory(
    robot: Robot,
    stored: StoredTrajectory,
    options: PlanOptions = PlanOptions(),
    *,
    urdf: Path | None = None,
    base: BaseModel | None = None,
    drawing: Drawing | None = None,
) -> Reviewed:
    """Judge a motion that was planned before by the robot file as it is today.

    Args:
        robot: the arm.
        stored: the motion.
        options: margin, tool speed and surroundings; what concerns planning does not count.
        urdf: the arm's own shapes; cylinders along the DH table when None.
        base: the arm's base model, where it is there already.
        drawing: pictures that PyBullet must draw.

    Raises:
        LimitBroken: it breaks a limit (E501).
        Collision: something comes too near (E502).
    """
    context = planning_context(_plain(base or base_model(robot)), options)
    trajectory = trajectory_of(stored)
    require_within_limits(context.check(trajectory), options.margin)
    shown = _shown(drawing or Drawing(), context, trajectory)
    clearance = require_clear_motion(context, trajectory, urdf, shown, given=True)
    return Reviewed(robot, options, stored, clearance, urdf)


def plan_inputs(robot: Robot, options: PlanOptions, files: Mapping[str, Path]) -> dict[str, str]:
    """Return what a plan depends on, for its header.

    Args:
        robot: the arm; beyond its model, its limits, base pose, prior and torque noise count.
        options: what is wanted.
        files: further files by what they are.
    """
    joints = [asdict(joint.limits) for joint in robot.joints]
    bodies = [asdict(each) if each else None for each in (robot.prior, robot.tool)]
    parts = [joints, robot.base_xyz, robot.base_rpy, *bodies, robot.torque.noise]
    limits = hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()
    hashes = {name: sha256(path) for name, path in files.items()}
    return {"robot": robot.model_key, "limits": limits, **hashes, **options.texts()}
