"""Recordings at a URL (``s3:``, ``gs:``, ``http:``, ``memory:``, ...): fetched whole into a folder, once."""

from __future__ import annotations

import json
import re
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from dynid.errors import LogNotFound, PackageMissing
from dynid.npz import written_whole
from dynid.text import file_name

#: A scheme has two letters or more: ``C:`` is a drive.
_URL = re.compile(r"[A-Za-z][A-Za-z0-9+.-]+://")
BLOCK = 1 << 20


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
        LogNotFound: there is nothing, or it cannot be read.
    """
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
        with system.open(path, "rb") as source, written_whole(place) as target:
            while block := source.read(BLOCK):
                target.write(block)
    except (ImportError, ValueError) as error:
        raise PackageMissing(f"{url} cannot be read: {error}", fix="install the package that it names") from error
    except OSError as error:
        raise LogNotFound(f"nothing can be read at {url}: {error or type(error).__name__}", where=url) from error
    with written_whole(note) as target:
        target.write(json.dumps(state).encode())
    return place


def _name(url: str) -> str:
    """Return a name for the copy: that of the recording, with its suffix."""
    name = Path(url.split("://", 1)[1].split("?", 1)[0])
    return f"{file_name(name.stem)}{name.suffix if name.suffix.isascii() and name.suffix[1:].isalnum() else ''}"


def _read(note: Path) -> Any:  # noqa: ANN401
    try:
        return json.loads(note.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
