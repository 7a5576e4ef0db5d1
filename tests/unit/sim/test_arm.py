"""The simulated arm against integrations and torques that are computed elsewhere."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from dynid import Robot, load_robot
from dynid.robot import Body, Joint, Limits
from dynid.sim.arm import Friction, SimulatedArm, SimulatedRun, track
from dynid.sim.plant import Sensors
from dynid.sim.sines import SineSpec, lowest_point, sines

SPHERE = (0.01, 0.0, 0.0, 0.01, 0.0, 0.01)
SPEC = SineSpec(duration=6.0, period=5.0, reach=0.5, speed=0.6, acceleration=0.5, floor=0.05)


def slider(gravity=(0.0, 0.0, 0.0)):
    return Robot("slider", "standard", (Joint("s", "prismatic"),), gravity)


def run(arm, steps, tau=0.0):
    states = []
    for _ in range(steps):
        arm.step(np.array([tau]))
        states.append([float(part[0]) for part in arm.state()])
    return np.array(states).T


SLIPPERY = Friction((4.0,), (0.0,), (0.0,), (0.01,))


@pytest.mark.parametrize(
    ("gravity", "options", "tau", "speed", "rel"),
    [
        (-9.81, {}, 0.0, -9.81 * 0.5, 1e-9),
        (0.0, {"rotor_inertia": [3.0]}, 10.0, 10.0 / 5.0 * 0.5, 1e-9),
        (0.0, {"friction": SLIPPERY}, 8.0, 2.0 * (1 - np.exp(-1.0)), 1e-3),
    ],
    ids=["v = g t", "v = F t / (m + Im)", "v = F / b (1 - exp(-b t / m))"],
)
def test_half_a_second_of_two_kilograms_is_that_of_the_textbook(gravity, options, tau, speed, rel):
    """To the first order of the step; damping of the engine would show."""
    body = Body(2.0, inertia_com=SPHERE)
    arm = SimulatedArm(slider((0.0, 0.0, gravity)), [body], **options, dt=1e-4)
    q, qd = run(arm, 5000, tau)
    assert qd[-1] == pytest.approx(speed, rel=rel)
    if not tau:
        assert q[-1] == pytest.approx(gravity * 0.25 / 2, rel=1e-3)


def test_the_base_pose_turns_gravity_with_the_arm():
    """Gravity is given in frame 0: an arm that is turned over with its gravity moves alike."""
    upright = slider((0.0, 0.0, -9.81))
    turned = Robot("t", "standard", upright.joints, upright.gravity, base_rpy=(np.pi, 0.3, 1.0))
    ends = []
    for robot in (upright, turned):
        arm = SimulatedArm(robot, [Body(2.0, inertia_com=SPHERE)])
        ends.append(run(arm, 500)[0, -1])
    assert ends[1] == pytest.approx(ends[0], rel=1e-9)


def test_coulomb_friction_slows_at_a_constant_rate_then_creeps():
    """A steep Coulomb part on a light body: v falls by c / m, then stays at rest without chattering."""
    friction = Friction((0.0,), (1.0,), (0.0,), (1e-3,))
    arm = SimulatedArm(slider(), [Body(0.05, inertia_com=SPHERE)], friction)
    arm.reset(np.zeros(1), np.ones(1))
    _, qd = run(arm, 400)
    assert qd[49] == pytest.approx(1.0 - 20.0 * 0.025, rel=1e-6)
    assert np.abs(qd[-100:]).max() < 1e-6


def test_no_mechanical_stop_disturbs_the_torques():
    """Position limits of the robot file do not act in the simulation."""
    robot = Robot(
        "s", "standard", (Joint("p", limits=Limits((-0.1, 0.1))),), gravity=(0.0, 0.0, 0.0)
    )
    arm = SimulatedArm(robot, [Body(1.0, inertia_com=SPHERE)])
    arm.reset(np.zeros(1), np.ones(1))
    q, qd = run(arm, 1000)
    assert q[-1] == pytest.approx(0.5)
    assert qd[-1] == pytest.approx(1.0)


@pytest.mark.slow
def test_a_tracked_motion_needs_the_torques_of_inverse_dynamics():
    """What the drives gave equals rigid body + friction + rotors of the motion that was made."""
    robot = load_robot("kuka_lwr4plus")
    friction = Friction((0.5,) * 7, (0.4,) * 7, (0.1,) * 7, (0.1,) * 7)
    arm = SimulatedArm(robot, None, friction, [0.1] * 7)
    motion = sines(robot, SineSpec(6.0, 6.0, 0.3, 0.3, 0.3, 0.05), arm.dt, np.random.default_rng(3))
    made = track(arm, motion)
    qd = np.gradient(made.q, arm.dt, axis=0)
    qdd = np.gradient(qd, arm.dt, axis=0)
    rows = list(range(10, len(made.t) - 10, 50))
    rigid = np.array([arm.inverse_dynamics(made.q[k], qd[k], qdd[k]) for k in rows])
    needed = rigid + friction.torque(qd[rows]) + 0.1 * qdd[rows]
    assert np.abs(made.q - made.q_ref).max() < np.radians(2.0)
    assert np.abs(needed - made.tau[rows]).max() < 0.01


def test_sines_rest_at_both_ends_and_keep_the_limits():
    """Position, velocity and acceleration are each other's derivatives and stay inside their shares."""
    robot = load_robot("kuka_lwr4plus")
    motion = sines(robot, SPEC, 1e-3, np.random.default_rng(1))
    for part in (motion.qd, motion.qdd):
        assert np.abs(part[[0, -1]]).max() == 0
    assert_allclose(np.gradient(motion.q, 1e-3, axis=0)[1:-1], motion.qd[1:-1], atol=1e-3)
    assert_allclose(np.gradient(motion.qd, 1e-3, axis=0)[1:-1], motion.qdd[1:-1], atol=3e-2)
    for i, joint in enumerate(robot.joints):
        assert np.abs(motion.q[:, i]).max() <= 0.5 * joint.limits.position[1] + 1e-12
        assert np.abs(motion.qd[:, i]).max() <= 0.6 * joint.limits.velocity + 1e-12
        assert np.abs(motion.qdd[:, i]).max() <= 0.5 * joint.limits.acceleration + 1e-12
    assert lowest_point(robot, motion.q) > 0.04


def test_the_lowest_point_of_an_outstretched_arm_is_its_tip():
    """LWR4+ with joint 2 at 90 deg lies level at 0.3105 m; at 120 deg the tip is 0.868 sin 30 deg lower."""
    robot = load_robot("kuka_lwr4plus")
    q = np.zeros((2, 7))
    q[:, 1] = np.radians([90, 120])
    assert lowest_point(robot, q[:1]) == pytest.approx(0.3105)
    assert lowest_point(robot, q) == pytest.approx(0.3105 - 0.868 * 0.5)


def test_sensors_add_what_they_say():
    """Noise of the stated size, positions on the encoder's grid, stamps that never go back."""
    still = np.full((20_000, 2), 0.123456)
    truth = SimulatedRun(np.arange(20_000) * 0.01, still, 0 * still, 0 * still, still)
    log = Sensors((0.1, 0.02), 1e-3, None, 0.02).measure(
        truth, ("a", "b"), np.random.default_rng(0)
    )
    assert_allclose(log.tau.std(axis=0), [0.1, 0.02], rtol=0.03)
    assert_allclose(log.q, 0.123)
    assert log.qd is None
    assert np.diff(log.t).min() > 0
    assert np.abs(log.t - truth.t).max() <= 0.0045 + 1e-12
