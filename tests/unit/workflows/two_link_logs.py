"""Logs of the two-link arm as objects."""

import numpy as np

import twolink
from dynid import Log

ROBOT = twolink.ROBOT


def log(seed, noise=0.02, scale=(1.0, 1.0)):
    """A log of the arm; ``scale`` multiplies the torque of each joint."""
    t, q, qd, qdd = twolink.motion(seed)
    rng = np.random.default_rng(seed + 100)
    tau = (twolink.torque(q, qd, qdd) + noise * rng.standard_normal(q.shape)) * np.array(scale)
    return Log(t=t, q=q, tau=tau, names=("shoulder", "elbow"))
