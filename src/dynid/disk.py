"""Files that are written whole or not at all, and known by their hash; help of a command may import this."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import IO

from dynid.errors import CannotWrite, WrongUsage


@contextmanager
def written_whole(path: Path | str) -> Iterator[IO[bytes]]:
    """Open a temporary file beside ``path`` that takes its name only when the block ends without an error."""
    path = Path(path)
    # Why: what is renamed to a device or a pipe would replace it.
    if path.exists() and not path.is_file():
        raise CannotWrite(f"cannot write {path}: it is no regular file", where=path)
    # Why not tempfile: its files are private; a result should follow the user's umask like any other file.
    temporary = path.with_name(f".dynid-{os.urandom(8).hex()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("xb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        temporary.replace(path)
    except (NotADirectoryError, FileExistsError) as error:
        raise WrongUsage(f"cannot write {path}: its folder is a file") from error
    except OSError as error:
        raise CannotWrite(f"cannot write {path}: {error.strerror}", where=path) from error
    finally:
        with suppress(OSError):  # it has taken its name, or there is no such folder
            temporary.unlink()


def sha256(path: Path) -> str:
    """Return the sha256 of a file, or of all files of a folder in the order of their names.

    A file is read for it once per process, and again only when its size or time of change is another.
    """
    files = sorted(filter(Path.is_file, path.iterdir())) if path.is_dir() else [path]
    return _hashed(
        tuple((file.absolute(), file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    )


@lru_cache(maxsize=256)
def _hashed(files: tuple[tuple[Path, int, int], ...]) -> str:
    """Return the sha256 of files by path, time of change [ns] and size."""
    digest = hashlib.sha256()
    for file, _, _ in files:
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


def write_text(path: Path, text: str) -> None:
    """Write a text file whole."""
    with written_whole(path) as stream:
        stream.write(text.encode("utf-8"))
