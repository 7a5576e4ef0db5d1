"""Files that are written whole or not at all and known by their hash, and .npz files of arrays with one JSON header.

Member files carry a fixed date, so that equal contents give equal bytes; nothing is ever pickled.
"""

from __future__ import annotations

import errno
import hashlib
import json
import os
import struct
import tempfile
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import CannotWrite, TooLarge
from dynid.version import __version__

#: Name of the array that holds the header.
HEADER = "header"
#: Larger arrays are measurements: compressing them costs seconds and saves next to nothing.
COMPRESSED_BYTES = 4 << 20
#: Larger members need the long form of a zip archive.
_ZIP64 = 1 << 31


def require_file(path: Path) -> None:
    """Raise OSError when a folder, a device or a pipe is at a place: what is renamed to it would replace it."""
    if path.exists() and not path.is_file():
        raise OSError(
            errno.EINVAL, "it is a folder" if path.is_dir() else "it is no regular file", str(path)
        )


def put_in_place(temporary: Path, path: Path) -> None:
    """Give a temporary file the name of a result, which it replaces.

    Raises:
        OSError: it cannot be renamed, or something else than a file is there.
    """
    require_file(path)
    temporary.replace(path)


@contextmanager
def written_whole(path: Path | str) -> Iterator[IO[bytes]]:
    """Open a temporary file beside ``path`` that takes its name only when the block ends without an error."""
    path = Path(path)
    try:
        require_file(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(prefix=".dynid-", dir=path.parent)
    except OSError as error:
        raise CannotWrite(f"cannot write {path}: {error.strerror}", where=str(path)) from error
    temporary = Path(name)
    try:
        with os.fdopen(handle, "wb") as stream:
            yield stream
            stream.flush()
            os.fsync(stream.fileno())
        # Why: mkstemp makes the file private; a result should follow the user's umask like any other file.
        mask = os.umask(0)
        os.umask(mask)
        temporary.chmod(0o666 & ~mask)
        put_in_place(temporary, path)
    except OSError as error:
        raise CannotWrite(f"cannot write {path}: {error.strerror}", where=str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


#: Packed data of up to so many bytes may expand as it likes; larger data up to so many times: joint states pack three-
#: to tenfold, a decompression bomb expands a thousandfold.
_SMALL, _EXPANSION = 16 << 20, 200


def bounded(packed: int, unpacked: int, where: Path | str) -> None:
    """Raise when packed data expands like a decompression bomb.

    Args:
        packed: size in the file [byte].
        unpacked: size in memory [byte].
        where: the file, and the place in it.
    """
    if unpacked > max(_SMALL, _EXPANSION * packed):
        raise TooLarge(f"{where}: {packed} bytes unpack to {unpacked}", where=str(where))


#: Path, time of change and size of a file.
State = tuple[Path, int, int]


def sha256(path: Path) -> str:
    """Return the sha256 of a file, or of all files of a folder in the order of their names.

    A file is read for it once per process, and again only when its size or time of change is another.
    """
    files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    return _hashed(
        tuple((file.absolute(), file.stat().st_mtime_ns, file.stat().st_size) for file in files)
    )


@lru_cache(maxsize=256)
def _hashed(files: tuple[State, ...]) -> str:
    digest = hashlib.sha256()
    for file, _, _ in files:
        with file.open("rb") as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


# ---------------------------------------------------------------- .npz
def write_npz(path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays and a header of JSON-able facts whole; equal contents give equal bytes."""
    text = np.array(json.dumps(header, sort_keys=True, default=_plain))
    with written_whole(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name, array in {HEADER: text, **arrays}.items():
            # Why not by name: that would write the time of day.
            info = zipfile.ZipInfo(f"{name}.npy")
            info.compress_type = (
                zipfile.ZIP_DEFLATED if array.nbytes < COMPRESSED_BYTES else zipfile.ZIP_STORED
            )
            with archive.open(info, "w", force_zip64=array.nbytes > _ZIP64) as member:
                np.lib.format.write_array(member, np.asanyarray(array), allow_pickle=False)


def write_artifact(
    path: Path, schema: str, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]
) -> None:
    """Write a result file whole; equal contents give equal bytes.

    Args:
        path: where to.
        schema: name and number, such as ``"dynid/regressor/1"``.
        header: JSON-able facts.
        arrays: arrays by name.
    """
    write_npz(path, {"schema": schema, "dynid": __version__, **header}, arrays)


def read_npz(path: Path, only: str | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file, or only one of them where it is there; nothing in it is executed.

    Raises:
        OSError: it cannot be opened.
        ValueError: it is not an .npz file of truth values, numbers and text, or is damaged.
        TooLarge: an array unpacks like a bomb.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            for member in archive.infolist():
                bounded(member.compress_size, member.file_size, f"{path}: {member.filename[:80]}")
        with np.load(path, allow_pickle=False) as stored:
            found = {name: stored[name] for name in stored.files if only in (None, name)}
    except (
        zipfile.BadZipFile,
        zlib.error,
        struct.error,
        EOFError,
        LookupError,
        MemoryError,
        NotImplementedError,
        OverflowError,
        RuntimeError,
        SyntaxError,
        TypeError,
    ) as error:
        raise ValueError(f"it is not a whole archive: {error}") from error
    if not all(isinstance(array, np.ndarray) for array in found.values()):
        raise ValueError("it holds something else than arrays")
    return found


def _plain(value: object) -> object:
    """Make numpy scalars, arrays and paths JSON-able."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")
