"""A file is hashed once, and again only when it has changed."""

import hashlib

from dynid.disk import sha256


def hashed(content):
    return hashlib.sha256(content).hexdigest()


def test_a_file_is_read_once_until_it_changes_and_a_folder_is_its_files_by_name(
    tmp_path, monkeypatch
):
    file, content = tmp_path / "file", bytes(range(256)) * 9000
    file.write_bytes(content)
    assert sha256(file) == hashed(content)
    (tmp_path / "a").write_bytes(b"first")
    assert sha256(tmp_path) == hashed(b"first" + content)
    with monkeypatch.context() as patched:
        patched.setattr(hashlib, "sha256", None)
        assert sha256(file)
    file.write_bytes(b"something else")
    assert sha256(file) == hashed(b"something else")
