"""The SHA-256 of files, each of which is read once: for its hash alone, or for what is in it, hashed on the way."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import IO

from dynid import limits

#: What is read at once for a hash alone [bytes].
_PIECE = 1 << 20
#: Files whose hashes are kept, the last ones.
_MOST = 256
#: Path, time of change and size of a file.
State = tuple[Path, int, int]
_known: dict[State, str] = {}


def sha256(path: Path) -> str:
    """Return the hash of a file; it is read again only when its size or time of change is another."""
    state = state_of(path)
    if state not in _known:
        limits.check_holes(path)
        with HashedFile(path) as stream:
            stream.finish()
        # Why: a file that changes while it is read is not kept.
        return stream.hexdigest
    return _known[state]


class HashedFile:
    """A file that is read from front to back, and hashed on the way; what is passed over is read for the hash.

    Args:
        path: of a regular file.
    """

    def __init__(self, path: Path) -> None:
        self._path, self._stream = path, limits.open_file(path)
        self._before, self._digest, self._hashed = state_of(path), hashlib.sha256(), 0

    def __enter__(self) -> HashedFile:
        """Return the open file."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the file."""
        self._stream.close()

    @property
    def hexdigest(self) -> str:
        """Hash of what was read."""
        return self._digest.hexdigest()

    def read(self, size: int = -1) -> bytes:
        """Return the next bytes."""
        at = self._stream.tell()
        content = self._stream.read(size)
        if at == self._hashed:
            self._digest.update(content)
            self._hashed += len(content)
        return content

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        """Go to another place, as a file does; back only over what was read."""
        if whence == os.SEEK_CUR:
            offset, whence = self.tell() + offset, os.SEEK_SET
        if whence == os.SEEK_SET and offset > self._hashed:
            self._pass(offset)
        return self._stream.seek(offset, whence)

    def tell(self) -> int:
        """Return the place of the next byte."""
        return self._stream.tell()

    def finish(self) -> None:
        """Read what is left, and keep the hash where the file is as it was when it was opened."""
        self._pass(None)
        if state_of(self._path) == self._before and self._hashed == self._before[2]:
            _known[self._before] = self.hexdigest
            while len(_known) > _MOST:
                del _known[next(iter(_known))]

    def _pass(self, end: int | None) -> None:
        """Read on to a place, or to the end, for the hash."""
        self._stream.seek(self._hashed)
        while (left := _PIECE if end is None else min(_PIECE, end - self._hashed)) and self.read(left):
            pass


def state_of(path: Path) -> State:
    """Return what tells whether a file is still the same."""
    info = path.stat()
    return path.absolute(), info.st_mtime_ns, info.st_size


#: What the readers of recordings take for a file.
Readable = IO[bytes] | HashedFile
