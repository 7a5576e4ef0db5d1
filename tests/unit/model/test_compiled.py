"""The compiled interpreter computes the bits that NumPy computes, and wherever it cannot be had NumPy goes on."""

import os

import numpy as np
import pytest

from dynid.files.robotfile import load_robot
from dynid.model import build_model, program, tuning
from dynid.workflows.doctor import fast_regressor

needs_compiler = pytest.mark.skipif(program.compiler() is None, reason="no C compiler")


@pytest.fixture
def cache(tmp_path, monkeypatch):
    """A cache of its own, and a process that knows nothing yet."""
    monkeypatch.setattr(program, "_interpreter", program._Interpreter())
    monkeypatch.setattr(program, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache"


def entries(robot, library, monkeypatch):
    """The regressor of a few thousand samples, which are no whole number of blocks."""
    monkeypatch.setattr(
        program, "_interpreter", program._Interpreter(looked=True, tried=True, library=library)
    )
    model = build_model(load_robot(robot))
    q, qd, qdd = np.random.default_rng(0).standard_normal((3, 3001, model.robot.n))
    return np.concatenate([each.copy() for _, each in model.observer().blocks(q, qd, qdd)], axis=1)


@needs_compiler
@pytest.mark.parametrize("robot", ["scara", "kuka_lwr4plus", "kinova_gen3"])
def test_compiled_and_interpreted_regressors_are_equal_to_the_bit(robot, cache, monkeypatch):
    library = program._compiled()
    assert library is not None
    np.testing.assert_array_equal(
        entries(robot, library, monkeypatch), entries(robot, None, monkeypatch)
    )


@needs_compiler
def test_only_many_samples_are_worth_a_compilation_and_the_next_process_finds_it(
    cache, monkeypatch
):
    assert program.interpreter(tuning.SAMPLES_WORTH_COMPILING) is None
    assert not cache.exists()
    assert fast_regressor()[1].startswith("not compiled yet")
    assert program.interpreter(1) is not None
    assert [file.name for file in (cache / "kernels").iterdir()] == [program.place().name]
    monkeypatch.setattr(program, "_interpreter", program._Interpreter())
    assert program.interpreter(1) is not None
    assert fast_regressor()[0]


def test_numpy_goes_on_without_a_compiler(cache, monkeypatch):
    monkeypatch.setattr(program.programs, "installed", lambda name: None)
    for _ in range(3):
        assert program.interpreter(10 * tuning.SAMPLES_WORTH_COMPILING) is None
    assert not cache.exists()
    assert "no C compiler" in fast_regressor()[1]


@needs_compiler
@pytest.mark.parametrize(
    "way", ["no folder", "a compiler that fails", "a compiler that writes nothing"]
)
def test_numpy_goes_on_where_compiling_fails(way, cache, monkeypatch):
    if way == "no folder":
        cache.write_text("")
    else:
        monkeypatch.setattr(program, "compiler", lambda: "false" if "fails" in way else "true")
    for _ in range(3):
        assert program.interpreter(10 * tuning.SAMPLES_WORTH_COMPILING) is None
    assert way == "no folder" or not list((cache / "kernels").iterdir())


def test_temporary_files_of_a_compiler_that_is_stopped_are_in_the_folder_that_is_removed(
    tmp_path, cache, monkeypatch
):
    stopped, temporary = tmp_path / "cc", tmp_path / "tmp"
    stopped.write_text('#!/bin/sh\ntouch "$TMPDIR/ccX.s" "$TMPDIR/../seen"\nkill -9 $$\n')
    stopped.chmod(0o755)
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    monkeypatch.setattr(program, "compiler", lambda: str(stopped))
    assert program._compiled() is None
    assert [file.name for file in (cache / "kernels").iterdir()] == ["seen"], (
        "it was asked, and nothing else is left"
    )
    assert not list(temporary.iterdir())


@needs_compiler
@pytest.mark.parametrize("others", ["file", "folder", "link"])
def test_what_others_can_change_is_not_loaded(others, cache):
    assert program._compiled() is not None
    path = program.place()
    if others == "link":
        path.rename(path.with_name("other.so"))
        path.symlink_to("other.so")
    else:
        os.chmod(path if others == "file" else path.parent, 0o777)  # noqa: PTH101
    assert program.kept() is None
    assert "can be changed by others" in fast_regressor()[1]


def test_what_is_no_library_is_not_loaded(cache):
    program.place().parent.mkdir(parents=True, mode=0o700)
    program.place().write_bytes(b"\x7fELF and nothing else")
    program.place().chmod(0o700)
    assert program.kept() is None


def test_a_compiler_of_the_current_folder_is_none(tmp_path, monkeypatch):
    (tmp_path / "cc").write_text("#!/bin/sh\ntouch HACKED\n")
    (tmp_path / "cc").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    for path in (".", "", f".{os.pathsep}/nowhere"):
        monkeypatch.setenv("PATH", path)
        assert program.compiler() is None
