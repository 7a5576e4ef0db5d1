"""Each ending of ``dynid gap`` on a seven-joint arm that Pinocchio moves, whose hidden torques are written here."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

import recorded_lwr
from dynid import find_gap, identify
from dynid.robot import Coulomb
from recorded_lwr import ROBOT, only, recorded, sharp

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
