"""A two-link arm in a vertical plane, written out as in every textbook: logs whose torques are not made by dynid."""

from pathlib import Path

import numpy as np

from dynid import Log
from dynid.files.robotfile import parse_robot
from motions import tones

ROBOT = """\
name: arm
convention: standard
gravity: [0, -9.81, 0]
joints:
  - {name: shoulder, a: 0.4, limits: {position: [-3, 3], velocity: 4, torque: 60}, friction: [viscous, coulomb]}
  - {name: elbow, a: 0.3, limits: {position: [-3, 3], velocity: 5, torque: 30}, friction: [viscous, coulomb]}
"""
LENGTH, GRAVITY = 0.4, 9.81
MASS, COM, INERTIA = (3.0, 2.0), (0.2, 0.15), (0.05, 0.03)
VISCOUS, COULOMB = (0.8, 0.5), (0.6, 0.3)
#: Speed below which friction changes its sign smoothly [rad/s], as in the robot file.
SMOOTH = 0.01


def robot():
    return parse_robot(ROBOT, Path("arm.yaml"))


def torque(q, qd, qdd):
    """Joint torques of the two-link arm, (N, 2) [N m]."""
    (m1, m2), (r1, r2), (i1, i2) = MASS, COM, INERTIA
    cosine, sine = np.cos(q[:, 1]), np.sin(q[:, 1])
    h = m2 * LENGTH * r2 * cosine
    m22 = m2 * r2**2 + i2
    m12 = m22 + h
    m11 = m1 * r1**2 + i1 + m2 * LENGTH**2 + m22 + 2 * h
    coriolis = m2 * LENGTH * r2 * sine
    g2 = m2 * r2 * GRAVITY * np.cos(q[:, 0] + q[:, 1])
    g1 = (m1 * r1 + m2 * LENGTH) * GRAVITY * np.cos(q[:, 0]) + g2
    tau1 = (
        m11 * qdd[:, 0]
        + m12 * qdd[:, 1]
        - coriolis * (2 * qd[:, 0] * qd[:, 1] + qd[:, 1] ** 2)
        + g1
    )
    tau2 = m12 * qdd[:, 0] + m22 * qdd[:, 1] + coriolis * qd[:, 0] ** 2 + g2
    friction = np.array(VISCOUS) * qd + np.array(COULOMB) * np.tanh(qd / SMOOTH)
    return np.column_stack([tau1, tau2]) + friction


def motion(seed, seconds=20.0, rate=100.0):
    """A motion of five sines a joint: t, q, qd, qdd."""
    t, k = np.arange(0, seconds, 1 / rate), np.arange(1, 6)[:, None]
    size, phase = np.random.default_rng(seed).uniform((0.5, 0), (1, 2 * np.pi), (2, 5, 2)).T
    return t, *tones(t, 0.9 * size / k, 0.24 * np.pi * k, phase)


def log(seed, noise=0.02, scale=(1.0, 1.0), draw=None):
    """A log of the motion of a seed: ``scale`` is that of each joint's torque, ``draw`` the seed of the noise."""
    t, q, qd, qdd = motion(seed)
    random = np.random.default_rng(seed + 100 if draw is None else draw)
    tau = (torque(q, qd, qdd) + noise * random.standard_normal(q.shape)) * np.array(scale)
    return Log(t=t, q=q, tau=tau, names=("shoulder", "elbow"))


def write_log(path, seed, change=None, **options):
    """Write a CSV log with a little sensor noise; ``change`` spoils the columns t, q, qd, tau first."""
    t, q, qd, qdd = motion(seed, **options)
    noise = 0.02 * np.random.default_rng(seed + 100).standard_normal(q.shape)
    columns = {"t": t, "q": q, "qd": qd, "tau": torque(q, qd, qdd) + noise}
    if change is not None:
        columns = change(columns) or columns
    kinds = ("q", "qd", "tau")
    names = ["t", *(f"{kind}_{joint}" for kind in kinds for joint in ("shoulder", "elbow"))]
    table = np.column_stack([columns["t"], *(columns[kind] for kind in kinds)])
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")


def write_arm(folder, text=ROBOT):
    """Write arm.yaml, log.csv and unseen.csv."""
    (folder / "arm.yaml").write_text(text)
    write_log(folder / "log.csv", seed=1)
    write_log(folder / "unseen.csv", seed=2)
