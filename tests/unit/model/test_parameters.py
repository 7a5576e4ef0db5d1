"""The table of columns: what each stands for, and where those of one kind are."""

from dataclasses import replace

from dynid.files.robotfile import load_robot
from dynid.model import build_model
from dynid.model.parameters import body_columns, columns_of, link_parameters, numbered
from dynid.robot import LINK_PARAMETERS, EffectSpec


def test_body_columns_are_found_whatever_their_order():
    kinds = [
        ("fv", 2),
        *((p, 2) for p in LINK_PARAMETERS),
        *((p, 3) for p in reversed(LINK_PARAMETERS)),
    ]
    table = [numbered(kind, link, "") for kind, link in kinds]
    found = body_columns(table)
    assert list(found) == [2, 3]
    for link, columns in found.items():
        assert [table[k].name for k in columns] == [f"{p}{link}" for p in LINK_PARAMETERS[:10]]


def test_every_column_of_a_model_has_its_kind_and_joint():
    robot = load_robot("staubli_tx40")
    spec = EffectSpec("stribeck", (robot.joint_names[2],), {"vs": 0.1, "d": 1.0, "a": 0.2})
    model = build_model(replace(robot, links=(1, 2, 3, 5, 6), effects=(spec,)))
    for kind in ("m", "Izz", "Im", "fv", "fc", "fo", "Imc", "fvc", "fcc"):
        columns = columns_of(model.parameters, kind)
        numbers = [int(model.parameter_names[k][len(kind) :]) for k in columns]
        assert [model.parameters[k].number for k in columns] == numbers
    assert [model.parameters[k].number for k in columns_of(model.parameters, "m")] == [
        1,
        2,
        3,
        5,
        6,
    ]
    assert columns_of(model.parameters, "Imc").size == 1
    (added,) = columns_of(model.parameters, "stribeck")
    assert (model.parameters[added].name, model.parameters[added].number) == ("stribeck3_a", 3)


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
