"""The stored model: keyed by content, rebuilt when stale, never executing what a file says."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import NewerSchema, NotAnArtifact
from dynid.files.artifact import read_artifact
from dynid.files.robotfile import load_robot
from dynid.model import build_model
from dynid.model.base_model import (
    key_of,
    load_model,
    load_reduction,
    save_model,
    save_reduction,
)
from dynid.model.relations import base_parameters
from dynid.npz import write_artifact

LISTS = ("names", "alone", "none", "combined", "gap", "formulas")


@pytest.fixture(scope="module")
def robot():
    return load_robot("scara")


def test_a_stored_model_gives_the_same_torques(robot, tmp_path):
    model = build_model(robot)
    save_model(tmp_path / "regressor.npz", model)
    states = np.random.default_rng(0).normal(size=(3, 4, robot.n))
    again = load_model(tmp_path / "regressor.npz", robot)
    assert again.regressor(*states) == pytest.approx(model.regressor(*states), abs=0)


def test_names_limits_and_priors_do_not_change_the_key(robot):
    assert key_of(replace(robot, name="other")) == key_of(robot)


def test_base_parameters_are_read_back(robot, tmp_path):
    model = build_model(robot)
    first = base_parameters(model)
    save_reduction(tmp_path / "fullregressor.npz", model, first)
    second = load_reduction(tmp_path / "fullregressor.npz")
    assert [getattr(first, name) for name in LISTS] == [getattr(second, name) for name in LISTS]
    for name in ("base", "K", "singular_values"):
        assert np.array_equal(getattr(first, name), getattr(second, name))


def test_a_program_with_operations_that_read_ahead_is_damaged(robot, tmp_path):
    path = tmp_path / "regressor.npz"
    save_model(path, build_model(robot))
    artifact = read_artifact(path)
    write_artifact(
        path,
        artifact.schema,
        artifact.header,
        {**artifact.arrays, "lhs": artifact.arrays["lhs"] + 10000},
    )
    with pytest.raises(NotAnArtifact, match="damaged"):
        load_model(path, robot)


def test_a_newer_file_asks_for_an_upgrade(robot, tmp_path):
    path = tmp_path / "regressor.npz"
    write_artifact(path, "dynid/regressor/9", {}, {})
    with pytest.raises(NewerSchema):
        load_model(path, robot)
