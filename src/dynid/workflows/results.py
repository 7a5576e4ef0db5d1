"""Read back what was saved, whatever it is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import NotAnArtifact
from dynid.progress import SILENT, Progress

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.model.base_model import BaseModel


def load(path: Path | str) -> Any:  # noqa: ANN401
    """Return what is in a result file: the object whose ``save`` wrote it, or the stored motion of a plan.

    Args:
        path: a file such as parameters.npz, or the folder of a run, whose parameters.npz is read.

    Raises:
        NotAnArtifact: the file is none of dynid's, or is damaged (E3xx).
    """
    from dynid.files.artifact import read_header

    path = parameters_of(Path(path))
    schema = str((read_header(path) or {}).get("schema", ""))
    kind = schema.rsplit("/", 1)[0]
    if kind == "dynid/identification":
        from dynid.estimation.result import load as load_result

        return load_result(path)
    if kind == "dynid/trajectory":
        from dynid.files.trajectoryfile import read_trajectory

        return read_trajectory(path)
    if kind == "dynid/gap":
        from dynid.workflows.gap_result import Gap

        return Gap.load(path)
    raise NotAnArtifact(f"{path} holds nothing that dynid.load reads", where=str(path))


def load_run(run: Path) -> Identification:
    """Return the result of a run, given by its folder or by its parameters.npz.

    Raises:
        NotAnArtifact: the file is none, or is damaged.
    """
    from dynid.estimation.result import load as load_result

    return load_result(parameters_of(run))


def parameters_of(run: Path) -> Path:
    """Return the parameters.npz of a run given by its folder or by the file."""
    return run / "parameters.npz" if run.is_dir() else run


def base_model_of(result: Identification, folder: Path | None = None, progress: Progress = SILENT) -> BaseModel:
    """Return the model that a result was made with; its base parameters are those of the result, never found anew.

    Args:
        result: the result.
        folder: where the model is kept; None keeps it in memory.
        progress: told that the model is made.
    """
    from dynid.model.base_model import BaseModel
    from dynid.workflows.model import base_model, derive_model

    if folder is None:
        return BaseModel(base_model(result.robot).model, result.reduction)
    progress.stage("model")
    return BaseModel(derive_model(result.robot, folder).model, result.reduction)
