"""The result of an identification, as a notebook has it: its data, what is made of them, and its files."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any, get_type_hints

import numpy as np
from numpy.typing import NDArray

from dynid.answer import Answer, Judged, judged, picked
from dynid.disk import write_text
from dynid.estimation.draws import Draws, draws
from dynid.estimation.evidence import evidence_of
from dynid.estimation.identified import USED, Identified, torque_units
from dynid.estimation.least_squares import counted
from dynid.files import typed
from dynid.files.artifact import packed, read_artifact, reading, unpacked
from dynid.files.robotfile import parse_robot, text_of
from dynid.judgement.evidence import Evidence
from dynid.model.regressor import build_model
from dynid.npz import write_artifact
from dynid.robot import Coulomb
from dynid.table import Table
from dynid.text import csv_row, yaml_text

SCHEMA = "dynid/identification/1"
TABLE = "dynid/parameters-table/1"
#: Fields of a result that are stored in another way, or not at all.
_APART = ("robot", "header", "path", "rigid", "stack")


class Identification(Identified, Judged):
    """Base parameters of an arm with what is known about them; p parameters, n joints.

    Attributes:
        robot: the arm, as it was then.
        reduction: how base parameters combine the full ones.
        fit: what the estimator itself found. Its numbers are attributes of the result too: ``method``, ``plain`` (base
            parameters, (p,)) with ``plain_covariance`` (p, p), ``noise`` of the joints (n,) [N m or N], and what other
            logs can be added to: triangular ``factors`` of [W tau] (n, p + 1, p + 1) and their ``counts`` of rows (n,).
        joints: quality of each joint.
        relative_error_percent: 100 |tau - W theta| / |tau| on the rows that were fitted [%].
        heldout_relative_error_percent: the same on rows that were not; None where nothing was held out [%].
        heldout: what was held out.
        rank: number of directions that the log excites.
        condition_number: of W with columns as they are.
        condition_number_scaled: of W with columns of unit length.
        samples: instants in the stack.
        expected: how far predicted torques will be off.
        why: why this estimator.
        theta: base parameters, those that predictions use, (p,).
        covariance: of ``theta``: of the posterior, or of the plain estimate where predictions use that, (p, p).
        std_error: standard errors of ``theta``; infinite where nothing is known at all, (p,).
        knowledge: ``"well"``, ``"negligible"``, ``"roughly"`` or ``"not determined"``, (p,).
        prior: prior values, NaN where there is none, (p,).
        physical: the physically possible parameters of the whole model nearest to data and prior.
        in_force: whether predictions use the ``"physical"`` set or the ``"plain"`` estimate.
        model_error: residual model of what the parameters leave unexplained; None where the data support none.
        findings: what is worth a warning.
        header: where it comes from: logs with their hashes, filter, delay, command, inputs.
        path: its file; empty when it was not read from one.
        motions: positions of each fitted log at 5 Hz, two minutes at most, (M, n) [rad or m].
        rigid: program of the rigid-body columns; None to derive it when it is needed.
        stack: the rows that it was made from; None when it was read from a file.
    """

    @property
    def evidence(self) -> Evidence:
        """What is known of it, with the replays and the search that lie beside its file.

        Raises:
            NotAnArtifact: a replay or a search beside its file is damaged.
        """
        return evidence_of(self)

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid identify`` says about it."""
        robot, floors = self.robot, self.header.get("noise_floor_nm") or ()
        noise = "noise_a" if robot.torque.relative else "noise_nm"
        held = "heldout_relative_error_percent"
        return {
            "schema": "dynid/identify/1",
            "robot": robot.name,
            **picked(self, "method", "rank", "samples", "heldout", held, "in_force"),
            **picked(self, "condition_number", "condition_number_scaled", "relative_error_percent"),
            "joints": [
                joint.facts(robot, noise_floor=floor or None)
                for joint, floor in zip_longest(self.joints, floors)
            ],
            "parameters": self.parameter_rows(),
            "physically_consistent": self.in_force == "physical",
            f"{held}_by_set": {"physical": None, "plain": None, self.in_force: getattr(self, held)},
            "expected_torque_error": {
                "fitted_motion_percent": self.expected.fitted_percent,
                "exciting_motion_percent": self.expected.exciting_percent,
                noise: (self.expected.noise / robot.shown_gains).tolist(),
            },
            "residual_model": self.residual_facts(),
            "links": self.links(),
            "findings": [asdict(finding) for finding in self.findings],
            "judgement": self.judgement.facts(),
        }

    def answer(self) -> Answer:
        """Return what ``dynid identify`` answers about it."""
        facts = self.facts()
        total, held = self.relative_error_percent, self.heldout_relative_error_percent
        held_out = "" if held is None else f", held out {held:.2f} % ({self.heldout})"
        mass = f"{sum(link['mass_kg'] for link in facts['links']):.3g} kg in all"
        if self.robot.torque.relative:
            mass = "masses are unknown without motor gains"
        return judged(
            self.judgement,
            facts,
            self._joint_table(facts["joints"]),
            f"total relative error {total:.2f} %{held_out}",
            details=(
                "",
                f"{len(self.names)} base parameters, estimator {self.method} ({self.why})",
                *self.expectation(),
                f"used for predictions: {USED[self.in_force]}",
                f"parameters known: {counted(self.knowledge)}",
                f"condition number {self.condition_number_scaled:.3g} with normalised columns",
                f"links are in parameters.npz: {mass}",
                "",
                self.table(),
                *self.findings,
            ),
        )

    def _joint_table(self, joints: Sequence[Mapping[str, Any]]) -> Table:
        """Return the joints of the JSON answer as a person reads them."""
        unit = "a" if self.robot.torque.relative else "nm"
        floor = "noise" if self.header.get("noise_repeats_s") else "noise level"
        columns = {
            "joint": "joint",
            "rms error": f"rms_{unit}",
            floor: f"noise_floor_{unit}",
            "torque rms": f"torque_rms_{unit}",
            "error %": "relative_error_percent",
            "held out": f"heldout_rms_{unit}",
        }
        return Table(
            [
                {head: row[key] for head, key in columns.items()} | {"unit": each}
                for row, each in zip(joints, torque_units(self.robot), strict=True)
            ]
        )

    def draws(self, count: int, seed: int = 0) -> Draws:
        """Return arms drawn jointly from the posterior: possible bodies, friction, effects, residual model.

        Args:
            count: how many.
            seed: of the draws.

        Raises:
            WrongUsage: there are none, or too many.
            NotPhysical: the prior of the robot file is itself not physical.
        """
        return draws(self, count, seed)

    # ---------------------------------------------------------------- files
    def save(self, path: Path, facts: dict[str, Any] | None = None) -> Path:
        """Write parameters.npz, which ``dynid.load`` reads.

        Args:
            path: where to.
            facts: further facts for the header, such as the inputs that it depends on.
        """
        names = [each.name for each in fields(Identified) if each.name not in _APART]
        arrays: dict[str, NDArray[Any]] = {}
        header = {
            **(facts or {}),
            **self.header,
            "result": {name: packed(getattr(self, name), arrays, name) for name in names},
            "robot_file": text_of(self.robot),
            "robot_path": str(self.robot.path or ""),
        }
        write_artifact(path, SCHEMA, header, arrays)
        return path

    def save_csv(self, path: Path) -> Path:
        """Write one row per base parameter, for spreadsheets; no value and no error where the logs determine none."""
        columns = ("name", "value", "std_error", "unit", "class", "known", "prior", "formula")
        rows = [[row[column] for column in columns] for row in self.parameter_rows()]
        write_text(path, "\n".join([csv_row(columns), *map(csv_row, rows), ""]))
        return path

    def save_yaml(self, path: Path) -> Path:
        """Write parameters.yaml; equal results give equal bytes."""
        rows = self.parameter_rows()
        for row in rows:
            error, unknown = row["std_error"], row["known"] == "not determined"
            row["value"] = None if unknown and not error else _digits(row["value"], error)
            row["std_error"] = None if error is None else float(f"{error:.2g}")
            row["terms"] = {name: float(f"{factor:.10g}") for name, factor in row["terms"].items()}
            row["prior"] = None if row["prior"] is None else float(f"{row['prior']:.6g}")
        document = {
            "schema": TABLE,
            "robot": self.robot.name,
            "logs_sha256": list(self.log_sha256),
            "method": self.method,
            "cutoff_hz": float(f"{self.cutoff:.6g}"),
            "coulomb": self.robot.coulomb_shape.facts(),
            "relative_error_percent": float(f"{self.relative_error_percent:.4g}"),
            "parameters": rows,
            "not_identifiable": list(self.reduction.none),
        }
        write_text(path, yaml_text(document))
        return path

    @classmethod
    def load(cls, path: Path) -> Identification:
        """Read parameters.npz.

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
            result = cls(robot=robot, header=header, path=path, **values)
            if len(result.joints) != robot.n:
                raise ValueError("its joints do not match its robot")
            if {result.reduction.names, result.physical.names} != {
                build_model(robot).parameter_names
            }:
                raise ValueError("its parameters do not match its robot")
        return result


def _digits(value: float, error: float | None) -> float:
    """Keep two digits of the error: more would pretend a knowledge that is not there."""
    if not error:
        return float(f"{value:.6g}")
    return round(value, max(0, 1 - int(np.floor(np.log10(error))))) + 0.0
