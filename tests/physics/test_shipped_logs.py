"""The logs in trajectories/ against the truth beside them, in Pinocchio."""

from pathlib import Path

import numpy as np
import pytest
from arms import pinocchio_model, pinocchio_torques
from rosbags.highlevel import AnyReader
from scipy.signal import butter, sosfiltfilt

from dynid.files.robotfile import load_robot
from dynid.model.prior import prior_bodies
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
    return t - t[0], *(np.array([getattr(m, part) for m in messages])[:, order] for part in ("position", "effort"))


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
    arm, job = request.param
    plant = read_plant(FOLDER / f"{arm}_truth.yaml")
    robot = load_robot(plant.robot)
    return robot, plant, *read(robot, FOLDER / f"{arm}_{job}.bag")


def test_the_truth_explains_the_torques_to_the_noise(log):
    """Published inertias + friction in Pinocchio leave the sensors' noise; cylinders leave far more.

    The median is taken because filtering smears the Coulomb steps where a joint turns.
    """
    robot, plant, t, q, tau = log
    states = derivatives(t, q, 8 if t[1] < 0.008 else 4)
    some = slice(100, -100, 5)
    q, qd, qdd = (state[some] for state in states)
    others = plant.friction.torque(qd) + np.array(plant.rotor_inertia) * qdd

    def worst(bodies):
        rest = tau[some] - others - pinocchio_torques(pinocchio_model(robot, bodies), q, qd, qdd)
        return (np.median(np.abs(rest), axis=0) / 0.6745 / plant.sensors.torque_noise).max()

    assert worst(plant.bodies) < 1.15
    assert worst(prior_bodies(robot)) > 5


def test_positions_stay_inside_the_limits_and_rest_at_both_ends(log):
    """The first and last 0.4 s are still to within the sag under gravity and the encoder's step."""
    robot, _, t, q, tau = log
    for i, joint in enumerate(robot.joints):
        if joint.limits.position:
            assert q[:, i].min() > joint.limits.position[0]
            assert q[:, i].max() < joint.limits.position[1]
        assert np.abs(np.gradient(q[:, i], t)).max() < 1.05 * joint.limits.velocity
        assert np.abs(tau[:, i]).max() < joint.limits.torque
    for end in (t < 0.4, t > t[-1] - 0.4):
        assert np.ptp(q[end], axis=0).max() < np.radians(0.5)


def test_every_joint_moves_a_lot_in_the_logs_to_identify_from(log):
    """At least 40 degrees, and the truth has a value for every parameter of the model."""
    robot, plant, t, q, _ = log
    if t[-1] > 35:
        assert np.degrees(np.ptp(q, axis=0)).min() > 40
    assert len(plant.parameters()) == 14 * robot.n


def test_the_bodies_are_those_that_were_published():
    """Masses of rtt_lwr and of kinova-ros; all inertias obey the triangle inequality."""
    masses = {
        "lwr4plus": [2.30339939, 2.30343543, 2.30342144, 2.30343587, 1.60059828, 1.49302437, 0.108688241],
        "kinova_gen2": [0.7477, 0.8447, 0.8447, 0.6763, 0.463, 0.463, 0.99],
    }
    for arm, expected in masses.items():
        bodies = read_plant(FOLDER / f"{arm}_truth.yaml").bodies
        assert [body.mass for body in bodies] == expected
        for body in bodies:
            xx, xy, xz, yy, yz, zz = body.inertia_com
            a, b, c = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
            assert a > 0
            assert a + b >= c * (1 - 1e-12)
