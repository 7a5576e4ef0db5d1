"""Programs that dynid starts are installed ones, whatever lies in the folder that somebody gave."""

import os
import stat
import subprocess
import time

import pytest

from dynid import programs


def script(path, text="exit 0"):
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)


@pytest.mark.parametrize("word", [".", "", "./", "bin", "..", "{here}"])
def test_a_program_of_the_current_folder_is_not_found(word, tmp_path, monkeypatch):
    (tmp_path / "bin").mkdir()
    for place in (tmp_path, tmp_path / "bin"):
        script(place / "cc")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", os.pathsep.join([word.format(here=tmp_path), "/nowhere"]))
    assert programs.installed("cc") is None


def test_an_installed_program_is_found_behind_one_of_the_current_folder(tmp_path, monkeypatch):
    here, there = tmp_path / "here", tmp_path / "there"
    for place in (here, there):
        place.mkdir()
        script(place / "cc")
    monkeypatch.chdir(here)
    monkeypatch.setenv("PATH", f".{os.pathsep}{there}")
    assert programs.installed("gcc", "cc") == str(there / "cc")
    assert programs.environment(tmp_path)["PATH"] == str(there)


def test_a_program_that_hangs_is_ended_with_all_that_it_started(tmp_path, monkeypatch):
    """What a script waits for would hold its pipes open for ever."""
    script(tmp_path / "cc", f"sleep 300 &\necho $! > {tmp_path}/child\nwait")
    monkeypatch.setattr(programs, "PATIENCE_S", 1.0)
    start = time.monotonic()
    with pytest.raises(subprocess.TimeoutExpired):
        programs.run([str(tmp_path / "cc")], tmp_path)
    assert time.monotonic() - start < 60.0
    child = int((tmp_path / "child").read_text())
    state = subprocess.run(
        ["ps", "-o", "stat=", "-p", str(child)], capture_output=True, text=True
    ).stdout.strip()
    assert state[:1] in ("", "Z"), "the one that was waited for has ended too"


def test_a_program_tells_its_failure(tmp_path):
    script(tmp_path / "cc", "exit 3")
    with pytest.raises(subprocess.CalledProcessError) as caught:
        programs.run([str(tmp_path / "cc")], tmp_path)
    assert caught.value.returncode == 3
