"""What ``dynid gap`` found, kept beside the result: investigation -> gap.npz -> the report's section."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from dynid.errors import NotAnArtifact
from dynid.files.artifact import Artifact, read_artifact, write_artifact
from dynid.gap.localisation import JointGap, ResidualRegion
from dynid.gap.refit import HeldOutImprovement

SCHEMA = "dynid/gap/1"
_IMPROVEMENT = ("before", "after", "ratio", "floor")


@dataclass(frozen=True)
class GapRecord:
    """One search as it was stored.

    Attributes:
        answer: what the command answered: verdict, named effects, nearest candidates, advice.
        logs: recordings that were searched.
        where: the disagreement of every joint.
        improvement: held-out error before and after.
    """

    answer: Mapping[str, Any]
    logs: tuple[str, ...]
    where: tuple[JointGap, ...]
    improvement: HeldOutImprovement


def save(
    path: Path,
    answer: Mapping[str, Any],
    logs: Sequence[Path],
    where: Sequence[JointGap],
    improvement: HeldOutImprovement,
) -> None:
    """Write gap.npz."""
    header = {"answer": answer, "logs": [str(log) for log in logs], "regions": [asdict(gap) for gap in where]}
    write_artifact(path, Artifact(SCHEMA, header, {name: getattr(improvement, name) for name in _IMPROVEMENT}))


def load(path: Path) -> GapRecord:
    """Read gap.npz.

    Raises:
        NotAnArtifact: it is damaged, or of another kind.
    """
    artifact = read_artifact(path, SCHEMA)
    header = artifact.header
    try:
        where = [
            JointGap(**{**gap, "regions": tuple(ResidualRegion(**region) for region in gap["regions"])})
            for gap in header["regions"]
        ]
        improvement = HeldOutImprovement(**{name: artifact.arrays[name] for name in _IMPROVEMENT})
        return GapRecord(dict(header["answer"]), tuple(header["logs"]), tuple(where), improvement)
    except (KeyError, TypeError) as error:
        raise NotAnArtifact(f"{path} is damaged: {error}", where=str(path)) from error
