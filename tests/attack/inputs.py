"""A small arm with a log of every format and results, from which broken inputs are made."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np

from dynid.files.convert import write_bag, write_log
from dynid.log import Log

ROBOT = """name: swing
convention: standard
angle_unit: rad
gravity: [0, -9.81, 0]
base: {xyz: [0, 0, 1.5], rpy: [1.5707963267948966, 0, 0]}
joints:
  - {name: shoulder, a: 0.4, d: 0.0, twist: 0.0, theta_offset: 0.0, friction: [viscous, coulomb],
     limits: {position: [-3, 3], velocity: 4, acceleration: 20, torque: 80}}
  - {name: elbow, a: 0.3, d: 0.1, twist: 0.0, theta_offset: 0.0, friction: [viscous, coulomb],
     limits: {position: [-3, 3], velocity: 4, acceleration: 20, torque: 50}}
prior:
  links:
    - {mass: 3.0, com: [-0.2, 0, 0], inertia_com: {ixx: 0.01, iyy: 0.04, izz: 0.04}}
    - {mass: 2.0, com: [-0.15, 0, 0], inertia_com: {ixx: 0.005, iyy: 0.015, izz: 0.015}}
"""
URDF = """<?xml version="1.0"?>
<robot name="swing">
  <link name="base"/>
  <link name="upper"><inertial><origin xyz="0.2 0 0" rpy="0 0 0"/><mass value="3"/>
    <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.04"/></inertial></link>
  <link name="lower"><inertial><origin xyz="0.15 0 0" rpy="0 0 0"/><mass value="2"/>
    <inertia ixx="0.005" ixy="0" ixz="0" iyy="0.015" iyz="0" izz="0.015"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><origin xyz="0 0 0.1" rpy="1.5708 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="4" effort="80"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="lower"/><origin xyz="0.4 0 0" rpy="0 0 0"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="4" effort="50"/><dynamics damping="0.1" friction="0.2"/></joint>
</robot>
"""
PLAN = """alpha: 0.3
duration: 4
basis: quintic
waypoints:
  - [0.0, 0.0]
  - [0.4, -0.3]
  - [0.0, 0.0]
times: [0, 2, 4]
obstacles:
  - {lower: [3, 3, 3], upper: [4, 4, 4]}
"""
BATCH = """defaults: {robot: arm.yaml}
jobs:
  - {name: one, logs: [log.csv], options: {method: wls, holdout: 10%, report: false}, validate: [other.npz],
     max_unexplained: 90%, fail_if: ["max_rms_nm > 100"]}
"""


WAYPOINTS = "t,q_shoulder,q_elbow\n0,0,0\n2,0.4,-0.3\n4,0,0\n"
SETTINGS = """seed: 3
verbose: 1
identify: {cutoff: auto, method: wls, holdout: 10%, report: false}
trajectory: {alpha: 0.3}
check: {rate: 100}
"""


def pendulum(q: np.ndarray, qd: np.ndarray, qdd: np.ndarray) -> np.ndarray:
    """Return the torques of the double pendulum that ROBOT describes, from the textbook's formula."""
    m1, m2, l1, c1, c2, i1, i2, g = 3.0, 2.0, 0.4, 0.2, 0.15, 0.04, 0.015, 9.81
    one, both, coupling = np.cos(q[:, 0]), np.cos(q.sum(axis=1)), m2 * l1 * c2 * np.cos(q[:, 1])
    h = m2 * l1 * c2 * np.sin(q[:, 1])
    M11, M12, M22 = (
        i1 + m1 * c1**2 + i2 + m2 * (l1**2 + c2**2) + 2 * coupling,
        i2 + m2 * c2**2 + coupling,
        i2 + m2 * c2**2,
    )
    v1, v2, a1, a2 = *qd.T, *qdd.T
    first = (
        M11 * a1
        + M12 * a2
        - h * (2 * v1 + v2) * v2
        + g * ((m1 * c1 + m2 * l1) * one + m2 * c2 * both)
    )
    return np.column_stack([first, M12 * a1 + M22 * a2 + h * v1**2 + g * m2 * c2 * both])


def motion(seed: int) -> Log:
    rng = np.random.default_rng(seed)
    t = np.arange(1200) / 100
    w, p = np.array([2.1, 4.4, 3.3, 5.2]), rng.uniform(0, 6, 4)
    q = np.column_stack(
        [np.sin(w[0] * t + p[0]) + 0.3 * np.sin(w[1] * t + p[1]), 0.9 * np.sin(w[2] * t + p[2])]
    )
    qd, qdd = np.gradient(q, t, axis=0), np.gradient(np.gradient(q, t, axis=0), t, axis=0)
    tau = (
        pendulum(q, qd, qdd)
        + 0.3 * qd
        + 0.5 * np.tanh(qd / 0.01)
        + 0.05 * rng.standard_normal(q.shape)
    )
    # Why: the model lacks this wave, so that results hold a residual model, and a search names something.
    tau[:, 1] += 0.4 * np.sin(3 * q[:, 1])
    return Log(t, q + 1e-5 * rng.standard_normal(q.shape), tau, ("shoulder", "elbow"), qd=qd)


#: Commands that make the results in out/.
RESULTS = (
    ["model", "arm.yaml", "--out", "out"],
    ["parameters", "arm.yaml", "log.npz", "--out", "out", "--no-identify"],
    ["identify", "arm.yaml", "log.npz", "--out", "out"],
    ["trajectory", "arm.yaml", "plan.yaml", "--out", "out", "--preview", "none"],
    ["validate", "out/parameters.npz", "other.npz", "--out", "out"],
    ["gap", "out/parameters.npz", "other.npz", "--apply", "best", "--out", "out/named"],
    ["run", "batch.yaml", "--out", "out/batch"],
)


def make(folder: Path, run: Callable[[list[str]], int]) -> Path:
    """Fill a folder with whole inputs of every kind, and out/ with results made from them by ``run``."""
    (folder / "arm.yaml").write_text(ROBOT)
    (folder / "arm.urdf").write_text(URDF)
    (folder / "plan.yaml").write_text(PLAN)
    (folder / "batch.yaml").write_text(BATCH)
    log, other = motion(0), motion(1)
    other.save(folder / "other.npz")
    log.save(folder / "log.npz")
    write_bag(log, folder / "log.bag", "/joint_states", start=10**18)
    head = "t," + ",".join(f"{kind}_{name}" for kind in ("q", "tau") for name in log.names)
    rows = np.column_stack([log.t, log.q, log.tau])
    np.savetxt(folder / "log.csv", rows, delimiter=",", header=head, comments="", fmt="%.8g")
    for suffix in ("db3", "mcap", "parquet", "tsv"):
        write_log(log, folder / f"log.{suffix}")
    (folder / "way.csv").write_text(WAYPOINTS)
    (folder / "settings.yaml").write_text(SETTINGS)
    (folder / "text").mkdir()
    for name, values in {"position": log.q, "torque": log.tau, "time": log.t[:, None]}.items():
        np.savetxt(folder / "text" / f"{name}.txt", values, fmt="%.8g")
    for words in RESULTS:
        assert run([*words, "--no-input", "--force"]) == 0, words
    return folder


def inputs_wanted(usual: int) -> int:
    """Return how many inputs of a kind are tried: a few with ``make test``, all with ``make attack``."""
    return max(1, round(usual * float(os.environ.get("ATTACK_SHARE", "0.015"))))


def first_seed() -> int:
    """Return the seed of the first input; other seeds give other inputs."""
    return int(os.environ.get("ATTACK_SEED", "1000"))
