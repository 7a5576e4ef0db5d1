"""The result of an identification, and parameters.npz and parameters.yaml (the paper's Table 10)."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, NotAnArtifact
from dynid.estimation.physical_parameters import FullSet
from dynid.files.artifact import Artifact, read_artifact, write_artifact, write_text
from dynid.files.robotfile import parse_robot
from dynid.model.base_model import BaseModel
from dynid.model.reduce import Reduction
from dynid.model.store import reduction_facts, reduction_from
from dynid.robot import Robot

Floats = NDArray[np.float64]

SCHEMA = "dynid/identification/1"
ARRAYS = ("theta", "plain", "covariance", "std_error", "prior", "noise", "factors", "counts")
FULL_ARRAYS = ("x", "std_error", "data_share", "theta")


@dataclass(frozen=True)
class JointQuality:
    """How well one joint is explained.

    Attributes:
        joint: name.
        rms: residual [N m].
        relative_percent: residual over measured torque [%].
        torque_rms: measured torque [N m].
        heldout_rms: residual on rows that were not fitted [N m].
    """

    joint: str
    rms: float
    relative_percent: float
    torque_rms: float
    heldout_rms: float | None


@dataclass(frozen=True)
class Identification:
    """Base parameters with what is known about them.

    Attributes:
        method: estimator.
        why: why this one.
        names: base parameters, (p,).
        theta: their values; those of the physical set where there is one, (p,).
        plain: what the estimator itself found, (p,).
        covariance: honest covariance of ``plain``, (p, p).
        std_error: standard errors; infinite where the log says nothing, (p,).
        knowledge: ``"well"``, ``"roughly"`` or ``"not determined"``, (p,).
        prior: values believed before, NaN where nothing was, (p,).
        noise: residual of each joint that the weights were made from, (n,).
        joints: quality of each joint.
        relative_error_percent: 100 |tau - W theta| / |tau| on the rows that were fitted.
        heldout_relative_error_percent: the same on rows that were not.
        heldout: what was held out.
        rank: number of directions that the log excites.
        condition_number: of W with columns as they are.
        condition_number_scaled: of W with columns of unit length.
        samples: instants in the stack.
        physical: the physically possible full set nearest to data and prior.
        in_force: whether ``theta`` is that of the ``"physical"`` set or the ``"plain"`` estimate.
        choice: why.
        heldout_by_set: held-out relative error of both, where rows were held out.
        factors: one triangular factor of [W tau] a joint, for ``--update``, (n, p + 1, p + 1).
        counts: number of rows in each, (n,).
        findings: what is worth a warning.
    """

    method: str
    why: str
    names: tuple[str, ...]
    theta: Floats
    plain: Floats
    covariance: Floats
    std_error: Floats
    knowledge: tuple[str, ...]
    prior: Floats
    noise: Floats
    joints: tuple[JointQuality, ...]
    relative_error_percent: float
    heldout_relative_error_percent: float | None
    heldout: str
    rank: int
    condition_number: float
    condition_number_scaled: float
    samples: int
    physical: FullSet
    in_force: str
    choice: str
    heldout_by_set: dict[str, float]
    factors: Floats = field(default_factory=lambda: np.zeros((0, 0, 0)))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    findings: tuple[Finding, ...] = ()


@dataclass(frozen=True)
class StoredResult:
    """A result as read from disk.

    Attributes:
        identification: the parameters.
        reduction: how they combine the full ones.
        robot: the robot they belong to, as it was then.
        cutoff: cut-off of the parallel filter [Hz].
        delay: by how much the torques were late, and were moved back [s].
        log_sha256: hashes of the logs they were made from.
        header: everything else.
        path: the file; empty for a new result.
        observations: what a new result was made from, None for one that was read.
    """

    identification: Identification
    reduction: Reduction
    robot: Robot
    cutoff: float
    delay: float
    log_sha256: tuple[str, ...]
    header: dict[str, Any]
    path: Path
    observations: Any = field(default=None, repr=False, compare=False)


def parameter_table(result: Identification, base: BaseModel) -> list[dict[str, Any]]:
    """Return one row a base parameter for JSON and YAML: name, value, unit, std_error, class, terms, prior."""
    reduction, units = base.reduction, base.model.units
    table = []
    for i, name in enumerate(result.names):
        terms = reduction.terms(i)
        error = float(result.std_error[i])
        table.append(
            {
                "name": name,
                "value": float(result.theta[i]),
                "unit": units[reduction.names[reduction.base[i]]],
                "std_error": error if np.isfinite(error) else None,
                "class": "alone" if len(terms) == 1 else "combined",
                "known": result.knowledge[i],
                "formula": reduction.formulas[i] if reduction.formulas else None,
                "terms": terms,
                "prior": None if np.isnan(result.prior[i]) else float(result.prior[i]),
            }
        )
    return table


def write_yaml(path: Path, result: Identification, base: BaseModel, facts: dict[str, Any]) -> None:
    """Write parameters.yaml; equal inputs give equal bytes."""
    import yaml

    def digits(value: float | None, error: float | None) -> float | None:
        """Keep two digits of the error: more would pretend a knowledge that is not there."""
        if value is None or not np.isfinite(value):
            return None
        if not error or not np.isfinite(error):
            return float(f"{value:.6g}")
        return round(value, max(0, 2 - 1 - int(np.floor(np.log10(error))))) + 0.0

    rows = []
    for row in parameter_table(result, base):
        error = row["std_error"]
        terms = {name: float(f"{factor:.10g}") for name, factor in row["terms"].items()}
        shown = {
            **row,
            "value": digits(row["value"], error) if row["known"] != "not determined" or error else None,
            "std_error": None if error is None else float(f"{error:.2g}"),
            "terms": terms,
            "prior": None if row["prior"] is None else float(f"{row['prior']:.6g}"),
        }
        rows.append(shown)
    document = {**facts, "parameters": rows, "not_identifiable": list(base.reduction.none)}
    write_text(path, yaml.safe_dump(document, sort_keys=False, allow_unicode=True, width=120, default_flow_style=None))


def save(path: Path, result: Identification, base: BaseModel, header: dict[str, Any]) -> None:
    """Write parameters.npz."""
    scalars = asdict(replace(result, findings=()))
    arrays = {key: scalars.pop(key) for key in ARRAYS}
    arrays |= {f"full_{key}": scalars["physical"].pop(key) for key in FULL_ARRAYS}
    reduction, reduction_arrays = reduction_facts(base.reduction)
    arrays |= reduction_arrays
    robot_text = base.robot.path.read_text(encoding="utf-8") if base.robot.path else ""
    facts = {
        **header,
        "result": scalars,
        "findings": [asdict(f) for f in result.findings],
        "reduction": reduction,
        "robot_file": robot_text,
        "robot_path": str(base.robot.path or ""),
    }
    write_artifact(path, Artifact(SCHEMA, facts, arrays))


def load(path: Path) -> StoredResult:
    """Read parameters.npz."""
    artifact = read_artifact(path, SCHEMA)
    h, a = dict(artifact.header), artifact.arrays
    if "reduction" not in h:
        raise NotAnArtifact(
            f"{path} was written by an earlier version of dynid", where=str(path), fix="identify again: dynid identify"
        )
    try:
        facts: dict[str, Any] = dict(h["result"])
        facts["joints"] = tuple(JointQuality(**joint) for joint in facts["joints"])
        facts["findings"] = tuple(Finding(**finding) for finding in h["findings"])
        facts |= {key: tuple(facts[key]) for key in ("names", "knowledge")}
        full: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in facts["physical"].items()
        }
        full |= {key: a[f"full_{key}"] for key in FULL_ARRAYS}
        facts |= {"physical": FullSet(**full)} | {key: a[key] for key in ARRAYS if key in a}
        identification = Identification(**facts)
        reduction = reduction_from(h["reduction"], a)
        robot = parse_robot(str(h["robot_file"]), Path(str(h["robot_path"])))
        cutoff, delay = float(h["cutoff_hz"]), float(h.get("delay_applied_s") or 0.0)
        return StoredResult(identification, reduction, robot, cutoff, delay, tuple(h["log_sha256"]), h, path)
    except (KeyError, TypeError, ValueError) as error:
        raise NotAnArtifact(f"{path} is damaged: {error}", where=str(path)) from error
