"""A file is hashed while it is read, whatever is passed over, and not twice."""

import hashlib

import pytest

from dynid.files import artifact as hashed
from dynid.files.artifact import sha256
from dynid.files.bag import read_topics
from dynid.files.convert import write_bag
from makelogs import lwr_log

CONTENT = bytes(range(256)) * 9000


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(CONTENT)
    return path


def test_reading_seeking_and_passing_over_give_the_hash_of_the_whole(file, monkeypatch):
    with hashed.HashedFile(file) as stream:
        assert stream.seek(0, 2) == len(CONTENT)
        stream.seek(13)
        assert stream.read(100) == CONTENT[13:113]
        stream.seek(1_500_000, 1)
        assert stream.read(7) == CONTENT[1_500_113:1_500_120]
        stream.seek(50)
        assert stream.read(100) == CONTENT[50:150]
        stream.finish()
    monkeypatch.setattr(hashed, "HashedFile", None)
    assert sha256(file) == hashlib.sha256(CONTENT).hexdigest()


def test_a_file_that_has_changed_is_hashed_anew(file):
    before = sha256(file)
    with hashed.HashedFile(file) as stream:
        stream.read(10)
        file.write_bytes(b"something else")
        stream.finish()
    assert sha256(file) == hashlib.sha256(b"something else").hexdigest() != before


def test_the_hash_of_a_bag_comes_with_its_messages(tmp_path, monkeypatch):
    path = tmp_path / "log.bag"
    write_bag(lwr_log(), path, "/joint_states")
    ((log,),) = read_topics(path, ["/joint_states"])[0].values()
    assert len(log) == len(lwr_log())
    monkeypatch.setattr(hashed, "HashedFile", None)
    assert sha256(path) == hashlib.sha256(path.read_bytes()).hexdigest()
