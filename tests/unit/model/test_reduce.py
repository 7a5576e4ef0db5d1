"""Ranks and classes against published counts (paper notes C1) and against Pinocchio's regressor."""

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from dynid.files.robotfile import load_robot
from dynid.model import build_model
from dynid.model.reduce import random_states, reduce


def variant(name, **changes):
    robot = load_robot(name)
    joint_changes = changes.pop("joints", {})
    joints = tuple(replace(joint, friction=(), **joint_changes) for joint in robot.joints)
    return replace(robot, joints=joints, **changes)


CASES = {
    "Gen2, Table 6": (variant("paper/kinova_gen2_table6"), 48, 31, 11),
    "Gen2, driver table": (variant("kinova_gen2"), 48, 31, 11),
    "LWR4+, corrected": (variant("kuka_lwr4plus"), 48, 31, 11),
    "LWR4+, all d zero": (variant("paper/kuka_lwr4plus_table7"), 48, 31, 16),
    "Gen2 without rotor inertia": (
        variant("paper/kinova_gen2_table6", joints={"motor_inertia": False}),
        43,
        26,
        11,
    ),
    "LWR4+ without rotor inertia": (
        variant("kuka_lwr4plus", joints={"motor_inertia": False}),
        43,
        26,
        11,
    ),
    "Gen2 on a wall": (variant("paper/kinova_gen2_table6", gravity=(9.81, 0.0, 0.0)), 50, 32, 8),
    "Gen2 without gravity": (
        variant("paper/kinova_gen2_table6", gravity=(0.0, 0.0, 0.0)),
        44,
        27,
        13,
    ),
    "LWR4+, all d zero, without gravity": (
        variant("paper/kuka_lwr4plus_table7", gravity=(0.0, 0.0, 0.0)),
        36,
        24,
        33,
    ),
}


@pytest.mark.parametrize("case", CASES, ids=str)
def test_ranks_and_classes_are_the_published_ones(case):
    robot, rank, alone, none = CASES[case]
    found = reduce(build_model(robot))
    assert (found.rank, len(found.alone), len(found.none)) == (rank, alone, none)
    assert len(found.combined) == len(found.names) - alone - none


def test_each_friction_column_stands_alone():
    found = reduce(build_model(load_robot("kuka_lwr4plus")))
    assert found.rank == 48 + 21
    assert {f"{kind}{j}" for kind in ("fv", "fc", "fo") for j in range(1, 8)} <= set(found.alone)


def test_the_relations_of_the_lwr_are_the_published_ones():
    found = reduce(build_model(variant("kuka_lwr4plus")))
    terms = {name: found.terms(i) for i, name in enumerate(found.base_names)}
    d3, d7 = 0.4, 0.078
    heavier = {f"m{k}": d3**2 for k in range(3, 8)}
    assert terms["Iyy1R"] == pytest.approx({"Iyy1": 1, "Im1": 1, "Izz2": 1})
    assert terms["Ixx2R"] == pytest.approx(
        {"Ixx2": 1, "Izz2": -1, "Izz3": 1, "mcy3": -2 * d3, **heavier}
    )
    assert terms["mcz5R"] == pytest.approx({"mcz5": 1, "mcy6": -1})
    assert terms["Ixx6R"] == pytest.approx(
        {"Ixx6": 1, "Izz6": -1, "Iyy7": 1, "mcz7": 2 * d7, "m7": d7**2}
    )
    assert terms["Ixx7R"] == pytest.approx({"Ixx7": 1, "Iyy7": -1})


@pytest.mark.slow
@pytest.mark.parametrize("name", ["kuka_lwr4plus", "kinova_gen2", "franka_panda", "ur10"])
def test_base_columns_times_relations_give_the_whole_regressor(name):
    model = build_model(load_robot(name))
    found = reduce(model)
    P = model.regressor(*random_states(model.robot, 20, seed=7)).reshape(-1, model.size)
    assert P[:, found.base] @ found.K == pytest.approx(P, abs=1e-9 * np.abs(P).max())


def test_the_result_does_not_depend_on_the_seed():
    model = build_model(variant("kinova_gen2"))
    first, second = (reduce(model, seed=seed) for seed in (0, 99))
    assert first.base.tolist() == second.base.tolist()
    assert pytest.approx(second.K, abs=1e-9) == first.K


def test_the_span_is_that_of_pinocchios_regressor():
    robot = variant("kuka_lwr4plus", joints={"motor_inertia": False})
    model = build_model(robot)
    P = model.regressor(*(states := random_states(robot, 60, seed=3))).reshape(-1, model.size)
    reference = pin.Model()
    reference.gravity = pin.Motion(np.array(robot.gravity), np.zeros(3))
    parent, place = 0, pin.SE3.Identity()
    for joint in robot.joints:
        here = place * pin.SE3(
            pin.utils.rotate("z", joint.theta_offset), np.array([0.0, 0.0, joint.d])
        )
        parent = reference.addJoint(parent, pin.JointModelRZ(), here, joint.name)
        reference.appendBodyToJoint(parent, pin.Inertia.Random(), pin.SE3.Identity())
        place = pin.SE3(pin.utils.rotate("x", joint.twist), np.array([joint.a, 0.0, 0.0]))
    data = reference.createData()
    other = np.vstack(
        [
            pin.computeJointTorqueRegressor(reference, data, *state).copy()
            for state in zip(*states, strict=True)
        ]
    )
    ranks = [
        np.linalg.matrix_rank(W / np.linalg.norm(W, axis=0).max(), tol=1e-8)
        for W in (P, other, np.hstack([P, other]))
    ]
    assert ranks == [43, 43, 43]


def test_a_joint_that_slides_along_gravity_ties_mass_rotor_and_offset_together():
    """Its force is m (qdd + g) + Im qdd + fo: three parameters, two functions of time."""
    robot = load_robot("scara")
    found = reduce(build_model(robot))
    sliding = next(k for k, joint in enumerate(robot.joints, start=1) if not joint.revolute)
    assert {f"m{sliding}", f"Im{sliding}", f"fo{sliding}"} <= set(found.combined)
    together = [terms for i in range(found.rank) if f"fo{sliding}" in (terms := found.terms(i))]
    assert together
