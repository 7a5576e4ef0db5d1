"""From a robot file to its base model: the regressor and what of its parameters can be identified (Paper Eq. 13)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dynid.progress import SILENT, Progress
from dynid.robot import Robot

if TYPE_CHECKING:
    from dynid.model.store import BaseModel

#: Base models that are kept in memory, by the key of their robot: deriving one takes a quarter of a second.
_kept: dict[str, BaseModel] = {}
KEPT = 8


def base_model(robot: Robot, folder: Path | None = None, progress: Progress = SILENT) -> BaseModel:
    """Return the regressor of an arm with its base parameters, derived when it is not there yet or stale.

    Args:
        robot: the arm.
        folder: where regressor.npz and fullregressor.npz are kept; None keeps the model in memory only.
        progress: told when it was derived.
    """
    from dynid.model.store import key_of, obtain_base_model, paths, stored_key

    progress.stage("model")
    if folder is None:
        return _in_memory(robot)
    path = paths(folder)[1]
    fresh = stored_key(path) == key_of(robot)
    base = obtain_base_model(robot, folder)
    if not fresh:
        made = f"{len(base.reduction.names)} -> {base.reduction.rank} base parameters"
        progress.stage("model", f"derived for {robot.name}: {made}, stored in {path.parent}")
    return base


def _in_memory(robot: Robot) -> BaseModel:
    from dynid.model.reduce import base_parameters
    from dynid.model.regressor import Model, build_model
    from dynid.model.store import BaseModel, key_of

    key = key_of(robot)
    if key not in _kept:
        model = build_model(robot)
        if len(_kept) >= KEPT:
            del _kept[next(iter(_kept))]
        _kept[key] = BaseModel(model, base_parameters(model))
    found = _kept[key]
    return found if found.robot is robot else BaseModel(Model(robot, found.model.rigid), found.reduction)
