"""A two-link arm whose logs come from the textbook's equations, with whatever a test adds to its torques."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

import models
import twolink
from dynid import BaseModel, Log
from dynid.estimation.estimate import estimate
from dynid.estimation.stack import stack_logs
from dynid.gap.problem import make_problem
from dynid.signals.conditioned_log import condition_log

#: Standard deviation of the torque noise before the filter [N m].
NOISE = 0.05


@dataclass(frozen=True)
class TwoLinkLogs:
    """Conditioned logs of the two-link arm."""

    base: BaseModel

    def log(self, plan, noise, added=None, *, seconds=15.0, start=0.0, delay=0.0, name="log"):
        """Return one conditioned log: motion ``plan``, its own noise, and ``added(t, q, qd, qdd)`` with the law."""
        t, q, qd, qdd = twolink.motion(plan, seconds)
        tau = twolink.torque(q, qd, qdd)
        tau = tau if added is None else tau + added(start + t, q, qd, qdd)
        if delay:
            tau = np.stack([np.interp(t - delay, t, column) for column in tau.T], axis=1)
        tau = tau + NOISE * np.random.default_rng(1000 + noise).standard_normal(q.shape)
        log = Log(start + t, q, tau, self.base.robot.joint_names)
        found = condition_log(log, self.base.model, cutoff=10.0)
        return replace(
            found,
            name=name,
            segments=[replace(s, elapsed=s.elapsed + start) for s in found.segments],
        )

    def logs(self, added=None, *, plans=(1, 2), repeats=2, first=0, **options):
        """Return logs of several motions, each driven several times."""
        made = []
        for plan in plans:
            for _ in range(repeats):
                k = len(made)
                made.append(
                    self.log(plan, first + k, added, start=20.0 * k, name=f"log {k + 1}", **options)
                )
        return made

    def kept(self, logs):
        """Return the model that logs give, to be kept."""
        stack = stack_logs(logs, self.base)
        return estimate(stack, method="wls", holdout=None)

    def problem(self, added=None, kept=None, **options):
        """Return the problem of such logs."""
        return make_problem(self.logs(added, **options), self.base, kept)


@pytest.fixture(scope="session")
def twolinks():
    return TwoLinkLogs(models.two_links())


@pytest.fixture(scope="session")
def clean(twolinks):
    """The problem of four logs in which nothing is hidden."""
    return twolinks.problem()


def only_joint(j, torque):
    """Return torques (N, 2) of which one joint has a column and the other nothing."""
    return np.stack([torque if k == j else np.zeros_like(torque) for k in range(2)], axis=1)


@pytest.fixture(scope="session")
def on_joint():
    return only_joint


@pytest.fixture(scope="session")
def more_friction():
    """Torques of a second joint that drags more than it did."""
    return lambda t, q, qd, qdd: only_joint(1, 0.15 * np.tanh(qd[:, 1] / 0.01))


@pytest.fixture(scope="session")
def old(twolinks):
    """Earlier logs, of other motions than those in which something may have changed."""
    return twolinks.logs(plans=(1, 2))


@pytest.fixture(scope="session")
def kept(twolinks, old):
    """The model that was identified from the earlier logs."""
    return twolinks.kept(old)
