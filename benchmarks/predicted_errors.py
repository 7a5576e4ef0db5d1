"""Torque errors that are predicted beforehand, beside what comes true: of plans, of results, simulated and on real arms.

PYTHONPATH=src python benchmarks/predicted_errors.py ../shared/data > benchmarks/predicted_errors.md

A point is a prediction that the user sees: what ``dynid trajectory`` expects of a log that nobody has recorded yet, or
what ``dynid identify`` and ``validate`` expect on another motion. Simulated torques are those of Pinocchio, arms have
links of random lumps; the effects that are hidden, and the recordings, are those of random_arms.py and real_arms.py.
The picture goes to docs/images/predicted-errors.svg.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy.signal import lfilter

from dynid import IdentifyOptions, Log, Motion, identify, load_robot, validate
from dynid.errors import DynidError
from dynid.trajectory.basis import Quintic
from dynid.trajectory.feasible import Shaping, bounds
from dynid.trajectory.plan import Trajectory
from dynid.trajectory.predict import default_noise, held_out, predict
from dynid.workflows.earlier_information import believed, earlier_information, torque_noise
from dynid.workflows.model import base_model
from random_arms import ARMS, HIDDEN, MOTIONS, Arm
from real_arms import pairs

#: Plans: seconds at full speed and speed factor.
PLANS = ((8.0, 1.0), (20.0, 0.6), (12.0, 0.2))
RATE = 100.0
FOUR = ("angle", "load", "ripple", "stribeck")
PICTURE = Path(__file__).parents[1] / "docs" / "images" / "predicted-errors.svg"


@dataclass(frozen=True)
class Point:
    """A prediction and what came true, both in percent of the torque."""

    kind: str
    name: str
    predicted: float
    true: float

    @property
    def ratio(self) -> float:
        """True over predicted error."""
        return self.true / self.predicted


@dataclass(frozen=True)
class Planned:
    """An arm, motions that were planned for it, and what is asked of the model."""

    arm: Arm

    def __post_init__(self) -> None:
        base = base_model(self.arm.robot)
        other = held_out(base.model, base.reduction.base, bounds(self.arm.robot))
        truth = base.reduction.K @ np.array(
            [self.arm.truth[0][name] for name in base.reduction.names]
        )
        for name, value in (("base", base), ("other", other), ("truth", truth)):
            object.__setattr__(self, name, value)

    def motion(self, seed: int, seconds: float, alpha: float) -> Motion:
        """Return a motion of the planner's family inside the limits."""
        basis = Quintic.even(seconds, max(3, round(seconds / 1.5)))
        shaping = Shaping(basis, bounds(self.arm.robot, 0.1), np.zeros(1))
        start = shaping.random(np.random.default_rng(seed))
        return Trajectory(basis, shaping.coefficients(start), alpha).sampled(RATE)

    def log(self, motion: Motion, seed: int, *, coloured: bool) -> Log:
        """Record a motion with white torque noise, or with as much of a slow one beside it."""
        (values, plant), n, rng = self.arm.truth, self.arm.robot.n, np.random.default_rng(seed)
        data, states = plant.createData(), zip(motion.q, motion.qd, motion.qdd, strict=True)
        fv, fc, fo = (
            np.array([values[f"{kind}{i + 1}"] for i in range(n)]) for kind in ("fv", "fc", "fo")
        )
        sign = np.tanh(motion.qd / np.array(self.arm.robot.coulomb_shape.velocity))
        tau = (
            np.array([pin.rnea(plant, data, *state) for state in states])
            + fv * motion.qd
            + fc * sign
            + fo
        )
        noise = rng.normal(size=tau.shape)
        if coloured:
            noise = noise + lfilter([0.4], [1, -0.92], rng.normal(size=tau.shape), axis=0)
        tau = tau + default_noise(self.arm.robot) * noise
        q = np.round(motion.q / 2e-5) * 2e-5
        return Log(motion.t, q, tau, self.arm.robot.joint_names, tau_unit="Nm", dh=True)

    def found(self, logs: list[Log]):
        """Return the default result."""
        return identify(
            self.arm.robot, logs, IdentifyOptions(holdout=None, cutoff=5.0), base=self.base
        )

    def point(self, kind: str, motion: Motion, result, earlier: list) -> Point:
        """Return what a plan promised after earlier results, and what a result of its log is worth."""
        robot, base, n = self.arm.robot, self.base, self.arm.robot.n
        noise, _ = torque_noise(robot, None, earlier, RATE)
        known = believed(base, earlier, earlier_information(base, earlier, noise))
        expected = predict(
            base.model, base.reduction.base, motion, noise, self.other, known
        ).torque_error
        miss = result.theta - self.truth
        size = 100.0 / np.sqrt(self.truth @ self.other @ self.truth / n)
        return Point(
            kind, robot.name, size * expected, size * float(np.sqrt(miss @ self.other @ miss / n))
        )


def plans() -> Iterator[Point]:
    """Yield plans of arms of which nothing is known but the robot file, and of arms that were identified before."""
    for i, (name, mass) in enumerate(ARMS.items()):
        planned = Planned(Arm(replace(load_robot(name), coupling=None), 500 + i, mass))
        for seed, (seconds, alpha) in enumerate(PLANS):
            motion = planned.motion(seed, seconds, alpha)
            result = planned.found([planned.log(motion, seed, coloured=False)])
            yield planned.point("plan", motion, result, [])
        for coloured in (False, True):
            first, motion = planned.motion(10, 10.0, 0.3), planned.motion(11, 10.0, 0.8)
            logs = [
                planned.log(each, 20 + k, coloured=coloured)
                for k, each in enumerate((first, motion))
            ]
            before = planned.found(logs[:1])
            noise = "coloured noise" if coloured else "white noise"
            yield planned.point(
                f"plan after a result, {noise}", motion, planned.found(logs), [before]
            )


def simulated() -> Iterator[Point]:
    """Yield results of simulated arms, complete and with hidden effects, on another motion."""
    for i, (name, mass) in enumerate(ARMS.items()):
        robot = replace(load_robot(name), coupling=None)
        for seed, hidden in ((0, ()), (1, ()), (2, FOUR), (3, (HIDDEN[i % len(HIDDEN)],))):
            arm = Arm(robot, 100 + seed, mass)
            result = identify(
                robot, arm.log(seed, *MOTIONS[seed], hidden), IdentifyOptions(holdout=None)
            )
            seen = validate(result, arm.log(seed + 500, 20.0, 0.5, hidden))
            kind = "result, complete model" if not hidden else "result, hidden effects"
            yield Point(
                kind,
                f"{robot.name} {'+'.join(hidden)}",
                seen.expected_percent,
                seen.relative_error_percent,
            )


def recorded(data: Path) -> Iterator[Point]:
    """Yield results of recordings of real arms, on what was not fitted."""
    for pair in pairs(data):
        try:
            result = identify(pair.robot, pair.fitted, IdentifyOptions(holdout=None))
            for name, log in pair.unseen:
                seen = validate(result, log)
                text = f"{pair.name} -> {name}"
                yield Point(
                    "result, real arm", text, seen.expected_percent, seen.relative_error_percent
                )
        except DynidError as error:
            print(f"{pair.name}: {error}", file=sys.stderr)


def row(kind: str, points: list[Point]) -> str:
    """Return one row of the table."""
    ratio = np.array([point.ratio for point in points])
    within = 100 * np.mean((ratio < 1.5) & (ratio > 1 / 1.5))
    low, median, high = np.percentile(ratio, (10, 50, 90))
    return f"| {kind} | {len(points)} | {median:.2f} | {low:.2f} to {high:.2f} | {within:.0f} |"


def draw(points: list[Point]) -> None:
    """Draw the scatter."""
    import matplotlib as mpl

    mpl.use("Agg")
    mpl.rcParams["svg.hashsalt"] = "dynid"
    from matplotlib import pyplot as plt

    figure, axes = plt.subplots(figsize=(6.4, 5.4), layout="constrained")
    values = np.array([(point.predicted, point.true) for point in points])
    low, high = values.min() / 1.5, values.max() * 1.5
    line = np.array([low, high])
    axes.fill_between(line, line / 1.5, line * 1.5, color="0.92", label="within a factor of 1.5")
    axes.plot(line, line, color="0.5", linewidth=1)
    for kind, mark in zip(dict.fromkeys(point.kind for point in points), "o^vsDP", strict=False):
        some = np.array([(p.predicted, p.true) for p in points if p.kind == kind])
        axes.plot(*some.T, mark, markersize=5, alpha=0.8, label=kind)
    axes.set(xscale="log", yscale="log", xlim=(low, high), ylim=(low, high))
    axes.set(xlabel="predicted torque error [%]", ylabel="true torque error on another motion [%]")
    axes.legend(fontsize=8, loc="upper left")
    figure.savefig(PICTURE, metadata={"Date": None})


def main() -> None:
    """Print the table and draw the picture."""
    points = [*plans(), *simulated()]
    if len(sys.argv) > 1:
        points += recorded(Path(sys.argv[1]))
    draw(points)
    print("# Predicted torque errors\n\nTrue over predicted error on another motion.\n")
    print("| | pairs | median | 10 to 90 % | within a factor of 1.5 [%] |\n| - | - | - | - | - |")
    for kind in dict.fromkeys(point.kind for point in points):
        print(row(kind, [point for point in points if point.kind == kind]))
    print(row("all", points))
    print("\n| | | predicted [%] | true [%] | ratio |\n| - | - | - | - | - |")
    for point in points:
        print(
            f"| {point.kind} | {point.name} | {point.predicted:.2f} | {point.true:.2f} | {point.ratio:.2f} |"
        )


if __name__ == "__main__":
    main()
