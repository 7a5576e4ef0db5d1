"""Compare the estimators on closed-loop simulated arms with BIRDy's noise levels.

    python benchmarks/estimators.py [--json out/estimators.json] [--minutes 20] [--table]

What is done is kept in the JSON file, and the next run goes on from there; --table only prints Markdown. For each estimator:
parameter error |db|/|b|, BIRDy's d_beta, torque error on the fitted motion (d_tau) and on an unseen noise-free one, the
share of true base parameters inside their 95 % intervals, seconds; errors of the physical set.

Source: Leboutet et al. 2021, "Inertial parameter identification in robotics: a survey" (BIRDy): noise levels, figures.
"""

import argparse
import json
import time
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import numpy as np
import pinocchio as pin
from scipy import signal

import of_tests  # noqa: F401
from arms import cylinder, pinocchio_model
from dynid.estimation.estimators import METHODS, choose
from dynid.estimation.least_squares import ordinary, relative_error
from dynid.estimation.possible_set import body_parameters, pseudo_inertia
from dynid.estimation.posterior import physical_posterior
from dynid.estimation.rows import Rows
from dynid.estimation.stack import stack_logs
from dynid.files.robotfile import load_robot
from dynid.log import Log
from dynid.model.base_model import BaseModel, prior_base_parameters
from dynid.model.parameters import body_of, columns_of
from dynid.model.regressor import prior_vector
from dynid.robot import Joint, Limits, Prior, Robot
from dynid.signals.conditioned_log import ConditionedLog, condition
from dynid.signals.filters import choose_filter, despiked
from models import base_of
from motions import harmonics, inside
from synthetic_arm import LIMITS, MASS, OFFSET, TWIST

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
FIGURES = (
    "error",
    "d_beta",
    "d_tau",
    "unseen",
    "inside",
    "seconds",
    "physical_error",
    "physical_unseen",
)
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


@cache
def arm_of(name):
    """Return ``lwr`` or ``tx40``, with the best of 60 random commands by condition number."""
    arm = _lwr() if name == "lwr" else _tx40()
    t, reduction = np.linspace(0, SECONDS, 200), arm.base.reduction
    observer = arm.base.model.observer(reduction.base)
    conditions = [
        np.linalg.cond(
            observer.dense(*command(replace(arm, seed=s), t)).reshape(-1, reduction.rank)
        )
        for s in range(60)
    ]
    return replace(arm, seed=int(np.argmin(conditions)))


def _lwr():
    rows = zip(TWIST, OFFSET, LIMITS.T, strict=True)
    joints = tuple(
        Joint(
            f"joint{i}",
            twist=twist,
            d=d,
            friction=("viscous", "coulomb"),
            limits=Limits((-reach, reach), speed, acceleration),
        )
        for i, (twist, d, (reach, speed, acceleration)) in enumerate(rows, start=1)
    )
    gains = np.array([[2000.0, 2000, 1500, 1500, 800, 500, 250], [100, 100, 60, 60, 25, 15, 8]])
    friction = np.array([3.0, 3, 2, 2, 1, 1, 0.5])
    length = [0.31, 0.2, 0.2, 0.2, 0.19, 0.1, 0.1]
    robot = Robot("LWR", "standard", joints)
    rotor = [0.3, 0.3, 0.2, 0.2, 0.1, 0.1, 0.05]
    return _made(robot, MASS, length, rotor, friction, friction, gains, 1000, 60.0, 5)


def _tx40():
    """BIRDy names no centres of mass that are at hand: cylinders of its masses, bent and stretched like the LWR's."""
    shipped = load_robot("staubli_tx40")
    joints = tuple(
        replace(
            j,
            friction=("viscous", "coulomb"),
            limits=replace(j.limits, acceleration=4 * j.limits.velocity),
        )
        for j in shipped.joints
    )
    ktau = np.array([35.24, 32.04, 23.94, 9.05, 15.5, 6.56])
    kp = 0.75 * np.array([455.8, 500, 253.8, 200.2, 244.3, 478.5]) * ktau
    kd = np.array([2.54, 4.12, 1.18, 0.546, 0.571, 0.195]) * ktau
    robot = Robot("TX40", "modified", joints)
    rotor = [0.362, 0.507, 0.0829, 0.0341, 0.0361, 0.0114]
    viscous, coulomb = [7.94, 5.69, 1.98, 1.11, 1.60, 0.69], [6.98, 7.83, 6.19, 2.41, 3.41, 1.83]
    length = [0.3, 0.225, 0.2, 0.2, 0.1, 0.1]
    masses = [8.61, 4.85, 4.07, 3.62, 1.02, 0.2]
    friction = np.array(viscous), np.array(coulomb)
    gains = np.array([kp, kd])
    return _made(robot, masses, length, rotor, *friction, gains, 5000, 0.0, 20)


def _made(robot, masses, length, rotor, viscous, coulomb, gains, rate, smooth, harmonics):
    rng, true, believed = np.random.default_rng(0), [], []
    for mass, long in zip(masses, length, strict=True):
        stretch = np.eye(4) + rng.standard_normal((4, 4)) * np.array(
            [[0.1, 0.1, 0.1, 0.02]] * 3 + [[0] * 4]
        )
        bent = stretch @ pseudo_inertia(cylinder(mass, long)) @ stretch.T
        true.append(body_of(body_parameters(bent)))
        believed.append(body_of(cylinder(mass * (1 + 0.2 * rng.standard_normal()), long)))
    base = base_of(replace(robot, prior=Prior(links=tuple(believed))))
    known = replace(base.model, robot=replace(robot, prior=Prior(links=tuple(true))))
    gamma = prior_vector(known)
    for kind, drive in (("Im", rotor), ("fv", viscous), ("fc", coulomb)):
        gamma[columns_of(known.parameters, kind)] = drive
    beta, plant = base.reduction.K @ gamma, pinocchio_model(robot, true, rotor)
    return Arm(base, beta, plant, viscous, coulomb, gains, rate, smooth, harmonics)


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
    reference = command(arm, t)
    seen, tau = _driven(
        arm, reference, np.deg2rad(encoder) * rng.standard_normal(reference[0].shape)
    )
    # A torque is held from its sample to the next; what acted on average around a sample has half of either end.
    weights = np.ones(every + 1) if every > 1 else np.ones(2)
    weights[0] = weights[-1] = 0.5
    start = len(weights) // 2
    padded = np.concatenate(
        [np.repeat(tau[:1], start, axis=0), tau, np.repeat(tau[-1:], len(weights), axis=0)]
    )
    windows = np.lib.stride_tricks.sliding_window_view(padded, len(weights), axis=0)[::every][
        : SECONDS * LOGGED
    ]
    measured = windows @ weights / weights.sum() + torque * rng.standard_normal(
        (SECONDS * LOGGED, arm.robot.n)
    )
    if regime == "spikes":
        hit = rng.random(measured.shape) < 0.01
        measured += hit * 0.3 * np.abs(measured).max(axis=0) * rng.choice([-1, 1], measured.shape)
    return Log(
        t[::every],
        seen[::every],
        measured,
        arm.robot.joint_names,
        tau_unit="Nm",
        dh=True,
        extra={"q_ref": reference[0][::every]},
    )


def _driven(arm, reference, noise):
    """Return measured positions and drive torques at the controller's rate."""
    plant, scratch, dt = arm.plant, arm.plant.createData(), 1.0 / arm.rate
    kp, kd = arm.gains
    keep = np.exp(-2 * np.pi * arm.smooth * dt) if arm.smooth else 0.0
    substeps = 2 if arm.rate == 1000 else 1
    h = dt / substeps
    q, qd = reference[0][0].copy(), reference[1][0].copy()
    seen, tau, speed = np.empty_like(noise), np.empty_like(noise), qd.copy()
    for k in range(len(noise)):
        seen[k] = q + noise[k]
        if k:
            speed = keep * speed + (1 - keep) * (seen[k] - seen[k - 1]) / dt
        u = tau[k] = kp * (reference[0][k] - seen[k]) + kd * (reference[1][k] - speed)
        for _ in range(substeps):
            # Why the midpoint: with Euler's steps positions lag by half a step, which looks like viscous friction.
            mid = qd + 0.5 * h * pin.aba(
                plant, scratch, q, qd, u - arm.viscous * qd - arm.coulomb * np.tanh(qd / SLOPE)
            )
            drive = u - arm.viscous * mid - arm.coulomb * np.tanh(mid / SLOPE)
            qdd = pin.aba(plant, scratch, q + 0.5 * h * qd, mid, drive)
            q, qd = q + h * mid, qd + h * qdd
    return seen, tau


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
    chosen = choose_filter(log, arm.robot)
    segments = condition(despiked(log, chosen.cutoff)[0], chosen, coulomb=arm.robot.coulomb_shape)
    rows = stack_logs([ConditionedLog(segments, chosen, "log")], arm.base)
    made = time.perf_counter() - start
    prior = prior_base_parameters(arm.base.model, arm.base.reduction)
    found = {"OLS 50 Hz": butterworth(arm, log)}
    for method in PLAIN:
        start = time.perf_counter()
        each = METHODS[method](replace(rows), prior)
        seconds = made + time.perf_counter() - start
        again = partial(METHODS[method], prior=prior)
        whole = physical_posterior(arm.base, each, rows, refit=again, residual_model=False).theta
        fitted = relative_error(rows.whole[0], each.theta)
        found[method] = figures(arm, each.theta, each.covariance, fitted, seconds, whole)
    found["auto"] = found[choose(rows)[0]]
    return found


def butterworth(arm, log):
    """Return the figures of BIRDy's recipe: 50 Hz on positions, no filter on torques, textbook errors."""
    start = time.perf_counter()
    q = signal.sosfiltfilt(signal.butter(4, 50 / (LOGGED / 2), output="sos"), log.q, axis=0)
    qd = np.gradient(q, 1 / LOGGED, axis=0)
    qdd = np.gradient(qd, 1 / LOGGED, axis=0)
    inside = slice(50, -50)
    W = arm.base.model.observer(arm.base.reduction.base).dense(q[inside], qd[inside], qdd[inside])
    rows = Rows.of(W, log.tau[inside])
    fit = ordinary(rows.factors(), rows.counts)
    seconds, fitted = time.perf_counter() - start, relative_error(fit.factors, fit.theta)
    return figures(arm, fit.theta, fit.covariance, fitted, seconds, fit.theta)


def figures(arm, theta, covariance, fitted, seconds, whole):
    """Return the figures of merit of one estimate, in the order of ``FIGURES``."""
    beta = arm.beta
    inside = np.abs(theta - beta) <= 1.96 * np.sqrt(np.diagonal(covariance))
    d_beta = 200 * np.mean(np.abs(theta - beta) / (np.abs(beta) + np.abs(theta)))
    W = arm.base.model.observer(arm.base.reduction.base).dense(
        *command(arm, np.linspace(0, SECONDS, 500), 10_000)
    )

    def off(one):
        return 100 * np.linalg.norm(one - beta) / np.linalg.norm(beta), 100 * np.linalg.norm(
            W @ (one - beta)
        ) / np.linalg.norm(W @ beta)

    (error, unseen), (physical, of_physical) = off(theta), off(whole)
    return [
        float(x)
        for x in (
            error,
            d_beta,
            fitted,
            unseen,
            100 * inside.mean(),
            seconds,
            physical,
            of_physical,
        )
    ]


def tables(done):
    """Yield Markdown: errors of each arm, share of true values inside the intervals, and seconds."""
    names = {name: done_of(done, name) for name in ("lwr", "tx40")}
    for name, regimes in names.items():
        shown = ("OLS 50 Hz", *PLAIN)
        yield (
            f"\n| {name.upper()}: parameters / unseen torque [%] | asked | "
            + " | ".join(shown)
            + " | physical set |"
        )
        yield "| --- " * (len(shown) + 3) + "|"
        for regime, runs in regimes.items():
            cells = [cell(runs, method) for method in shown]
            physical = np.mean([found["auto"][6:8] for found in runs], axis=0)
            asked = f"{TARGETS[regime]} %" if regime in TARGETS else "-"
            yield (
                f"| {titled(regime, runs)} | {asked} | "
                + " | ".join([*cells, two(*physical)])
                + " |"
            )
    yield ("\n| inside the 95 % interval [%] | OLS 50 Hz (textbook) | " + " | ".join(PLAIN) + " |")
    yield "| --- " * (len(PLAIN) + 2) + "|"
    for name, regimes in names.items():
        for regime, runs in regimes.items():
            cells = [cell(runs, method, inside=True) for method in ("OLS 50 Hz", *PLAIN)]
            yield f"| {name.upper()}, {titled(regime, runs)} | " + " | ".join(cells) + " |"
    yield "\n| seconds, conditioning included | " + " | ".join(PLAIN) + " |"
    yield "| --- " * (len(PLAIN) + 1) + "|"
    for name, regimes in names.items():
        runs = [found for some in regimes.values() for found in some]
        times = [
            np.median([found[method][5] for found in runs if method in found]) for method in PLAIN
        ]
        yield f"| {name.upper()} | " + " | ".join(f"{t:.2f}" for t in times) + " |"


def done_of(done, name):
    """Return the runs of each regime of an arm."""
    runs = {
        regime: [v for key, v in done.items() if key.startswith(f"{name}/{regime}/")]
        for regime in REGIMES
    }
    return {regime: some for regime, some in runs.items() if some}


def titled(regime, runs):
    return f"{regime.replace('_', ' ')} ({len(runs)})"


def two(error, unseen):
    return f"{error:.3f} / {unseen:.3f}" if error < 1 else f"{error:.1f} / {unseen:.1f}"


def cell(runs, method, *, inside=False):
    """Return the mean figures of a method; how many draws where not all have it."""
    rows = [found[method] for found in runs if method in found]
    if not rows:
        return "-"
    mean = np.mean(rows, axis=0)
    few = f" ({len(rows)})" if len(rows) < len(runs) else ""
    return (f"{mean[4]:.1f}" if inside else two(mean[0], mean[3])) + few


def main():
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--json", type=Path, default=Path("out/estimators.json"))
    options.add_argument("--minutes", type=float, default=25.0)
    options.add_argument("--table", action="store_true")
    given = options.parse_args()
    done = json.loads(given.json.read_text()) if given.json.exists() else {}
    begin = time.monotonic()
    for job in () if given.table else jobs():
        key = "/".join(map(str, job))
        if key in done:
            continue
        if time.monotonic() - begin > 60 * given.minutes:
            break
        done[key] = one(*job)
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(done))
    print(*tables(done), sep="\n")


if __name__ == "__main__":
    main()
