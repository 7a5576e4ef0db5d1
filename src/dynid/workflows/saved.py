"""What was saved is read back, whatever it is."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, overload

from dynid import arguments
from dynid.arguments import public
from dynid.errors import NotAnArtifact
from dynid.estimation.result import Identification
from dynid.files.artifact import read_header
from dynid.files.trajectoryfile import StoredTrajectory, read_trajectory
from dynid.loading import load_run, parameters_of
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
    file = parameters_of(arguments.path(path, "path"))
    schema = str((read_header(file) or {}).get("schema", "")).rpartition("/")[0]
    readers: dict[str, Callable[[Path], object]] = {
        "dynid/identification": load_run,
        "dynid/trajectory": read_trajectory,
        "dynid/gap": Gap.load,
    }
    if schema not in readers:
        raise NotAnArtifact(f"{file} holds nothing that dynid.load reads", where=str(file))
    found = readers[schema](file)
    if not isinstance(found, kind):
        raise arguments.refused("path", f"a file with an object of type {kind.__name__}", found)
    return found
