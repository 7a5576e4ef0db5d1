"""Each ending of ``dynid gap`` on a seven-joint arm that Pinocchio moves, whose hidden torques are written here."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

import recorded_lwr
from arms import pinocchio_model, pinocchio_torques
from dynid import Log, find_gap, identify, load_robot
from dynid.diagnose.gravity import check_gravity
from dynid.errors import GravityRemoved
from dynid.model.parameters import joined, prior_bodies
from dynid.robot import Body, Coulomb, Prior
from motions import tones
from recorded_lwr import COULOMB, ROBOT, only, recorded, sharp

pytestmark = pytest.mark.slow

#: The truth is tanh(v / 0.003); 0.005 leaves a difference that the search must not take for an effect.
JOINTS = (
    replace(joint, friction=("viscous", "coulomb"), motor_inertia=False) for joint in ROBOT.joints
)
ARM = replace(ROBOT, joints=tuple(JOINTS), coulomb=Coulomb("smooth", (0.005,) * ROBOT.n))


def driven(added=None, repeats=2):
    """Logs of 15 s of three motions, each driven several times, one after the other."""
    return [
        recorded(1 + k // repeats, seconds=15.0, added=added, noise=10 + k, start=20.0 * k)
        for k in range(3 * repeats)
    ]


def look(logs):
    return find_gap(identify(ARM, logs, feasible=False), logs)


def named(gap):
    return {(one.effect, one.indices) for one in gap.named}


def slow_noise(t):
    """A torque that wanders as it likes, of another kind in each recording."""
    white = np.random.default_rng(int(10 * t[0])).normal(size=len(t))
    return lfilter([1.0], [1.0, -0.99], white)


def ringing(t, v):
    """Oscillation of 5.5 Hz that dies away after each reversal."""
    out = np.zeros_like(v)
    for k in np.flatnonzero(np.diff(np.sign(v)) != 0):
        tail = t[k:] - t[k]
        out[k:] += np.sign(v[min(k + 2, len(v) - 1)]) * np.exp(-tail / 0.15) * np.sin(34.6 * tail)
    return out


def position_friction(t, q, qd, rigid):
    return only(3, 0.6 * np.cos(2 * q[:, 3] + 0.4) * sharp(qd[:, 3]))


@pytest.mark.parametrize(("repeats", "said"), [(2, "at its noise"), (1, "lower bound")])
def test_nothing_hidden_gets_no_name(repeats, said):
    """Without repeats the noise is known by a bound only, which is said."""
    gap = look(driven(repeats=repeats))
    assert named(gap) == set()
    assert said in gap.advice
    assert repeats == 1 or gap.verdict == "nothing_missing"


DISTANCES = np.linspace(0.2e-3, 0.9e-3, ROBOT.n)


def bristles(t, q, qd, rigid):
    """Coulomb friction by Dahl's law in place of the sharp one."""
    z = np.zeros_like(q)
    for k, step in enumerate(np.diff(q, axis=0), start=1):
        z[k] = np.sign(step) + (z[k - 1] - np.sign(step)) * np.exp(-np.abs(step) / DISTANCES)
    return COULOMB * (z - sharp(qd))


def test_the_distance_of_friction_is_found_and_is_no_delay():
    result = identify(ROBOT, driven(bristles, repeats=1))
    assert_allclose(result.robot.coulomb_shape.distance, DISTANCES, rtol=0.2)
    assert not result.delay


def test_friction_that_lags_behind_its_reversals_gets_no_name():
    gap = look(driven(bristles))
    assert (named(gap), gap.verdict) == (set(), "nothing_missing")


def test_two_effects_on_two_joints_are_both_named():
    gap = look(driven(lambda *x: position_friction(*x) + only(1, 0.5 * np.abs(x[2][:, 1]))))
    assert named(gap) == {("asymmetric_viscous", (1,)), ("position_friction", (3,))}


def test_an_effect_outside_the_catalogue_is_unexplained_and_gets_no_name():
    gap = look(driven(lambda t, q, qd, rigid: only(3, 0.6 * ringing(t, qd[:, 3]))))
    assert (gap.verdict, named(gap)) == ("unexplained", set())
    assert "lwr_3_joint" in gap.advice


def test_what_does_not_repeat_is_called_so():
    gap = look(driven(lambda t, q, qd, rigid: only(2, 0.1 * slow_noise(t))))
    assert gap.verdict == "unexplained"
    assert gap.not_repeatable == ("lwr_2_joint",)
    assert "does not repeat" in gap.advice


def test_joints_that_always_move_together_make_their_coupling_ambiguous(monkeypatch):
    """Joint 3 is dragged along by joint 4, but joint 2 moves just as joint 4 does."""

    def together(*motion):
        parts = tones(*motion)
        for part in parts:
            part[:, 1] = part[:, 3]
        return parts

    tones = recorded_lwr.tones
    monkeypatch.setattr(recorded_lwr, "tones", together)
    gap = look(driven(lambda t, q, qd, rigid: only(2, 0.3 * qd[:, 3] + 0.15 * sharp(qd[:, 3]))))
    assert gap.verdict == "ambiguous"
    (one,) = gap.named
    assert {one.indices, *(joints for _, joints in one.rival_keys)} == {(2, 1), (2, 3)}
    assert "apart: move the two joints one after the other." in gap.advice


def test_a_spring_is_named_through_lost_samples():
    """Linear and cubic spring have columns of different number here, and evidence that hardly differs."""
    logs = driven(lambda t, q, qd, rigid: only(4, 0.5 * q[:, 4]))
    for k, log in enumerate(logs):
        rng = np.random.default_rng(k)
        kept = rng.random(len(log)) > 0.01
        for at in rng.uniform(log.t[0] + 2, log.t[-1] - 2, 2):
            kept &= np.abs(log.t - at) > rng.uniform(0.05, 0.15)
        logs[k] = replace(log, t=log.t[kept], q=log.q[kept], tau=log.tau[kept])
    assert named(look(logs)) == {("spring", (4,))}


# ---------------------------------------------------------------- sizes that effects are not in proportion to
def found(effects, **options):
    logs = [
        recorded(plan, seconds=12.0, noise=10 * plan + k, start=17.0 * (2 * plan + k), **options)
        for plan in (1, 2, 3)
        for k in range(2)
    ]
    return find_gap(identify(ROBOT, logs, feasible=False), logs, effects=effects).named


@pytest.mark.parametrize(
    ("name", "joint", "size", "near"),
    [("encoder_offset", 2, 0.126, 0.01), ("joint_elasticity", 3, 0.0042, 0.1)],
)
def test_a_large_size_is_right_and_leaves_nothing_for_a_companion(name, joint, size, near):
    """An encoder zero of an eighth of a radian, and a gear that bends by some hundredths of one."""

    def lead(rigid):
        return only(joint, size * (rigid[:, joint] if "elastic" in name else np.ones(len(rigid))))

    (one,) = found("encoder_offset,joint_elasticity,spring,end_stop", lead=lead)
    assert (one.effect, one.indices) == (name, (joint,))
    (value,) = one.values.values()
    assert value == pytest.approx(size, rel=near)


# ---------------------------------------------------------------- counterbalances of heavy arms
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
