"""The regressor times the parameters against two inverse dynamics that other people wrote."""

import numpy as np
import pinocchio as pin
import pytest

from arms import (
    pinocchio_model,
    pinocchio_torques,
    random_bodies,
    random_robot,
    random_states,
    relative_error,
    simulated_torques,
    tensor_of,
)
from dynid.model import build_model
from dynid.sim.arm import SimulatedArm

FRICTION = ("fv", "fc", "fo")


def parameters(model, bodies, rotors, friction):
    """Return gamma in the model's own order, taken by name."""
    values = {}
    kinds = ("m", "mcx", "mcy", "mcz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
    for i, body in enumerate(bodies, start=1):
        about_origin = tensor_of(body) - body.mass * pin.skew(np.array(body.com)) @ pin.skew(
            np.array(body.com)
        )
        ten = [body.mass, *(body.mass * np.array(body.com)), *about_origin[np.triu_indices(3)]]
        values |= {f"{kind}{i}": value for kind, value in zip(kinds, ten, strict=True)}
        values[f"Im{i}"] = rotors[i - 1]
        values |= {f"{kind}{i}": friction[kind][i - 1] for kind in FRICTION}
    return np.array([values[name] for name in model.parameter_names])


def random_drives(rng, n):
    return rng.uniform(0.01, 0.5, n), {kind: rng.uniform(0.1, 1.0, n) for kind in FRICTION}


@pytest.mark.parametrize("seed", range(80))
def test_any_arm_has_the_torques_of_pinocchio(seed):
    """2 to 8 joints, both conventions, turning and sliding joints mixed, any gravity: 1e-9 relative."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng)
    bodies, (rotors, friction) = random_bodies(rng, robot.n), random_drives(rng, robot.n)
    q, qd, qdd = random_states(rng, robot.n, 5)
    model = build_model(robot)
    tau = model.regressor(q, qd, qdd) @ parameters(model, bodies, rotors, friction)
    expected = pinocchio_torques(pinocchio_model(robot, bodies, rotors), q, qd, qdd)
    smooth_within = np.array([0.01 if joint.revolute else 0.001 for joint in robot.joints])
    expected += friction["fv"] * qd + friction["fc"] * np.tanh(qd / smooth_within) + friction["fo"]
    assert relative_error(tau, expected) < 1e-9


@pytest.mark.parametrize("seed", range(300, 312))
def test_any_arm_has_the_torques_of_mujoco(seed):
    """Through the URDF: geometry, base pose, gravity in the world and inertias in other frames; 1e-6 relative."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng)
    bodies = random_bodies(rng, robot.n)
    q, qd, qdd = random_states(rng, robot.n, 5)
    model = build_model(robot)
    nothing = {kind: np.zeros(robot.n) for kind in FRICTION}
    tau = model.regressor(q, qd, qdd) @ parameters(model, bodies, np.zeros(robot.n), nothing)
    arm = SimulatedArm(robot, bodies)
    expected = simulated_torques(arm, q, qd, qdd)
    assert relative_error(tau, expected) < 1e-6
