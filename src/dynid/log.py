"""The noun Log: one recording of positions and torques, from a file or from arrays.

A ``Log`` straight from a file or from arrays is raw: the columns, their order and units are those of the driver.
``dynid.signals.checks.prepare`` turns it into DH quantities of one robot, checks it, and says what is wrong with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.answer import Answer, Answered, picked
from dynid.arrays import Floats
from dynid.errors import Finding, LogLayout
from dynid.npz import write_artifact
from dynid.table import dataframe
from dynid.units import FACTORS

if TYPE_CHECKING:
    from pandas import DataFrame


#: Name and number of the format of a saved log.
SCHEMA = "dynid/log/1"
#: What has one column per joint, (N, n), in the order of tables, and the quantity whose unit, sign and offset it takes;
#: none of them, and never saved, where that is "". What only some logs have stands in ``extra``.
COLUMNS = {
    "q": "position",
    "qd": "velocity",
    "tau": "effort",
    "q_ref": "position",
    "qd_reported": "velocity",
    "clipped": "",
}


@dataclass(frozen=True, eq=False, repr=False)
class Log(Answered):
    """A recording of one arm: N samples of n joints.

    Arrays may be anything NumPy makes an array of; they are stored as float64, without a copy where they have that type
    already.

    Attributes:
        t: time stamps, (N,) [s].
        q: positions, (N, n), in the unit of ``units``, else of the robot file [rad or m].
        tau: torques, or motor currents, (N, n) [N m, N or A].
        names: names of the n columns; () when they are not named and have the order of the robot file.
        qd: measured velocities, (N, n) [rad/s or m/s], or None.
        source: the file or folder it came from, None when made from arrays.
        sha256: hash of that file.
        topic: ROS topic, or "".
        tau_unit: "Nm" or "A", as far as the file says; "" when it does not.
        units: units of ``position``, ``velocity`` and ``effort`` that the file itself declares; they go before the
            robot file's.
        motor_side: whether q and tau are on the motor side of the gears.
        dh: whether the columns are DH quantities of the robot already, in its joint order and SI units.
        checked: whether it has passed the checks of ``prepare`` for one robot: in DH quantities, every number finite,
            time increasing.
        findings: what was noticed while reading and checking.
        extra: further arrays and facts, such as the commanded positions ``q_ref`` (N, n) in the unit of q. Order, unit
            and sign of what ``COLUMNS`` names are changed like those of q.

    Raises:
        LogLayout: an array has another shape than (N, n), holds no numbers, or a unit is not known.
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
    checked: bool = False
    findings: tuple[Finding, ...] = ()
    extra: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check shapes, number types and units."""
        self._set("t", self._floats("t", self.t).reshape(-1))
        self._set("q", self._floats("q", self.q))
        if self.q.ndim != 2 or len(self.q) != len(self.t):
            raise self._wrong(
                f"array 'q' is {self.q.shape}, expected ({len(self.t)}, number of joints)"
            )
        self._set("tau", self._columns("tau", self.tau))
        if self.qd is not None:
            self._set("qd", self._columns("qd", self.qd))
        further = {
            key: self._columns(key, self.extra[key], kind)
            for key, kind in COLUMNS.items()
            if key in self.extra
        }
        if further:
            self._set("extra", self.extra | further)
        self._set("names", tuple(str(name) for name in self.names))
        if self.names and len(self.names) != self.n:
            raise self._wrong(f"{len(self.names)} names for {self.n} columns")
        for key, unit in self.units.items():
            if key not in FACTORS or unit not in FACTORS[key]:
                raise self._wrong(
                    f"units.{key} = {unit} is not known; known: {', '.join(FACTORS.get(key, FACTORS))}"
                )
        if self.tau_unit not in ("", "Nm", "A"):
            raise self._wrong(f"tau_unit = {self.tau_unit} is not known; known: Nm, A")

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _wrong(self, text: str) -> LogLayout:
        return LogLayout(f"{self.name}: {text}", where=self.source or "")

    def _floats(self, key: str, values: ArrayLike) -> Floats:
        try:
            return np.asarray(values, dtype=np.float64)
        except (TypeError, ValueError):
            text = f"array '{key}' holds no numbers, or rows of different lengths"
            raise self._wrong(text) from None

    def _columns(self, key: str, values: ArrayLike, quantity: str = "any") -> NDArray[Any]:
        array: NDArray[Any] = self._floats(key, values) if quantity else np.asarray(values)
        if array.shape != self.q.shape:
            raise self._wrong(f"array '{key}' is {array.shape}, expected {self.q.shape}")
        return array

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.t)

    @property
    def name(self) -> str:
        """Name of the file it came from, for people."""
        return self.source.name if self.source else "the log"

    @property
    def n(self) -> int:
        """Number of columns."""
        return int(self.q.shape[1])

    @property
    def columns(self) -> dict[str, NDArray[Any]]:
        """What has one column per joint, (N, n), by its name in ``COLUMNS``."""
        given = {"q": self.q, "qd": self.qd, "tau": self.tau} | self.extra
        return {key: given[key] for key in COLUMNS if given.get(key) is not None}

    def with_columns(self, columns: Mapping[str, NDArray[Any]], **facts: Any) -> Log:  # noqa: ANN401
        """Return the log with other columns by their names in ``COLUMNS``, and other attributes."""
        own: dict[str, Any] = {key: columns[key] for key in ("q", "qd", "tau") if key in columns}
        extra = self.extra | {key: values for key, values in columns.items() if key not in own}
        return replace(self, **own, extra=extra, **facts)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.t[-1] - self.t[0]) if len(self.t) else 0.0

    @cached_property
    def rate(self) -> float:
        """Median sample rate [Hz]; not a number where most stamps are equal."""
        step = float(np.median(np.diff(self.t))) if len(self.t) > 1 else 0.0
        return 1.0 / step if step else np.nan

    def answer(self) -> Answer:
        """Return name, size, joints and findings."""
        state = "checked" if self.checked else "not checked"
        names = f": {', '.join(self.names)}" if self.names else ", not named"
        return Answer(
            {"log": self.name, "samples": len(self)},
            parts=(
                ("log", self.source.name if self.source else "made from arrays"),
                ("samples", f"{len(self)}, {self.duration:.1f} s, {self.rate:.1f} Hz"),
                ("joints", f"{self.n}{names}"),
                ("columns", "position, torque" + ", velocity" * (self.qd is not None)),
                ("quantities", f"{'DH' if self.dh else 'those of the driver'}, {state}"),
                *self.findings,
            ),
        )

    def to_dataframe(self) -> DataFrame:
        """Return the samples as a pandas table: index ``t``, columns ``q_<joint>``, ``qd_<joint>``, ``tau_<joint>``.

        Raises:
            PackageMissing: pandas is not installed.
        """
        return dataframe(self.named_columns()).set_index("t")

    def named_columns(self, unit: str = "") -> dict[str, NDArray[Any]]:
        """Return the columns of a table by name, (N,) each; those without any number were never recorded.

        Args:
            unit: how the name of a column ends whose unit is known, such as ``" [{}]"``.
        """
        joints = self.names or tuple(f"joint_{k + 1}" for k in range(self.n))
        columns = {"t": self.t}
        for kind, values in self.columns.items():
            if COLUMNS[kind] and np.isfinite(values).any():
                key = "i" if kind == "tau" and self.tau_unit == "A" else kind
                end = unit.format(own) if (own := self.units.get(COLUMNS[kind])) else ""
                columns |= {
                    f"{key}_{x}{end}": each for x, each in zip(joints, values.T, strict=True)
                }
        return columns

    def save(self, path: str | Path, run: Mapping[str, Any] | None = None) -> Path:
        """Write the log as .npz, whole, with names and units in its header; ``dynid.load_log`` reads and checks it.

        Args:
            path: the file.
            run: facts about the run that made it, for the header: command line, seed, hashes of inputs.
        """
        columns = {key: x for key, x in self.columns.items() if COLUMNS[key]}
        arrays = {"t": self.t, **columns}
        header = {
            **(run or {}),
            "joint_names": list(self.names),
            "units": ({"effort": self.tau_unit} if self.tau_unit else {}) | self.units,
            "topic": self.topic,
            "motor_side": self.motor_side,
            "dh": self.dh,
            "source": {"file": self.source.name if self.source else "", "sha256": self.sha256},
            "findings": [picked(each, "code", "level", "text") for each in self.findings],
        }
        write_artifact(Path(path), SCHEMA, header, arrays)
        return Path(path)
