"""The logs in trajectories/ against the truth beside them, in Pinocchio."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

from arms import pinocchio_model, pinocchio_torques, tensor_of
from dynid import load_robot
from dynid.files.logs import read_log
from dynid.model.parameters import prior_bodies
from dynid.sim.plant import read_plant

FOLDER = Path(__file__).parents[2] / "trajectories"
#: The joints that carry the arm against gravity, from 0: there cylinders are not the arm.
HEAVY = {"kuka_lwr4plus": [1, 3], "kinova_gen2": [1, 3, 5]}


@pytest.mark.parametrize("job", ["identify", "validate"])
@pytest.mark.parametrize("arm", ["lwr4plus", "kinova_gen2"])
def test_the_truth_explains_the_torques_to_the_noise(arm, job):
    """Published inertias + friction in Pinocchio leave the sensors' noise; cylinders leave four times as much and more.

    The median is taken because filtering smears the Coulomb steps where a joint turns; that leaves up to 13 % more
    than white noise of the stated size, and the size itself is known to 3 to 5 % from 560 to 1560 samples.
    """
    plant = read_plant(FOLDER / f"{arm}_truth.yaml")
    robot = load_robot(plant.robot)
    log = read_log(FOLDER / f"{arm}_{job}.bag", robot=robot)
    columns, some = [log.names.index(name) for name in robot.log_names], slice(100, -100, 5)
    dt = round(float(np.median(np.diff(log.t))), 4)
    even = log.t[0] + np.arange(len(log)) * dt
    q = np.column_stack([np.interp(even, log.t, each) for each in log.q[:, columns].T])
    sos = butter(4, (8 if dt < 0.008 else 4) * 2 * dt, output="sos")
    q = sosfiltfilt(sos, q, axis=0)
    qd = np.gradient(q, dt, axis=0)
    qdd = np.gradient(qd, dt, axis=0)
    q, qd, qdd, tau = (x[some] for x in (q, qd, qdd, log.tau[:, columns]))
    others = plant.friction.torque(qd) + np.array(plant.rotor_inertia) * qdd

    def noise_ratio(bodies):
        rest = tau - others - pinocchio_torques(pinocchio_model(robot, bodies), q, qd, qdd)
        return np.median(np.abs(rest), axis=0) / 0.6745 / plant.sensors.torque_noise

    true = noise_ratio(plant.bodies)
    assert true.min() > 0.95
    assert true.max() < 1.14
    assert noise_ratio(prior_bodies(robot))[HEAVY[plant.robot]].min() > 4


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
