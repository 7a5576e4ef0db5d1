"""The result of an identification: parameters with what is known about them, and their files (the paper's Table 10)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, NotAnArtifact, WrongUsage
from dynid.estimation.covariance import WORDS, counted
from dynid.estimation.error_columns import GROUPS
from dynid.estimation.least_squares import relative_error
from dynid.estimation.model_error import GROUP_NAMES, ModelError
from dynid.estimation.physical_parameters import PhysicalParameters
from dynid.estimation.posterior import ExpectedError
from dynid.estimation.quantiles import normal_quantile
from dynid.files.artifact import Artifact, read_artifact, read_header, reading, write_artifact, write_text
from dynid.files.contents import Array, Contents, Fact, require_numbers
from dynid.files.robotfile import parse_robot, text_of
from dynid.limits import LIMITS
from dynid.model.base_model import (
    REDUCTION_ARRAYS,
    REDUCTION_FACTS,
    BaseModel,
    Reduction,
    reduction_facts,
    reduction_from,
)
from dynid.model.effects.interface import ArmMotion
from dynid.model.parameters import body_columns, body_of
from dynid.model.program import Program
from dynid.model.regressor import Model, build_model, model_torques, parameter_names
from dynid.robot import Robot
from dynid.signals.conditioned_log import known_torque
from dynid.table import Table
from dynid.text import csv_row, visible, yaml_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure
    from pandas import DataFrame

    from dynid.estimation.stack import Stack

Floats = NDArray[np.float64]

#: Draws torques of some joints on the fitted logs, or only what is left of them; the workflow gives it to new results.
Drawing = Callable[["Identification", tuple[str, ...], bool], "Figure"]

SCHEMA = "dynid/identification/1"
TABLE = "dynid/parameters-table/1"
#: Attributes that are stored as arrays, and those that are stored as they are.
ARRAYS = ("theta", "plain", "covariance", "plain_covariance", "std_error", "prior", "noise", "factors", "counts")
SCALARS = (
    "method", "why", "knowledge", "joints", "relative_error_percent", "heldout_relative_error_percent", "heldout",
    "rank", "condition_number", "condition_number_scaled", "samples", "in_force", "choice", "heldout_by_set",
)  # fmt: skip
FULL_ARRAYS = ("x", "std_error", "data_share", "covariance", "hessian")
ERROR_ARRAYS = ("speed", "reference", "scale", "projection", "mean", "root", "slope", "size", "rms")
#: By how much a covariance may exceed the product of its standard deviations, as a share.
ROUNDING = 1e-6
#: Least noise and size that is none of rounding, and longest delay of torques [s].
LEAST, LATEST = 1e-60, 100.0
IN_FORCE = {"physical": "the physically possible set", "plain": "the plain estimate"}


@dataclass(frozen=True)
class JointQuality:
    """How well one joint is explained.

    Attributes:
        joint: name.
        rms: root mean square of the residual [N m or N].
        relative_percent: residual over measured torque [%].
        torque_rms: root mean square of the measured torque [N m or N].
        heldout_rms: the residual on rows that were not fitted [N m or N].
    """

    joint: str
    rms: float
    relative_percent: float
    torque_rms: float
    heldout_rms: float | None


@dataclass(frozen=True, repr=False, eq=False)
class Identification:
    """Base parameters of an arm with what is known about them; p parameters, n joints.

    Attributes:
        robot: the arm, as it was then.
        reduction: how base parameters combine the full ones.
        method: estimator.
        why: why this one.
        theta: base parameters, those of the set in force, (p,).
        plain: what the estimator itself found, (p,).
        covariance: of ``theta``: of the posterior, or of the plain estimate where that is in force, (p, p).
        plain_covariance: of ``plain``, allowing for coloured residuals, (p, p).
        std_error: standard errors of ``theta``; infinite where nothing is known at all, (p,).
        knowledge: ``"well"``, ``"negligible"``, ``"roughly"`` or ``"not determined"``, (p,).
        prior: prior values, NaN where there is none, (p,).
        noise: residual of each joint that the weights were made from, (n,) [N m or N].
        joints: quality of each joint.
        relative_error_percent: 100 |tau - W theta| / |tau| on the rows that were fitted [%].
        heldout_relative_error_percent: the same on rows that were not; None where nothing was held out [%].
        heldout: what was held out.
        heldout_by_set: held-out relative error of both sets, where rows were held out [%].
        rank: number of directions that the log excites.
        condition_number: of W with columns as they are.
        condition_number_scaled: of W with columns of unit length.
        samples: instants in the stack.
        physical: the physically possible parameters of the whole model nearest to data and prior.
        model_error: what the model lacks, as random columns; None where there is none, or no evidence for it.
        expected: how far predicted torques will be off; None in a result of an earlier version.
        in_force: whether ``theta`` is that of the ``"physical"`` set or the ``"plain"`` estimate.
        choice: why.
        factors: one triangular factor of [W tau] per joint, to which other logs can be added, (n, p + 1, p + 1).
        counts: number of rows in each, (n,).
        findings: what is worth a warning.
        cutoff: cut-off frequency of the filter over torques and columns [Hz].
        delay: by how much the torques were late, and were moved back [s].
        log_sha256: hashes of the logs that it was made from.
        header: where it comes from: logs, command, inputs.
        path: its file; empty when it was not read from one.
        motions: positions of each fitted log at 5 Hz, two minutes at most, (M, n) [rad or m].
        rigid: program of the rigid-body columns; None to derive it when it is needed.
        stack: the rows that it was made from; None when it was read from a file.
        draw: draws torques on these logs, None for a result that was read.
    """

    robot: Robot
    reduction: Reduction
    method: str
    why: str
    theta: Floats
    plain: Floats
    covariance: Floats
    plain_covariance: Floats
    std_error: Floats
    knowledge: tuple[str, ...]
    prior: Floats
    noise: Floats
    joints: tuple[JointQuality, ...]
    relative_error_percent: float
    heldout_relative_error_percent: float | None
    heldout: str
    heldout_by_set: dict[str, float]
    rank: int
    condition_number: float
    condition_number_scaled: float
    samples: int
    physical: PhysicalParameters
    in_force: str
    choice: str
    model_error: ModelError | None = None
    expected: ExpectedError | None = None
    factors: Floats = field(default_factory=lambda: np.zeros((0, 0, 0)))
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    findings: tuple[Finding, ...] = ()
    cutoff: float = 0.0
    delay: float = 0.0
    log_sha256: tuple[str, ...] = ()
    header: dict[str, Any] = field(default_factory=dict)
    path: Path = Path()
    motions: tuple[Floats, ...] = ()
    rigid: Program | None = None
    stack: Stack | None = None
    draw: Drawing | None = field(default=None, repr=False, compare=False)

    @property
    def label(self) -> str:
        """Its file, for messages."""
        return str(self.path) if self.path.name else "the earlier result"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters, (p,)."""
        return self.reduction.base_names

    @cached_property
    def base(self) -> BaseModel:
        """Model and base parameters."""
        model = build_model(self.robot) if self.rigid is None else Model(self.robot, self.rigid)
        return BaseModel(model, self.reduction)

    # ---------------------------------------------------------------- figures
    def plot_torque(self) -> Figure:
        """Return a figure of measured and estimated torque and their difference on the fitted logs, joint by joint.

        Raises:
            WrongUsage: the result was read from a file, which keeps no rows.
        """
        return self._figure(self.robot.joint_names, residual_only=False)

    def plot_residual(self, joint: int | str) -> Figure:
        """Return a figure of what the model leaves of the torque of one joint on the fitted logs.

        Args:
            joint: number from 1, or name.

        Raises:
            WrongUsage: there is no such joint, or the result was read from a file, which keeps no rows.
        """
        return self._figure((self.robot.joint_name(joint),), residual_only=True)

    def _figure(self, joints: tuple[str, ...], *, residual_only: bool) -> Figure:
        if self.draw is None:
            raise WrongUsage(
                f"{self.label} keeps no rows to draw", fix="dynid.validate(result, log).plot_torque()", where=self.label
            )
        return self.draw(self, joints, residual_only)

    # ---------------------------------------------------------------- parameters
    @property
    def params(self) -> dict[str, float]:
        """Values of the base parameters by name, those of the set in force, in their units."""
        return dict(zip(self.names, self.theta.tolist(), strict=True))

    def conf_int(self, level: float = 0.95) -> Floats:
        """Return the interval of each parameter alone, (p, 2), in its unit; infinite where the log says nothing.

        Args:
            level: probability that the interval of a parameter holds its true value.
        """
        half = normal_quantile(0.5 + level / 2) * self.std_error
        return np.column_stack([self.theta - half, self.theta + half])

    def parameter_rows(self) -> list[dict[str, Any]]:
        """Return one row per base parameter for JSON: name, value, unit, std_error, class, known, formula, prior."""
        reduction, units = self.reduction, self.base.model.units
        table = []
        for i, name in enumerate(self.names):
            terms = reduction.terms(i)
            error = float(self.std_error[i])
            table.append(
                {
                    "name": name,
                    "value": float(self.theta[i]),
                    "unit": units[reduction.names[reduction.base[i]]],
                    "std_error": error if np.isfinite(error) else None,
                    "class": "alone" if len(terms) == 1 else "combined",
                    "known": self.knowledge[i],
                    "formula": reduction.formulas[i] if reduction.formulas else None,
                    "terms": terms,
                    "prior": None if np.isnan(self.prior[i]) else float(self.prior[i]),
                }
            )
        return table

    def table(self) -> Table:
        """Return one row per base parameter: value with 95 % interval, unit, class, how well it is known, prior."""
        rows = [
            {
                "parameter": row["name"],
                "value": row["value"],
                "std error": row["std_error"],
                "2.5 %": float(low),
                "97.5 %": float(high),
                "unit": row["unit"],
                "class": row["class"],
                "known": row["known"],
                "prior": row["prior"],
            }
            for row, (low, high) in zip(self.parameter_rows(), self.conf_int(), strict=True)
        ]
        return Table(rows)

    def to_dataframe(self) -> DataFrame:
        """Return the table as a pandas DataFrame."""
        return self.table().to_dataframe()

    def joint_table(self) -> Table:
        """Return one row per joint: rms error and rms torque [N m or N], what is unexplained [%], held-out error."""
        rows = [
            {
                "joint": quality.joint,
                "rms error": quality.rms,
                "rms torque": quality.torque_rms,
                "unexplained %": quality.relative_percent,
                "held out": quality.heldout_rms,
                "unit": "A" if self.robot.torque.relative else joint.torque_unit,
            }
            for quality, joint in zip(self.joints, self.robot.joints, strict=True)
        ]
        return Table(rows)

    def links(self) -> list[dict[str, Any]]:
        """Return mass, centre of mass and inertia of each identified link, for JSON; ``origin`` is data or prior."""
        x, names, origin = self.physical.x, self.physical.names, self.physical.origin
        found = []
        for link, columns in body_columns(self.base.model.parameters).items():
            body = body_of(x[columns])
            inertia = dict(zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), body.inertia_com, strict=True))
            found.append(
                {
                    "link": link,
                    "mass_kg": body.mass,
                    "com_m": list(body.com),
                    "inertia_com_kg_m2": inertia,
                    "origin": {names[k]: origin[names[k]] for k in columns},
                }
            )
        return found

    def residual_table(self) -> Table:
        """Return one row per joint: rms torque [N m or N] of the model error by group in the fitted motion, and in all.

        Position: angle offsets, springs, cables. Friction: friction that depends on position or speed. Load: friction
        that grows with the torque. Empty where there is no model error.
        """
        error = self.model_error
        if error is None:
            return Table([])
        rows = []
        for name, parts in zip(self.robot.joint_names, error.rms.tolist(), strict=True):
            rows.append({"joint": name, **dict(zip((*GROUP_NAMES, "all"), parts, strict=True))})
        return Table(rows)

    def residual_facts(self) -> dict[str, Any] | None:
        """Return what the model error holds, for JSON; None where there is none."""
        error = self.model_error
        if error is None:
            return None
        return {
            "log_evidence": error.evidence if np.isfinite(error.evidence) else None,
            "size": dict(zip(GROUP_NAMES, error.size.tolist(), strict=True)),
            "joints": list(self.residual_table()),
        }

    # ---------------------------------------------------------------- model
    def inverse_dynamics(
        self, q: Floats, qd: Floats, qdd: Floats, t: Floats | None = None, *, residual_model: bool = True
    ) -> Floats:
        """Return the torques of the whole arm with its friction, (N, n) [N m or N], in DH quantities.

        Links that were not identified take part with their prior values.

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
            t: time of the samples since the motion began, (N,) [s]; needed where the robot file lists effects.
            residual_model: add the mean of the model error, where the result has one.

        Raises:
            WrongUsage: the model has effects that depend on the order of the samples, and their time is not given.
        """
        model = self.base.model
        tau = known_torque(model, q, qd, qdd)
        error = self.model_error if residual_model else None
        if model.added or error is not None:
            W = self.regressor(q, qd, qdd, t)
            sign = model.observer(self.reduction.base).coulomb_sign(qd)
            return tau + W @ self.theta + (0.0 if error is None else error.torque_of(q, qd, sign, W))
        return tau + model.observer(self.reduction.base).torque(self.theta, q, qd, qdd)

    def regressor(self, q: Floats, qd: Floats, qdd: Floats, t: Floats | None = None) -> Floats:
        """Return the base regressor Y with tau = Y theta, (N, n, p), in DH quantities (Paper Eq. 13).

        Links that were not identified have no part in it.

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
            t: time of the samples since the motion began, (N,) [s]; needed where the robot file lists effects.

        Raises:
            WrongUsage: as for ``inverse_dynamics``.
        """
        model = self.base.model
        observer = model.observer(self.reduction.base)
        full = observer.dense(q, qd, qdd)
        if model.added:
            if t is None:
                raise WrongUsage(
                    "this model has effects that depend on the order of the samples", fix="give their time: t=[...]"
                )
            reference = model_torques(model, self.reduction, self.theta)
            motion = ArmMotion(t, q, qd, qdd, self.robot, reference, lambda x: x)
            wanted, count = observer.added_entries, len(observer.rows) - len(observer.added_entries)
            full[:, observer.rows[count:], observer.cols[count:]] = model.added_entries(motion)[wanted].T
        return full

    # ---------------------------------------------------------------- text
    @property
    def title(self) -> str:
        """One line: the arm, the number of parameters, the estimator."""
        return visible(f"{self.robot.name}: {len(self.names)} base parameters, estimator {self.method} ({self.why})")

    def verdict(self) -> list[str]:
        """Return what the result is worth, line by line."""
        error = f"torque error {self.relative_error_percent:.2f} % on the fitted rows"
        if self.heldout_relative_error_percent is not None:
            error += f", {self.heldout_relative_error_percent:.2f} % held out ({self.heldout})"
        lines = [
            error,
            *self.expectation(),
            f"in force: {IN_FORCE[self.in_force]}; {self.choice}",
            f"parameters known: {counted(self.knowledge)}",
            f"condition number {self.condition_number_scaled:.3g} with normalised columns",
        ]
        return [visible(line) for line in lines]

    def expectation(self) -> list[str]:
        """Return the torque error to expect and what the model error holds, line by line."""
        lines = []
        if self.expected is not None:
            fitted, exciting = self.expected.fitted_percent, self.expected.exciting_percent
            lines.append(
                f"expected torque error {fitted:.2g} % on another recording of the fitted motion, {exciting:.2g} % on "
                "an exciting motion inside the limits"
            )
        if self.model_error is not None:
            alone = relative_error(self.factors, self.theta)
            lines.append(
                f"residual model in predictions: {self.relative_error_percent:.2f} % with it, {alone:.2f} % by the "
                "parameters alone, which are what URDF and the like hold"
            )
        return lines

    def summary(self) -> str:
        """Return a text with fit, verdict, joints, parameters and warnings."""
        warnings = [visible(f"{finding.code} {finding.text}") for finding in self.findings]
        parts = [self.title, *self.verdict(), "", repr(self.joint_table()), "", repr(self.table())]
        return "\n".join([*parts, *(["", *warnings] if warnings else [])])

    def __repr__(self) -> str:
        """Return the arm and the verdict."""
        return "\n".join([self.title, *self.verdict()])

    def _repr_html_(self) -> str:
        return Table(self.table(), self.title, self.verdict())._repr_html_()

    # ---------------------------------------------------------------- files
    def save(self, path: Path, facts: dict[str, Any] | None = None) -> Path:
        """Write parameters.npz, which ``load`` reads.

        Args:
            path: where to.
            facts: further facts for the header, such as the inputs that it depends on.
        """
        physical, (reduction, reduction_arrays) = asdict(self.physical), reduction_facts(self.reduction)
        arrays = {key: getattr(self, key) for key in ARRAYS}
        arrays |= {f"full_{key}": physical.pop(key) for key in FULL_ARRAYS}
        arrays |= reduction_arrays
        if self.model_error is not None:
            arrays |= {f"error_{key}": getattr(self.model_error, key) for key in ERROR_ARRAYS}
        arrays |= {f"motion_{k}": motion.astype(np.float32) for k, motion in enumerate(self.motions)}
        scalars = {key: getattr(self, key) for key in SCALARS} | {"physical": physical}
        scalars["model_error_evidence"] = None if self.model_error is None else self.model_error.evidence
        scalars["expected"] = None if self.expected is None else self.expected.facts()
        header = {
            **(facts or {}),
            **self.header,
            "cutoff_hz": self.cutoff,
            "delay_applied_s": self.delay,
            "log_sha256": list(self.log_sha256),
            "result": scalars | {"joints": [asdict(joint) for joint in self.joints]},
            "findings": [asdict(f) for f in self.findings],
            "reduction": reduction,
            "robot_file": text_of(self.robot),
            "robot_path": str(self.robot.path or ""),
        }
        write_artifact(path, Artifact(SCHEMA, header, arrays))
        return path

    def save_csv(self, path: Path) -> Path:
        """Write one row per base parameter, for spreadsheets; no value and no error where the logs determine none."""
        columns = ("name", "value", "std_error", "unit", "class", "known", "prior", "formula")
        rows = [[row[column] for column in columns] for row in self.parameter_rows()]
        write_text(path, "\n".join([csv_row(columns), *map(csv_row, rows), ""]))
        return path

    def save_yaml(self, path: Path) -> Path:
        """Write parameters.yaml; equal results give equal bytes."""
        rows = []
        for row in self.parameter_rows():
            error = row["std_error"]
            terms = {name: float(f"{factor:.10g}") for name, factor in row["terms"].items()}
            shown = {
                **row,
                "value": _digits(row["value"], error) if row["known"] != "not determined" or error else None,
                "std_error": None if error is None else float(f"{error:.2g}"),
                "terms": terms,
                "prior": None if row["prior"] is None else float(f"{row['prior']:.6g}"),
            }
            rows.append(shown)
        coulomb = self.robot.coulomb_shape
        document = {
            "schema": TABLE,
            "robot": self.robot.name,
            "logs_sha256": list(self.log_sha256),
            "method": self.method,
            "cutoff_hz": float(f"{self.cutoff:.6g}"),
            "coulomb": {"shape": coulomb.shape, "velocity": list(coulomb.velocity)},
            "relative_error_percent": float(f"{self.relative_error_percent:.4g}"),
            "parameters": rows,
            "not_identifiable": list(self.reduction.none),
        }
        write_text(path, yaml_text(document))
        return path


_K, _G = len(GROUPS), len(GROUP_NAMES)
CONTENTS = Contents(
    SCHEMA,
    {
        "robot_file": Fact(str),
        "robot_path": Fact(str),
        "cutoff_hz": Fact(float, least=0.0, most=LIMITS["rate_hz"].most),
        "kept_rate_hz": Fact(float, least=0.0, most=LIMITS["rate_hz"].most, needed=False),
        "delay_applied_s": Fact(float, least=-LATEST, most=LATEST),
        "delay_s": Fact(float | None, least=-LATEST, most=LATEST, needed=False),
        "log_sha256": Fact(list[str]),
        "logs": Fact(list[str], needed=False),
        "findings": Fact(list[Finding]),
        **REDUCTION_FACTS,
        "result": Fact(dict[str, Any]),
        **{f"result.{key}": Fact(str) for key in ("method", "why", "heldout", "choice")},
        "result.knowledge": Fact(list[Literal[WORDS]], "p"),  # type: ignore[valid-type]
        "result.in_force": Fact(Literal["physical", "plain"]),
        "result.joints": Fact(list[JointQuality], "n"),
        "result.relative_error_percent": Fact(float),
        "result.heldout_relative_error_percent": Fact(float | None),
        "result.heldout_by_set": Fact(dict[str, float]),
        "result.rank": Fact(int, least=0),
        "result.condition_number": Fact(float),
        "result.condition_number_scaled": Fact(float),
        "result.samples": Fact(int, least=0),
        "result.model_error_evidence": Fact(float | None),
        "result.expected": Fact(dict[str, Any] | None),
        "result.physical.names": Fact(list[str], "c"),
        "result.physical.touched": Fact(list[str]),
        "result.physical.cost": Fact(float),
        "result.physical.objective": Fact(float),
        "result.physical.gap": Fact(float),
        "result.physical.steps": Fact(int),
        "result.physical.inflation": Fact(float, least=LEAST),
    },
    {
        **REDUCTION_ARRAYS,
        "theta": Array("p"),
        "plain": Array("p"),
        "covariance": Array("p p", endless=True),
        "plain_covariance": Array("p p", endless=True),
        "std_error": Array("p", endless=True, least=0.0, most=np.inf),
        "prior": Array("p", gaps=True),
        "noise": Array("n", least=LEAST),
        "factors": Array("n p+1 p+1"),
        "counts": Array("n", np.int64, least=0),
        "full_x": Array("c"),
        "full_std_error": Array("c", least=0.0),
        "full_data_share": Array("c"),
        "full_covariance": Array("c c", endless=True),
        "full_hessian": Array("d d"),
        "motion_*": Array("_ n", np.float32),
        "error_speed": Array("n", least=LEAST, needed=False),
        "error_reference": Array("p", needed=False),
        "error_scale": Array(f"n {_K}", least=LEAST, needed=False),
        "error_projection": Array(f"n p {_K}", needed=False),
        "error_mean": Array(f"n {_K}", needed=False),
        "error_root": Array(f"n {_K} {_K}", needed=False),
        "error_slope": Array(f"n {_K} p", needed=False),
        "error_size": Array(f"{_G}", least=LEAST, needed=False),
        "error_rms": Array(f"n {_G + 1}", least=0.0, needed=False),
    },
)


def load(path: Path) -> Identification:
    """Read parameters.npz.

    Raises:
        NotAnArtifact: the file is none of dynid's, or is damaged.
    """
    header = read_header(path) or {}
    if header.get("schema") == SCHEMA and "reduction" not in header:
        raise NotAnArtifact(
            f"{path} was written by an earlier version of dynid", where=str(path), fix="identify again: dynid identify"
        )
    artifact = read_artifact(path, CONTENTS)
    h, a = dict(artifact.header), artifact.arrays
    with reading(path):
        stored: dict[str, Any] = dict(h["result"])
        facts: dict[str, Any] = {key: stored[key] for key in SCALARS} | {key: a[key] for key in ARRAYS}
        facts |= {"joints": _tuple(JointQuality, stored["joints"]), "findings": _tuple(Finding, h["findings"])}
        full: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in stored["physical"].items()
        }
        full |= {key: a[f"full_{key}"] for key in FULL_ARRAYS}
        robot = parse_robot(h["robot_file"], Path(h["robot_path"]))
        found = Identification(
            robot=robot if h["robot_path"] else replace(robot, path=None),
            reduction=reduction_from(h["reduction"], a),
            **{**facts, "knowledge": tuple(facts["knowledge"])},
            physical=PhysicalParameters(**full),
            model_error=_model_error(stored["model_error_evidence"], a),
            expected=_expected(stored["expected"], len(a["noise"])),
            motions=tuple(a[f"motion_{k}"].astype(np.float64) for k in range(len(a)) if f"motion_{k}" in a),
            cutoff=float(h["cutoff_hz"]),
            delay=float(h["delay_applied_s"]),
            log_sha256=tuple(h["log_sha256"]),
            header=h,
            path=path,
        )
        _require_one_arm(found)
    return found


def _require_one_arm(found: Identification) -> None:
    """Raise when the parts of a result are not those of one arm."""
    robot = found.robot
    if len(found.joints) != robot.n:
        raise ValueError("its joints are not those of its robot")
    names = parameter_names(robot)
    if found.reduction.names != names or found.physical.names != names:
        raise ValueError("its parameters are not those of its robot")
    _require_covariance(covariance=found.covariance, plain_covariance=found.plain_covariance)
    _require_covariance(full_covariance=found.physical.covariance)
    if found.model_error is not None:
        # Why: loads are found with what the root takes away.
        root = found.model_error.root
        require_numbers(root.shape, error_root=np.linalg.inv(root))


def _expected(facts: dict[str, Any] | None, n: int) -> ExpectedError | None:
    found = ExpectedError.of(facts)
    if found is not None:
        require_numbers((n,), noise_nm=found.noise)
    return found


def _require_covariance(**arrays: Floats) -> None:
    """Raise when matrices are no covariances; infinity stands for what is not known."""
    for name, found in arrays.items():
        known = np.isfinite(found)
        variance = np.where(np.isfinite(np.diagonal(found)), np.diagonal(found), np.inf)
        most = np.sqrt(np.maximum(variance, 0.0))
        if np.any(variance < 0.0) or np.any(np.abs(found[known]) > (1.0 + ROUNDING) * np.outer(most, most)[known]):
            raise ValueError(f"'{name}' is no covariance")


def _model_error(evidence: float | None, arrays: Mapping[str, NDArray[Any]]) -> ModelError | None:
    if evidence is None:
        return None
    return ModelError(**{key: arrays[f"error_{key}"] for key in ERROR_ARRAYS}, evidence=float(evidence))


def _tuple(kind: Any, rows: Iterable[dict[str, Any]]) -> tuple[Any, ...]:  # noqa: ANN401
    return tuple(kind(**row) for row in rows)


def _digits(value: float | None, error: float | None) -> float | None:
    """Keep two digits of the error: more would pretend a knowledge that is not there."""
    if value is None or not np.isfinite(value):
        return None
    if not error or not np.isfinite(error):
        return float(f"{value:.6g}")
    return round(value, max(0, 2 - 1 - int(np.floor(np.log10(error))))) + 0.0
