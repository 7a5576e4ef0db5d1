"""Batch files are read with defaults and relative paths, and refused with file and line."""

from pathlib import Path

import pytest

from dynid.errors import DynidError, UnknownKey, WrongRobotFile
from dynid.files.batchfile import folder_name, read_batch


def batch(folder, text):
    path = folder / "batch.yaml"
    path.write_text(text)
    return path


def test_defaults_hold_for_all_jobs_and_paths_are_relative_to_the_file(tmp_path):
    """A job's own keys win."""
    text = """
defaults: {robot: arms/one.urdf#tip, tolerance: 1%, options: {cutoff: 8, drop_weak: true}}
jobs:
  - logs: a.bag
  - {logs: [a.bag, b.bag], name: both, robot: kinova_gen2, validate: c.bag, baseline: old, fail_if: max_rms_nm > 1}
"""
    first, second = read_batch(batch(tmp_path, text))
    assert (first.name, first.robot, first.logs) == (
        "one-a",
        str(tmp_path / "arms/one.urdf#tip"),
        (tmp_path / "a.bag",),
    )
    assert first.options == {"cutoff": "8", "drop_weak": "true"}
    assert (second.robot, second.tolerance, second.baseline) == (
        "kinova_gen2",
        "1%",
        tmp_path / "old",
    )
    assert second.logs == (tmp_path / "a.bag", tmp_path / "b.bag")
    assert second.fail_if == ("max_rms_nm > 1",)


@pytest.mark.parametrize(
    ("text", "error", "message"),
    [
        (
            "jobs: [{robot: arm, log: a.bag}]",
            UnknownKey,
            r"batch.yaml:1: unknown key 'log'; did you mean 'logs'",
        ),
        ("jobs:\n- {robot: arm}", WrongRobotFile, r"batch.yaml:2: jobs\[0\] lacks the key 'logs'"),
        ("jobs: [{robot: arm, logs: []}]", WrongRobotFile, "is empty"),
        (
            "jobs: [{robot: a, logs: x.bag}, {robot: a, logs: d/x.bag}]",
            WrongRobotFile,
            "two jobs would write to the folder 'a-x'",
        ),
        ("logs: [a.bag]", DynidError, "unknown key 'logs'"),
    ],
)
def test_mistakes_are_named_with_their_line(text, error, message, tmp_path):
    """The same rules as for robot files."""
    with pytest.raises(error, match=message):
        read_batch(batch(tmp_path, text))


def test_a_jobs_folder_stays_inside_the_results(tmp_path):
    """A name with slashes or dots cannot lead out of it."""
    (job,) = read_batch(batch(tmp_path, "jobs: [{name: ../../etc/x, robot: a, logs: l.bag}]"))
    assert Path(folder_name(job)).name == folder_name(job)
    assert not folder_name(job).startswith(".")
