"""Read back what was saved, whatever it is."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dynid.errors import NotAnArtifact


def load(path: Path | str) -> Any:  # noqa: ANN401
    """Return what is in a result file: the object whose ``save`` wrote it.

    Args:
        path: a file such as parameters.npz, or the folder of a run, whose parameters.npz is read.

    Raises:
        NotAnArtifact: the file is none of dynid's, or is damaged (E3xx).
    """
    from dynid.files.artifact import read_header

    path = Path(path)
    if path.is_dir():
        path /= "parameters.npz"
    schema = str((read_header(path) or {}).get("schema", ""))
    kind = schema.rsplit("/", 1)[0]
    if kind == "dynid/identification":
        from dynid.estimation.result import load as load_result

        return load_result(path)
    raise NotAnArtifact(f"{path} holds nothing that dynid.load reads", where=str(path))
