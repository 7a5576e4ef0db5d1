"""Simulated beside measured motion: position and torque errors of one or several models of an arm."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.robot import Robot
from dynid.table import Table

Floats = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class SimulatorGap:
    """Simulated beside measured motion of one or several models of an arm; N samples, n joints.

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
        return np.asarray(np.sqrt(np.mean((self.simulated - self.q) ** 2, axis=1)))

    @property
    def torque_rms(self) -> Floats:
        """Torque error of each model and joint, (models, n) [N m or N]."""
        return np.asarray(np.sqrt(np.mean(self.added**2, axis=1)))

    def table(self) -> Table:
        """Return one row per joint: position error [mrad or mm] and torque error [N m or N] of each model."""
        position, torque = 1000 * self.position_rms, self.torque_rms
        return Table(
            [
                {
                    "joint": joint.name,
                    **{f"position {name}": float(f"{position[k, j]:.3g}") for k, name in enumerate(self.models)},
                    "in": "mrad" if joint.revolute else "mm",
                    **{f"torque {name}": float(f"{torque[k, j]:.3g}") for k, name in enumerate(self.models)},
                    "unit": joint.torque_unit,
                }
                for j, joint in enumerate(self.robot.joints)
            ]
        )

    def sentence(self) -> str:
        """Return the answer in one sentence."""
        size = 1000 * np.sqrt(np.mean(self.position_rms**2, axis=1))
        shown = " -> ".join(f"{value:.3g}" for value in size)
        return f"Position error in {self.engine} on {self.log}: {shown} mrad ({' -> '.join(self.models)})."

    def facts(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            "schema": "dynid/simulator_gap/1",
            "robot": self.robot.name,
            "log": self.log,
            "engine": self.engine,
            "joints": list(self.robot.joint_names),
            "models": [
                {"name": name, "position_rms_rad": position.tolist(), "torque_rms_nm": torque.tolist()}
                for name, position, torque in zip(self.models, self.position_rms, self.torque_rms, strict=True)
            ],
        }

    def __repr__(self) -> str:
        """Return the answer and the table."""
        return f"{self.sentence()}\n{self.table()!r}"
