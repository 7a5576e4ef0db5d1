"""The inputs that are broken, made once."""

from __future__ import annotations

import inputs
import pytest
from forked import load, run


@pytest.fixture(scope="session")
def originals(tmp_path_factory):
    """Return a folder with whole inputs of every kind, and out/ with results made from them."""
    load()
    folder = tmp_path_factory.mktemp("originals") / "work"
    folder.mkdir()
    return inputs.make(folder, lambda words: run(words, folder).status)
