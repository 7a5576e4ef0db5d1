"""Files are written whole, and only where files belong."""

import os

import pytest

from dynid.errors import CannotWrite
from dynid.npz import written_whole


def test_a_pipe_a_device_or_a_folder_is_not_replaced_by_a_file(tmp_path):
    """As root the new file would take the place of /dev/full, and every program that writes there would fill it."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "link").symlink_to("/dev/null")
    for name in ("pipe", "folder", "link"):
        with pytest.raises(CannotWrite, match="no regular file"), written_whole(tmp_path / name) as stream:
            stream.write(b"x")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder", "link", "pipe"]
    assert (tmp_path / "pipe").is_fifo()
