"""Compare the estimators on a closed-loop simulated arm with BIRDy's noise levels.

    python benchmarks/estimators.py [--draws 10] [--regimes standard,high_position] [--seed 0]

The arm is the LWR of docs/explanation/estimators.md, moved for 10 s along a random Fourier reference by a PD controller
at 1 kHz whose feedback carries the encoder noise; the plant is Pinocchio's forward dynamics with four substeps. Printed
for each estimator: parameter error |db|/|b|, torque error on an unseen noise-free motion, share of true base
parameters inside their 95 % intervals, seconds.

Source: Leboutet et al. 2021, "Inertial parameter identification in robotics: a survey" (BIRDy): noise levels, filter.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from functools import cache

import numpy as np
import pinocchio as pin
from scipy import signal

from dynid.identify.consistent import complete
from dynid.identify.hac import hac_covariance
from dynid.identify.instrumental import instrumental
from dynid.identify.least_squares import ordinary, weighted
from dynid.identify.physics import BODY_PARAMETERS, body_parameters, make_physics, pseudo_inertia
from dynid.identify.robust import huber
from dynid.identify.rows import Rows, joint_factors
from dynid.model import build_model
from dynid.model.reduce import reduce
from dynid.quality.filters import decimate, lowpass_kernel
from dynid.robot import Body, Joint, Robot

TWIST = np.deg2rad([90, -90, -90, 90, 90, -90, 0])
OFFSET = np.array([0.31, 0, 0.4, 0, 0.39, 0, 0.078])
POSITION = np.deg2rad([170, 120, 170, 120, 170, 120, 170]) * 0.95
VELOCITY = np.deg2rad([110, 110, 128, 128, 204, 184, 184])
ACCELERATION = np.array([6.0, 6, 8, 8, 12, 12, 12])
KP = np.array([2000.0, 2000, 1500, 1500, 800, 500, 250])
KD = np.array([100.0, 100, 60, 60, 25, 15, 8])
ROTOR = np.array([0.3, 0.3, 0.2, 0.2, 0.1, 0.1, 0.05])
FRICTION = np.array([3.0, 3, 2, 2, 1, 1, 0.5])  # viscous and Coulomb alike
RATE, SECONDS, SUBSTEPS = 1000, 10, 2
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


@dataclass(frozen=True)
class Recording:
    """A simulated log at 1 kHz and the commanded motion."""

    q: np.ndarray
    tau: np.ndarray
    reference: tuple[np.ndarray, np.ndarray, np.ndarray]


@cache
def world():
    """Return the model, its reduction, the true parameters, the physics with prior, and Pinocchio's copy."""
    joints = tuple(
        Joint(f"joint{i + 1}", twist=TWIST[i], d=OFFSET[i], friction=("viscous", "coulomb")) for i in range(7)
    )
    model = build_model(Robot("LWR", "standard", joints))
    names, rng = model.parameter_names, np.random.default_rng(0)
    truth, prior = np.zeros(model.size), np.zeros(model.size)
    for i, mass in enumerate([2.9, 3.1, 2.9, 2.0, 2.0, 1.7, 0.27]):
        columns = [names.index(f"{p}{i + 1}") for p in BODY_PARAMETERS]
        stretch = np.eye(4) + rng.standard_normal((4, 4)) * np.array([[0.1, 0.1, 0.1, 0.02]] * 3 + [[0] * 4])
        truth[columns] = body_parameters(stretch @ pseudo_inertia(_cylinder(mass, i)) @ stretch.T)
        prior[columns] = _cylinder(mass * (1 + 0.2 * rng.standard_normal()), i)
        for kind, value in zip(("Im", "fv", "fc"), (ROTOR, FRICTION, FRICTION), strict=True):
            truth[names.index(f"{kind}{i + 1}")] = value[i]
    return model, reduce(model), truth, make_physics(names, prior), _plant(names, truth)


def _cylinder(mass: float, link: int, radius: float = 0.06) -> np.ndarray:
    length = max([0.31, 0.2, 0.2, 0.2, 0.19, 0.1, 0.08][link], 0.1)
    across = mass * (3 * radius**2 + length**2) / 12
    return Body(mass, (0, 0, -length / 2), (across, 0, 0, across, 0, mass * radius**2 / 2)).parameters()


def _plant(names, truth):
    plant, place, parent = pin.Model(), pin.SE3.Identity(), 0
    for i in range(7):
        parent = plant.addJoint(parent, pin.JointModelRZ(), place, f"joint{i}")
        lift = pin.SE3(pin.utils.rotate("x", TWIST[i]), np.array([0, 0, OFFSET[i]]))
        m, *rest = (truth[names.index(f"{p}{i + 1}")] for p in BODY_PARAMETERS)
        c, (xx, xy, xz, yy, yz, zz) = np.array(rest[:3]) / m, rest[3:]
        tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - m * (c @ c * np.eye(3) - np.outer(c, c))
        plant.appendBodyToJoint(parent, pin.Inertia(m, c, tensor), lift)
        place = lift
    plant.armature = truth[[names.index(f"Im{i + 1}") for i in range(7)]]
    return plant


def fourier(t: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Five harmonics of 0.1 Hz, scaled to the tightest limit of each joint."""
    rng, w = np.random.default_rng(seed), 0.2 * np.pi * np.arange(1, 6)
    a, b = rng.standard_normal((2, 5, 7)) / np.arange(1, 6)[:, None]
    sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    q, qd, qdd = sin @ a + cos @ b, (cos * w) @ a - (sin * w) @ b, -(sin * w**2) @ a - (cos * w**2) @ b
    q = q - (q.max(axis=0) + q.min(axis=0)) / 2
    limits = zip((q, qd, qdd), (POSITION, VELOCITY, ACCELERATION), strict=True)
    scale = np.min([limit / np.abs(x).max(axis=0) for x, limit in limits], axis=0)
    return q * scale, qd * scale, qdd * scale


@cache
def reference_seed() -> int:
    """Return the best of 60 random references by the condition number of the base regressor."""
    _, reduction, *_ = world()
    t = np.linspace(0, SECONDS, 200)
    conditions = [np.linalg.cond(base_regressor(*fourier(t, seed)).reshape(-1, reduction.rank)) for seed in range(60)]
    print(f"reference: condition number {min(conditions):.0f}")
    return int(np.argmin(conditions))


def base_regressor(q, qd, qdd) -> np.ndarray:
    model, reduction, *_ = world()
    return model.observer(reduction.base).dense(q, qd, qdd)


def simulate(regime: str, seed: int) -> Recording:
    """Move the arm along the reference and log what a driver would."""
    *_, plant = world()
    rng, scratch = np.random.default_rng(seed), plant.createData()
    reference = fourier(np.arange(SECONDS * RATE) / RATE, reference_seed())
    encoder, torque = REGIMES[regime]
    noise = np.deg2rad(encoder) * rng.standard_normal(reference[0].shape)
    q, qd = reference[0][0].copy(), reference[1][0].copy()
    smooth = np.exp(-2 * np.pi * 60 / RATE)
    seen, speed = q + noise[0], qd.copy()
    log_q, log_tau = np.empty_like(noise), np.empty_like(noise)
    dt = 1.0 / RATE / SUBSTEPS
    for k in range(len(noise)):
        new = q + noise[k]
        speed = smooth * speed + (1 - smooth) * (new - seen) * RATE if k else speed
        seen = new
        tau = KP * (reference[0][k] - seen) + KD * (reference[1][k] - speed)
        log_q[k], log_tau[k] = seen, tau
        for _ in range(SUBSTEPS):
            # Why the midpoint: with Euler's steps positions lag by half a step, which looks like viscous friction.
            half = 0.5 * dt * pin.aba(plant, scratch, q, qd, tau - FRICTION * (qd + np.tanh(qd / SLOPE)))
            q_mid, qd_mid = q + 0.5 * dt * qd, qd + half
            qdd = pin.aba(plant, scratch, q_mid, qd_mid, tau - FRICTION * (qd_mid + np.tanh(qd_mid / SLOPE)))
            q, qd = q + dt * qd_mid, qd + dt * qdd
    # The controller holds its torque from sample to sample: what acted on average around sample k is the mean of two.
    log_tau[1:] = 0.5 * (log_tau[1:] + log_tau[:-1])
    log_tau += torque * rng.standard_normal(log_tau.shape)
    if regime == "spikes":
        hit = rng.random(log_tau.shape) < 0.01
        log_tau += hit * 0.3 * np.abs(log_tau).max(axis=0) * rng.choice([-1, 1], log_tau.shape)
    return Recording(log_q, log_tau, reference)


def conditioned(recording: Recording, cutoff: float | None, factor: int, instruments: bool) -> Rows:
    """Zero-phase Butterworth on positions, central differences, parallel filter and decimation by ``factor``."""
    q = recording.q
    if cutoff is not None:
        q = signal.sosfiltfilt(signal.butter(4, cutoff / (RATE / 2), output="sos"), q, axis=0)
    qd = np.gradient(q, 1 / RATE, axis=0)
    qdd = np.gradient(qd, 1 / RATE, axis=0)
    inside = slice(100, -100)
    W = base_regressor(q[inside], qd[inside], qdd[inside])
    Z = base_regressor(*(x[inside] for x in recording.reference)) if instruments else None
    return Rows(*(None if x is None else _decimate(x, factor) for x in (W, recording.tau[inside], Z)))


def _decimate(x: np.ndarray, factor: int) -> np.ndarray:
    flat = x.reshape(len(x), -1)
    moving = np.flatnonzero(np.ptp(flat, axis=0) + np.abs(flat[0]))
    kernel = lowpass_kernel(0.4 * RATE / factor, RATE)[None]
    kept = decimate(np.ascontiguousarray(flat[:, moving].T), kernel, factor)[0].T
    out = np.zeros((len(kept), flat.shape[1]))
    out[:, moving] = kept
    return out.reshape(len(out), *x.shape[1:])


def estimate(method: str, segment: Rows) -> tuple[np.ndarray, np.ndarray]:
    """Return base parameters and their covariance, textbook for OLS, HAC otherwise."""
    if method.startswith("iv"):
        fit = instrumental([segment], robust="huber" in method)
        return fit.theta, fit.covariance
    if method == "ols":
        fit = ordinary(*joint_factors([segment]))
        return fit.theta, fit.covariance
    fit = weighted(*joint_factors([segment]))
    if method == "wls":
        return fit.theta, hac_covariance([segment], fit.theta, fit.noise).covariance
    robust = huber([segment], fit.theta)
    return robust.theta, hac_covariance([segment], robust.theta, robust.noise, robust=True).covariance


#: Name, estimator, cut-off of the position filter [Hz], decimation.
METHODS = (
    ("OLS 50 Hz (BIRDy)", "ols", 50.0, 2),
    ("WLS 50 Hz", "wls", 50.0, 2),
    ("WLS 20 Hz, x20", "wls", 20.0, 20),
    ("IRLS 20 Hz, x20", "irls", 20.0, 20),
    ("IV-ref 50 Hz", "iv", 50.0, 2),
    ("IV-ref 20 Hz, x20", "iv", 20.0, 20),
    ("IV-ref Huber 50 Hz", "iv huber", 50.0, 2),
    ("IV-ref Huber 20 Hz, x20", "iv huber", 20.0, 20),
)


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--draws", type=int, default=10)
    options.add_argument("--regimes", default=",".join(REGIMES))
    options.add_argument("--seed", type=int, default=0)
    given = options.parse_args()
    _, reduction, truth, physics, _ = world()
    beta = reduction.K @ truth
    heldout = fourier(np.linspace(0, SECONDS, 500), 10_000)
    W, unseen = base_regressor(*heldout), base_regressor(*heldout) @ beta
    print("parameter / held-out torque error [%], inside the 95 % interval [%], seconds; errors of the entropic set")
    for regime in given.regimes.split(","):
        start = time.perf_counter()
        recordings = [simulate(regime, given.seed + draw) for draw in range(given.draws)]
        print(f"\n{regime}: {given.draws} draws, simulated in {time.perf_counter() - start:.0f} s")
        for name, method, cutoff, factor in METHODS:
            rows = []
            for recording in recordings:
                start = time.perf_counter()
                theta, covariance = estimate(method, conditioned(recording, cutoff, factor, method.startswith("iv")))
                seconds = time.perf_counter() - start
                inside = 100 * np.mean(np.abs(theta - beta) <= 1.96 * np.sqrt(np.diagonal(covariance)))
                whole = reduction.K @ complete(reduction.K, theta, covariance, physics, exact=False).fit.x
                plain, physical = (_errors(one, beta, W, unseen) for one in (theta, whole))
                rows.append([*plain, inside, seconds, *physical])
            a, b, c, s, d, e = np.mean(rows, axis=0)
            print(f"  {name:24s} {a:8.3f} / {b:7.3f}   {c:5.1f}   {s:4.1f} s      {d:8.3f} / {e:7.3f}", flush=True)


def _errors(theta, beta, W, unseen) -> tuple[float, float]:
    relative = 100 * np.linalg.norm(theta - beta) / np.linalg.norm(beta)
    return float(relative), float(100 * np.linalg.norm(W @ theta - unseen) / np.linalg.norm(unseen))


if __name__ == "__main__":
    main()
