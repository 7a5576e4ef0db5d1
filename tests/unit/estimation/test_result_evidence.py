"""What is known of a result is the same from wherever it is opened."""

from types import SimpleNamespace

import pytest

from dynid.estimation.evidence import found_path


@pytest.fixture
def moved(tmp_path):
    """A result that was identified in the folder s, with two recordings there and an empty folder beside."""
    for folder in ("s/out/arm", "elsewhere"):
        (tmp_path / folder).mkdir(parents=True)
    for name in ("a.csv", "loaded.csv"):
        (tmp_path / "s" / name).write_text("")
    header = {"logs": ["a.csv"], "logs_from_here": ["../../a.csv"]}
    return SimpleNamespace(path=tmp_path / "s/out/arm/parameters.npz", header=header)


def test_a_recording_that_was_typed_where_the_arm_was_identified_is_found_from_elsewhere(
    moved, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path / "s")
    assert found_path(moved, "loaded.csv") == "loaded.csv"
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert found_path(moved, "loaded.csv") == str(tmp_path / "s/loaded.csv")


def test_a_recording_is_the_same_whichever_way_it_was_typed(moved, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path / "elsewhere")
    typed = (
        "loaded.csv",
        "../s/loaded.csv",
        "../elsewhere/../s/loaded.csv",
        str(tmp_path / "s/loaded.csv"),
    )
    assert {found_path(moved, name) for name in typed} == {str(tmp_path / "s/loaded.csv")}


def test_a_recording_that_is_gone_keeps_its_name(moved):
    assert found_path(moved, "gone.csv") == "gone.csv"
    assert found_path(moved, "") == ""
