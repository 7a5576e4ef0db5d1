"""Results take the place of files only: a device, a pipe or a folder of that name stays what it is."""

import json
import os
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from dynid.disk import written_whole
from dynid.errors import CannotWrite, TooLarge
from dynid.npz import read_npz, write_artifact


@pytest.mark.parametrize("make", [os.mkfifo, Path.mkdir])
def test_what_is_no_file_is_not_replaced(make, tmp_path):
    path = tmp_path / "result.npz"
    make(path)
    before = path.stat()
    with pytest.raises(CannotWrite, match="no regular file"), written_whole(path) as stream:
        stream.write(b"x")
    assert (path.stat().st_ino, path.stat().st_mode) == (before.st_ino, before.st_mode)
    assert not list(tmp_path.glob(".dynid*"))


def test_a_file_and_a_link_to_a_file_are_replaced_once_the_new_one_is_whole(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).write_text("old")
    (tmp_path / "link").symlink_to("b")
    for name in ("a", "link", "new"):
        with written_whole(str(tmp_path / name)) as stream:
            stream.write(b"new")
        assert (tmp_path / name).read_bytes() == b"new"
    with suppress(ZeroDivisionError), written_whole(tmp_path / "new") as stream:
        stream.write(b"half of")
        raise ZeroDivisionError
    assert (tmp_path / "new").read_bytes() == b"new"
    assert not list(tmp_path.glob(".dynid*"))


def test_equal_contents_give_equal_bytes(tmp_path):
    arrays = {"a": np.arange(6.0).reshape(2, 3), "flags": np.arange(4) > 1, "text": np.array(["x"])}
    for name in ("one", "two"):
        write_artifact(tmp_path / name, "x", {"b": 1, "a": np.float64(2.0)}, arrays)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()
    found = read_npz(tmp_path / "one")
    header = json.loads(str(found.pop("header")))
    assert (header["schema"], header["a"], header["b"]) == ("x", 2.0, 1)
    for name, array in arrays.items():
        np.testing.assert_array_equal(found[name], array)


def test_damaged_and_alien_files_are_answered_by_a_value_error(tmp_path):
    path, random = tmp_path / "a.npz", np.random.default_rng(0)
    write_artifact(path, "x", {}, {"a": random.standard_normal((100, 3))})
    whole = path.read_bytes()
    np.save(tmp_path / "a.npy", np.zeros(3))
    np.savez(tmp_path / "objects.npz", np.array([{}], dtype=object))
    others = [
        b"",
        b"PK",
        (tmp_path / "a.npy").read_bytes(),
        (tmp_path / "objects.npz").read_bytes(),
    ]
    cut = [whole[: len(whole) * k // 20] for k in range(20)]
    for content in [*others, *cut]:
        path.write_bytes(content)
        with pytest.raises(ValueError):
            read_npz(path)


def test_an_array_that_unpacks_like_a_bomb_is_refused(tmp_path):
    np.savez_compressed(tmp_path / "a.npz", a=np.zeros(1 << 23))
    with pytest.raises(TooLarge, match="unpack to"):
        read_npz(tmp_path / "a.npz")
