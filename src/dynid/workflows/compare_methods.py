"""Every estimator on the same logs, side by side."""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import partial
from typing import Any

from dynid import arguments
from dynid.answer import Answer
from dynid.arguments import public
from dynid.errors import DynidError
from dynid.estimation.compare import biased, differing
from dynid.estimation.estimate import estimate, last_share
from dynid.estimation.estimators import METHODS, choose
from dynid.estimation.possible_arm import is_possible
from dynid.estimation.result import Identification
from dynid.loading import LogsLike, RobotLike, as_base_model, as_logs, as_robot
from dynid.model.base_model import BaseModel
from dynid.options import LogOptions
from dynid.progress import Progress
from dynid.robot import Robot
from dynid.table import Table
from dynid.workflows.parameters import observe

#: Share of each log that is held out to compare estimators.
HELD_OUT = 0.2
#: Names that a table shows of the parameters that differ.
SHOWN_NAMES = 4


@dataclass(frozen=True)
class EstimatorRow:
    """What one estimator made of the logs.

    Attributes:
        method: estimator.
        result: what it found.
        physical_percent: held-out relative error of the possible arm that it leads to [%].
        seconds: how long it took [s].
        possible: whether some arm has exactly these base parameters; None where the logs leave directions open.
        differs: parameters further from the chosen estimator's than the errors of both, the furthest first.
    """

    method: str
    result: Identification
    physical_percent: float | None
    seconds: float
    possible: bool | None
    differs: tuple[str, ...]


@dataclass(frozen=True, repr=False)
class MethodComparison(Answer):
    """Every estimator on the same logs.

    Attributes:
        robot: the arm.
        logs: names of the logs.
        chosen: estimator that ``auto`` takes.
        why: why.
        heldout: what was held out.
        delay: the delay of the torques, as in the JSON answer [s].
        rows: one per estimator that could be used, the chosen one first.
        biased: parameters on which least squares and instruments disagree, which encoder noise explains; None where
            one of the two could not be used.
    """

    robot: Robot
    logs: tuple[str, ...]
    chosen: str
    why: str
    heldout: str
    delay: dict[str, Any]
    rows: tuple[EstimatorRow, ...]
    biased: tuple[str, ...] | None

    def table(self) -> Table:
        """Return one row per estimator: errors, time, whether the parameters are possible, what differs."""
        words = {True: "yes", False: "no", None: "-"}
        rows = []
        for row in self.rows:
            more = (
                f" and {len(row.differs) - SHOWN_NAMES} more"
                if len(row.differs) > SHOWN_NAMES
                else ""
            )
            rows.append(
                {
                    "method": row.method + (" (auto)" if row.method == self.chosen else ""),
                    "unexplained": f"{row.result.relative_error_percent:.2f} %",
                    "held out": f"{row.result.heldout_relative_error_percent:.2f} %",
                    "physical set": f"{row.physical_percent:.2f} %",
                    "time": f"{row.seconds:.2f} s",
                    "possible as it is": words[row.possible],
                    "differs beyond errors": ", ".join(row.differs[:SHOWN_NAMES]) + more or "-",
                }
            )
        return Table(rows)

    def __repr__(self) -> str:
        """Return the table and the alarm for encoder noise."""
        return "\n".join(filter(None, [repr(self.table()), self.alarm()]))

    def alarm(self) -> str:
        """Return the sentence about encoder noise; empty when least squares and instruments agree."""
        if not self.biased:
            return ""
        names = ", ".join(self.biased[:SHOWN_NAMES])
        return f"bias: least squares and instruments disagree on {names}: encoder noise; use --method iv"

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid compare --methods`` says."""
        return {
            "schema": "dynid/compare/1",
            "robot": self.robot.name,
            "logs": list(self.logs),
            "auto": self.chosen,
            "why": self.why,
            "heldout": self.heldout,
            **self.delay,
            "methods": [
                {
                    "method": row.method,
                    "relative_error_percent": row.result.relative_error_percent,
                    "heldout_relative_error_percent": row.result.heldout_relative_error_percent,
                    "heldout_relative_error_percent_physical": row.physical_percent,
                    "seconds": row.seconds,
                    "physically_consistent": row.possible,
                    "differs_from_auto": list(row.differs),
                }
                for row in self.rows
            ],
            "bias_alarm": None if self.biased is None else bool(self.biased),
            "biased_parameters": list(self.biased or ()),
        }


@public
def compare_methods(
    robot: RobotLike,
    logs: LogsLike,
    options: LogOptions | None = None,
    *,
    base: BaseModel | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> MethodComparison:
    """Identify from the same logs with every estimator that they allow.

    Args:
        robot: the arm, its name, or the path of its file.
        logs: one or several logs, or their paths.
        options: how they are checked and filtered.
        base: the arm's base model, where it is there already.
        progress: reports which estimators are not possible.
        changes: single options by name, such as ``cutoff=8``; see ``dynid.LogOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).
        DynidError: the first serious fault of a log.

    Example:
        dynid.compare_methods("kuka_lwr4plus", "run1.bag")
    """
    options, progress = (
        arguments.options(LogOptions, options, changes),
        arguments.progress(progress),
    )
    robot, base = as_robot(robot), as_base_model(base)
    seen = observe(robot, as_logs(logs, robot, options), options, base=base, progress=progress)
    stack, base, header = seen.stack, seen.base, seen.header()
    holdout = last_share(stack, HELD_OUT)
    chosen, why = choose(stack)
    progress.stage("estimate", f"auto takes {chosen}: {why}")
    found: dict[str, tuple[Identification, float | None, float]] = {}
    for name in sorted(METHODS, key=lambda name: name != chosen):
        start, fit = time.perf_counter(), partial(estimate, stack, base, method=name)
        try:
            result = fit(holdout=holdout, drop_weak=True)
            taken = time.perf_counter() - start
            possible = fit(holdout=holdout, feasible=True).heldout_relative_error_percent
        except DynidError as error:
            progress.stage(name, f"not possible: {error}")
            continue
        found[name] = (result, possible, taken)
    rows = tuple(
        EstimatorRow(
            name,
            result,
            physical,
            seconds,
            is_possible(base, result.plain, result.plain_covariance)
            if result.rank == len(result.names)
            else None,
            tuple(differing(result, found[chosen][0])),
        )
        for name, (result, physical, seconds) in found.items()
    )
    alarm = tuple(biased(found["wls"][0], found["iv"][0])) if {"wls", "iv"} <= set(found) else None
    delay = {key: header[key] for key in ("delay_s", "delay_std_error_s", "delay_applied_s")}
    text = "nothing held out" if holdout is None else holdout[2]
    return MethodComparison(robot, seen.logs, chosen, why, text, delay, rows, alarm)
