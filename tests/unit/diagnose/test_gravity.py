"""Torques are compared with the weight of the arm: removed gravity and unzeroed sensors are seen."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from arms import pinocchio_torques
from dynid import Log, load_robot
from dynid.diagnose.diagnosis import diagnose
from dynid.diagnose.gravity import check_gravity
from dynid.errors import GravityRemoved
from dynid.files.logs import read_log
from dynid.model.regressor import expected_torque
from dynid.robot import TorqueSource
from dynid.signals.checks import check_zero, prepare
from dynid.sim.urdf import urdf_text
from makelogs import ROOT, gen2, gen2_log, lwr, lwr_log, shared_data
from motions import harmonics, pose_to_pose

NOISE = np.random.default_rng(1).normal(0, 0.3, lwr_log().tau.shape)


@pytest.mark.slow
def test_torques_of_a_moving_arm_without_its_weight_are_refused():
    broken = replace(lwr_log(), tau=NOISE)
    with pytest.raises(GravityRemoved, match="gravity was already removed") as caught:
        diagnose(prepare(broken, lwr()), lwr())
    assert "msrJntTrq" in caught.value.fix
    free = replace(lwr(), torque=TorqueSource("gravity_free"))
    check_gravity(prepare(broken, free), free)


def short_log(amplitude, noise, seed, weight):
    """A log of 3 s around one pose whose friction is no tanh of the speed, with or without the weight of the arm."""
    robot, rng, t = lwr(), np.random.default_rng(seed), np.arange(0.0, 3.0, 0.005)
    window = np.sin(np.pi * t / 3.0) ** 2
    phases, speeds = rng.uniform(0, 6, robot.n), rng.uniform(1.0, 4.0, robot.n)
    q = rng.uniform(-0.5, 0.5, robot.n) + amplitude * window[:, None] * np.sin(
        np.outer(t, speeds) + phases
    )
    qd = np.gradient(q, t, axis=0)
    tau = 15.0 * np.arctan(20.0 * qd) + noise * rng.standard_normal(q.shape)
    return Log(t, q, tau + weight * expected_torque(q, robot), robot.joint_names, qd), robot


def test_a_short_motion_that_hardly_lifts_the_arm_does_not_tell_its_weight():
    for seed in range(30):
        check_gravity(*short_log(0.02, 3.0, seed, weight=1.0))
    with pytest.raises(GravityRemoved):
        check_gravity(*short_log(1.0, 0.3, 0, weight=0.0))


def poses(robot):
    """A motion that rests in several poses: time and positions."""
    return pose_to_pose(np.random.default_rng(0).uniform(-1, 1, (8, robot.n)))[:2]


def test_rests_in_several_poses_show_that_gravity_was_removed():
    t, q = poses(lwr())
    rng = np.random.default_rng(0)
    with pytest.raises(GravityRemoved, match="torques do not follow the pose"):
        check_gravity(Log(t, q, rng.normal(0, 0.05, q.shape), tau_unit="Nm"), lwr())
    check_gravity(Log(t, q, 0.5 * expected_torque(q, lwr()), tau_unit="Nm"), lwr())


def test_a_scara_whose_turning_joints_carry_no_weight_is_not_suspected():
    robot = load_robot(ROOT / "robots" / "scara.yaml")
    t, q = poses(robot)
    check_gravity(Log(t, q, np.tile([0.0, 0.0, -20.0, 0.0], (len(q), 1)), tau_unit="Nm"), robot)


def test_currents_are_not_compared_with_weights():
    t, q = poses(lwr())
    check_gravity(Log(t, q, 0 * q + 0.1, tau_unit="A"), lwr())


def test_a_sensor_that_was_not_zeroed_is_seen_at_rest():
    robot = gen2()
    t, q = poses(robot)
    zeroed = Log(t, q, 0.8 * expected_torque(q, robot), tau_unit="Nm")
    assert not [*check_zero(zeroed, robot)]
    (finding,) = check_zero(replace(zeroed, tau=zeroed.tau + 1.8 * np.eye(7)[0]), robot)
    assert finding.code == "W316"
    assert finding.text.startswith("j2s7s300_joint_1 reads +1.8 Nm with the arm at rest")
    assert "W316" not in [each.code for each in prepare(gen2_log(), robot).findings]


@pytest.mark.data
def test_a_real_recording_with_its_weight_taken_out_is_refused():
    log = read_log(shared_data("kuka_lwr4plus/run1.bag"), robot=lwr())
    with pytest.raises(GravityRemoved):
        diagnose(prepare(replace(log, tau=0.02 * log.tau + NOISE[0]), lwr()), lwr())


@pytest.mark.parametrize(
    "name", ["kuka_lwr4plus", "kinova_gen2", "ur10", "franka_panda", "staubli_tx40"]
)
@pytest.mark.parametrize("seed", range(3))
def test_a_log_that_never_rests_shows_whether_gravity_was_removed(name, seed):
    """Five harmonics a joint; Pinocchio makes the torques, inertia and friction included, with its weight and without.

    Why several masses: the check knows them only roughly, so the arm's are off by half to twice.
    """
    robot = load_robot(name)
    rng = np.random.default_rng(seed)
    model = pin.buildModelFromXML(urdf_text(robot))
    for k in range(1, robot.n + 1):
        factor = rng.uniform(0.5, 2)
        model.inertias[k] = pin.Inertia(
            factor * model.inertias[k].mass,
            model.inertias[k].lever,
            factor * model.inertias[k].inertia,
        )
    t = np.arange(0, 20, 0.02)
    w = 2 * np.pi / 20 * np.arange(1, 6)
    a, b = rng.normal(size=(2, 5, robot.n)) * rng.uniform(0.3, 1.0) / (w[:, None] * np.sqrt(5))
    q, qd, qdd = harmonics(t, a, b, base=1 / 20)
    q = q + rng.uniform(-0.7, 0.7, robot.n)
    logs = []
    for gravity in (np.array(robot.gravity), np.zeros(3)):
        model.gravity.linear = gravity
        tau = pinocchio_torques(model, q, qd, qdd)
        tau += 0.5 * np.tanh(qd / 0.02) + 0.3 * qd + rng.normal(0, 0.1, q.shape)
        shown = q + rng.normal(0, 1e-4, q.shape)
        logs.append(
            Log(t=t, q=shown, tau=tau, qd=qd, names=robot.joint_names, tau_unit="Nm", dh=True)
        )
    check_gravity(logs[0], robot)
    with pytest.raises(GravityRemoved):
        check_gravity(logs[1], robot)


@pytest.mark.parametrize("scale", [0.02, -0.001])
def test_a_motor_reading_of_unknown_scale_is_not_called_without_gravity(scale):
    """Readings of motors follow the weight at another size; ``relative: true`` is what such a log needs."""
    log = prepare(lwr_log(), lwr())
    with pytest.raises(GravityRemoved, match="their scale is unknown") as found:
        check_gravity(replace(log, tau=scale * log.tau), lwr())
    assert "relative: true" in found.value.fix
