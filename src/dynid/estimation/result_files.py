"""The files of a result: parameters.npz, which is read again, and the tables for people and other programs."""

from __future__ import annotations

from dataclasses import fields, replace
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from dynid.disk import write_text
from dynid.estimation.identified import Identified
from dynid.files import typed
from dynid.files.artifact import packed, read_artifact, reading, unpacked
from dynid.files.robotfile import parse_robot, text_of
from dynid.model.regressor import parameter_names
from dynid.npz import write_artifact
from dynid.robot import Coulomb
from dynid.text import csv_row, yaml_text

SCHEMA = "dynid/identification/1"
TABLE = "dynid/parameters-table/1"
#: Fields of a result that are stored in another way, or not at all.
_APART = ("robot", "header", "path", "rigid", "stack", "draw")
Result = TypeVar("Result", bound=Identified)


def save(path: Path, result: Identified, facts: dict[str, Any] | None = None) -> Path:
    """Write parameters.npz, which ``read`` reads.

    Args:
        path: where to.
        result: the result.
        facts: further facts for the header, such as the inputs that it depends on.
    """
    names = [each.name for each in fields(Identified) if each.name not in _APART]
    arrays: dict[str, NDArray[Any]] = {}
    header = {
        **(facts or {}),
        **result.header,
        "cutoff_hz": result.cutoff,
        "delay_applied_s": result.delay,
        "log_sha256": list(result.log_sha256),
        "result": {name: packed(getattr(result, name), arrays, name) for name in names},
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
    header, kinds = dict(artifact.header), get_type_hints(Identified, localns={"Stack": Any})
    with reading(path):
        values = {
            name: unpacked(kinds[name], stored, artifact.arrays)
            for name, stored in header["result"].items()
        }
        file = Path(header["robot_path"])
        robot = parse_robot(header["robot_file"], file)
        known: dict[str, Any] = {"source": typed(file)} if file.name else {"path": None}
        coulomb = unpacked(Coulomb | None, header.get("coulomb"), {})
        robot = replace(robot, estimated_coulomb=coulomb, **known)
        result = kind(robot=robot, header=header, path=path, **values)
        if len(result.joints) != robot.n:
            raise ValueError("its joints do not match its robot")
        if {result.reduction.names, result.physical.names} != {parameter_names(robot)}:
            raise ValueError("its parameters do not match its robot")
    return result


def _digits(value: float, error: float | None) -> float | None:
    """Keep two digits of the error: more would pretend a knowledge that is not there."""
    if not np.isfinite(value):
        return None
    if not error or not np.isfinite(error):
        return float(f"{value:.6g}")
    return round(value, max(0, 1 - int(np.floor(np.log10(error))))) + 0.0
