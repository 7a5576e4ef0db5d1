"""A two-joint arm that swings, with sensor noise, for tests of what is wrong with samples."""

from functools import cache
from pathlib import Path

import numpy as np

from dynid import Log
from dynid.files.robotfile import parse_robot

RNG = np.random.default_rng(5)
_ROBOT = """
name: swing
convention: standard
joints:
  - {a: 0.4, d: 0.0, twist: 0.0, limits: {position: [-3, 3], velocity: 4, torque: 50}}
  - {a: 0.3, d: 0.0, twist: 0.0, limits: {position: [-3, 3], velocity: 4, torque: 50}}
"""


@cache
def robot():
    return parse_robot(_ROBOT, Path("swing.yaml"))


@cache
def moving_log(seconds=10.0, rate=200.0):
    t = np.arange(round(seconds * rate)) / rate
    q = np.column_stack([np.sin(2.1 * t) + 0.3 * np.sin(5.3 * t), 0.8 * np.sin(3.3 * t + 0.4)])
    q = q + 1e-5 * RNG.standard_normal(q.shape)
    return Log(t, q, 5 * np.cos(q) + 0.05 * RNG.standard_normal(q.shape), ("joint_1", "joint_2"))
