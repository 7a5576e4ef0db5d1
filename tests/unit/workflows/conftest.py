"""Results of a two-link arm whose torques are written out by hand, for the tests of the workflows."""

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "cli"))
import twolink
from dynid import Log, identify, load_robot


def log(seed, noise=0.02, scale=(1.0, 1.0)):
    """A log of the arm; ``scale`` multiplies the torque of each joint."""
    t, q, qd, qdd = twolink.motion(seed)
    rng = np.random.default_rng(seed + 100)
    tau = (twolink.torque(q, qd, qdd) + noise * rng.standard_normal(q.shape)) * np.array(scale)
    return Log(t=t, q=q, tau=tau, names=("shoulder", "elbow"))


@pytest.fixture(scope="session")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "arm.yaml"
    path.write_text(twolink.ROBOT)
    return load_robot(path)


@pytest.fixture(scope="session")
def result(arm):
    return identify(arm, [log(1)])


@pytest.fixture(scope="session")
def other(arm):
    """The same arm on another motion."""
    return identify(arm, [log(2)])


@pytest.fixture(scope="session")
def scaled(arm):
    """The same arm with an elbow whose torque is 5 % larger."""
    return identify(arm, [log(1, scale=(1.0, 1.05))])
