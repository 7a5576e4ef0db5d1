"""Arms with links of random lumps of mass: how many true parameters lie inside their 95 % intervals, and torque errors.

PYTHONPATH=src python benchmarks/random_arms.py > benchmarks/random_arms.md

Kinematics are those of robot files, everything else is drawn: no truth comes from the prior. Pinocchio gives the
torques, so that nothing is shared with the model; the effects that are hidden are written here.
"""

import sys
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pinocchio as pin
from scipy.signal import lfilter

import study
from arms import lumped, pinocchio_model, pinocchio_torques
from dynid import Log, Robot, identify, load_robot, validate
from dynid.errors import DynidError
from dynid.model import build_model
from dynid.model.parameters import BODY_PARAMETERS
from motions import tones

#: Robot files and the mass of such an arm [kg], about which the true one is drawn.
ARMS = {
    "kuka_lwr4plus": 15.0,
    "kinova_gen2": 5.5,
    "ur10": 28.0,
    "ur5e": 18.0,
    "staubli_tx40": 27.0,
    "franka_panda": 17.0,
    "xarm7": 13.0,
    "kuka_iiwa14": 30.0,
}
#: Seconds of motion and share of the fastest speed, by seed.
MOTIONS = ((12.0, 0.6), (20.0, 0.35), (30.0, 0.6), (40.0, 0.5))
HIDDEN = ("angle", "load", "ripple", "stribeck", "spring", "delay")
RATE = 200.0


@dataclass(frozen=True)
class Arm:
    """A true arm.

    Attributes:
        robot: its kinematics, without coupled motors.
        seed: of everything that is drawn.
        mass: of all links, about [kg].
    """

    robot: Robot
    seed: int
    mass: float

    @cached_property
    def truth(self):
        """True parameters by name, and Pinocchio's copy."""
        rng, n = np.random.default_rng(self.seed), self.robot.n
        weight = np.exp(-0.25 * np.arange(n) + 0.5 * rng.normal(size=n))
        masses = self.mass * np.exp(0.3 * rng.normal()) * weight / weight.sum()
        bodies = [self.lumps(rng, i, mass) for i, mass in enumerate(masses)]
        values = {}
        for i, body in enumerate(bodies, start=1):
            values |= zip(
                (f"{kind}{i}" for kind in BODY_PARAMETERS), body.parameters(), strict=True
            )
        plant = pinocchio_model(self.robot, bodies)
        size = float(np.abs(np.diag(pin.crba(plant, plant.createData(), np.zeros(n)))).mean())
        plant.armature = 0.15 * size * np.exp(0.9 * rng.normal(size=n))
        plant.armature = plant.armature * [joint.motor_inertia for joint in self.robot.joints]
        drawn = {
            "Im": plant.armature,
            "fc": 0.04 * self.rated * np.exp(0.5 * rng.normal(size=n)),
            "fv": 0.03 * self.rated * np.exp(0.6 * rng.normal(size=n)),
            "fo": 0.005 * self.rated * rng.normal(size=n),
        }
        for kind, v in drawn.items():
            values |= {f"{kind}{i + 1}": v[i] for i in range(n)}
        return values, plant

    def lumps(self, rng, i, mass):
        """Return a body of 3 to 11 balls scattered around the link's axis."""
        joint, start, end = self.robot.joints[i], np.zeros(3), np.zeros(3)
        if self.robot.convention == "standard":
            start = -joint.d * np.array([0, np.sin(joint.twist), np.cos(joint.twist)])
            start = start - [joint.a, 0, 0]
        else:
            after = self.robot.joints[i + 1].a if i + 1 < self.robot.n else 0.0
            end = np.array([after, 0, -joint.d])
        if np.linalg.norm(end - start) < 0.05:
            end = end + 0.06 * rng.normal(size=3)
        count = rng.integers(3, 12)
        places = start + rng.beta(0.8, 0.8, size=(count, 1)) * (end - start)
        places = places + rng.normal(size=(count, 3)) * rng.uniform(0.02, 0.07)
        parts = rng.dirichlet(np.full(count, 0.8)) * mass
        return lumped(parts, places, 0.4 * rng.uniform(0.015, 0.05) ** 2 * mass)

    @cached_property
    def rated(self):
        """Torques of the drives [N m]."""
        rated = [joint.limits.torque for joint in self.robot.joints]
        return np.array(rated) if all(rated) else 60.0 * np.exp(-0.45 * np.arange(self.robot.n))

    def motion(self, t, rng, share):
        """Return q, qd, qdd of five tones a joint inside the limits, (N, n) each."""
        found = []
        for joint in self.robot.joints:
            low, high = joint.limits.position or (-2.5, 2.5)
            speed = min(joint.limits.velocity or 1.5, 3.0)
            f = np.sort(rng.uniform(0.06, 0.7, 5))
            phase, size = rng.uniform(0, 7, 5), rng.uniform(0.4, 1, 5) / f**0.8
            one = np.hstack(tones(t, size[:, None], 2 * np.pi * f[:, None], phase[:, None]))
            reach, fastest, _ = np.abs(one).max(axis=0)
            one *= min(min(0.42 * (high - low), 1.7) / reach, share * speed / fastest)
            found.append(one + np.array([(low + high) / 2, 0.0, 0.0]))
        return tuple(np.moveaxis(found, (2, 1), (0, 1)))

    def log(self, seed, seconds, share, hidden=()):
        """Record a motion with white and coloured torque noise; what is hidden belongs to the arm."""
        rng, own = np.random.default_rng(seed), np.random.default_rng(self.seed + 1000)
        values, plant = self.truth
        n, t = self.robot.n, np.arange(0, seconds, 1 / RATE)
        q, qd, qdd = self.motion(t, rng, share)
        offset, size = own.normal(size=n), np.exp(0.4 * own.normal(size=(5, n)))
        phase = own.uniform(0, 7, (2, n))
        off = np.deg2rad(0.5) * offset if "angle" in hidden else 0.0
        rigid = pinocchio_torques(plant, q + off, qd, qdd)
        fv, fc, fo = (
            np.array([values[f"{kind}{i + 1}"] for i in range(n)]) for kind in ("fv", "fc", "fo")
        )
        sign = np.tanh(qd / 0.003)
        tau = rigid + fv * qd + fc * sign + fo
        extra = {
            "load": 0.05 * size[0] * np.abs(rigid) * sign,
            "ripple": 0.15
            * fc
            * (size[1] * np.cos(3 * q + phase[0]) + size[2] * sign * np.cos(2 * q + phase[1])),
            "stribeck": 0.4 * fc * size[3] * np.exp(-np.abs(qd) / 0.08) * sign,
            "spring": 0.4 * fc * size[4] * (q - q.mean(axis=0)),
        }
        tau = tau + sum(extra[name] for name in hidden if name in extra)
        if "delay" in hidden:
            tau = np.stack([np.interp(t - 0.004, t, column) for column in tau.T], axis=1)
        noise = 0.004 * self.rated * np.exp(0.2 * own.normal(size=n))
        coloured = lfilter([0.28], [1, -0.96], rng.normal(size=tau.shape), axis=0)
        tau = tau + noise * (rng.normal(size=tau.shape) + 0.3 * coloured)
        return Log(
            t, np.round(q / 2e-5) * 2e-5, tau, self.robot.joint_names, tau_unit="Nm", dh=True
        )


def judged(arm, seed, hidden):
    """Return share inside, median of |z|, torque error [%], true over expected error, and whether a residual model is on."""
    seconds, share = MOTIONS[seed % len(MOTIONS)]
    log, other = arm.log(seed, seconds, share, hidden), arm.log(seed + 500, 20.0, 0.5, hidden)
    result = identify(arm.robot, log, holdout=None, drop_weak=True)
    seen, values = validate(result, other), arm.truth[0]
    true = result.reduction.K @ np.array([values[name] for name in result.reduction.names])
    motion = arm.motion(np.linspace(0, 20, 400), np.random.default_rng(seed + 700), 0.5)
    torque = build_model(arm.robot).observer(result.reduction.base).torque
    z = np.abs(result.theta - true) / np.sqrt(np.diag(result.covariance))
    size, off = (np.linalg.norm(torque(each, *motion)) for each in (true, result.theta - true))
    ratio = seen.relative_error_percent / (seen.expected_percent or np.nan)
    on = result.model_error is not None
    return np.mean(z < 1.96), np.median(z), 100 * off / size, ratio, float(on)


def table(cases):
    """Return one table."""
    lines = []
    for name, found in [*cases.items(), ("all", [row for each in cases.values() for row in each])]:
        if not found:
            continue
        x = np.array(found)
        error = np.exp(np.log(x[:, 2]).mean())
        figures = (f"{y:.2f}" for y in (np.median(x[:, 1]), error, np.median(x[:, 3])))
        inside, on = f"{100 * x[:, 0].mean():.0f}", int(x[:, 4].sum())
        lines.append([name, len(x), inside, *figures, on])
    head = " | logs | inside [%] | median of z | torque error [%] | true / expected"
    return study.markdown(f"{head} | with residual model", lines)


def main():
    """Print the tables."""
    complete, hidden = {}, {}
    seeds = range(int(sys.argv[1]) if len(sys.argv) > 1 else len(MOTIONS))
    for name, mass in ARMS.items():
        robot = replace(load_robot(name), coupling=None)
        for seed in seeds:
            arm = Arm(robot, 100 + seed, mass)
            kinds = {(name,): name for name in HIDDEN if seed == 1}
            kinds["angle", "load", "ripple", "stribeck"] = "four of them"
            plan = [((), complete.setdefault(name, []))]
            plan += [(what, hidden.setdefault(kind, [])) for what, kind in kinds.items()]
            for what, found in plan:
                try:
                    found.append(judged(arm, seed, what))
                except DynidError as error:
                    print(f"{name} {seed} {what}: {error}", file=sys.stderr)
    said = f"Seeds 0 to {len(seeds) - 1} of each arm; errors are geometric means."
    print("# Arms with links of random lumps", said, "## Complete models", sep="\n\n")
    print("", table(complete), "", "## With hidden effects", "", table(hidden), sep="\n")


if __name__ == "__main__":
    main()
