"""Read back what was saved, whatever it is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, overload

from dynid.errors import NotAnArtifact
from dynid.progress import SILENT, Progress
from dynid.workflows import arguments
from dynid.workflows.arguments import public

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.files.trajectoryfile import StoredTrajectory
    from dynid.model.base_model import BaseModel
    from dynid.workflows.gap_result import Gap

T = TypeVar("T")


@overload
def load(path: Path | str) -> Identification | Gap | StoredTrajectory: ...
@overload
def load(path: Path | str, kind: type[T]) -> T: ...
@public
def load(path: Path | str, kind: type[Any] = object) -> Any:
    """Return what is in a result file: the object whose ``save`` wrote it, or the stored motion of a plan.

    Args:
        path: a file such as parameters.npz, or the folder of a run, whose parameters.npz is read.
        kind: the type that is expected, such as ``dynid.Identification``; it is the type of what is returned.

    Raises:
        WrongUsage: an argument is something else than what is wanted, or the file holds another type (E101).
        NotAnArtifact: the file is none of dynid's, or is damaged (E3xx).

    Example:
        dynid.load("out/kuka_lwr4plus", dynid.Identification)
    """
    arguments.instance(kind, type, "kind", "a type such as dynid.Identification")
    found = _read(parameters_of(arguments.path(path, "path")))
    if not isinstance(found, kind):
        raise arguments.refused("path", f"a file with an object of type {kind.__name__}", found)
    return found


def _read(path: Path) -> Identification | Gap | StoredTrajectory:
    from dynid.files.artifact import read_header

    schema = str((read_header(path) or {}).get("schema", ""))
    kind = schema.rsplit("/", 1)[0]
    if kind == "dynid/identification":
        from dynid.estimation.result_files import load as load_result

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
    from dynid.estimation.result_files import load as load_result

    return load_result(parameters_of(run))


def parameters_of(run: Path) -> Path:
    """Return the parameters.npz of a run given by its folder or by the file."""
    return run / "parameters.npz" if run.is_dir() else run


def base_model_of(result: Identification, folder: Path | None = None, progress: Progress = SILENT) -> BaseModel:
    """Return the model that a result was made with; its base parameters are those of the result, never found anew.

    Args:
        result: the result.
        folder: where the model is kept; None keeps it in memory.
        progress: reports that the model is made.
    """
    from dynid.model.base_model import BaseModel
    from dynid.workflows.model import base_model, derive_model

    if folder is None:
        return BaseModel(base_model(result.robot).model, result.reduction)
    progress.stage("model")
    return BaseModel(derive_model(result.robot, folder).model, result.reduction)
