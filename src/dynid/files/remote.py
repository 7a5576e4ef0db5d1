"""Recordings at a URL (``s3:``, ``gs:``, ``http:``, ``memory:``, ...): fetched whole into a folder, once."""

from __future__ import annotations

import json
import re
from importlib.util import find_spec
from pathlib import Path
from typing import IO, Any

from dynid import limits
from dynid.errors import DynidError, LogNotFound, PackageMissing
from dynid.npz import written_whole
from dynid.text import file_name

#: A scheme has two letters or more: ``C:`` is a drive.
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
BLOCK = 1 << 20
#: Kinds of URLs that are stores of files, and those that are files of this machine.
#: Why not all that fsspec knows: some unpack archives, follow tables of other places or fill in templates.
_HERE = frozenset(["file", "local"])
STORES = _HERE | frozenset(
    [
        "memory",
        "http",
        "https",
        "s3",
        "s3a",
        "gs",
        "gcs",
        "abfs",
        "abfss",
        "az",
        "adl",
        "oci",
        "oss",
        "tos",
        "sftp",
        "ssh",
        "ftp",
        "smb",
        "webdav",
        "hdfs",
        "webhdfs",
        "hf",
    ]
)


def is_url(text: str) -> bool:
    """Return whether a text is a URL and no path."""
    return _URL.match(text) is not None


def fetch(url: str, folder: Path) -> Path:
    """Return a copy of a recording in a folder; it is fetched again only when what is at the URL has changed.

    Args:
        url: where it is.
        folder: where to; the copy has the name of the recording.

    Raises:
        PackageMissing: fsspec, or the package for this kind of URL, is not installed.
        LogNotFound: there is nothing, it cannot be read, or the URL is of no store of files.
        TooLarge: it does not end within the limit.
    """
    kind = url.partition("://")[0].lower()
    if kind not in STORES or "::" in url or not url.isprintable():
        raise LogNotFound(
            f"{url} is not the URL of a recording",
            where=url,
            fix=f"one of {', '.join(sorted(STORES))}",
        )
    if find_spec("fsspec") is None:
        raise PackageMissing(f"{url} needs fsspec", fix="pip install 'dynid[cluster]'")
    import fsspec

    place = folder / _name(url)
    note = place.with_name(f"{place.name}.from")
    try:
        system, path = fsspec.core.url_to_fs(url)
        state = {"url": url, "state": str(system.ukey(path))}
        if place.is_file() and _read(note) == state:
            return place
        # Why: of what is no regular file, such as a device or a pipe, a copy would never end.
        with limits.open_file(Path(path)) if kind in _HERE else system.open(path, "rb") as source:
            _copy(source, place, url)
    except DynidError:
        raise
    except (ImportError, ValueError) as error:
        raise PackageMissing(
            f"{url} cannot be read: {error}", fix="install the package that it names"
        ) from error
    except Exception as error:  # Why all: each package for a kind of URL has mistakes of its own.
        raise LogNotFound(
            f"nothing can be read at {url}: {error or type(error).__name__}", where=url
        ) from error
    with written_whole(note) as target:
        target.write(json.dumps(state).encode())
    return place


def _copy(source: IO[bytes], place: Path, url: str) -> None:
    count = 0
    with written_whole(place) as target:
        while block := source.read(BLOCK):
            count += len(block)
            limits.check("fetched_bytes", count, url)
            target.write(block)


def _name(url: str) -> str:
    """Return a name for the copy: that of the recording, with its suffix."""
    name = Path(url.split("://", 1)[1].split("?", 1)[0])
    return f"{file_name(name.stem)}{name.suffix if name.suffix.isascii() and name.suffix[1:].isalnum() else ''}"


def _read(note: Path) -> Any:  # noqa: ANN401
    try:
        return json.loads(note.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
