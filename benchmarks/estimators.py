"""Compare the estimators on closed-loop simulated arms with BIRDy's noise levels.

    python benchmarks/estimators.py [--json out/estimators.json] [--minutes 20] [--table]

What is done is kept in the JSON file, and the next run goes on from there; --table only prints Markdown. For each estimator:
parameter error |db|/|b|, BIRDy's d_beta, torque error on the fitted motion (d_tau) and on an unseen noise-free one, the
share of true base parameters inside their 95 % intervals, seconds; errors of the physical set.

Source: Leboutet et al. 2021, "Inertial parameter identification in robotics: a survey" (BIRDy): noise levels, figures.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy import signal

from closed_loop_arms import LOGGED, REGIMES, SECONDS, Arm, arm_of, command, recorded
from dynid.estimation.estimators import METHODS, choose
from dynid.estimation.least_squares import ordinary, relative_error
from dynid.estimation.posterior import physical_posterior
from dynid.estimation.rows import dense_rows, joint_factors
from dynid.estimation.stack import stack_logs
from dynid.log import Log
from dynid.model.parameters import prior_base_parameters
from dynid.signals.conditioned_log import ConditionedLog, condition
from dynid.signals.filters import choose_filter, despiked

PLAIN, SIMULATED = ("ols", "wls", "irls", "iv"), ("idim-iv", "didim")
#: Draws of each regime; more where the coverage of the intervals is counted, fewer where they take long.
DRAWS, COUNTED, OF_TX40, OF_SIMULATED = 10, 40, 10, 3
COVERAGE = ("standard", "lwr_like", "high_position")
FIGURES = (
    "error",
    "d_beta",
    "d_tau",
    "unseen",
    "inside",
    "seconds",
    "physical_error",
    "physical_unseen",
)
#: Largest parameter error that is asked for [%].
TARGETS = {
    "low_position": 0.5,
    "standard": 0.5,
    "high_torque": 0.5,
    "high_position": 1.5,
    "high_both": 1.5,
    "spikes": 0.6,
}


def jobs() -> Iterator[tuple[str, str, int]]:
    """Yield arm, regime and draw, the first draws of everything first."""
    for draw in range(COUNTED):
        for regime in REGIMES:
            if draw < DRAWS or regime in COVERAGE:
                yield "lwr", regime, draw
            if draw < OF_TX40 and regime != "lwr_like":
                yield "tx40", regime, draw


def one(name: str, regime: str, draw: int) -> dict[str, list[float]]:
    """Return the figures of all estimators on one log."""
    arm, log = arm_of(name), recorded(name, regime, draw)
    start = time.perf_counter()
    chosen = choose_filter(log, arm.robot)
    segments = condition(despiked(log, chosen.cutoff)[0], chosen, coulomb=arm.robot.coulomb_shape)
    rows = stack_logs([ConditionedLog(segments, chosen, "log")], arm.base)
    made = time.perf_counter() - start
    prior = prior_base_parameters(arm.base.model, arm.base.reduction)
    found = {"OLS 50 Hz": butterworth(arm, log)}
    for method in (*PLAIN, *SIMULATED) if draw < OF_SIMULATED else PLAIN:
        start = time.perf_counter()
        each = METHODS[method](replace(rows), prior, arm.robot.controller)
        seconds = made + time.perf_counter() - start
        again = partial(METHODS[method], prior=prior)
        whole = physical_posterior(arm.base, each, rows, refit=again, residual_model=False).theta
        fitted = relative_error(rows.whole[0], each.theta)
        found[method] = figures(arm, each.theta, each.covariance, fitted, seconds, whole)
    found["auto"] = found[choose(rows)[0]]
    return found


def butterworth(arm: Arm, log: Log) -> list[float]:
    """Return the figures of BIRDy's recipe: 50 Hz on positions, no filter on torques, textbook errors."""
    start = time.perf_counter()
    q = signal.sosfiltfilt(signal.butter(4, 50 / (LOGGED / 2), output="sos"), log.q, axis=0)
    qd = np.gradient(q, 1 / LOGGED, axis=0)
    qdd = np.gradient(qd, 1 / LOGGED, axis=0)
    inside = slice(50, -50)
    W = arm.base.model.observer(arm.base.reduction.base).dense(q[inside], qd[inside], qdd[inside])
    factors = joint_factors([dense_rows(W, log.tau[inside])])
    fit = ordinary(*factors)
    seconds, fitted = time.perf_counter() - start, relative_error(factors[0], fit.theta)
    return figures(arm, fit.theta, fit.covariance, fitted, seconds, fit.theta)


def figures(arm: Arm, theta, covariance, fitted: float, seconds: float, whole) -> list[float]:
    """Return the figures of merit of one estimate, in the order of ``FIGURES``."""
    beta = arm.beta
    inside = np.abs(theta - beta) <= 1.96 * np.sqrt(np.diagonal(covariance))
    d_beta = 200 * np.mean(np.abs(theta - beta) / (np.abs(beta) + np.abs(theta)))
    W = arm.base.model.observer(arm.base.reduction.base).dense(
        *command(arm, np.linspace(0, SECONDS, 500), 10_000)
    )

    def off(one):
        return 100 * np.linalg.norm(one - beta) / np.linalg.norm(beta), 100 * np.linalg.norm(
            W @ (one - beta)
        ) / np.linalg.norm(W @ beta)

    (error, unseen), (physical, of_physical) = off(theta), off(whole)
    return [
        float(x)
        for x in (
            error,
            d_beta,
            fitted,
            unseen,
            100 * inside.mean(),
            seconds,
            physical,
            of_physical,
        )
    ]


def tables(done: dict[str, dict[str, list[float]]]) -> Iterator[str]:
    """Yield Markdown: errors of each arm, share of true values inside the intervals, and seconds."""
    names = {name: done_of(done, name) for name in ("lwr", "tx40")}
    for name, regimes in names.items():
        shown = ("OLS 50 Hz", *PLAIN, *SIMULATED)
        yield (
            f"\n| {name.upper()}: parameters / unseen torque [%] | asked | "
            + " | ".join(shown)
            + " | physical set |"
        )
        yield "| --- " * (len(shown) + 3) + "|"
        for regime, runs in regimes.items():
            cells = [cell(runs, method) for method in shown]
            physical = np.mean([found["auto"][6:8] for found in runs], axis=0)
            asked = f"{TARGETS[regime]} %" if regime in TARGETS else "-"
            yield (
                f"| {titled(regime, runs)} | {asked} | "
                + " | ".join([*cells, two(*physical)])
                + " |"
            )
    yield (
        "\n| inside the 95 % interval [%] | OLS 50 Hz (textbook) | "
        + " | ".join((*PLAIN, *SIMULATED))
        + " |"
    )
    yield "| --- " * (len(PLAIN) + len(SIMULATED) + 2) + "|"
    for name, regimes in names.items():
        for regime, runs in regimes.items():
            cells = [
                cell(runs, method, inside=True) for method in ("OLS 50 Hz", *PLAIN, *SIMULATED)
            ]
            yield f"| {name.upper()}, {titled(regime, runs)} | " + " | ".join(cells) + " |"
    yield "\n| seconds, conditioning included | " + " | ".join((*PLAIN, *SIMULATED)) + " |"
    yield "| --- " * (len(PLAIN) + len(SIMULATED) + 1) + "|"
    for name, regimes in names.items():
        runs = [found for some in regimes.values() for found in some]
        times = [
            np.median([found[method][5] for found in runs if method in found])
            for method in (*PLAIN, *SIMULATED)
        ]
        yield f"| {name.upper()} | " + " | ".join(f"{t:.2f}" for t in times) + " |"


def done_of(done, name: str) -> dict[str, list[dict[str, list[float]]]]:
    """Return the runs of each regime of an arm."""
    runs = {
        regime: [v for key, v in done.items() if key.startswith(f"{name}/{regime}/")]
        for regime in REGIMES
    }
    return {regime: some for regime, some in runs.items() if some}


def titled(regime: str, runs) -> str:
    return f"{regime.replace('_', ' ')} ({len(runs)})"


def two(error: float, unseen: float) -> str:
    return f"{error:.3f} / {unseen:.3f}" if error < 1 else f"{error:.1f} / {unseen:.1f}"


def cell(runs, method: str, *, inside: bool = False) -> str:
    """Return the mean figures of a method; how many draws where not all have it."""
    rows = [found[method] for found in runs if method in found]
    if not rows:
        return "-"
    mean = np.mean(rows, axis=0)
    few = f" ({len(rows)})" if len(rows) < len(runs) else ""
    return (f"{mean[4]:.1f}" if inside else two(mean[0], mean[3])) + few


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--json", type=Path, default=Path("out/estimators.json"))
    options.add_argument("--minutes", type=float, default=25.0)
    options.add_argument("--table", action="store_true")
    given = options.parse_args()
    done = json.loads(given.json.read_text()) if given.json.exists() else {}
    begin = time.monotonic()
    for job in () if given.table else jobs():
        key = "/".join(map(str, job))
        if key in done:
            continue
        if time.monotonic() - begin > 60 * given.minutes:
            break
        done[key] = one(*job)
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(done))
    print(*tables(done), sep="\n")


if __name__ == "__main__":
    main()
