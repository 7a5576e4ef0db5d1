"""What a planned motion is: its samples, what it uses of the limits and will teach, and how it is told and kept."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.answer import Answer, picked
from dynid.errors import Finding
from dynid.files.trajectoryfile import (
    Review,
    StoredTrajectory,
    write_csv,
    write_joint_trajectory,
    write_trajectory,
)
from dynid.motion import Motion
from dynid.robot import Robot
from dynid.table import Table
from dynid.trajectory.feasible import Bounds, assumed_limits, unsafe_to_play
from dynid.trajectory.limits import LimitCheck
from dynid.trajectory.options import PlanOptions
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.planning import Clearance, thickness
from dynid.trajectory.predict import AlphaRow, Prediction
from dynid.trajectory.preview import window
from dynid.units import joint_unit

Floats = NDArray[np.float64]

#: PyBullet measures no distance beyond this [m].
FAR = 0.3
#: How many of the closest pairs the JSON answer lists.
CLOSEST = 5
#: How a search can end, in words; ``{done}`` says how many starts finished.
ENDINGS = {
    "no search": "a random motion",
    "all starts": "all {done}",
    "time": "the time limit was reached, {done}",
    "interrupt": "interrupted, {done}",
}


@dataclass(frozen=True)
class SearchRecord:
    """How a motion was found.

    Attributes:
        seed: of the search.
        ended: why the search ended, a key of ``ENDINGS``.
        finished_starts: number of starts that went to their end.
        share: how much of the motion is left after it was drawn in to keep clear.
    """

    seed: int
    ended: str
    finished_starts: int
    share: float

    @property
    def text(self) -> str:
        """How the search ended, in words."""
        done = f"{self.finished_starts} start{'s' * (self.finished_starts != 1)} finished"
        drawn = f", reduced to {100 * self.share:.0f} % of its size to avoid collisions"
        drawn *= self.share < 1
        return f"{ENDINGS[self.ended].format(done=done)}{drawn}; seed {self.seed}"


@dataclass(frozen=True, repr=False)
class Plan(Answer):
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
    urdf: Path | None = None
    review: Review | None = None
    outlook: tuple[str, ...] = ()
    unexplained: float | None = None

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is worth a warning."""
        assumed, found = assumed_limits(self.robot), [*self.clearance.findings]
        if unsafe_to_play(assumed):
            text = f"the robot file has no limits for {'; '.join(assumed)} is assumed"
            text += "; dynid record refuses assumed rates"
            found.append(Finding("W606", "warning", text, {"assumed": list(assumed)}))
        error, noise = self.at_full_speed.torque_error, self.noise_rms
        if error > noise:
            text = f"expected torque error on other motions {error:.2g} {self.units[3]} even at full speed"
            text += f", more than the noise of one sample ({noise:.2g}); weakest: {self.weakest}"
            found.append(Finding("W608", "warning", text, {"expected_torque_error_nm": error}))
        return tuple(found)

    @property
    def noise_rms(self) -> float:
        """The noise of one sample, rms of all joints [N m or N]."""
        return float(np.sqrt(np.mean(self.noise**2)))

    @property
    def sentence(self) -> str:
        """What the motion is worth, in one sentence."""
        return plan_sentence(self.robot, self.facts())

    @property
    def at_full_speed(self) -> AlphaRow:
        """What the motion costs and teaches at full speed."""
        return next(row for row in self.alphas if row.alpha == 1.0)

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
        peak = {
            "position_rad": "position",
            "velocity_rad_s": "velocity",
            "acceleration_rad_s2": "acceleration",
            "torque_nm": "torque",
            "limit_share": "share",
        }
        return {
            "schema": "dynid/trajectory/1",
            "robot": self.robot.name,
            **picked(self.trajectory, "alpha", duration_s="duration"),
            **picked(figures, condition_number="condition", smallest_singular_value="smallest"),
            "condition_number_scaled": figures.condition_scaled,
            "peak": [picked(each, "joint", **peak) for each in self.check.peaks],
            "tool_speed_m_s": self.check.tool_speed,
            "collisions": [],
            "closest_m": min((each.distance for each in distances), default=None),
            "closest": [
                picked(each, "pair", distance_m="distance", time_s="time")
                for each in distances[:CLOSEST]
            ],
            "left_out_pairs": list(self.clearance.left_out),
            "assumed_limits": list(assumed_limits(self.robot)),
            "predicted_std_error": self.std_errors,
            "expected_torque_error_nm": self.prediction.torque_error,
            "ladder": [asdict(row) for row in self.alphas],
            "torque_noise_nm": self.noise.tolist(),
            **picked(self, "weakest", torque_noise_from="noise_from"),
            "unexplained_torque_nm": self.unexplained,
            "search": None if self.search is None else asdict(self.search),
            "outlook": list(self.outlook),
        }

    def stored(self, inputs: Mapping[str, str] | None = None) -> StoredTrajectory:
        """Return the plan as trajectory.npz holds it.

        Args:
            inputs: what it was made from, for the header.
        """
        answer = self.facts()
        return StoredTrajectory(
            robot=self.robot.name,
            joints=self.robot.joint_names,
            motion=self.motion,
            alpha=self.trajectory.alpha,
            basis=self.trajectory.basis.facts,
            coefficients=self.trajectory.coefficients,
            review=self.review,
            facts={
                "answer": answer,
                "inputs": dict(inputs or {}),
                **picked(self.options, "seed", rate_hz="rate"),
                "scene": scene_facts(self.options, self.urdf),
                **{key: answer[key] for key in ("assumed_limits", "left_out_pairs")},
                "pictures": [picture.name for picture in self.clearance.pictures],
            },
        )

    def save(self, path: Path | str, inputs: Mapping[str, str] | None = None) -> list[Path]:
        """Write trajectory.npz, and the same motion as CSV and for ROS beside it.

        For ROS: a JointTrajectory as ROS 1 and as ROS 2 spell it, and the goal of a FollowJointTrajectory of ROS 2.

        Args:
            path: the .npz file.
            inputs: what the plan was made from, for the header.
        """
        path = Path(path)
        endings = (".csv", ".yaml", "_ros2.yaml", "_ros2_goal.yaml")
        texts = [path.with_name(f"{path.stem}{ending}") for ending in endings]
        write_csv(texts[0], self.robot.joint_names, self.motion)
        write_joint_trajectory(texts[1], self.robot, self.motion)
        write_joint_trajectory(texts[2], self.robot, self.motion, ros=2)
        write_joint_trajectory(texts[3], self.robot, self.motion, ros=2, goal=True)
        write_trajectory(path, self.stored(inputs))
        return [path, *texts]

    @property
    def units(self) -> tuple[str, ...]:
        """Units of positions, velocities, accelerations and torques; both where joints turn and slide."""
        kinds = sorted({joint.revolute for joint in self.robot.joints}, reverse=True)
        units = ("rad", "rad/s", "rad/s^2", "N m")
        return tuple(
            " or ".join(joint_unit(unit, revolute=kind) for kind in kinds) for unit in units
        )

    def table(self) -> Table:
        """Return the largest values of each joint, and the share of the nearest limit that they use."""
        units = self.units
        rows = [
            {
                "joint": peak.joint,
                f"position [{units[0]}]": peak.position,
                f"velocity [{units[1]}]": peak.velocity,
                f"acceleration [{units[2]}]": peak.acceleration,
                f"torque [{units[3]}]": peak.torque,
                "share of limit": peak.share,
            }
            for peak in self.check.peaks
        ]
        return Table(rows, footer=self.summary().splitlines())

    def summary(self) -> str:
        """Return what the motion is, uses, teaches and costs, one line each."""
        return "\n".join(f"{label:<11}{text}" for label, text in self.lines())

    def lines(self) -> list[tuple[str, str]]:
        """Return the lines of the summary, each as a label and a sentence."""
        run, figures, unit = self.trajectory, self.prediction.figures, self.units[3]
        basis, alpha = run.basis.facts, run.alpha
        kind = f"{len(basis['knots']) - 1} {basis['kind']} segments, {run.basis.duration:.1f} s at full speed"
        slow = f"{run.duration:.1f} s at alpha {alpha:g} (speed x{alpha:g}, acceleration x{alpha**2:.2g})"
        condition = (
            f"{figures.condition:.3g} (columns of equal length: {figures.condition_scaled:.3g})"
        )
        left = (
            f" and {self.unexplained:.2g} {unit} that no parameter explains"
            if self.unexplained is not None
            else ""
        )
        error = f"{self.prediction.torque_error:.2g} {unit} on other motions{left}"
        sizes = dict.fromkeys(f"{size:.2g}" for size in (self.noise.min(), self.noise.max()))
        return [
            ("plan", f"{kind}; {slow}"),
            *([("search", self.search.text)] if self.search is not None else []),
            ("limits", self._shares()),
            *self._nearest(),
            (
                "excitation",
                f"condition number {condition}   smallest singular value {figures.smallest:.2g}",
            ),
            ("predicted", f"torque error {error}; weakest: {self.weakest}"),
            *(("gap", text) for text in self.outlook),
            ("noise", f"{' to '.join(sizes)} {unit} per sample, {self.noise_from}"),
            *self._alpha_lines(),
        ]

    def _shares(self) -> str:
        """Say how much of what the margin leaves is used."""
        limits, peaks = self.limits, self.check.peaks
        middle, half = (limits.upper + limits.lower) / 2, (limits.upper - limits.lower) / 2
        used = {
            "position": (np.array([p.position for p in peaks]) - middle) / half,
            "speed": np.array([p.velocity for p in peaks]) / limits.velocity,
            "acceleration": np.array([p.acceleration for p in peaks]) / limits.acceleration,
            "torque": np.array([p.torque or 0.0 for p in peaks]) / limits.torque,
        }
        words = "   ".join(f"{k} {100 * np.max(np.abs(share)):.0f} %" for k, share in used.items())
        return f"{words}   of the limits less margin: all inside; tool up to {self.check.tool_speed:.2f} m/s"

    def _nearest(self) -> Iterator[tuple[str, str]]:
        for near in self.clearance.distances[:1]:
            size = f"{'at least ' * (near.distance >= FAR)}{1000 * near.distance:.0f} mm"
            yield "collision", f"none; nearest {near.pair} at {size}, t = {near.time:.1f} s"
        if self.clearance.left_out and self.urdf is None:
            pairs = f"{', '.join(self.clearance.left_out)}; {thickness(self.robot)}"
            yield "left out", f"always close to each other, so not checked: {pairs}"
        if assumed := assumed_limits(self.robot):
            yield "assumed", f"not in the robot file: {'; '.join(assumed)}"

    def _alpha_lines(self) -> Iterator[tuple[str, str]]:
        """Say what slowing down costs, so that nobody identifies from a first, slow run by mistake."""
        for row in self.alphas:
            times, here = row.torque_error / self.at_full_speed.torque_error, ""
            if row.alpha == self.trajectory.alpha:
                here, cost = "  <- this plan", times
            text = f"{row.alpha:g}: {row.duration:.0f} s, expected torque error x{times:.3g}{here}"
            yield "alpha", text
        if (alpha := self.trajectory.alpha) < 1:
            text = f"at alpha {alpha:g} the expected torque error is {cost:.2g} times larger than at 1.0"
            yield "note", f"{text} for equally many samples: a first, safe run; then 0.5, then 1.0"

    def window(self) -> AbstractContextManager[None]:
        """Show the motion in PyBullet's window for the length of a ``with`` block.

        Raises:
            NoDisplay: there is no display.
        """
        return window(self.trajectory, self.robot, self.urdf, self.options.scene)


def plan_sentence(robot: Robot, facts: Mapping[str, Any]) -> str:
    """Return what a motion is worth, in one sentence.

    Args:
        robot: the arm.
        facts: of the motion, as ``Plan.facts`` says them.
    """
    units = " or ".join(dict.fromkeys(joint.torque_unit for joint in robot.joints))
    error = f"{facts['expected_torque_error_nm']:.2g} {units}"
    return (
        f"This motion of {facts['duration_s']:.1f} s keeps all limits of {robot.name}. "
        f"With a recording of it the model should predict other motions to {error}."
    )


def scene_facts(options: PlanOptions, urdf: Path | None) -> dict[str, Any]:
    """Return in which surroundings a motion was judged, and with which shapes of the arm; for ``dynid record``."""
    return {**options.scene.facts, "urdf": None if urdf is None else str(urdf.resolve())}
