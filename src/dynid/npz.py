"""Files that are written whole or not at all and known by their hash, and .npz files of arrays with one JSON header.

Member files carry a fixed date, so that equal contents give equal bytes; nothing is ever pickled. What is read is
measured first: how members are packed, what type and shape they say they have, and how much memory that takes.
"""

from __future__ import annotations

import errno
import hashlib
import io
import json
import math
import os
import re
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

from dynid import limits
from dynid.errors import CannotWrite, TooLarge
from dynid.scratch import empty, prefix, release, sweep
from dynid.version import __version__

#: Name of the array that holds the header.
HEADER = "header"
#: Larger arrays are measurements: compressing them costs seconds and saves next to nothing.
COMPRESSED_BYTES = 4 << 20
#: Of an array beyond so many bytes a part is packed first: where that saves less than a tenth, nothing is.
TRIED_BYTES, SAVES = 1 << 16, 0.9
#: What is read or written of a member at once.
PIECE_BYTES = 4 << 20
#: Larger members need the long form of a zip archive.
_ZIP64 = 1 << 31
#: What NumPy writes in front of an array, for the types that a result may have: truth values, numbers, text.
_ARRAY_HEADER = re.compile(
    r"\{'descr': '([<>|=]?(?:b1|[iu][1248]|f[248]|U\d{1,9}))', 'fortran_order': (False|True), "
    r"'shape': \(((?:\d{1,18},? ?){0,8})\), \} *\n"
)
#: Fixed part at the end of a zip archive: what comes before it may be a comment of 64 KiB.
_ZIP_END, _ZIP_COMMENT = struct.Struct("<4s4H2LH"), 1 << 16
#: Bytes of the directory of an archive for each member that the limit allows.
_ENTRY_BYTES = 1 << 10
#: What stands for half a character in JSON, unless the other half is beside it.
_HALF = re.compile(r"\\u[dD][89a-fA-F]")
_TOKENS = re.compile(r'"(?:[^"\\]|\\.)*"|[\[{]|[\]}]')


def require_file(path: Path) -> None:
    """Raise when there is something at a place that is no file: what is renamed to it would take its place.

    Raises:
        OSError: it is a folder, a device, a pipe or a socket, or a link to one.
    """
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
        sweep(path.parent)
        handle, name = tempfile.mkstemp(prefix=f".{prefix()}", dir=path.parent)
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
        limits.check_holes(file)
        with limits.open_file(file) as stream:
            while block := stream.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()


# ---------------------------------------------------------------- .npz
def write_npz(path: Path, header: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write arrays and a header of JSON-able facts whole; equal contents give equal bytes."""
    with (
        written_whole(path) as stream,
        zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive,
    ):
        text = np.array(json.dumps(header, sort_keys=True, default=_plain))
        for name, array in {HEADER: text, **arrays}.items():
            info = zipfile.ZipInfo(f"{name}.npy")
            if array.nbytes >= COMPRESSED_BYTES:
                with archive.open(info, "w", force_zip64=array.nbytes > _ZIP64) as member:
                    _write_long(member, np.ascontiguousarray(array))
                continue
            buffer = io.BytesIO()
            np.lib.format.write_array(buffer, np.asanyarray(array), allow_pickle=False)
            content = buffer.getbuffer()
            method = zipfile.ZIP_DEFLATED if _packs(content) else zipfile.ZIP_STORED
            archive.writestr(info, content, method, 1)


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


def _packs(content: memoryview) -> bool:
    """Return whether packing saves anything worth its time: the digits of measurements are noise."""
    middle = len(content) // 2
    tried = content[middle : middle + TRIED_BYTES // 8]
    return len(content) <= TRIED_BYTES or len(zlib.compress(tried, 1)) < SAVES * len(tried)


def _write_long(stream: IO[bytes], array: NDArray[Any]) -> None:
    """Write an array as NumPy does, piece by piece: one that lives in a file need not be in memory for it."""
    header = np.lib.format.header_data_from_array_1_0(array)
    np.lib.format.write_array_header_1_0(stream, header)
    content = array.reshape(-1).view(np.uint8)
    for start in range(0, len(content), PIECE_BYTES):
        stream.write(content[start : start + PIECE_BYTES].data)
        release()


def read_npz(path: Path, only: str | None = None) -> dict[str, NDArray[Any]]:
    """Return the arrays of an .npz file, or only one of them where it is there; nothing in it is executed.

    Raises:
        OSError: it cannot be opened, or is no regular file.
        ValueError: it is not an .npz file of truth values, numbers and text, or is damaged.
        TooLarge: it holds more than a limit.
    """
    with limits.open_file(path) as stream:
        _check_directory(stream, path)
        stream.seek(0)
        try:
            with zipfile.ZipFile(stream) as archive:
                members = archive.infolist()
                limits.check("members", len(members), path)
                limits.check("archive_bytes", sum(member.file_size for member in members), path)
                wanted = [
                    member for member in members if only is None or member.filename == f"{only}.npy"
                ]
                return {
                    member.filename.removesuffix(".npy"): _array(archive, member, path)
                    for member in wanted
                }
        except (
            zipfile.BadZipFile,
            zlib.error,
            EOFError,
            NotImplementedError,
            RuntimeError,
            struct.error,
        ) as error:
            raise ValueError(f"it is not a whole archive: {error}") from error
        except (UnicodeError, IndexError, OverflowError, KeyError) as error:
            raise ValueError("its directory is damaged") from error


def _check_directory(stream: IO[bytes], path: Path) -> None:
    """Raise when the directory at the end of an archive, which is read as a whole, is missing or very long."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(0, size - _ZIP_END.size - _ZIP_COMMENT))
    tail = stream.read()
    place = tail.rfind(b"PK\x05\x06")
    if place < 0 or place + _ZIP_END.size > len(tail):
        raise ValueError("it is not an archive")
    _, _, _, _, members, directory, _, _ = _ZIP_END.unpack_from(tail, place)
    limits.check("members", members, path)
    if directory > limits.limit("members") * _ENTRY_BYTES:
        limits.check("members", directory // _ENTRY_BYTES, path)


def _array(archive: zipfile.ZipFile, member: zipfile.ZipInfo, path: Path) -> NDArray[Any]:
    name = member.filename[:80]
    if member.flag_bits & 1 or member.compress_type not in (
        zipfile.ZIP_STORED,
        zipfile.ZIP_DEFLATED,
    ):
        raise ValueError(f"'{name}' is encrypted or packed in a way that .npz files do not have")
    if not name.endswith(".npy"):
        raise ValueError(f"'{name}' is no array")
    limits.check_expansion(member.compress_size, member.file_size, f"{path}: {name}")
    if name == f"{HEADER}.npy":
        # Unit: text is stored at four bytes a character.
        limits.check("header_bytes", member.file_size / 4, path)
    with archive.open(member) as stream:
        version = np.lib.format.read_magic(stream)
        length = (
            struct.unpack("<H", stream.read(2))[0]
            if version == (1, 0)
            else struct.unpack("<I", stream.read(4))[0]
        )
        match = _ARRAY_HEADER.fullmatch(stream.read(min(length, _ENTRY_BYTES)).decode("latin-1"))
        if match is None:
            raise ValueError(f"'{name}' holds no numbers and no text")
        dtype, shape = (
            np.dtype(match[1]),
            tuple(int(size) for size in match[3].replace(",", " ").split()),
        )
        rest = member.file_size - length - (10 if version == (1, 0) else 12)
        if math.prod(shape) * dtype.itemsize != rest:
            raise ValueError(f"'{name}' has another length than its shape {shape}")
        content = _filled(stream, rest)
        if len(content) != rest:
            raise ValueError(f"'{name}' is cut")
    if not content.size:
        return np.zeros(shape, dtype)
    order: Any = "F" if match[2] == "True" else "C"
    return content.view(dtype).reshape(shape, order=order)


def _filled(stream: IO[bytes], size: int) -> NDArray[np.uint8]:
    """Return so many bytes of a stream, fewer where it ends before; in a file where they are many."""
    content, place = empty((size,), np.uint8), 0
    while place < size and (piece := stream.read(min(PIECE_BYTES, size - place))):
        content[place : place + len(piece)] = np.frombuffer(piece, np.uint8)
        place += len(piece)
        if size > PIECE_BYTES:
            release()
    return content[:place]


def parse_json(text: str, where: Path | str) -> Any:  # noqa: ANN401
    """Return what JSON text holds.

    Raises:
        ValueError: it is not JSON, or has half characters, which no file and no message can hold.
        TooLarge: lists and keys are nested deeper than the limit.
    """
    text.encode()
    depth = deepest = 0
    for token in _TOKENS.finditer(text):
        depth += {"[": 1, "{": 1, "]": -1, "}": -1}.get(token[0], 0)
        deepest = max(deepest, depth)
    limits.check("nesting", deepest, where)
    found = json.loads(text)
    if _HALF.search(text):
        json.dumps(found, ensure_ascii=False).encode()
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
