"""What becomes of a result: it is drawn, written and answered, and what was saved is read back, whatever it is."""

from __future__ import annotations

import os
from dataclasses import asdict
from itertools import zip_longest
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.estimation import prediction
from dynid.estimation.result import Identification
from dynid.model.base_model import BaseModel
from dynid.progress import SILENT, Progress
from dynid.reports import figures
from dynid.workflows.model import base_model, derive_model

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def base_model_of(
    result: Identification, folder: Path | None = None, progress: Progress = SILENT
) -> BaseModel:
    """Return the model that a result was made with; its base parameters are those of the result, never found anew.

    Args:
        result: the result.
        folder: where the model is kept; None keeps it in memory.
        progress: reports that the model is made.
    """
    if folder is None:
        return BaseModel(base_model(result.robot).model, result.reduction)
    progress.stage("model")
    return BaseModel(derive_model(result.robot, folder).model, result.reduction)


# ---------------------------------------------------------------- what is drawn, written and answered
def torque_figure(result: Identification, joints: tuple[str, ...], residual_only: bool) -> Figure:
    """Return a figure of torques on the logs that a new result was made from, which follow each other.

    Args:
        result: what ``identify`` returned.
        joints: names of the joints that are drawn.
        residual_only: draw only what the model leaves.
    """
    stack = result.stack
    assert stack is not None, "only new results have a drawing"
    motions = prediction.predict_logs(stack, result.theta, result.model_error)
    title = f"{result.robot.name}, fitted logs"
    return figures.motion_figure(
        prediction.joined(motions), result.robot, joints, title, residual_only=residual_only
    )


def save_result(
    folder: Path, result: Identification, facts: dict[str, Any] | None = None
) -> list[Path]:
    """Write parameters.npz, parameters.yaml, parameters.csv and estimatedmotion.npz of a new result.

    Args:
        folder: where to.
        result: what ``identify`` returned.
        facts: further facts for the headers, such as the inputs that they depend on.
    """
    stack = result.stack
    assert stack is not None, "a result that was read from a file is written by its own method save"
    # Why both: a log is found from any working folder, and where the folders were moved together.
    beside = [
        os.path.relpath(path, folder)
        for path in result.header.get("logs", [])
        if path and Path(path).exists()
    ]
    if len(beside) == len(result.header.get("logs", [])):
        facts = {**(facts or {}), "logs_from_here": beside}
    header = {**(facts or {}), **result.header}
    motions = prediction.predict_logs(stack, result.theta, result.model_error)
    motion = folder / "estimatedmotion.npz"
    prediction.save(
        motion, motions, {**header, "joints": list(stack.joints), "torque_from": "identified"}
    )
    # Why last: parameters.npz is what later commands look for, so it appears only when everything else is there.
    tables = [
        result.save_yaml(folder / "parameters.yaml"),
        result.save_csv(folder / "parameters.csv"),
    ]
    return [motion, *tables, result.save(folder / "parameters.npz", facts)]


def answer_of(found: Identification) -> dict[str, Any]:
    """Return what the JSON answer of ``dynid identify`` says about a result."""
    return {
        "schema": "dynid/identify/1",
        "robot": found.robot.name,
        "method": found.method,
        "rank": found.rank,
        "samples": found.samples,
        "condition_number": found.condition_number,
        "condition_number_scaled": found.condition_number_scaled,
        "relative_error_percent": found.relative_error_percent,
        "heldout": found.heldout,
        "heldout_relative_error_percent": found.heldout_relative_error_percent,
        "joints": [
            {
                "joint": j.joint,
                "rms_nm": j.rms,
                "torque_rms_nm": j.torque_rms,
                "relative_error_percent": j.relative_percent,
                "heldout_rms_nm": j.heldout_rms,
                "noise_floor_nm": floor,
            }
            for j, floor in zip_longest(found.joints, found.header.get("noise_floor_nm") or ())
        ],
        "parameters": found.parameter_rows(),
        "physically_consistent": found.in_force == "physical",
        "in_force": found.in_force,
        "heldout_relative_error_percent_by_set": {"physical": None, "plain": None}
        | {found.in_force: found.heldout_relative_error_percent},
        "expected_torque_error": None if found.expected is None else found.expected.facts(),
        "residual_model": found.residual_facts(),
        "links": found.links(),
        "findings": [asdict(f) for f in found.findings],
        "judgement": found.judgement.facts(),
    }
