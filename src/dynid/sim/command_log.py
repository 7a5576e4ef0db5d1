"""What a simulated driver was sent, and whether it kept the arm's limits: the check at the receiving end."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.files.artifact import write_text
from dynid.robot import Robot
from dynid.text import csv_row

Floats = NDArray[np.float64]


@dataclass
class CommandLog:
    """Commands in DH quantities with their time of arrival.

    Args:
        robot: the arm.
        period: time between two commands that the driver expects [s].
    """

    robot: Robot
    period: float
    times: list[float] = field(default_factory=list)
    positions: list[Floats] = field(default_factory=list)
    velocities: list[Floats] = field(default_factory=list)
    accelerations: list[Floats] = field(default_factory=list)

    def velocity(self, time: float, qd: Floats) -> None:
        """Take a velocity command, (n,) [rad/s]; its acceleration is the change since the last one over the period."""
        before = self.velocities[-1] if self.velocities else np.zeros_like(qd)
        self._add(time, np.full_like(qd, np.nan), qd, (qd - before) / self.period)

    def point(self, time: float, q: Floats, qd: Floats, qdd: Floats) -> None:
        """Take a point of a trajectory: (n,) each [rad, rad/s, rad/s^2]."""
        self._add(time, q, qd, qdd)

    def _add(self, time: float, q: Floats, qd: Floats, qdd: Floats) -> None:
        self.times.append(time)
        self.positions.append(q)
        self.velocities.append(qd)
        self.accelerations.append(qdd)

    def facts(self) -> dict[str, Any]:
        """Return how many came, in which rhythm, and how much of each limit they used."""
        if not self.times:
            return {"commands": 0, "velocity_share": None, "acceleration_share": None, "violations": []}
        step = np.diff(self.times)
        shares = {name: self._shares(name) for name in ("velocity", "acceleration")}
        broken = [
            f"{joint}: {name} at {100 * value:.0f} % of its limit"
            for name, values in shares.items()
            for joint, value in zip(self.robot.joint_names, values, strict=True)
            if value > 1
        ]
        return {
            "commands": len(self.times),
            "command_rate_hz": float((len(self.times) - 1) / (self.times[-1] - self.times[0])) if len(step) else None,
            "longest_interval_s": float(step.max()) if len(step) else None,
            **{f"{name}_share": self._largest(name, values) for name, values in shares.items()},
            "violations": broken,
        }

    def _largest(self, name: str, shares: list[float]) -> float | None:
        """Return the largest share; None where no joint has such a limit."""
        return max(shares) if any(getattr(joint.limits, name) for joint in self.robot.joints) else None

    def _shares(self, name: str) -> list[float]:
        peaks = np.abs({"velocity": self.velocities, "acceleration": self.accelerations}[name]).max(axis=0)
        limits = [getattr(joint.limits, name) or np.inf for joint in self.robot.joints]
        return [float(peak / limit) for peak, limit in zip(peaks, limits, strict=True)]

    def write(self, path: Path) -> None:
        """Write all commands as CSV."""
        kinds = {"q": self.positions, "qd": self.velocities, "qdd": self.accelerations}
        head = ["t", *(f"{kind}_{name}" for kind in kinds for name in self.robot.joint_names)]
        rows = zip(self.times, *kinds.values(), strict=True)
        lines = [",".join(f"{value:.9g}" for value in (time, *np.concatenate(parts))) for time, *parts in rows]
        write_text(path, "\n".join([csv_row(head), *lines]) + "\n")
