"""A file is hashed once, and again only when it has changed."""

import hashlib

import pytest

from dynid.disk import sha256

CONTENT = bytes(range(256)) * 9000


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "file"
    path.write_bytes(CONTENT)
    return path


def test_the_hash_is_that_of_the_whole_file_and_it_is_read_once(file, monkeypatch):
    before = hashlib.sha256(CONTENT).hexdigest()
    assert sha256(file) == before
    monkeypatch.setattr(hashlib, "sha256", None)
    assert sha256(file) == before


def test_a_file_that_has_changed_is_hashed_anew(file):
    before = sha256(file)
    file.write_bytes(b"something else")
    assert sha256(file) == hashlib.sha256(b"something else").hexdigest() != before


def test_the_hash_of_a_folder_is_that_of_its_files_by_name(file):
    (file.parent / "a").write_bytes(b"first")
    assert sha256(file.parent) == hashlib.sha256(b"first" + CONTENT).hexdigest()
