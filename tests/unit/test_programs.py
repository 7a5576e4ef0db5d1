"""Programs that dynid starts are installed ones, whatever lies in the folder that somebody gave."""

import os
import stat

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
