"""Counterbalances at axis 2 of heavy arms that Pinocchio moves, whose bodies nobody has told dynid."""

from dataclasses import replace

import numpy as np
import pytest

from arms import pinocchio_model, pinocchio_torques
from dynid import Log, find_gap, identify, load_robot
from dynid.diagnose.gravity import check_gravity
from dynid.errors import GravityRemoved
from dynid.model.parameters import joined, prior_bodies
from dynid.robot import Body, Coulomb, Prior
from motions import tones
from recorded_lwr import sharp

pytestmark = pytest.mark.slow

CENTRE = np.radians([0, 90, -90, 0, 60, 0])


class Heavy:
    """An arm of 110 kg with the lengths of a UR10 and links of its own; axis 1 crosses axis 2 or is 0.2 m before it."""

    def __init__(self, *, apart=False, counterweight=False):
        rng, small = np.random.default_rng(3), load_robot("ur10")
        first = replace(small.joints[0], a=0.2 if apart else 0.0)
        joints = tuple(
            replace(j, friction=("viscous", "coulomb", "offset"))
            for j in (first, *small.joints[1:])
        )
        self.robot = replace(small, joints=joints, coulomb=Coulomb("smooth", (0.005,) * 6))
        self.bodies = [
            Body(
                4 * rng.uniform(0.7, 1.4) * body.mass,
                tuple(body.com + rng.normal(0, 0.02, 3)),
                tuple(4 * rng.uniform(0.7, 1.4) * np.array(body.inertia_com)),
            )
            for body in prior_bodies(self.robot)
        ]
        if counterweight:  # the upper arm goes on behind its axis
            behind = Body(20.0, (-1.3 * small.joints[1].a, 0.0, 0.0), (0.1, 0, 0, 0.1, 0, 0.1))
            self.bodies[1] = joined(self.bodies[1], behind)
        self.engine = pinocchio_model(self.robot, self.bodies)

    def weight(self, q):
        return pinocchio_torques(self.engine, q, 0 * q, 0 * q)

    def log(self, seed, carried=0.0):
        """A log of 12 s with a spring that carries a share of what axis 2 carries stretched out."""
        rng, t = np.random.default_rng(seed), np.arange(0, 12, 0.005)
        w, phase = rng.uniform([[[1.0]], [[0.0]]], [[[4.0]], [[7.0]]], (2, 4, 6))
        q, qd, qdd = tones(t, np.array([0.6, 0.3, 0.3, 0.5, 0.4, 0.7]) * np.ones((4, 1)), w, phase)
        q = q + CENTRE
        tau, rated = pinocchio_torques(self.engine, q, qd, qdd), np.abs(self.weight(q)).max(axis=0)
        rated = np.maximum(rated, 0.02 * rated.max())
        tau += rated * (0.04 * qd + 0.04 * sharp(qd) + 0.012 * rng.normal(size=q.shape))
        tau[:, 1] -= carried * self.at_rest() * np.cos(q[:, 1])
        return Log(t + 20.0 * seed, q, tau, self.robot.joint_names, tau_unit="Nm", dh=True)

    def at_rest(self):
        """Torque of gravity at axis 2 with the arm stretched out [N m]."""
        return self.weight(np.zeros((1, 6)))[0, 1]

    def searched(self, carried):
        logs = [self.log(seed, carried) for seed in (1, 2)]
        known = identify(self.robot, logs, feasible=False, anyway=True)
        return find_gap(known, logs, effects="counterbalance,spring,torque_offset,end_stop")


@pytest.mark.parametrize("apart", [True, False])
def test_it_is_sure_where_the_first_axes_are_apart_and_likely_where_they_cross(apart):
    """Where axis 1 is before axis 2, the torques of the first tell what the second carries."""
    gap = Heavy(apart=apart).searched(1.0)
    assert "A counterbalance on shoulder_lift_joint makes the links more plausible" in gap.asked
    assert (("counterbalance", (1,)) in [(one.effect, one.indices) for one in gap.named]) is apart


@pytest.mark.parametrize("counterweight", [True, False])
def test_an_arm_without_one_is_not_suspected_even_with_a_counterweight(counterweight):
    gap = Heavy(counterweight=counterweight).searched(0.0)
    assert "counterbalance" not in gap.asked
    assert "counterbalance" not in [one.effect for one in (*gap.named, *gap.closest)]


def test_a_weight_that_is_carried_wholly_is_no_gravity_that_was_removed():
    """The spring carries all that axis 2 would; that the other axes carry theirs shows that gravity is there."""
    arm = Heavy()
    robot = replace(arm.robot, prior=Prior(links=tuple(arm.bodies)))
    log = arm.log(1, 1.0)
    check_gravity(log, robot)
    bare = arm.log(1)
    with pytest.raises(GravityRemoved):
        check_gravity(replace(bare, tau=bare.tau - arm.weight(bare.q)), robot)
