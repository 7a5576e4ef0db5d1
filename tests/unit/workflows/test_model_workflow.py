"""A base model is derived once, and shows people every parameter in the class that the reduction gives it."""

import sys
from dataclasses import replace

import numpy as np
import pytest

from dynid import ModelOptions, base_model, load_robot
from dynid.errors import PackageMissing
from dynid.model.base_model import key_of, stored_key
from dynid.model.parameters import columns_of
from dynid.workflows.model import adapted, derive_model, reduce_model, stored_differences


@pytest.fixture(scope="module")
def base():
    return base_model(load_robot("scara"))


def test_every_parameter_is_in_one_class(base):
    classes = base.classes
    assert sorted(name for names in classes.values() for name in names) == sorted(
        base.model.parameter_names
    )
    assert base.rank == len(base.names) == len(base.table())


def test_the_table_says_what_each_base_parameter_is_made_of(base):
    for row, terms in zip(base.table(), map(base.reduction.terms, range(base.rank)), strict=True):
        assert row["class"] == ("alone" if len(terms) == 1 else "combined")
        assert all(name in row["made of"] for name in terms)
        assert row["unit"] == base.model.units[row["name"].removesuffix("R")]


def test_the_numbers_behind_the_relations_are_those_of_the_robot_file(base):
    joints = base.robot.joints
    assert base.symbols == {"a1": joints[0].a, "a2": joints[1].a}
    assert base.where == "with a1 = 0.325 m, a2 = 0.275 m"


def test_the_class_table_marks_each_joint(base):
    rows = base.class_table()
    assert [row["joint"] for row in rows] == [
        f"{j} {name}" for j, name in enumerate(base.robot.joint_names, 1)
    ]
    marks = [value for row in rows for key, value in row.items() if key != "joint"]
    counts = {
        "#": base.classes["alone"],
        "+": base.classes["combined"],
        ".": base.classes["not identifiable"],
    }
    assert {mark: marks.count(mark) for mark in counts} == {
        mark: len(names) for mark, names in counts.items()
    }
    assert repr(base).startswith(
        "Example SCARA: of 56 parameters 16 are identifiable alone, 15 only"
    )


def test_without_pandas_a_data_frame_is_refused_by_name(base, monkeypatch):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(PackageMissing, match="pandas"):
        base.to_dataframe()


def test_options_change_the_arm_as_text_and_as_values():
    robot = load_robot("scara")
    assert (
        ModelOptions(gravity="9.81,0,0").gravity
        == ModelOptions(gravity=(9.81, 0, 0)).gravity
        == (9.81, 0.0, 0.0)
    )
    bare = adapted(robot, ModelOptions(effects="none", links="1-2,4"))
    assert (
        bare.identified_links
        == adapted(robot, ModelOptions(links=(1, 2, 4))).identified_links
        == (1, 2, 4)
    )
    assert columns_of(base_model(bare).model.parameters, "fv", "fc", "fo", "Im").size == 0
    on_wall = base_model(robot, options=ModelOptions(gravity=(9.81, 0, 0)))
    assert on_wall.rank > base_model(robot).rank


def test_a_model_in_a_folder_is_the_one_in_memory(tmp_path, base):
    first, second = (base_model(base.robot, tmp_path) for _ in range(2))
    assert first.names == second.names == base.names
    assert np.array_equal(first.reduction.K, second.reduction.K)
    assert first.relations == second.relations
    states = np.random.default_rng(0).normal(size=(3, 4, base.robot.n))
    assert np.array_equal(first.model.regressor(*states), second.model.regressor(*states))
    assert {path.name for path in tmp_path.iterdir()} == {"regressor.npz", "fullregressor.npz"}


def test_a_regressor_is_derived_once_and_again_when_the_robot_changes(tmp_path):
    robot = load_robot("scara")
    assert stored_differences(robot, tmp_path) is None
    assert [bool(derive_model(robot, tmp_path).wrote) for _ in range(2)] == [True, False]
    moved = replace(robot, joints=(replace(robot.joints[0], a=0.9), *robot.joints[1:]))
    assert stored_differences(moved, tmp_path) == "joints[0].a 0.325 -> 0.9"
    assert derive_model(moved, tmp_path).wrote
    assert stored_key(tmp_path / "regressor.npz") == key_of(moved)


def test_random_states_that_differ_from_the_usual_are_not_answered_from_the_file(tmp_path):
    derived = derive_model(load_robot("scara"), tmp_path)
    again = derive_model(derived.model.robot, tmp_path)
    assert [bool(reduce_model(x).wrote) for x in (derived, again)] == [True, False]
    assert reduce_model(again, ModelOptions(samples=300)).wrote
