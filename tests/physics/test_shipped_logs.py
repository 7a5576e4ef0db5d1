"""The logs in trajectories/ against the truth beside them, in Pinocchio."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from rosbags.highlevel import AnyReader
from scipy.signal import butter, sosfiltfilt

from arms import pinocchio_model, pinocchio_torques, tensor_of
from dynid import load_robot
from dynid.model.parameters import prior_bodies
from dynid.sim.plant import read_plant

FOLDER = Path(__file__).parents[2] / "trajectories"
LOGS = [(arm, job) for arm in ("lwr4plus", "kinova_gen2") for job in ("identify", "validate")]


def read(robot, path):
    """Return time, positions and torques in chain order, columns taken by name."""
    with AnyReader([path]) as reader:
        (channel,) = reader.connections
        messages = [reader.deserialize(raw, channel.msgtype) for _, _, raw in reader.messages()]
    assert channel.topic == robot.driver.topic
    order = [messages[0].name.index(name) for name in robot.log_names]
    t = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages])
    return t - t[0], *(
        np.array([getattr(m, part) for m in messages])[:, order] for part in ("position", "effort")
    )


def derivatives(t, q, cutoff):
    """Return filtered positions on an even grid with their first two differences."""
    dt = round(float(np.median(np.diff(t))), 4)
    even = np.arange(len(t)) * dt
    sos = butter(4, cutoff * 2 * dt, output="sos")
    q = sosfiltfilt(sos, np.column_stack([np.interp(even, t, column) for column in q.T]), axis=0)
    qd = np.gradient(q, dt, axis=0)
    return q, qd, np.gradient(qd, dt, axis=0)


@pytest.fixture(scope="module", params=LOGS, ids="-".join)
def log(request):
    """The robot, its true plant, what the truth says about motion and log, and the log: t, q, tau."""
    arm, job = request.param
    path = FOLDER / f"{arm}_truth.yaml"
    plant, notes = read_plant(path), yaml.safe_load(path.read_text())
    robot = load_robot(plant.robot)
    (made,) = (each for each in notes["logs"] if each["file"] == f"{arm}_{job}.bag")
    return robot, plant, notes["motion"] | made, *read(robot, FOLDER / f"{arm}_{job}.bag")


def filtered(t, q):
    return derivatives(t, q, 8 if t[1] < 0.008 else 4)


#: The joints that carry the arm against gravity, from 0: there cylinders are not the arm.
HEAVY = {"kuka_lwr4plus": [1, 3], "kinova_gen2": [1, 3, 5]}


def test_the_truth_explains_the_torques_to_the_noise(log):
    """Published inertias + friction in Pinocchio leave the sensors' noise; cylinders leave four times as much and more.

    The median is taken because filtering smears the Coulomb steps where a joint turns; that leaves up to 13 % more
    than white noise of the stated size, and the size itself is known to 3 to 5 % from 560 to 1560 samples.
    """
    robot, plant, _, t, q, tau = log
    some = slice(100, -100, 5)
    q, qd, qdd = (state[some] for state in filtered(t, q))
    others = plant.friction.torque(qd) + np.array(plant.rotor_inertia) * qdd

    def noise_ratio(bodies):
        rest = tau[some] - others - pinocchio_torques(pinocchio_model(robot, bodies), q, qd, qdd)
        return np.median(np.abs(rest), axis=0) / 0.6745 / plant.sensors.torque_noise

    true = noise_ratio(plant.bodies)
    assert true.min() > 0.95
    assert true.max() < 1.14
    assert noise_ratio(prior_bodies(robot))[HEAVY[plant.robot]].min() > 4


def test_stamps_are_as_far_off_as_the_truth_says_and_positions_steps_of_the_encoder(log):
    """Steps of the clock differ by sqrt(2) times the jitter of a stamp; rate and duration are those that were asked."""
    _, plant, made, t, q, _ = log
    steps = q / plant.sensors.position_step
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-6)
    assert len(t) == made["duration"] * made["rate"]
    assert np.diff(t).mean() == pytest.approx(1 / made["rate"], rel=1e-4)
    assert np.diff(t).std() == pytest.approx(np.sqrt(2) * plant.sensors.stamp_jitter, rel=0.02)


def test_the_motion_uses_its_share_of_the_limits_and_no_more(log):
    """The fastest joint moves as fast as was asked, to the controller's 2 %; none goes further or needs its torque."""
    robot, _, made, t, q, tau = log
    speed = np.abs(filtered(t, q)[1]).max(axis=0) / [
        joint.limits.velocity for joint in robot.joints
    ]
    assert speed.max() == pytest.approx(made["speed"], rel=0.02)
    for k, joint in enumerate(robot.joints):
        low, high = joint.limits.position or (-np.pi, np.pi)
        reach = np.abs(q[:, k] - (low + high) / 2).max() / ((high - low) / 2)
        assert reach < 1.01 * made["reach"]
        assert np.abs(tau[:, k]).max() < 0.25 * joint.limits.torque


def test_the_bodies_are_those_that_were_published():
    """Masses of rtt_lwr and of kinova-ros; all inertias obey the triangle inequality."""
    masses = {
        "lwr4plus": [
            *(2.30339939, 2.30343543, 2.30342144, 2.30343587),
            *(1.60059828, 1.49302437, 0.108688241),
        ],
        "kinova_gen2": [0.7477, 0.8447, 0.8447, 0.6763, 0.463, 0.463, 0.99],
    }
    for arm, expected in masses.items():
        bodies = read_plant(FOLDER / f"{arm}_truth.yaml").bodies
        assert [body.mass for body in bodies] == expected
        for body in bodies:
            a, b, c = np.linalg.eigvalsh(tensor_of(body))
            assert a > 0
            assert a + b >= c * (1 - 1e-12)
