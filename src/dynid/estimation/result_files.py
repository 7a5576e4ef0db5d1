"""The files of a result: parameters.npz, which is read again, and the tables for people and other programs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.disk import write_text
from dynid.errors import Finding, NotAnArtifact
from dynid.estimation.least_squares import Fit
from dynid.estimation.possible_arm import PhysicalParameters
from dynid.estimation.posterior import ExpectedError
from dynid.estimation.residual_model import ModelError
from dynid.estimation.result import Identification, JointQuality, Quality
from dynid.files import typed
from dynid.files.artifact import read_artifact, read_header, reading
from dynid.files.robotfile import parse_robot, text_of
from dynid.model.base_model import (
    REDUCTION_SHAPES,
    reduction_facts,
    reduction_from,
)
from dynid.model.regressor import parameter_names
from dynid.npz import write_artifact
from dynid.robot import coulomb_of
from dynid.text import csv_row, yaml_text

Floats = NDArray[np.float64]

SCHEMA = "dynid/identification/1"
TABLE = "dynid/parameters-table/1"
#: What is stored as arrays, and what is stored as it is, by its name in the result.
ARRAYS = (
    "theta",
    "plain",
    "covariance",
    "plain_covariance",
    "std_error",
    "prior",
    "noise",
    "factors",
    "counts",
)
SCALARS = (
    "method",
    "why",
    "knowledge",
    "joints",
    "relative_error_percent",
    "heldout_relative_error_percent",
    "heldout",
    "rank",
    "condition_number",
    "condition_number_scaled",
    "samples",
    "in_force",
)
FULL_ARRAYS = ("x", "std_error", "data_share", "covariance", "hessian")
FULL_SCALARS = ("names", "cost", "objective", "inflation")
ERROR_ARRAYS = ("speed", "reference", "scale", "projection", "mean", "root", "slope", "size", "rms")
#: What files of results without joints apart lack; zero there.
APART_ARRAYS = ("apart", "own", "own_root", "own_slope")


def save(path: Path, found: Identification, facts: dict[str, Any] | None = None) -> Path:
    """Write parameters.npz, which ``load`` reads.

    Args:
        path: where to.
        found: the result.
        facts: further facts for the header, such as the inputs that it depends on.
    """
    physical, (reduction, reduction_arrays) = (
        asdict(found.physical),
        reduction_facts(found.reduction),
    )
    arrays = {key: getattr(found, key) for key in ARRAYS}
    arrays |= {f"full_{key}": physical.pop(key) for key in FULL_ARRAYS}
    arrays |= reduction_arrays
    if found.model_error is not None:
        apart = APART_ARRAYS if len(found.model_error.joints_apart) else ()
        arrays |= {
            f"error_{key}": getattr(found.model_error, key) for key in (*ERROR_ARRAYS, *apart)
        }
    arrays |= {f"motion_{k}": motion.astype(np.float32) for k, motion in enumerate(found.motions)}
    scalars = {key: getattr(found, key) for key in SCALARS} | {"physical": physical}
    scalars["model_error_evidence"] = (
        None if found.model_error is None else found.model_error.evidence
    )
    scalars["expected"] = None if found.expected is None else found.expected.facts()
    header = {
        **(facts or {}),
        **found.header,
        "cutoff_hz": found.cutoff,
        "delay_applied_s": found.delay,
        "log_sha256": list(found.log_sha256),
        "result": scalars | {"joints": [asdict(joint) for joint in found.joints]},
        "findings": [asdict(f) for f in found.findings],
        "reduction": reduction,
        "robot_file": text_of(found.robot),
        "robot_path": str(found.robot.path or ""),
    }
    write_artifact(path, SCHEMA, header, arrays)
    return path


def save_csv(path: Path, found: Identification) -> Path:
    """Write one row per base parameter, for spreadsheets; no value and no error where the logs determine none."""
    columns = ("name", "value", "std_error", "unit", "class", "known", "prior", "formula")
    rows = [[row[column] for column in columns] for row in found.parameter_rows()]
    write_text(path, "\n".join([csv_row(columns), *map(csv_row, rows), ""]))
    return path


def save_yaml(path: Path, found: Identification) -> Path:
    """Write parameters.yaml; equal results give equal bytes."""
    rows = []
    for row in found.parameter_rows():
        error = row["std_error"]
        terms = {name: float(f"{factor:.10g}") for name, factor in row["terms"].items()}
        shown = {
            **row,
            "value": _digits(row["value"], error)
            if row["known"] != "not determined" or error
            else None,
            "std_error": None if error is None else float(f"{error:.2g}"),
            "terms": terms,
            "prior": None if row["prior"] is None else float(f"{row['prior']:.6g}"),
        }
        rows.append(shown)
    coulomb = found.robot.coulomb_shape
    document = {
        "schema": TABLE,
        "robot": found.robot.name,
        "logs_sha256": list(found.log_sha256),
        "method": found.method,
        "cutoff_hz": float(f"{found.cutoff:.6g}"),
        "coulomb": {
            "shape": coulomb.shape,
            "velocity": list(coulomb.velocity),
            **({"interval": [list(each) for each in coulomb.interval]} if coulomb.interval else {}),
        },
        "relative_error_percent": float(f"{found.relative_error_percent:.4g}"),
        "parameters": rows,
        "not_identifiable": list(found.reduction.none),
    }
    write_text(path, yaml_text(document))
    return path


#: What parameters.npz holds besides the motions and what a model of its residual has.
SHAPES = {
    **REDUCTION_SHAPES,
    **dict.fromkeys(("theta", "plain", "std_error", "prior"), "p"),
    **dict.fromkeys(("covariance", "plain_covariance"), "p p"),
    **dict.fromkeys(("noise", "counts"), "n"),
    "factors": "n p+1 p+1",
    **dict.fromkeys(("full_x", "full_std_error", "full_data_share"), "c"),
    "full_covariance": "c c",
    "full_hessian": "d d",
}


def load(path: Path) -> Identification:
    """Read parameters.npz.

    Raises:
        NotAnArtifact: the file is none of dynid's, or is damaged.
    """
    header = read_header(path) or {}
    if header.get("schema") == SCHEMA and "reduction" not in header:
        raise NotAnArtifact(
            f"{path} was written by an earlier version of dynid",
            where=str(path),
            fix="identify again: dynid identify",
        )
    artifact = read_artifact(path, SCHEMA, SHAPES)
    h, a = dict(artifact.header), artifact.arrays
    with reading(path):
        stored: dict[str, Any] = dict(h["result"])
        full: dict[str, Any] = {key: stored["physical"][key] for key in FULL_SCALARS}
        full["names"] = tuple(full["names"])
        full |= {key: a[f"full_{key}"] for key in FULL_ARRAYS}
        file = Path(h["robot_path"])
        robot = parse_robot(h["robot_file"], file)
        known: dict[str, Any] = {"source": typed(file)} if h["robot_path"] else {"path": None}
        measured = {key: stored[key] for key in SCALARS if key in Quality.__annotations__}
        measured |= {"joints": _tuple(JointQuality, stored["joints"])}
        found = Identification(
            robot=replace(robot, estimated_coulomb=coulomb_of(h), **known),
            reduction=reduction_from(h["reduction"], a),
            fit=Fit(
                stored["method"],
                a["plain"],
                a["noise"],
                a["plain_covariance"],
                a["factors"],
                a["counts"],
            ),
            quality=Quality(**measured, expected=ExpectedError.of(stored["expected"])),
            why=stored["why"],
            in_force=stored["in_force"],
            theta=a["theta"],
            covariance=a["covariance"],
            std_error=a["std_error"],
            prior=a["prior"],
            knowledge=tuple(stored["knowledge"]),
            physical=PhysicalParameters(**full),
            model_error=_model_error(stored["model_error_evidence"], a),
            findings=_tuple(Finding, h["findings"]),
            motions=tuple(
                a[f"motion_{k}"].astype(np.float64) for k in range(len(a)) if f"motion_{k}" in a
            ),
            header=h,
            path=path,
        )
        _require_one_arm(found)
    return found


def _require_one_arm(found: Identification) -> None:
    """Raise when the parts of a result are not those of one arm."""
    robot = found.robot
    if len(found.joints) != robot.n:
        raise ValueError("its joints do not match its robot")
    names = parameter_names(robot)
    if found.reduction.names != names or found.physical.names != names:
        raise ValueError("its parameters do not match its robot")


def _model_error(evidence: float | None, arrays: Mapping[str, NDArray[Any]]) -> ModelError | None:
    if evidence is None:
        return None
    given = {key: arrays[f"error_{key}"] for key in ERROR_ARRAYS}
    n, p = given["slope"].shape[0], given["slope"].shape[2]
    for key, shape in zip(APART_ARRAYS, ((n,), (n, p), (n, p, p), (n, p, p)), strict=True):
        given[key] = arrays.get(f"error_{key}", np.zeros(shape))
    return ModelError(**given, evidence=float(evidence))


def _tuple(kind: Any, rows: Iterable[dict[str, Any]]) -> tuple[Any, ...]:  # noqa: ANN401
    return tuple(kind(**row) for row in rows)


def _digits(value: float | None, error: float | None) -> float | None:
    """Keep two digits of the error: more would pretend a knowledge that is not there."""
    if value is None or not np.isfinite(value):
        return None
    if not error or not np.isfinite(error):
        return float(f"{value:.6g}")
    return round(value, max(0, 2 - 1 - int(np.floor(np.log10(error))))) + 0.0
