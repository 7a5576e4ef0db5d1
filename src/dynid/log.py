"""The noun Log: what a driver published, as time series keyed by joint name.

A ``Log`` straight from a file is raw: the driver's own columns, order and units, all joints it had. ``dynid.signals``
turns it into DH quantities of one robot and says what is wrong with it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Log:
    """A recording.

    Attributes:
        t: time stamps, (N,) [s].
        q: positions, (N, n).
        tau: torques (or currents), (N, n).
        names: names of the n columns; () when the file does not name them.
        qd: measured velocities, (N, n), or None.
        source: the file or folder it came from.
        sha256: hash of that file.
        topic: ROS topic, or "".
        tau_unit: "Nm" or "A", as far as the file says; "" when it does not.
        units: units of ``position``, ``velocity`` and ``effort`` that the file itself declares; they go before the
            robot file's.
        motor_side: whether q and tau are on the motor side of the gears.
        dh: whether the columns are DH quantities of the robot already, in its joint order and SI units.
        findings: what was noticed while reading.
        extra: further arrays, such as the commanded positions ``q_ref`` (N, n).
    """

    t: Floats
    q: Floats
    tau: Floats
    names: tuple[str, ...] = ()
    qd: Floats | None = None
    source: Path | None = None
    sha256: str = ""
    topic: str = ""
    tau_unit: str = ""
    units: dict[str, str] = field(default_factory=dict)
    motor_side: bool = False
    dh: bool = False
    findings: tuple[Finding, ...] = ()
    extra: dict[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)

    @property
    def n(self) -> int:
        """Number of columns."""
        return int(self.q.shape[1])

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.t[-1] - self.t[0]) if len(self.t) else 0.0

    @property
    def rate(self) -> float:
        """Median sample rate [Hz]."""
        return 1.0 / float(np.median(np.diff(self.t))) if len(self.t) > 1 else float("nan")
