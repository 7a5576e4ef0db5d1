"""The inputs that are broken, made once."""

from __future__ import annotations

import os

import inputs
import pytest
from forked import load, run


def inputs_wanted(usual: int) -> int:
    """Return how many inputs of a kind are tried: a few with ``make test``, all with ``make attack``."""
    return max(1, round(usual * float(os.environ.get("ATTACK_SHARE", "0.015"))))


def first_seed() -> int:
    """Return the seed of the first input; other seeds give other inputs."""
    return int(os.environ.get("ATTACK_SEED", "1000"))


@pytest.fixture(scope="session")
def originals(tmp_path_factory):
    """Return a folder with whole inputs of every kind, and out/ with results made from them."""
    load()
    folder = tmp_path_factory.mktemp("originals") / "work"
    folder.mkdir()
    return inputs.make(folder, lambda words: run(words, folder).status)
