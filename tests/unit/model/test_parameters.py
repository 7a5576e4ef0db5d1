"""The table of columns: what each stands for."""

from dataclasses import replace

from dynid import load_robot
from dynid.model import build_model
from dynid.model.parameters import link_parameters


def test_units_of_sliding_joints_are_those_of_forces():
    robot = load_robot("kuka_lwr4plus")
    first = replace(robot.joints[0], type="prismatic", friction=("viscous", "coulomb", "offset"))
    units = build_model(replace(robot, joints=(first, *robot.joints[1:]))).units
    assert [units[name] for name in ("m1", "Im1", "fv1", "fc1", "fo1")] == [
        "kg",
        "kg",
        "N s/m",
        "N",
        "N",
    ]
    assert [units[name] for name in ("mcx2", "Im2", "Ixy2", "fv2")] == [
        "kg m",
        "kg m^2",
        "kg m^2",
        "N m s/rad",
    ]
    assert [parameter.name for parameter in link_parameters(robot)[9:13]] == [
        "Izz1",
        "Im1",
        "m2",
        "mcx2",
    ]
