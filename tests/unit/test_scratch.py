"""Temporary files carry who made them; the next run removes those of processes that have ended, and no others."""

import os
import subprocess
import sys
from contextlib import suppress

import pytest

from dynid import scratch
from dynid.scratch import scratch_folder, sweep


def of_process(number: int) -> str:
    return scratch.prefix().replace(f"-{os.getpid()}-", f"-{number}-")


@pytest.fixture
def ended() -> int:
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid


@pytest.fixture(autouse=True)
def not_swept(monkeypatch):
    monkeypatch.setattr(scratch, "_SWEPT", set())


def test_what_ended_processes_left_is_removed_and_nothing_else(tmp_path, ended):
    left = [f"{of_process(ended)}abc", f".{of_process(ended)}def"]
    kept = [
        f"{of_process(os.getpid())}abc",
        f"{of_process(os.getppid())}abc",
        f".{of_process(1)}abc",
        "log.npz",
        "dynid-notes-1-x",
        f"dynid-00000000-{ended}-abc",
        f"dynid-{ended}-abc",
        f"{of_process(10**30)}x",
    ]
    for name in (*left, *kept):
        (tmp_path / name).write_text("x")
    (tmp_path / f"{of_process(ended)}folder" / "deep").mkdir(parents=True)
    sweep(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted(kept)


def test_a_link_in_the_place_of_a_temporary_folder_is_removed_and_not_followed(tmp_path, ended):
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "log.npz").write_text("x")
    (tmp_path / f"{of_process(ended)}abc").symlink_to(tmp_path / "mine")
    sweep(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["mine"]
    assert (tmp_path / "mine" / "log.npz").exists()


def test_a_scratch_folder_is_gone_with_its_block_also_after_an_error(tmp_path):
    with suppress(ZeroDivisionError), scratch_folder(tmp_path) as folder:
        (folder / "deep").mkdir()
        (folder / "deep" / "file").write_text("x")
        assert folder.name.startswith(".dynid-")
        raise ZeroDivisionError
    assert not list(tmp_path.iterdir())


def test_a_folder_that_is_not_there_or_cannot_be_read_is_no_matter(tmp_path):
    sweep(tmp_path / "missing")
    (tmp_path / "file").write_text("x")
    sweep(tmp_path / "file")
