"""gap.npz: what a search for missing effects found, written, and read back for answers, reports and plans."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from dynid.files.artifact import packed, read_artifact, reading, unpacked
from dynid.judgement.gap import GapRecord
from dynid.npz import write_artifact

SCHEMA = "dynid/gap/1"


def write_record(path: Path, record: GapRecord) -> None:
    """Write gap.npz."""
    arrays: dict[str, NDArray[Any]] = {}
    names = [each.name for each in fields(GapRecord)]
    facts = {name: packed(getattr(record, name), arrays, name) for name in names}
    write_artifact(path, SCHEMA, {"record": facts}, arrays)


def read_record(path: Path) -> GapRecord:
    """Read gap.npz.

    Raises:
        NotAnArtifact: it is damaged, or of another kind.
    """
    artifact = read_artifact(path, SCHEMA)
    with reading(path):
        record: GapRecord = unpacked(GapRecord, artifact.header["record"], artifact.arrays)
        return record
