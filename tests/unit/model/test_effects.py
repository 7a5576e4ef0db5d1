"""Effects against Pinocchio, against MuJoCo, against an integrated law."""

from dataclasses import replace

import mujoco
import numpy as np
import pinocchio as pin
import pytest
from numpy.testing import assert_allclose
from scipy.signal import butter, filtfilt

from arms import pinocchio_torques, placements
from dynid.errors import WrongRobotFile
from dynid.model.effects.catalogue import CATALOGUE, checked
from dynid.model.effects.friction import coulomb_sign
from dynid.model.effects.laws import presliding
from dynid.model.effects.motion import ArmMotion
from dynid.model.reduce import reduce, with_added
from dynid.model.regressor import ModelTorques, build_model
from dynid.robot import Coulomb, EffectSpec
from motions import tones
from recorded_lwr import ENGINE, PLANT, ROBOT


def torque(motion, engine=ENGINE, moved=0.0):
    """Torques of the true arm on a motion of which joint 2 is elsewhere."""
    q = motion.q - moved * np.eye(7)[1]
    return pinocchio_torques(engine, q, motion.qd, motion.qdd)


@pytest.fixture(scope="module")
def model():
    return build_model(ROBOT)


@pytest.fixture(scope="module")
def motion(model):
    """A random motion with the true arm as the current model."""
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 40, 7))
    values = PLANT.parameters()
    gamma = np.array([values.get(name, 0.0) for name in model.parameter_names])
    return ArmMotion(
        np.arange(40) / 10.0, q, qd, qdd, model.robot, ModelTorques(model, gamma), lambda x: x
    )


def test_tool_force_is_the_transposed_jacobian(motion):
    engine = ENGINE.copy()
    tip = pin.Frame("tip", 7, 0, placements(ROBOT)[-1][1], pin.FrameType.OP_FRAME)
    frame, data = engine.addFrame(tip), engine.createData()
    slopes = [
        pin.computeFrameJacobian(engine, data, q, frame, pin.LOCAL_WORLD_ALIGNED) for q in motion.q
    ]
    columns = CATALOGUE["tool_force"].columns(motion, (), {})
    assert_allclose(columns.transpose(2, 0, 1), -np.array(slopes)[:, :3], atol=1e-9)


@pytest.mark.parametrize(("gravity", "level"), [((0.0, 0.0, -9.81), 0), ((9.81, 0.0, 0.0), 1)])
def test_base_tilt_is_gravity_turned_towards_a_level_axis(motion, gravity, level):
    """On the floor and on a wall, where the first axis of the base points down."""
    upright, leaning = ENGINE.copy(), ENGINE.copy()
    upright.gravity.linear = np.array(gravity)
    leaning.gravity.linear = gravity + 9.81e-3 * np.eye(3)[level]
    still = np.zeros_like(motion.q)
    before, after = (pinocchio_torques(x, motion.q, still, still) for x in (upright, leaning))
    there = replace(motion, robot=replace(motion.robot, gravity=gravity))
    column = CATALOGUE["base_tilt"].columns(there, (), {})[0].T
    assert_allclose(1e-3 * column, after - before, atol=1e-8)


@pytest.mark.parametrize("size", [1e-6, 0.12])
def test_an_encoder_zero_is_exact_at_its_size(motion, model, size):
    named = EffectSpec("encoder_offset", (model.robot.joint_names[1],), {"offset": size})
    column = checked(named, model.robot).columns(motion, (1,), {})[0].T
    change = torque(motion, moved=size) - torque(motion)
    assert_allclose(size * column, change, atol=1e-8)


def test_a_bent_joint_is_nearly_exact_at_its_size():
    """The link of a pendulum moves as it is told, its motor by as much more as its gear bends."""
    t = np.arange(0, 20, 0.002)
    link = np.array([0.8 * np.sin(1.7 * t) + 0.3 * np.cos(3.1 * t)])
    link = np.concatenate([link, [np.gradient(link[0], t)]])
    link = np.concatenate([link, [np.gradient(link[1], t)]])
    torque, compliance = Pendulum().rigid(*link), 0.15
    shown = link[0] + compliance * torque
    speed = np.gradient(shown, t)
    motion = one_joint(t, shown, speed, np.gradient(speed, t))
    motion = replace(motion, smooth=lambda x: filtfilt(*butter(4, 4.0, fs=500.0), x))
    change, inside = torque - motion.rigid[:, 0], slice(1000, -1000)
    slope, exact = (
        compliance * effect.columns(motion, (0,), {})[0, 0]
        for effect in (
            CATALOGUE["joint_elasticity"],
            CATALOGUE["joint_elasticity"].at_size({"compliance": compliance}),
        )
    )
    left = [
        np.sqrt(np.mean((change - x)[inside] ** 2) / np.mean(change[inside] ** 2))
        for x in (slope, exact)
    ]
    assert left[0] > 0.05, "to first order much is left"
    assert left[1] < 0.12 * left[0]


def test_payload_is_a_body_on_the_last_link(motion):
    com, mass = np.array([0.01, 0.02, 0.04]), 0.3
    heavy = ENGINE.copy()
    ball = pin.Inertia(mass, com, 1e-4 * mass * np.eye(3))
    heavy.appendBodyToJoint(7, ball, placements(ROBOT)[-1][1])
    tensor = 1e-4 * mass * np.eye(3) + mass * (com @ com * np.eye(3) - np.outer(com, com))
    ten = np.concatenate([[mass], mass * com, tensor[np.triu_indices(3)]])
    columns = CATALOGUE["payload"].columns(motion, (), {"form": 10.0})
    change = torque(motion, heavy) - torque(motion)
    assert_allclose(np.tensordot(ten, columns, axes=1).T, change, atol=1e-9)


def test_counterbalance_is_a_spring_between_two_links_of_mujoco(motion):
    # A spring without free length between a point of the arm and one of the base.
    engine = mujoco.MjModel.from_xml_string("""<mujoco><worldbody><site name="base" pos="-0.3 0 0.2"/><body>
      <joint name="axis" axis="0 1 0"/><geom size="0.1" mass="1"/><site name="link" pos="0.1 0 0.4"/></body></worldbody>
      <tendon><spatial stiffness="900" springlength="0"><site site="base"/><site site="link"/></spatial></tendon>
      </mujoco>""")
    data, held = mujoco.MjData(engine), []
    for data.qpos[0] in motion.q[:, 1]:
        mujoco.mj_forward(engine, data)
        held.append(-data.qfrc_passive[0])
    columns = CATALOGUE["counterbalance"].columns(motion, (1,), {})[:, 0].T
    amplitudes = np.linalg.lstsq(columns, np.array(held), rcond=None)[0]
    assert_allclose(columns @ amplitudes, held, atol=1e-9)
    assert np.hypot(*amplitudes) == pytest.approx(900 * np.hypot(0.3, 0.2) * np.hypot(0.1, 0.4))


class Pendulum:
    """One link with an inertia of 0.05 kg m^2 and 0.6 N m of weight."""

    def rigid(self, q, qd, qdd):
        return 0.05 * qdd + 0.6 * np.sin(q)

    total = rigid


def one_joint(t, q, qd, qdd):
    return ArmMotion(
        t,
        q[:, None],
        qd[:, None],
        qdd[:, None],
        None,
        Pendulum(),
        lambda x: x,
        np.sign(qd)[:, None],
    )


def low_passed(signal, rate):
    numerator, denominator = butter(4, 10 / (rate / 2))
    return filtfilt(numerator, denominator, signal)[rate // 2 : -rate // 2]


def sines(t):
    size, hertz, phase = np.array([(1.0, 0.35, 0.3), (0.4, 0.8, 1.0), (0.15, 1.7, 2.0)]).T[
        ..., None
    ]
    return (x[:, 0] for x in tones(t, size, 2 * np.pi * hertz, phase))


def test_backlash_is_a_link_that_falls_between_two_stiff_flanks():
    rate, finer, half = 1000, 20, 0.003
    fine = np.arange(0, 20, 1 / (rate * finer))
    motor, motor_speed, _ = sines(fine)
    link, speed, torque = motor[0] - half, motor_speed[0], np.zeros(len(fine))
    for k in range(len(fine)):
        lag = motor[k] - link
        push = 8e3 * (abs(lag) - half) + 12.0 * (motor_speed[k] - speed) * np.sign(lag)
        torque[k] = np.sign(lag) * max(0.0, push) if abs(lag) > half else 0.0
        speed += (torque[k] - 0.6 * np.sin(link)) / 0.05 / (rate * finer)
        link += speed / (rate * finer)
    t = np.arange(0, 20, 1 / rate)
    motion = one_joint(t, *sines(t))
    left = low_passed(torque.reshape(-1, finer).mean(axis=1) - motion.rigid[:, 0], rate)
    columns = {
        b: low_passed(CATALOGUE["backlash"].columns(motion, (0,), {"b": b})[0, 0], rate)
        for b in (half / 2, half, 2 * half)
    }
    fit = {b: float(np.corrcoef(x, left)[0, 1]) for b, x in columns.items()}
    assert fit[half] > 0.98
    assert fit[half] > max(fit[half / 2], fit[2 * half])
    assert columns[half] @ left / (columns[half] @ columns[half]) == pytest.approx(1.0, abs=0.1)


def test_gear_friction_is_a_mesh_whose_force_turns_with_the_wheel():
    step = 2e-5
    t = np.arange(0, 10, step)
    wanted, wanted_speed, _ = sines(t)
    q, qd, qdd, torque = np.zeros((4, len(t)))
    x, v = wanted[0], wanted_speed[0]
    for k in range(len(t)):
        torque[k] = 40 * (wanted[k] - x) + 3 * (wanted_speed[k] - v)
        normal = 3.0 * (1 + 0.4 * np.cos(20 * x + 0.7))
        q[k], qd[k], qdd[k] = x, v, (torque[k] - 0.6 * np.sin(x) - 0.1 * normal * np.sign(v)) / 0.05
        v += qdd[k] * step
        x += v * step
    motion = one_joint(t, q, qd, qdd)
    columns = np.column_stack(
        [np.sign(qd), *CATALOGUE["gear_friction"].columns(motion, (0,), {"k": 20.0})[:, 0]]
    )
    found = np.linalg.lstsq(columns, torque - motion.rigid[:, 0], rcond=None)[0]
    assert_allclose(found, [0.3, 0.12 * np.cos(0.7), -0.12 * np.sin(0.7)], atol=1e-6)


def test_torque_constant_is_a_motor_that_needs_more_current_when_it_is_fast(motion):
    # A log in N m by the constant at rest; the true one falls by a percent a radian per second.
    needed = torque(motion)[:, 3]
    logged = needed / (1 - 0.01 * np.abs(motion.qd[:, 3]))
    column = CATALOGUE["torque_constant"].columns(
        replace(motion, reference=Frictionless(motion.reference)), (3,), {}
    )
    assert_allclose(0.01 * column[0, 0], logged - needed, atol=2e-3 * np.abs(needed).max())


class Frictionless:
    """A model whose whole torque is that of its bodies."""

    def __init__(self, model):
        self.rigid = self.total = model.rigid


def test_hysteresis_follows_the_dahl_equation_through_reversals():
    t = np.linspace(0, 6, 60001)
    q = 0.05 * np.sin(2 * t) + 0.02 * np.sin(5 * t)
    z = np.zeros_like(q)
    for k in range(1, len(q)):
        step = q[k] - q[k - 1]
        z[k] = z[k - 1] + step / 0.02 * (1 - z[k - 1] * np.sign(step))
    assert_allclose(presliding(q, 0.02), z, atol=5e-4)
    sign = coulomb_sign(np.gradient(q, t), Coulomb("smooth", (1e-5,), (), (0.02,)), 0, t[1])
    assert_allclose(sign, z, atol=2e-3)


def test_a_listed_effect_becomes_a_column_that_stands_alone(model):
    spec = EffectSpec("stribeck", ("lwr_2_joint",), {"a": 0.5, "vs": 0.05, "d": 2.0})
    made = build_model(replace(model.robot, effects=(spec,)))
    reduction = with_added(reduce(made), made)
    assert made.parameter_names[-1] == "stribeck3_a"
    assert "stribeck3_a" in reduction.alone
    assert reduction.rank == reduce(model).rank + 1


def test_two_waves_on_one_joint_have_names_of_their_own_and_one_effect_twice_is_an_error(model):
    def with_waves(*k):
        effects = tuple(
            EffectSpec("torque_ripple", (model.robot.joint_names[2],), {"k": each}) for each in k
        )
        return replace(model, robot=replace(model.robot, effects=effects)).parameter_names[-4:]

    assert with_waves(7.0, 14.0) == (
        "torque_ripple3_a",
        "torque_ripple3_b",
        "torque_ripple3_a_2",
        "torque_ripple3_b_2",
    )
    with pytest.raises(WrongRobotFile, match="torque_ripple is given twice on"):
        with_waves(7.0, 7.0)


@pytest.mark.parametrize(
    ("effect", "said"), [("stribek", "did you mean 'stribeck'"), ("stribeck", "vs")]
)
def test_an_effect_of_another_name_or_without_its_shape_is_an_error(model, effect, said):
    robot = replace(model.robot, effects=(EffectSpec(effect, ("lwr_2_joint",), {"a": 1.0}),))
    with pytest.raises(WrongRobotFile, match=said):
        _ = build_model(robot).parameter_names
