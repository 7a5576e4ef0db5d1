"""Plan an excitation motion that is optimal, safe, and seen before it runs (Paper Eqs. 14-19)."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, PlanTeachesLittle
from dynid.files.planfile import Waypoints
from dynid.files.trajectoryfile import Review, StoredTrajectory
from dynid.motion import Motion
from dynid.progress import SILENT, Progress
from dynid.robot import Robot
from dynid.table import Table
from dynid.threads import one_thread
from dynid.trajectory.feasible import assumed_limits, unsafe_to_play
from dynid.trajectory.options import PlanOptions
from dynid.trajectory.scene import Scene
from dynid.units import joint_unit
from dynid.workflows.earlier_information import (
    Earlier,
    believed,
    earlier_information,
    torque_noise,
    unexplained,
)
from dynid.workflows.gap_experiment import GapExperiment

if TYPE_CHECKING:
    from dynid.gap.record import GapRecord
    from dynid.model.base_model import BaseModel
    from dynid.trajectory.feasible import Bounds
    from dynid.trajectory.limits import LimitCheck
    from dynid.trajectory.optimise import SearchOutcome
    from dynid.trajectory.plan import Trajectory
    from dynid.trajectory.planning import Clearance, PlanningContext, Proposal
    from dynid.trajectory.predict import AlphaRow, Prediction
    from dynid.trajectory.preview import Drawing

Floats = NDArray[np.float64]

#: PyBullet measures no distance beyond this [m].
FAR = 0.3
#: Share of the time limit that prediction and files may need after the pictures.
FILES = 0.05
#: A motion shorter than this at full speed is named as too short when it teaches little [s].
SHORT = 10.0
#: How many of the closest pairs the JSON answer lists.
CLOSEST = 5
#: How a search can end, in words; ``{done}`` says how many starts finished.
ENDINGS = {
    "no search": "a random motion",
    "all starts": "all {done}",
    "time": "the time was over, {done}",
    "interrupt": "interrupted, {done}",
    "replay": "an earlier search's best, made again",
}


@dataclass(frozen=True)
class SearchRecord:
    """How a motion was found, with all that makes it again.

    Attributes:
        seed: of the search.
        ended: why the search ended, a key of ``ENDINGS``.
        finished_starts: number of starts that went to their end.
        start: number of the start that led to the motion.
        evaluation: evaluation of that start at which it was met; None without a search.
        share: how much of the motion is left after it was drawn in to keep clear.
        again: options that make the same plan again.
    """

    seed: int
    ended: str
    finished_starts: int
    start: int
    evaluation: int | None
    share: float
    again: str

    @property
    def text(self) -> str:
        """How the search ended and what makes the same plan again, in words."""
        done = f"{self.finished_starts} start{'s' * (self.finished_starts != 1)} finished"
        drawn = f", drawn in to {100 * self.share:.0f} % to keep clear" if self.share < 1 else ""
        return f"{ENDINGS[self.ended].format(done=done)}{drawn}; the same plan again: {self.again}"


@dataclass(frozen=True)
class Plan:
    """A motion that keeps all limits and stays clear of everything, with what it will teach.

    Attributes:
        robot: the arm.
        options: what was wanted.
        trajectory: the motion as coefficients of its family, at its speed factor.
        motion: its samples at ``options.rate``.
        limits: the limits, margins taken off.
        check: what the motion uses of them.
        clearance: how far it stays away from the arm itself, the floor and obstacles.
        names: names of the base parameters, (p,).
        prediction: expected standard errors and torque error of a log of it.
        alphas: what each speed factor costs.
        noise: standard deviation of each joint's torque, (n,) [N m or N].
        noise_from: where that comes from, in words.
        weakest: base parameter whose error costs the most torque on other motions.
        search: how the motion was found; None when a person gave the path.
        selected: samples chosen as measurement points (Eqs. 15-16), (K,); None for all.
        urdf: shapes of the arm that distances were measured with; None for cylinders along the DH table.
        review: who accepted the motion; None when nobody has.
        outlook: how much better a second gap search will be, in words.
        unexplained: rms torque that an earlier result leaves whatever the parameters [N m or N]; None without one.
    """

    robot: Robot
    options: PlanOptions
    trajectory: Trajectory
    motion: Motion
    limits: Bounds
    check: LimitCheck
    clearance: Clearance
    names: tuple[str, ...]
    prediction: Prediction
    alphas: tuple[AlphaRow, ...]
    noise: Floats
    noise_from: str
    weakest: str
    search: SearchRecord | None
    selected: NDArray[np.intp] | None = None
    urdf: Path | None = None
    review: Review | None = None
    outlook: tuple[str, ...] = ()
    unexplained: float | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is worth a warning."""
        assumed = assumed_limits(self.robot)
        text = f"the robot file has no limits for {'; '.join(assumed)} is assumed; dynid record refuses assumed rates"
        more: tuple[Finding, ...] = ()
        more += (Finding("W606", "warning", text, {"assumed": list(assumed)}),) if unsafe_to_play(assumed) else ()
        full = next(row for row in self.alphas if row.alpha == 1.0)
        noise = float(np.sqrt(np.mean(self.noise**2)))
        if full.torque_error > noise:
            text = (
                f"{full.torque_error:.2g} {self.units[3]} to expect on other motions after a log of it even at full "
                f"speed, more than the {noise:.2g} of noise in one sample; weakest is {self.weakest}"
            )
            more += (Finding("W608", "warning", text, {"expected_torque_error_nm": full.torque_error}),)
        return (*self.clearance.findings, *more)

    @property
    def std_errors(self) -> dict[str, float]:
        """Expected standard error of each base parameter, that of the prior where the motion shows nothing of it."""
        return dict(zip(self.names, self.prediction.std_error.tolist(), strict=True))

    def accepted(self, *, seen: bool = True) -> Plan:
        """Return the plan with the mark of the person at this machine, who has seen it, or accepts it unseen."""
        return replace(self, review=Review.now(self.motion, seen=seen))

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid trajectory`` says."""
        figures, distances = self.prediction.figures, self.clearance.distances
        return {
            "schema": "dynid/trajectory/1",
            "robot": self.robot.name,
            "duration_s": self.trajectory.duration,
            "alpha": self.trajectory.alpha,
            "condition_number": figures.condition,
            "condition_number_scaled": figures.condition_scaled,
            "smallest_singular_value": figures.smallest,
            "peak": [
                {
                    "joint": p.joint,
                    "position_rad": p.position,
                    "velocity_rad_s": p.velocity,
                    "acceleration_rad_s2": p.acceleration,
                    "torque_nm": p.torque,
                    "limit_share": p.share,
                }
                for p in self.check.peaks
            ],
            "tool_speed_m_s": self.check.tool_speed,
            "collisions": [],
            "closest_m": min((d.distance for d in distances), default=None),
            "closest": [{"pair": d.pair, "distance_m": d.distance, "time_s": d.time} for d in distances[:CLOSEST]],
            "left_out_pairs": list(self.clearance.left_out),
            "assumed_limits": list(assumed_limits(self.robot)),
            "predicted_std_error": self.std_errors,
            "expected_torque_error_nm": self.prediction.torque_error,
            "unexplained_torque_nm": self.unexplained,
            "ladder": [asdict(row) for row in self.alphas],
            "torque_noise_nm": self.noise.tolist(),
            "torque_noise_from": self.noise_from,
            "selected_samples": None if self.selected is None else len(self.selected),
            "weakest": self.weakest,
            "search": None if self.search is None else asdict(self.search),
            "outlook": list(self.outlook),
        }

    def stored(self, inputs: Mapping[str, str] | None = None) -> StoredTrajectory:
        """Return the plan as trajectory.npz holds it.

        Args:
            inputs: what it was made from, for the header.
        """
        return StoredTrajectory(
            robot=self.robot.name,
            joints=self.robot.joint_names,
            motion=self.motion,
            alpha=self.trajectory.alpha,
            basis=self.trajectory.basis.facts,
            coefficients=self.trajectory.coefficients,
            review=self.review,
            facts={
                "answer": self.facts(),
                "inputs": dict(inputs or {}),
                "rate_hz": self.options.rate,
                "seed": self.options.seed,
                "scene": scene_facts(self.options, self.urdf),
                "assumed_limits": list(assumed_limits(self.robot)),
                "left_out_pairs": list(self.clearance.left_out),
                "pictures": [picture.name for picture in self.clearance.pictures],
            },
            selected=self.selected,
        )

    def save(self, path: Path | str, inputs: Mapping[str, str] | None = None) -> list[Path]:
        """Write trajectory.npz, and the same motion as CSV and as JointTrajectory in YAML beside it.

        Args:
            path: the .npz file.
            inputs: what the plan was made from, for the header.
        """
        from dynid.files.trajectoryfile import write_csv, write_joint_trajectory, write_trajectory

        path = Path(path)
        texts = [path.with_suffix(".csv"), path.with_suffix(".yaml")]
        write_csv(texts[0], self.robot.joint_names, self.motion)
        write_joint_trajectory(texts[1], self.robot, self.motion)
        write_trajectory(path, self.stored(inputs))
        return [path, *texts]

    @property
    def units(self) -> tuple[str, ...]:
        """Units of positions, velocities, accelerations and torques; both where joints turn and slide."""
        kinds = sorted({joint.revolute for joint in self.robot.joints}, reverse=True)
        units = ("rad", "rad/s", "rad/s^2", "N m")
        return tuple(" or ".join(joint_unit(unit, revolute=kind) for kind in kinds) for unit in units)

    def table(self) -> Table:
        """Return the largest values of each joint, and the share of the nearest limit that they use."""
        units = self.units
        return Table(
            [
                {
                    "joint": peak.joint,
                    f"position [{units[0]}]": peak.position,
                    f"velocity [{units[1]}]": peak.velocity,
                    f"acceleration [{units[2]}]": peak.acceleration,
                    f"torque [{units[3]}]": peak.torque,
                    "share of limit": peak.share,
                }
                for peak in self.check.peaks
            ],
            footer=self.summary().splitlines(),
        )

    def summary(self) -> str:
        """Return what the motion is, uses, teaches and costs, one line each."""
        return "\n".join(f"{label:<11}{text}" for label, text in self.lines())

    def lines(self) -> list[tuple[str, str]]:
        """Return the lines of the summary, each as a label and a sentence."""
        basis, alpha = self.trajectory.basis.facts, self.trajectory.alpha
        kind = (
            f"{len(basis['knots']) - 1} {basis['kind']} segments"
            if "knots" in basis
            else f"{basis['harmonics']} harmonics"
        )
        slow = f"{self.trajectory.duration:.1f} s at alpha {alpha:g} (speed x{alpha:g}, acceleration x{alpha**2:.2g})"
        figures, low, high = self.prediction.figures, float(self.noise.min()), float(self.noise.max())
        excitation = f"condition number {figures.condition:.3g} (columns of equal length: "
        size = f"{low:.2g}" if low == high else f"{low:.2g} to {high:.2g}"
        left, unit = self.unexplained, self.units[3]
        beside = "" if left is None else f" and {left:.2g} {unit} that no parameter explains"
        error = (
            f"torque error {self.prediction.torque_error:.2g} {unit} on other motions{beside}; weakest: {self.weakest}"
        )
        return [
            ("plan", f"{kind}, {self.trajectory.basis.duration:.1f} s at full speed; {slow}"),
            *([("search", self.search.text)] if self.search is not None else []),
            ("limits", self._shares()),
            *self._nearest(),
            (
                "excitation",
                f"{excitation}{figures.condition_scaled:.3g})   smallest singular value {figures.smallest:.2g}",
            ),
            ("predicted", error),
            *(("gap", text) for text in self.outlook),
            ("noise", f"{size} {self.units[3]} per sample, {self.noise_from}"),
            *self._alpha_lines(),
        ]

    def _shares(self) -> str:
        """Say how much of what the margin leaves is used."""
        limits, peaks = self.limits, self.check.peaks
        middle, half = (limits.upper + limits.lower) / 2, (limits.upper - limits.lower) / 2
        shares = {
            "position": np.max(np.abs(np.array([p.position for p in peaks]) - middle) / half),
            "speed": np.max(np.array([p.velocity for p in peaks]) / limits.velocity),
            "acceleration": np.max(np.array([p.acceleration for p in peaks]) / limits.acceleration),
            "torque": np.max(np.array([p.torque or 0.0 for p in peaks]) / limits.torque),
        }
        words = "   ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items())
        return f"{words}   of what the margin leaves: all inside; tool up to {self.check.tool_speed:.2f} m/s"

    def _nearest(self) -> Iterator[tuple[str, str]]:
        for near in self.clearance.distances[:1]:
            least = "at least " * (near.distance >= FAR)
            size = f"{least}{1000 * near.distance:.0f} mm"
            yield "collision", f"none; nearest {near.pair} at {size}, t = {near.time:.1f} s"
        if self.clearance.left_out and self.urdf is None:
            from dynid.trajectory.planning import thickness

            pairs = ", ".join(self.clearance.left_out)
            yield "left out", f"near in usual poses whatever the motion: {pairs}; {thickness(self.robot)}"
        if assumed := assumed_limits(self.robot):
            yield "assumed", f"not in the robot file: {'; '.join(assumed)}"

    def _alpha_lines(self) -> Iterator[tuple[str, str]]:
        """Say what slowing down costs, so that nobody identifies from a first, slow run by mistake."""
        full = next(row for row in self.alphas if row.alpha == 1.0)
        here = next(row for row in self.alphas if row.alpha == self.trajectory.alpha)
        for row in self.alphas:
            times, mark = row.torque_error / full.torque_error, "  <- this plan" * (row is here)
            yield "alpha", f"{row.alpha:g}: {row.duration:.0f} s, expected torque error x{times:.3g}{mark}"
        if here.alpha < 1:
            times = here.torque_error / full.torque_error
            cost = f"at alpha {here.alpha:g} the expected torque error is {times:.2g} times larger than at 1.0"
            yield "note", f"{cost} for equally many samples: a first, safe run; then 0.5, then 1.0"

    def __repr__(self) -> str:
        """Return the table and the summary as text."""
        return repr(self.table())

    def _repr_html_(self) -> str:
        """Return the table and the summary as HTML for notebooks."""
        return self.table()._repr_html_()

    def window(self) -> AbstractContextManager[None]:
        """Show the motion in PyBullet's window for the length of a ``with`` block.

        Raises:
            NoDisplay: there is no display.
        """
        return show_in_window(self.robot, self.trajectory, self.options.scene, self.urdf)


@contextmanager
def show_in_window(robot: Robot, trajectory: Trajectory, scene: Scene, urdf: Path | None) -> Iterator[None]:
    """Show a motion in PyBullet's window for the length of the block."""
    from dynid.trajectory.preview import urdf_of, window

    with urdf_of(robot, urdf) as shapes, window(trajectory, robot, shapes, scene):
        yield


@one_thread
def plan_trajectory(
    robot: Robot,
    options: PlanOptions = PlanOptions(),  # noqa: B008
    *,
    waypoints: Waypoints | Floats | None = None,
    path: StoredTrajectory | Plan | None = None,
    earlier: Sequence[Earlier | Plan] = (),
    urdf: Path | None = None,
    base: BaseModel | None = None,
    drawing: Drawing | None = None,
    for_gap: GapRecord | None = None,
    progress: Progress = SILENT,
    **changes: Any,  # noqa: ANN401
) -> Plan:
    """Plan a motion that keeps all limits and stays clear, and predict what a log of it will tell.

    Args:
        robot: the arm.
        options: what is wanted.
        waypoints: points that the motion goes through instead of a search, (K, n) [rad or m].
        path: an earlier plan whose path runs at ``options.alpha`` instead of a search.
        earlier: logs, results and motions whose information the motion completes.
        urdf: the arm's own shapes; cylinders along the DH table when None.
        base: the arm's base model, where it is there already.
        drawing: pictures that PyBullet must draw; without it PyBullet is used where it is installed.
        for_gap: a gap search; the motion answers what it left open.
        progress: told how far the search is.
        changes: single options by name, such as ``duration=10.0``.

    Raises:
        LimitBroken: no motion keeps all limits (E501).
        Collision: something comes too near (E502).
        PlanTeachesLittle: what the search found excites too little (E511).
    """
    from dynid.trajectory.planning import (
        first_accepted,
        once_more,
        planning_context,
        proposals,
        require_clear_motion,
        require_safe,
        search_motions,
        search_time,
    )
    from dynid.trajectory.preview import Drawing
    from dynid.workflows.model import base_model

    options = replace(options, **changes)
    begin = time.monotonic()
    base = _plain(base or base_model(robot, progress=progress), progress)
    before = [known.stored() if isinstance(known, Plan) else known for known in earlier]
    noise, source = torque_noise(robot, options.noise, before, options.rate)
    known = earlier_information(base, before, noise, progress)
    context = planning_context(base, options, noise, known, believed(base, before, known))
    experiment = None if for_gap is None else GapExperiment.of(for_gap, context, progress)
    candidates, found = _given_path(context, waypoints, path), None
    progress.stage("search" if candidates is None else "plan")
    if candidates is None:
        limit = search_time(options.seconds - (time.monotonic() - begin))
        if experiment is None:
            found = search_motions(context, progress, limit)
        else:
            found = experiment.search(context, limit, progress)
        candidates = proposals(context, found)
    progress.stage("clearance")
    given = waypoints is not None or path is not None
    until = begin + options.seconds
    drawing = replace(drawing or Drawing(), until=None if given else until - FILES * options.seconds)
    chosen, (check, clearance) = first_accepted(
        candidates,
        lambda motion: (
            once_more(lambda: require_safe(context, motion)),
            require_clear_motion(context, motion, urdf, _shown(drawing, context, motion), progress, given=given),
        ),
        np.inf if given or options.replay else until,
        progress,
    )
    search = _search_record(options, chosen, found)
    progress.stage("predict")
    plan = once_more(lambda: _predicted(context, chosen.trajectory, check, clearance, source, search, urdf))
    plan = replace(plan, unexplained=unexplained(before))
    if experiment is not None:
        return replace(plan, outlook=experiment.outlook(plan.trajectory))
    if found is not None and not before:
        require_teaching(plan, context)
    return plan


def require_teaching(plan: Plan, context: PlanningContext) -> None:
    """Refuse a plan whose log would predict other motions worse than one sample measures, even at full speed.

    Args:
        plan: what was found.
        context: the arm and what is wanted.

    Raises:
        PlanTeachesLittle: it teaches too little (E511); the message says what limits it.
    """
    from dynid.trajectory.predict import predict

    fast = replace(plan.trajectory, alpha=1.0).sampled(plan.options.rate)
    base = context.base
    full = predict(base.model, base.reduction.base, fast, context.noise, context.other, context.believed)
    noise = float(np.sqrt(np.mean(context.noise**2)))
    if full.torque_error <= noise:
        return
    reasons = [f"weakest is {plan.weakest}"]
    if plan.search is not None and plan.search.share < 1:
        reasons.insert(0, f"to keep clear it was drawn in to {100 * plan.search.share:.0f} %")
    if plan.search is not None and plan.search.ended in ("time", "interrupt") and plan.search.finished_starts == 0:
        reasons.insert(0, "the search ended before its first start was through")
    if plan.options.duration < SHORT:
        reasons.insert(0, f"it has {plan.options.duration:g} s")
    error = f"{full.torque_error:.2g} N m to expect on other motions after a log of it at full speed"
    raise PlanTeachesLittle(f"{error}, more than the {noise:.2g} N m of noise in one sample: {', '.join(reasons)}")


def _plain(base: BaseModel, progress: Progress) -> BaseModel:
    """Return the base model that motions are planned with: without the effects of the robot file.

    Why: some effects follow the whole motion, and none has a slope that a search could go down.
    """
    from dynid.workflows.model import base_model

    if not base.robot.effects:
        return base
    progress.stage("effects", "the motion is planned without those of the robot file")
    return base_model(replace(base.robot, effects=()))


def _given_path(
    context: PlanningContext, waypoints: Waypoints | Floats | None, path: StoredTrajectory | Plan | None
) -> Iterable[Proposal] | None:
    """Return the motion through waypoints, or on the path of an earlier plan; None to search."""
    from dynid.trajectory.plan import through_waypoints
    from dynid.trajectory.planning import Proposal

    alpha = context.options.alpha
    if path is not None:
        return [Proposal(replace(trajectory_of(path), alpha=alpha))]
    if waypoints is None:
        return None
    points = waypoints if isinstance(waypoints, Waypoints) else Waypoints(np.asarray(waypoints, dtype=float))
    return [Proposal(through_waypoints(points.q, context.limits, points.times).slowed(alpha))]


def trajectory_of(stored: StoredTrajectory | Plan) -> Trajectory:
    """Return the motion of a plan, or of its file, as coefficients of its family."""
    from dynid.files.artifact import reading, require_shape
    from dynid.trajectory.basis import basis_from
    from dynid.trajectory.plan import Trajectory

    if isinstance(stored, Plan):
        return stored.trajectory
    with reading(Path(stored.source or "the trajectory")):
        basis = basis_from(dict(stored.basis))
        require_shape((basis.size, len(stored.joints)), coefficients=stored.coefficients)
        if not (np.all(np.isfinite(stored.coefficients)) and 0 < stored.alpha < np.inf):
            raise ValueError("its coefficients or its alpha are none of a motion")
    return Trajectory(basis, stored.coefficients, stored.alpha)


def _shown(drawing: Drawing, context: PlanningContext, trajectory: Trajectory) -> Drawing:
    """Return what to draw of a motion, with its title and how it is sketched."""
    from dynid.reports.motion_drawing import draw_motion

    title = f"{context.robot.name}, alpha {trajectory.alpha:g}, {trajectory.duration:.1f} s"
    return replace(drawing, title=title, sketch=draw_motion)


def _search_record(options: PlanOptions, chosen: Proposal, found: SearchOutcome | None) -> SearchRecord | None:
    if chosen.start is None:
        return None
    again = f"--seed {options.seed}"
    if found is not None and found.ended != "all starts":
        again += f" --replay {chosen.start}:{chosen.evaluation}"
    ended, finished = ("no search", 0) if found is None else (found.ended, found.finished)
    return SearchRecord(options.seed, ended, finished, chosen.start, chosen.evaluation, chosen.share, again)


def _predicted(
    context: PlanningContext,
    trajectory: Trajectory,
    check: LimitCheck,
    clearance: Clearance,
    noise_from: str,
    search: SearchRecord | None,
    urdf: Path | None,
) -> Plan:
    """Return the plan with what it will teach."""
    from dynid.trajectory.cost import select_samples
    from dynid.trajectory.predict import alpha_table, predict

    base, options, noise = context.base, context.options, context.noise
    motion = trajectory.sampled(options.rate)
    columns = base.reduction.base
    prediction = predict(base.model, columns, motion, noise, context.other, context.believed)
    selected = None
    if options.select is not None:
        W = base.model.observer(columns).dense(motion.q, motion.qd, motion.qdd)
        selected = select_samples(W, options.select)
    cost = prediction.std_error * np.sqrt(np.diag(context.other))
    return Plan(
        robot=context.robot,
        options=options,
        trajectory=trajectory,
        motion=motion,
        limits=context.limits,
        check=check,
        clearance=clearance,
        names=base.reduction.base_names,
        prediction=prediction,
        alphas=alpha_table(trajectory, base.model, columns, noise, context.other, context.believed),
        noise=noise,
        noise_from=noise_from,
        weakest=base.reduction.base_names[int(np.argmax(cost))],
        search=search,
        selected=selected,
        urdf=urdf,
    )


def scene_facts(options: PlanOptions, urdf: Path | None) -> dict[str, Any]:
    """Return in which surroundings a motion was judged, and with which shapes of the arm; for ``dynid record``."""
    return {**options.scene.facts, "urdf": None if urdf is None else str(urdf.resolve())}


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
        return show_in_window(self.robot, trajectory_of(self.stored), self.options.scene, self.urdf)


def review_trajectory(
    robot: Robot,
    stored: StoredTrajectory,
    options: PlanOptions = PlanOptions(),  # noqa: B008
    *,
    urdf: Path | None = None,
    base: BaseModel | None = None,
    drawing: Drawing | None = None,
    progress: Progress = SILENT,
) -> Reviewed:
    """Judge a motion that was planned before by the robot file as it is today.

    Args:
        robot: the arm.
        stored: the motion.
        options: margin, tool speed and surroundings; what concerns planning does not count.
        urdf: the arm's own shapes; cylinders along the DH table when None.
        base: the arm's base model, where it is there already.
        drawing: pictures that PyBullet must draw.
        progress: told how far the work is.

    Raises:
        LimitBroken: it breaks a limit (E501).
        Collision: something comes too near (E502).
    """
    from dynid.trajectory.limits import require_within_limits
    from dynid.trajectory.planning import planning_context, require_clear_motion
    from dynid.trajectory.preview import Drawing
    from dynid.workflows.model import base_model

    context = planning_context(_plain(base or base_model(robot, progress=progress), progress), options)
    trajectory = trajectory_of(stored)
    require_within_limits(context.check(trajectory), options.margin)
    shown = _shown(drawing or Drawing(), context, trajectory)
    clearance = require_clear_motion(context, trajectory, urdf, shown, progress, given=True)
    return Reviewed(robot, options, stored, clearance, urdf)


def plan_inputs(robot: Robot, options: PlanOptions, files: Mapping[str, Path]) -> dict[str, str]:
    """Return what a plan depends on, for its header.

    Args:
        robot: the arm; beyond its model, its limits, base pose, prior and torque noise count.
        options: what is wanted.
        files: further files by what they are.
    """
    from dynid.files.artifact import sha256

    parts: list[Any] = [[asdict(joint.limits) for joint in robot.joints], robot.base_xyz, robot.base_rpy]
    parts += [asdict(robot.prior) if robot.prior else None, asdict(robot.tool) if robot.tool else None]
    parts.append(robot.torque.noise)
    limits = hashlib.sha256(json.dumps(parts, sort_keys=True, default=str).encode()).hexdigest()
    hashes = {name: sha256(path) for name, path in files.items()}
    return {"robot": robot.model_key, "limits": limits, **hashes, **options.texts()}
