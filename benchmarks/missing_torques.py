"""Arms whose model lacks a large torque: what the set in force predicts on another motion, beside what others would.

PYTHONPATH=src python benchmarks/missing_torques.py > benchmarks/missing_torques.md

The arms are those of random_arms.py (links of random lumps, torques from Pinocchio); what is missing is written here.
Rules and constants were chosen looking at the first half of the cases and confirmed on the second. Fitted are single
tones (one sine a joint) or sums of five; the judge is another motion of five tones a joint. At most four times as large
as the weight of the links that the joint carries: a counterbalance, a spring, a crank, a cable that slackens. Else a
wrong torque scale of one joint (10 to 40 %), a tilted base (2 to 10 degrees), a payload and strong Stribeck friction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from scipy.signal import lfilter

from dynid import IdentifyOptions, Log, identify, load_robot
from dynid.errors import DynidError
from dynid.estimation.residual_model import squares
from dynid.estimation.result import Identification
from dynid.estimation.stack import Stack
from dynid.workflows.parameters import observe
from random_arms import ARMS, RATE, Arm

NAMES = ("ur10", "kuka_lwr4plus", "staubli_tx40", "ur5e", "franka_panda", "xarm7", "kuka_iiwa14")
MISSING = ("counterbalance", "spring", "crank", "cable", "scale", "tilt", "payload", "stribeck")
#: What is missing and has a size of its own.
LARGE = MISSING[:4]
MOTIONS = (("tone",), ("rich",), ("tone",), ("tone", "tone"))
#: Numbers of the cases: looked at when rules were chosen, and not.
CHOSEN_ON, CONFIRMED_ON = range(24), range(100, 124)
SECONDS = 16.0


@dataclass(frozen=True)
class Case:
    """What is missing at which joint of which arm, and the motions that are fitted."""

    robot: str
    seed: int
    motions: tuple[str, ...]
    missing: str
    size: float
    joint: int

    @classmethod
    def drawn(cls, number: int) -> Case:
        """Draw a case."""
        rng, missing = np.random.default_rng(9000 + number), MISSING[number % len(MISSING)]
        robot = NAMES[rng.integers(len(NAMES))]
        size = (
            np.exp(rng.uniform(np.log(0.7), np.log(4.0)))
            if missing in LARGE
            else rng.uniform(0.4, 1.6)
        )
        motions = MOTIONS[number // 8 % 4] if number % 3 else MOTIONS[0]
        return cls(robot, 1000 + number, motions, missing, float(size), int(rng.integers(1, 4)))

    def logs(self) -> tuple[Arm, list[Log], Log]:
        """Return the arm, the logs that are fitted, and the one that judges."""
        arm = Arm(replace(load_robot(self.robot), coupling=None), 200 + self.seed, ARMS[self.robot])
        fitted = [
            self.recorded(arm, kind, 10 * self.seed + k) for k, kind in enumerate(self.motions)
        ]
        return arm, fitted, self.recorded(arm, "rich", 7000 + self.seed)

    def recorded(self, arm: Arm, kind: str, seed: int) -> Log:
        """Record a motion with white and coloured torque noise; what is missing belongs to the arm."""
        rng, own = np.random.default_rng(seed), np.random.default_rng(arm.seed + 1000)
        t, n = np.arange(0, SECONDS, 1 / RATE), arm.robot.n
        q, qd, qdd = tone(arm, t, rng) if kind == "tone" else arm.motion(t, rng, 0.5)
        values, truth = arm.truth
        plant = truth.copy()
        if self.missing == "tilt":
            lean = np.sin(np.deg2rad(6.0 * self.size)) * np.linalg.norm(plant.gravity.linear)
            plant.gravity.linear = plant.gravity.linear + lean * np.array([1.0, 0.5, 0.0])
        if self.missing == "payload":
            mass = self.size * arm.mass / 12
            body = pin.Inertia(mass, np.array([0.03, 0.02, 0.08]), 4e-3 * mass * np.eye(3))
            plant.appendBodyToJoint(n, body, pin.SE3.Identity())
        data = plant.createData()
        rigid = np.array([pin.rnea(plant, data, *state) for state in zip(q, qd, qdd, strict=True)])
        fv, fc, fo = (
            np.array([values[f"{kind}{i + 1}"] for i in range(n)]) for kind in ("fv", "fc", "fo")
        )
        sign = np.tanh(qd / 0.003)
        tau = rigid + fv * qd + fc * sign + fo
        poses = np.random.default_rng(5).uniform(-1.5, 1.5, (200, n))
        weights = np.array([pin.computeGeneralizedGravity(plant, data, pose) for pose in poses])
        j = self.joint
        unit = self.size * max(np.sqrt(np.mean(weights[:, j] ** 2)), 0.09 * arm.rated[j])
        if self.missing == "counterbalance":
            tau[:, j] -= 1.2 * unit * np.sin(q[:, j] + 0.3 + own.uniform(-0.5, 0.5))
        elif self.missing == "spring":
            tau[:, j] += 0.8 * unit * (q[:, j] - 0.3)
        elif self.missing == "crank":
            tau[:, j] -= 1.5 * unit * np.sin(q[:, j] + 0.4) / np.sqrt(1.5 + np.cos(q[:, j] + 0.4))
        elif self.missing == "cable":
            tau[:, j] += 0.5 * unit * np.tanh(1.5 * (q[:, j] - 0.2))
        elif self.missing == "scale":
            tau[:, j] *= 1 - 0.25 * self.size
        elif self.missing == "stribeck":
            tau += self.size * fc * np.exp(-np.abs(qd) / 0.12) * sign
        noise = 0.004 * arm.rated * np.exp(0.2 * own.normal(size=n))
        coloured = lfilter([0.28], [1, -0.96], rng.normal(size=tau.shape), axis=0)
        tau = tau + noise * (rng.normal(size=tau.shape) + 0.3 * coloured)
        return Log(t, np.round(q / 2e-5) * 2e-5, tau, arm.robot.joint_names, tau_unit="Nm", dh=True)


def tone(arm: Arm, t: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, ...]:
    """Return q, qd, qdd of one sine a joint inside the limits, (N, n) each."""
    q, qd, qdd = (np.zeros((len(t), arm.robot.n)) for _ in range(3))
    for j, joint in enumerate(arm.robot.joints):
        low, high = joint.limits.position or (-2.5, 2.5)
        w, phase = 2 * np.pi * rng.uniform(0.1, 0.3), rng.uniform(0, 7)
        size = min(0.42 * (high - low), 1.3, 0.6 * min(joint.limits.velocity or 1.5, 3.0) / w)
        q[:, j] = size * np.sin(w * t + phase) + (low + high) / 2 + 0.2 * rng.normal()
        qd[:, j], qdd[:, j] = size * w * np.cos(w * t + phase), -size * w**2 * np.sin(w * t + phase)
    return q, qd, qdd


def error_of(result: Identification, judge: Stack) -> float:
    """Return the relative torque error on other rows [%]."""
    left = squares(judge, result.theta, result.model_error)
    return float(100 * np.sqrt(left.sum() / np.sum(judge.whole[0][:, :, -1] ** 2)))


def judged(case: Case) -> tuple[tuple[float, ...], str]:
    """Return the torque errors of the default, the physical set without residual model and the plain one, and the row."""
    arm, fitted, judge = case.logs()
    options = IdentifyOptions(holdout=None, drop_weak=True)
    seen = observe(arm.robot, fitted, options)
    other = observe(arm.robot, [judge], replace(options, cutoff=seen.cutoff), base=seen.base).stack
    variants = (
        options,
        replace(options, feasible=True, residual_model=False),
        replace(options, feasible=False, residual_model=False),
    )
    results = [identify(arm.robot, seen, each) for each in variants]
    errors = tuple(error_of(each, other) for each in results)
    chosen = results[0]
    error = chosen.model_error
    large = "" if error is None else ", ".join(str(j + 1) for j in error.free)
    what = f"{case.missing} {case.size:.1f}" + (
        f", joint {case.joint + 1}" if case.missing in (*LARGE, "scale") else ""
    )
    figures = " | ".join(f"{x:.2f}" for x in (*errors, errors[0] / min(errors[1:])))
    return (
        errors,
        f"| {case.robot} | {' + '.join(case.motions)} | {what} | {chosen.in_force} | {large} | {figures} |",
    )


def main() -> None:
    """Print the tables."""
    print("# Arms whose model lacks a large torque\n\nRelative torque error on another motion [%].")
    for title, numbers in (
        ("Cases that rules were chosen on", CHOSEN_ON),
        ("Cases that they were confirmed on", CONFIRMED_ON),
    ):
        print(f"\n## {title}\n")
        print(
            "| robot | fitted | missing | in force | large torque at joint | default | physical alone | plain | default / better |"
        )
        print("| - | - | - | - | - | - | - | - | - |")
        every = []
        for number in numbers:
            case = Case.drawn(number)
            try:
                errors, row = judged(case)
            except DynidError as error:
                print(
                    f"| {case.robot} | {' + '.join(case.motions)} | {case.missing} | refused: {type(error).__name__} | | | | | |"
                )
                continue
            every.append(errors)
            print(row, flush=True)
        x = np.array(every)
        ratio = x[:, 0] / x[:, 1:].min(axis=1)
        means = ", ".join(f"{m:.2f}" for m in np.exp(np.log(x).mean(axis=0)))
        print(
            f"\nGeometric means: {means}. Default over the better of both: median {np.median(ratio):.2f}, largest",
            end=" ",
        )
        print(
            f"{ratio.max():.2f}; within 5 % in {np.sum(ratio < 1.05)} of {len(ratio)}, better in {np.sum(ratio < 0.999)}."
        )


if __name__ == "__main__":
    main()
