"""Simulated compared with measured motion: position and torque errors of one or several models of an arm."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from dynid.answer import Answer, Answered
from dynid.arrays import Floats
from dynid.files.artifact import read_artifact, reading
from dynid.npz import write_artifact
from dynid.robot import Robot
from dynid.table import Table

SCHEMA = "dynid/simulator_gap/1"
ARRAYS = ("t", "q", "simulated", "added")


@dataclass(frozen=True, repr=False)
class SimulatorGap(Answered):
    """Simulated compared with measured motion of one or several models of an arm; N samples, n joints.

    Attributes:
        robot: the arm.
        log: name of the log.
        engine: the simulator.
        models: names of the models.
        t: (N,) [s].
        q: measured positions, (N, n) [rad or m].
        simulated: positions by model, (models, N, n) [rad or m].
        added: torque that the controller had to add, by model, (models, N, n) [N m or N].
    """

    robot: Robot
    log: str
    engine: str
    models: tuple[str, ...]
    t: Floats
    q: Floats
    simulated: Floats
    added: Floats

    @property
    def position_rms(self) -> Floats:
        """Position error of each model and joint, (models, n) [rad or m]."""
        return np.sqrt(np.mean((self.simulated - self.q) ** 2, axis=1))

    @property
    def torque_rms(self) -> Floats:
        """Torque error of each model and joint, (models, n) [N m or N]."""
        return np.sqrt(np.mean(self.added**2, axis=1))

    def table(self) -> Table:
        """Return one row per joint: position error of each model [mrad or mm]."""
        rows = []
        for joint, errors in zip(self.robot.joints, 1000 * self.position_rms.T, strict=True):
            row = dict(zip(self.models, errors.tolist(), strict=True))
            unit = "mrad" if joint.revolute else "mm"
            rows.append({"joint": joint.name, **row, "unit": unit})
        return Table(rows)

    def sentence(self) -> str:
        """Return the answer in one sentence."""
        size = 1000 * np.sqrt(np.mean(self.position_rms**2, axis=1))
        shown = " -> ".join(f"{value:.3g}" for value in size)
        return f"Position error in {self.engine} on {self.log}: {shown} mrad ({' -> '.join(self.models)})."

    def facts(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            "schema": SCHEMA,
            "robot": self.robot.name,
            "log": self.log,
            "engine": self.engine,
            "joints": list(self.robot.joint_names),
            "models": [
                {
                    "name": name,
                    "position_rms_rad": position.tolist(),
                    "torque_rms_nm": torque.tolist(),
                }
                for name, position, torque in zip(
                    self.models, self.position_rms, self.torque_rms, strict=True
                )
            ],
        }

    def save(self, path: Path) -> Path:
        """Write it as a file that ``load`` reads and the report shows."""
        header = {
            "log": self.log,
            "engine": self.engine,
            "models": self.models,
            "joints": self.robot.joint_names,
        }
        write_artifact(path, SCHEMA, header, {key: getattr(self, key) for key in ARRAYS})
        return path

    @classmethod
    def load(cls, path: Path, robot: Robot) -> SimulatorGap:
        """Read what was saved of an arm.

        Raises:
            NotAnArtifact: the file is damaged, or of another kind.
            JointCountDiffers: it is of another arm.
        """
        artifact = read_artifact(path, SCHEMA)
        header = artifact.header
        with reading(path):
            robot.require_joints(header["joints"], path)
            arrays = [artifact.arrays[key] for key in ARRAYS]
            return cls(robot, header["log"], header["engine"], tuple(header["models"]), *arrays)

    def answer(self) -> Answer:
        """Return the answer and the table."""
        return Answer(self.facts(), self.sentence(), (self.table(),))
