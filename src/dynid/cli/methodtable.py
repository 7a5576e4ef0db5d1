"""``dynid compare --methods ROBOT LOG...``: every estimator on the same logs, in one table."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common
from dynid.errors import DynidError, WrongUsage

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.model.store import BaseModel

#: Two estimates of one parameter differ when they are this many of the larger standard error apart.
APART = 2.0
#: Least squares and instruments from the same rows differ by the difference of their variances (Hausman 1978), at least
#: by this share of the instruments'. Without encoder noise simulated logs stay below 1.4 such errors, with 0.09 deg
#: they reach 7.7 to 9.6.
LEAST_VARIANCE, BIASED = 0.25, 4.0
#: Names that are shown of those that differ.
SHOWN = 4


def compare_methods(common: Common, words: tuple[Path, ...]) -> dict[str, Any]:
    """Run all estimators, print the table, and return the JSON answer."""
    from dynid.estimation.estimate import estimate, last_share
    from dynid.estimation.estimators import METHODS, choose
    from dynid.files.robotfile import load_robot
    from dynid.workflows.logs import read_log
    from dynid.workflows.model import base_model
    from dynid.workflows.parameters import observe

    if len(words) < 2:
        raise WrongUsage("--methods needs a robot and a log", fix="dynid compare --methods ROBOT LOG...")
    robot = load_robot(str(words[0]))
    with common.terminal.progress() as progress:
        base = base_model(robot, common.folder(robot.slug), progress)
        seen = observe(robot, [read_log(path, robot) for path in words[1:]], base=base, progress=progress)
    stack, header = seen.stack, seen.header()
    holdout = last_share(stack, 0.2)
    chosen, why = choose(stack)
    common.terminal.stage("estimate", f"auto takes {chosen}: {why}")
    found: dict[str, tuple[Identification, float]] = {}
    for name in sorted(METHODS, key=lambda name: name != chosen):
        start = time.perf_counter()
        try:
            result = estimate(stack, base, method=name, holdout=holdout, drop_weak=True)
        except DynidError as error:
            common.terminal.stage(name, f"not possible: {error}")
            continue
        found[name] = (result, time.perf_counter() - start)
    rows = [row(base, name, result, found[chosen][0], seconds) for name, (result, seconds) in found.items()]
    show(common, rows, chosen)
    alarm = biased(found["wls"][0], found["iv"][0]) if {"wls", "iv"} <= set(found) else None
    if alarm:
        names = ", ".join(alarm[:SHOWN])
        common.terminal.answer(
            f"bias: least squares and instruments disagree on {names}: encoder noise; use --method iv"
        )
    return {
        "schema": "dynid/compare/1",
        "robot": base.robot.name,
        "logs": [str(word) for word in words[1:]],
        "auto": chosen,
        "why": why,
        "heldout": holdout.text,
        **{key: header[key] for key in ("delay_s", "delay_std_error_s", "delay_applied_s")},
        "methods": rows,
        "bias_alarm": None if alarm is None else bool(alarm),
        "biased_parameters": alarm or [],
    }


def row(
    base: BaseModel, name: str, result: Identification, reference: Identification, seconds: float
) -> dict[str, Any]:
    """Return what the table says about one estimator."""
    apart = differing(result, reference)
    held = result.heldout_by_set
    return {
        "method": name,
        "relative_error_percent": result.relative_error_percent,
        "heldout_relative_error_percent": held["plain"],
        "heldout_relative_error_percent_physical": held["physical"],
        "seconds": seconds,
        "physically_consistent": possible(base, result),
        "differs_from_auto": apart,
    }


def differing(one: Identification, other: Identification) -> list[str]:
    """Return the parameters that two estimates put further apart than their error bars, the furthest first."""
    import numpy as np

    error = np.maximum(one.std_error, other.std_error)
    known = np.isfinite(error) & (error > 0)
    z = np.zeros(len(error))
    z[known] = np.abs(one.plain - other.plain)[known] / error[known]
    return [one.names[k] for k in np.argsort(-z) if z[k] > APART]


def biased(least_squares: Identification, instruments: Identification) -> list[str]:
    """Return the parameters in which least squares differ from instruments by more than noise explains."""
    import numpy as np

    variances = [np.diagonal(each.covariance) for each in (instruments, least_squares)]
    known = np.isfinite(instruments.std_error) & (instruments.std_error > 0)
    error = np.sqrt(np.maximum(variances[0] - variances[1], LEAST_VARIANCE * variances[0]))
    z = np.zeros(len(error))
    z[known] = np.abs(least_squares.plain - instruments.plain)[known] / error[known]
    return [instruments.names[k] for k in np.argsort(-z) if z[k] > BIASED]


def possible(base: BaseModel, result: Identification) -> bool | None:
    """Return whether some arm has exactly these base parameters; None where the log leaves directions open."""
    from dynid.estimation.physical_parameters import reproduced

    return reproduced(base, result.plain, result.covariance) if result.rank == len(result.names) else None


def show(common: Common, rows: list[dict[str, Any]], chosen: str) -> None:
    """Print one line an estimator."""
    words = {True: "yes", False: "no", None: "-"}
    table = []
    for each in rows:
        apart = each["differs_from_auto"]
        more = f" and {len(apart) - SHOWN} more" if len(apart) > SHOWN else ""
        table.append(
            [
                each["method"] + (" (auto)" if each["method"] == chosen else ""),
                f"{each['relative_error_percent']:.2f} %",
                f"{each['heldout_relative_error_percent']:.2f} %",
                f"{each['heldout_relative_error_percent_physical']:.2f} %",
                f"{each['seconds']:.2f} s",
                words[each["physically_consistent"]],
                ", ".join(apart[:SHOWN]) + more or "-",
            ]
        )
    heads = ["method", "unexplained", "held out", "physical set", "time", "possible as it is", "differs beyond errors"]
    common.terminal.table(heads, table)
