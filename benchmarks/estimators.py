"""Compare the estimators on closed-loop simulated arms with BIRDy's noise levels.

    python benchmarks/estimators.py [--json out/estimators.json] [--minutes 20] [--table]

What is done is kept in the JSON file, and the next run goes on from there; --table only prints Markdown. For each estimator:
parameter error |db|/|b|, torque error on an unseen noise-free motion, the share of true base parameters inside their 95 % intervals, seconds; errors of the physical set.

Source: Leboutet et al. 2021, "Inertial parameter identification in robotics: a survey" (BIRDy): noise levels, figures.
"""

import time
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy import signal

import study
from arms import cylinder, pinocchio_model
from dynid import BaseModel, Log, Motion, Robot, load_robot
from dynid.estimation.estimators import choose
from dynid.estimation.estimators import fitted as estimated
from dynid.estimation.least_squares import ordinary
from dynid.estimation.possible_set import body_parameters, pseudo_inertia
from dynid.estimation.posterior import physical_posterior
from dynid.estimation.rows import Rows
from dynid.estimation.stack import stack_logs
from dynid.model.parameters import body_of, columns_of
from dynid.model.regressor import prior_vector
from dynid.robot import Prior
from dynid.signals.conditioned_log import condition_logs
from follower import follow_motion
from models import base_of
from motions import harmonics, inside
from synthetic_arm import MASS, ROBOT, SHAPE

SECONDS, LOGGED = 10, 1000
SLOPE = 0.01  # Coulomb friction is fc tanh(qd / SLOPE)
#: Encoder noise [deg] and torque noise [N m].
REGIMES = {
    "low_position": (1e-4, 0.05),
    "standard": (1e-3, 0.05),
    "high_torque": (1e-3, 0.1),
    "high_position": (1e-2, 0.05),
    "high_both": (1e-2, 0.1),
    "spikes": (1e-3, 0.05),
    "lwr_like": (1e-3, np.array([0.5, 0.5, 0.3, 0.3, 0.15, 0.1, 0.06])),
}
PLAIN = ("ols", "wls", "irls", "iv")
#: Draws of each regime; more where the coverage of the intervals is counted.
DRAWS, COUNTED, OF_TX40 = 10, 40, 10
COVERAGE = ("standard", "lwr_like", "high_position")
#: Largest parameter error that is asked for [%].
TARGETS = {
    "low_position": 0.5,
    "standard": 0.5,
    "high_torque": 0.5,
    "high_position": 1.5,
    "high_both": 1.5,
    "spikes": 0.6,
}


@dataclass(frozen=True)
class Arm:
    """A true arm and how it is driven.

    Attributes:
        base: model and base parameters of its robot, whose prior is wrong by 20 %.
        beta: true base parameters, (p,).
        plant: Pinocchio's copy.
        viscous: (n,).
        coulomb: (n,).
        gains: stiffness and damping of the position controller, (2, n).
        rate: of the controller [Hz]; a multiple of that of the log.
        smooth: cut-off of the controller's velocity [Hz], 0 for plain differences.
        harmonics: of 0.1 Hz in the command.
        seed: of the command.
    """

    base: BaseModel
    beta: np.ndarray
    plant: pin.Model
    viscous: np.ndarray
    coulomb: np.ndarray
    gains: np.ndarray
    rate: int
    smooth: float
    harmonics: int
    seed: int = 0

    @property
    def robot(self):
        return self.base.robot

    def friction(self, qd):
        return self.viscous * qd + self.coulomb * np.tanh(qd / SLOPE)

    def torques(self, theta, motion):
        """Return what parameters say of the drives on a motion, (N n,)."""
        dense = self.base.observer.dense(*motion)
        return dense.reshape(-1, len(self.beta)) @ theta


@cache
def arm_of(name):
    """Return ``lwr`` or ``tx40``, with the best of 60 random commands by condition number."""
    arm = _lwr() if name == "lwr" else _tx40()
    t, p = np.linspace(0, SECONDS, 200), np.eye(len(arm.beta))
    commands = (command(replace(arm, seed=seed), t) for seed in range(60))
    conditions = [np.linalg.cond(arm.torques(p, each)) for each in commands]
    return replace(arm, seed=int(np.argmin(conditions)))


def _lwr():
    gains = np.array([[2000.0, 2000, 1500, 1500, 800, 500, 250], [100, 100, 60, 60, 25, 15, 8]])
    friction = np.array([3.0, 3, 2, 2, 1, 1, 0.5])
    length = [0.31, 0.2, 0.2, 0.2, 0.19, 0.1, 0.1]
    return _made(ROBOT, MASS, length, friction / 10, friction, friction, gains, 1000, 60.0, 5)


def _tx40():
    """BIRDy names no centres of mass that are at hand: cylinders of its masses, bent and stretched like the LWR's."""
    joints = tuple(
        replace(j, limits=replace(j.limits, acceleration=4 * j.limits.velocity))
        for j in load_robot("staubli_tx40").joints
    )
    ktau = np.array([35.24, 32.04, 23.94, 9.05, 15.5, 6.56])
    kp = 0.75 * np.array([455.8, 500, 253.8, 200.2, 244.3, 478.5]) * ktau
    kd = np.array([2.54, 4.12, 1.18, 0.546, 0.571, 0.195]) * ktau
    robot = Robot("TX40", "modified", joints)
    rotor = [0.362, 0.507, 0.0829, 0.0341, 0.0361, 0.0114]
    viscous, coulomb = np.array(
        [[7.94, 5.69, 1.98, 1.11, 1.60, 0.69], [6.98, 7.83, 6.19, 2.41, 3.41, 1.83]]
    )
    length = [0.3, 0.225, 0.2, 0.2, 0.1, 0.1]
    masses = [8.61, 4.85, 4.07, 3.62, 1.02, 0.2]
    gains = np.array([kp, kd])
    return _made(robot, masses, length, rotor, viscous, coulomb, gains, 5000, 0.0, 20)


def _made(robot, masses, length, rotor, viscous, coulomb, *drive):
    rng, true, believed = np.random.default_rng(0), [], []
    for mass, long in zip(masses, length, strict=True):
        stretch = np.eye(4) + rng.standard_normal((4, 4)) * SHAPE
        bent = stretch @ pseudo_inertia(cylinder(mass, long)) @ stretch.T
        true.append(body_of(body_parameters(bent)))
        believed.append(body_of(cylinder(mass * (1 + 0.2 * rng.standard_normal()), long)))
    joints = tuple(replace(j, friction=("viscous", "coulomb")) for j in robot.joints)
    robot = replace(robot, joints=joints)
    base = base_of(replace(robot, prior=Prior(links=tuple(believed))))
    known = replace(base.model, robot=replace(robot, prior=Prior(links=tuple(true))))
    gamma = prior_vector(known)
    for kind, values in (("Im", rotor), ("fv", viscous), ("fc", coulomb)):
        gamma[columns_of(known.parameters, kind)] = values
    beta, plant = base.reduction.K @ gamma, pinocchio_model(robot, true, rotor)
    return Arm(base, beta, plant, viscous, coulomb, *drive)


def command(arm, t, seed=None):
    """Return a random Fourier motion, scaled to the tightest limit of each joint."""
    rng, orders = np.random.default_rng(arm.seed if seed is None else seed), arm.harmonics
    drawn = rng.standard_normal((2, orders, arm.robot.n)) / np.arange(1, orders + 1)[:, None]
    limits = [
        (joint.limits.position[1], joint.limits.velocity, joint.limits.acceleration)
        for joint in arm.robot.joints
    ]
    return inside(*harmonics(t, *drawn), *np.array(limits).T)


def recorded(name, regime, seed):
    """Move an arm along its command and log what a driver would."""
    arm = arm_of(name)
    encoder, torque = REGIMES[regime]
    if np.ndim(torque):
        torque = torque[: arm.robot.n]
    rng = np.random.default_rng(seed)
    every = arm.rate // LOGGED
    t = np.arange(SECONDS * arm.rate) / arm.rate
    reference = Motion(t, *command(arm, t))
    noise = np.deg2rad(encoder) * rng.standard_normal(reference.q.shape)
    substeps = 2 if arm.rate == 1000 else 1
    seen, tau = follow_motion(
        *(arm.plant, arm.friction, reference, arm.gains, noise),
        smooth=arm.smooth,
        substeps=substeps,
    )
    # A torque is held from its sample to the next; what acted on average around a sample has half of either end.
    weights = np.ones(every + 1)
    weights[0] = weights[-1] = 0.5
    padded = np.pad(tau, ((len(weights) // 2, len(weights)), (0, 0)), mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, len(weights), axis=0)[::every]
    measured = windows[: SECONDS * LOGGED] @ weights / weights.sum()
    measured += torque * rng.standard_normal(measured.shape)
    if regime == "spikes":
        hit = rng.random(measured.shape) < 0.01
        measured += hit * 0.3 * np.abs(measured).max(axis=0) * rng.choice([-1, 1], measured.shape)
    log = Log(t[::every], seen[::every], measured, arm.robot.joint_names, tau_unit="Nm", dh=True)
    return replace(log, extra={"q_ref": reference.q[::every]})


def jobs():
    """Yield arm, regime and draw, the first draws of everything first."""
    for draw in range(COUNTED):
        for regime in REGIMES:
            if draw < DRAWS or regime in COVERAGE:
                yield "lwr", regime, draw
            if draw < OF_TX40 and regime != "lwr_like":
                yield "tx40", regime, draw


def one(name, regime, draw):
    """Return the figures of all estimators on one log."""
    arm, log = arm_of(name), recorded(name, regime, draw)
    start = time.perf_counter()
    rows = stack_logs(condition_logs([log], arm.base.model), arm.base)
    made = time.perf_counter() - start
    found = {"OLS 50 Hz": butterworth(arm, log)}
    for method in PLAIN:
        start = time.perf_counter()
        each = estimated(replace(rows), method)
        seconds = made + time.perf_counter() - start
        whole = physical_posterior(each, rows, residual_model=False).theta
        found[method] = figures(arm, each.theta, each.covariance, seconds, whole)
    found["auto"] = found[choose(rows)[0]]
    return found


def butterworth(arm, log):
    """Return the figures of BIRDy's recipe: 50 Hz on positions, no filter on torques, textbook errors."""
    start = time.perf_counter()
    q = signal.sosfiltfilt(signal.butter(4, 50 / (LOGGED / 2), output="sos"), log.q, axis=0)
    qd = np.gradient(q, 1 / LOGGED, axis=0)
    motion = (x[50:-50] for x in (q, qd, np.gradient(qd, 1 / LOGGED, axis=0)))
    observer = arm.base.observer
    rows = Rows.of(observer.dense(*motion), log.tau[50:-50])
    fit = ordinary(rows.factors(), rows.counts)
    return figures(arm, fit.theta, fit.covariance, time.perf_counter() - start, fit.theta)


def figures(arm, theta, covariance, seconds, whole):
    """Return what is wrong with one estimate, as listed on top; of the physical set the error, and that on the unseen motion."""
    beta, unseen = arm.beta, command(arm, np.linspace(0, SECONDS, 500), 10_000)
    inside = np.abs(theta - beta) <= 1.96 * np.sqrt(np.diagonal(covariance))

    def off(one):
        of_torque = arm.torques(one - beta, unseen), arm.torques(beta, unseen)
        return [
            100 * np.linalg.norm(away) / np.linalg.norm(true)
            for away, true in ((one - beta, beta), of_torque)
        ]

    error, of_unseen = off(theta)
    found = (error, of_unseen, 100 * inside.mean(), seconds, *off(whole))
    return [float(x) for x in found]


def tables(done):
    """Yield Markdown: errors of each arm, share of true values inside the intervals, and seconds."""
    runs = {
        (name, regime): some
        for name in ("lwr", "tx40")
        for regime in REGIMES
        if (some := [done[key] for key in done if key.startswith(f"{name}/{regime}/")])
    }
    shown, heads = ("OLS 50 Hz", *PLAIN), " | ".join(PLAIN)
    inside, times = [], []
    for arm in ("lwr", "tx40"):
        rows, every = [], []
        for (name, regime), some in runs.items():
            if name == arm:
                title = f"{regime.replace('_', ' ')} ({len(some)})"
                target = f"{TARGETS[regime]} %" if regime in TARGETS else "-"
                physical = two(*np.mean([found["auto"][4:] for found in some], axis=0))
                cells = (cell(some, method) for method in shown)
                rows.append([title, target, *cells, physical])
                cells = (cell(some, method, inside=True) for method in shown)
                inside.append([f"{arm.upper()}, {title}", *cells])
                every += some
        head = f"{arm.upper()}: parameters / unseen torque [%] | asked | OLS 50 Hz | {heads}"
        yield "\n" + study.markdown(f"{head} | physical set", rows)
        seconds = ([found[method][3] for found in every if method in found] for method in PLAIN)
        times.append([arm.upper(), *(f"{np.median(each or np.nan):.2f}" for each in seconds)])
    head = "inside the 95 % interval [%] | OLS 50 Hz (textbook)"
    yield "\n" + study.markdown(f"{head} | {heads}", inside)
    yield "\n" + study.markdown(f"seconds, conditioning included | {heads}", times)


def two(error, unseen):
    return f"{error:.3f} / {unseen:.3f}" if error < 1 else f"{error:.1f} / {unseen:.1f}"


def cell(runs, method, *, inside=False):
    """Return the mean figures of a method; how many draws where not all have it."""
    rows = [found[method] for found in runs if method in found]
    if not rows:
        return "-"
    mean = np.mean(rows, axis=0)
    few = f" ({len(rows)})" if len(rows) < len(runs) else ""
    return (f"{mean[2]:.1f}" if inside else two(*mean[:2])) + few


def main():
    kept = Path("out/estimators.json")
    given = study.arguments(__doc__, json=kept, minutes=25.0, table=False)
    done, end = study.Answers(given.json), time.monotonic() + 60 * given.minutes
    for job in () if given.table else jobs():
        if (key := "/".join(map(str, job))) not in done:
            if time.monotonic() > end:
                break
            done.keep(key, one(*job))
    print(*tables(done), sep="\n")


if __name__ == "__main__":
    main()
