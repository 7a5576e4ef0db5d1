"""The files of a result: parameters.npz, which is read again, and the tables for people and other programs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from dynid.disk import write_text
from dynid.errors import Finding
from dynid.estimation.identified import ExpectedError, Identified, JointQuality
from dynid.estimation.least_squares import Fit
from dynid.estimation.possible_arm import PhysicalParameters
from dynid.estimation.residual_model import ModelError
from dynid.files import typed
from dynid.files.artifact import read_artifact, reading
from dynid.files.robotfile import parse_robot, text_of
from dynid.model.base_model import (
    reduction_facts,
    reduction_from,
)
from dynid.model.regressor import parameter_names
from dynid.npz import write_artifact
from dynid.robot import coulomb_of
from dynid.text import csv_row, yaml_text

SCHEMA = "dynid/identification/1"
TABLE = "dynid/parameters-table/1"
#: What is stored as it is, by its name in the result.
SCALARS = (
    "why",
    "relative_error_percent",
    "heldout_relative_error_percent",
    "heldout",
    "rank",
    "condition_number",
    "condition_number_scaled",
    "samples",
    "in_force",
)
#: Arrays of the estimator's own fit, in its order.
FIT = ("plain", "noise", "plain_covariance", "factors", "counts")
#: What is stored as arrays.
ARRAYS = ("theta", "covariance", "std_error", "prior")
Result = TypeVar("Result", bound=Identified)


def save(path: Path, result: Identified, facts: dict[str, Any] | None = None) -> Path:
    """Write parameters.npz, which ``read`` reads.

    Args:
        path: where to.
        result: the result.
        facts: further facts for the header, such as the inputs that it depends on.
    """
    reduction, reduction_arrays = reduction_facts(result.reduction)
    physical, error = asdict(result.physical), result.model_error
    arrays = {key: getattr(result, key) for key in FIT + ARRAYS} | reduction_arrays
    arrays |= {f"full_{k}": x for k, x in physical.items() if isinstance(x, np.ndarray)}
    if error is not None:
        arrays |= {f"error_{k}": x for k, x in vars(error).items() if isinstance(x, np.ndarray)}
    arrays |= {f"motion_{k}": motion.astype(np.float32) for k, motion in enumerate(result.motions)}
    scalars = {key: getattr(result, key) for key in ("method", "knowledge", *SCALARS)} | {
        "physical": {key: x for key, x in physical.items() if f"full_{key}" not in arrays},
        "model_error_evidence": None if error is None else error.evidence,
        "expected": result.expected.facts(),
    }
    header = {
        **(facts or {}),
        **result.header,
        "cutoff_hz": result.cutoff,
        "delay_applied_s": result.delay,
        "log_sha256": list(result.log_sha256),
        "result": scalars | {"joints": [asdict(joint) for joint in result.joints]},
        "findings": [asdict(f) for f in result.findings],
        "reduction": reduction,
        "robot_file": text_of(result.robot),
        "robot_path": str(result.robot.path or ""),
    }
    write_artifact(path, SCHEMA, header, arrays)
    return path


def save_csv(path: Path, result: Identified) -> Path:
    """Write one row per base parameter, for spreadsheets; no value and no error where the logs determine none."""
    columns = ("name", "value", "std_error", "unit", "class", "known", "prior", "formula")
    rows = [[row[column] for column in columns] for row in result.parameter_rows()]
    write_text(path, "\n".join([csv_row(columns), *map(csv_row, rows), ""]))
    return path


def save_yaml(path: Path, result: Identified) -> Path:
    """Write parameters.yaml; equal results give equal bytes."""
    rows = result.parameter_rows()
    for row in rows:
        error, unknown = row["std_error"], row["known"] == "not determined"
        row["value"] = None if unknown and not error else _digits(row["value"], error)
        row["std_error"] = None if error is None else float(f"{error:.2g}")
        row["terms"] = {name: float(f"{factor:.10g}") for name, factor in row["terms"].items()}
        row["prior"] = None if row["prior"] is None else float(f"{row['prior']:.6g}")
    coulomb = result.robot.coulomb_shape
    document = {
        "schema": TABLE,
        "robot": result.robot.name,
        "logs_sha256": list(result.log_sha256),
        "method": result.method,
        "cutoff_hz": float(f"{result.cutoff:.6g}"),
        "coulomb": {
            "shape": coulomb.shape,
            "velocity": list(coulomb.velocity),
            **({"interval": [list(each) for each in coulomb.interval]} if coulomb.interval else {}),
        },
        "relative_error_percent": float(f"{result.relative_error_percent:.4g}"),
        "parameters": rows,
        "not_identifiable": list(result.reduction.none),
    }
    write_text(path, yaml_text(document))
    return path


def read(path: Path, kind: type[Result]) -> Result:
    """Read parameters.npz as a kind of result.

    Raises:
        NotAnArtifact: the file is none of dynid's, or is damaged.
    """
    artifact = read_artifact(path, SCHEMA)
    h, a = dict(artifact.header), artifact.arrays
    with reading(path):
        stored: dict[str, Any] = dict(h["result"])
        full = {
            **stored["physical"],
            **_without("full_", a),
            "names": tuple(stored["physical"]["names"]),
        }
        file = Path(h["robot_path"])
        robot = parse_robot(h["robot_file"], file)
        known: dict[str, Any] = {"source": typed(file)} if h["robot_path"] else {"path": None}
        values: dict[str, Any] = {key: stored[key] for key in SCALARS}
        values |= {key: a[key] for key in ARRAYS}
        result = kind(
            robot=replace(robot, estimated_coulomb=coulomb_of(h), **known),
            reduction=reduction_from(h["reduction"], a),
            fit=Fit(stored["method"], *(a[key] for key in FIT)),
            joints=tuple(JointQuality(**row) for row in stored["joints"]),
            expected=ExpectedError.of(stored["expected"]),
            **values,
            knowledge=tuple(stored["knowledge"]),
            physical=PhysicalParameters(**full),
            model_error=None
            if stored["model_error_evidence"] is None
            else ModelError(**_without("error_", a), evidence=stored["model_error_evidence"]),
            findings=tuple(Finding(**row) for row in h["findings"]),
            motions=tuple(
                a[f"motion_{k}"].astype(np.float64) for k in range(len(a)) if f"motion_{k}" in a
            ),
            header=h,
            path=path,
        )
        if len(result.joints) != result.robot.n:
            raise ValueError("its joints do not match its robot")
        if {result.reduction.names, result.physical.names} != {parameter_names(result.robot)}:
            raise ValueError("its parameters do not match its robot")
    return result


def _without(prefix: str, arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return arrays of a part of a result by their name in it."""
    return {k.removeprefix(prefix): x for k, x in arrays.items() if k.startswith(prefix)}


def _digits(value: float, error: float | None) -> float | None:
    """Keep two digits of the error: more would pretend a knowledge that is not there."""
    if not np.isfinite(value):
        return None
    if not error or not np.isfinite(error):
        return float(f"{value:.6g}")
    return round(value, max(0, 1 - int(np.floor(np.log10(error))))) + 0.0
