"""Results take the place of files only: a device, a pipe or a folder of that name stays what it is."""

import os
import stat
import zipfile
from pathlib import Path

import numpy as np
import pytest

from dynid.errors import CannotWrite
from dynid.files.convert import WRITERS, write_log
from dynid.log import Log
from dynid.npz import read_npz, write_npz, written_whole


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_device(path: Path) -> None:
    """Make a device like /dev/full that belongs to the test alone."""
    try:
        os.mknod(path, stat.S_IFCHR | 0o666, os.makedev(1, 7))
    except PermissionError:
        pytest.skip("only root makes devices")


def make_link(path: Path) -> None:
    os.mkfifo(path.with_name("other"))
    path.symlink_to("other")


special = pytest.mark.parametrize("make", [make_pipe, make_device, make_link, Path.mkdir])


@special
def test_what_is_no_file_is_not_replaced(make, tmp_path):
    path = tmp_path / "result.npz"
    make(path)
    before = os.lstat(path)
    with (
        pytest.raises(CannotWrite, match=r"no regular file|a folder"),
        written_whole(path) as stream,
    ):
        stream.write(b"x")
    assert os.lstat(path).st_ino == before.st_ino
    assert stat.S_IFMT(os.lstat(path).st_mode) == stat.S_IFMT(before.st_mode)
    assert not list(tmp_path.glob(".dynid*"))


@special
@pytest.mark.parametrize("suffix", WRITERS)
def test_no_converted_log_replaces_what_is_no_file(make, suffix, tmp_path):
    path = tmp_path / f"log{suffix}"
    make(path)
    before = os.lstat(path)
    t = np.arange(50) / 100
    with pytest.raises(CannotWrite):
        write_log(Log(t, np.sin(t)[:, None], np.cos(t)[:, None], ("joint",)), path)
    assert os.lstat(path).st_ino == before.st_ino


def test_a_file_and_a_link_to_a_file_are_replaced(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).write_text("old")
    (tmp_path / "link").symlink_to("b")
    for name in ("a", "link", "new"):
        with written_whole(tmp_path / name) as stream:
            stream.write(b"new")
        assert (tmp_path / name).read_bytes() == b"new"


LONG = {
    "order C": np.random.default_rng(0).standard_normal((5000, 3)),
    "order F": np.asfortranarray(np.arange(12000.0).reshape(4000, 3)),
    "single": np.linspace(0, 1, 3001, dtype=np.float32),
    "flags": np.arange(9000).reshape(3000, 3) % 7 == 0,
    "nothing": np.zeros((4, 0)),
    "number": np.array(3),
}


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_long_arrays_are_read_in_pieces_as_numpy_reads_them_whole(save, tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.scratch.IN_MEMORY", 1000)
    monkeypatch.setattr("dynid.scratch.PAGES", 0)
    monkeypatch.setattr("dynid.npz.PIECE_BYTES", 4096)
    save(tmp_path / "long.npz", **LONG)
    found = read_npz(tmp_path / "long.npz")
    for name, array in LONG.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


def test_long_arrays_are_written_in_pieces_as_numpy_writes_them_whole(tmp_path, monkeypatch):
    monkeypatch.setattr("dynid.npz.COMPRESSED_BYTES", 1)
    monkeypatch.setattr("dynid.npz.PIECE_BYTES", 1000)
    write_npz(tmp_path / "dynid.npz", {}, LONG)
    np.savez(
        tmp_path / "numpy.npz",
        **{name: np.ascontiguousarray(array) for name, array in LONG.items()},
    )
    with (
        zipfile.ZipFile(tmp_path / "dynid.npz") as own,
        zipfile.ZipFile(tmp_path / "numpy.npz") as theirs,
    ):
        for name in LONG:
            if LONG[name].ndim:
                assert own.read(f"{name}.npy") == theirs.read(f"{name}.npy")


def test_only_what_gets_smaller_is_packed(tmp_path):
    path, noise = tmp_path / "log.npz", np.random.default_rng(0).standard_normal(20_000)
    arrays = {"noise": noise, "few": noise[:100], "rounded": np.round(noise, 2)}
    write_npz(path, {}, arrays)
    with zipfile.ZipFile(path) as archive:
        packed = {
            member.filename: member.compress_type == zipfile.ZIP_DEFLATED
            for member in archive.infolist()
        }
    assert packed == {"header.npy": True, "noise.npy": False, "few.npy": True, "rounded.npy": True}
    found = read_npz(path)
    assert all(np.array_equal(found[name], array) for name, array in arrays.items())
