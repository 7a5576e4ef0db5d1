""".npz files of arrays with one JSON header.

Member files carry the fixed date of ``ZipInfo``, so that equal contents give equal bytes; nothing is ever pickled.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.disk import written_whole
from dynid.errors import TooLarge
from dynid.version import __version__

#: Name of the array that holds the header.
HEADER = "header"
#: Larger arrays are measurements: compressing them costs seconds and saves next to nothing.
COMPRESSED_BYTES = 1 << 20
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
        raise TooLarge(f"{where}: {packed} bytes unpack to {unpacked}", where=where)


# ---------------------------------------------------------------- .npz
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
    facts = json.dumps({"schema": schema, "dynid": __version__, **header}, default=_plain)
    with written_whole(path) as stream, zipfile.ZipFile(stream, "w") as archive:
        for name, array in {HEADER: np.array(facts), **arrays}.items():
            member_info = zipfile.ZipInfo(f"{name}.npy")
            if array.nbytes < COMPRESSED_BYTES:
                member_info.compress_type = zipfile.ZIP_DEFLATED
            # Why: what the size will be is not known to the archive, and arrays may be large.
            with archive.open(member_info, "w", force_zip64=True) as member:
                # Why a copy: rows after rows, whatever the order in memory.
                np.lib.format.write_array(member, array.copy(), allow_pickle=False)


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
            arrays = {name: stored[name] for name in stored.files if only in (None, name)}
    except (OSError, ValueError, TooLarge):
        raise
    except Exception as error:  # whatever zip, zlib and NumPy say of a damaged file
        raise ValueError(f"it is not a whole archive: {error}") from error
    if not all(isinstance(array, np.ndarray) for array in arrays.values()):
        raise ValueError("it holds something else than arrays")
    return arrays


def _plain(value: object) -> object:
    """Make numpy scalars, arrays and paths JSON-able."""
    if isinstance(value, (np.generic, np.ndarray)):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} cannot be written as JSON")
