"""The stored model: keyed by content, rebuilt when stale, never executing what a file says."""

import pytest

from dynid import load_robot
from dynid.errors import NewerSchema, NotAnArtifact
from dynid.files.artifact import read_artifact
from dynid.model import build_model
from dynid.model.base_model import (
    load_model,
    save_model,
)
from dynid.npz import write_artifact


@pytest.fixture(scope="module")
def robot():
    return load_robot("scara")


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
