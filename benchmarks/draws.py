"""Arms drawn from posteriors: what a band of their torques covers on unseen motion, how wide it is, how long it takes.

    PYTHONPATH=src python benchmarks/draws.py ../shared/data > benchmarks/draws.md

Recordings and pairs are those of real_arms.py. The band holds 90 % of 1000 draws (seed 0) with the expected noise; the
comparison changes every parameter of the same arm by up to 20 %, evenly and independently, with the same noise.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import mujoco
import numpy as np

from dynid import IdentifyOptions, ValidateOptions, identify
from dynid.errors import DynidError
from dynid.estimation.possible_arm import constraints_of
from dynid.estimation.possible_set import smallest_eigenvalues
from dynid.estimation.stack import LogRows, scaled
from dynid.exporters import FORMATS
from dynid.exporters.full_model import model_of
from dynid.progress import SILENT
from dynid.workflows.export import ExportOptions, identified_arm
from dynid.workflows.logs import checked_log, condition_logs
from real_arms import pairs

COUNT = 1000


def torques(parts, log, result, theta, factors, own=None):
    """Return torques of draws, (D, M, n), and what was measured, (M, n), on usable rows."""
    observer, error = result.base.observer, result.model_error
    found, measured, usable = [], [], []
    for rows in parts:
        tau = np.einsum("mjp,dp->dmj", rows.W, theta, optimize=True)
        if error is not None and factors is not None:
            tau += np.einsum(
                "mjk,djk->dmj", error.columns(rows, log, observer), factors, optimize=True
            )
            tau[:, :, error.joints_apart] += np.einsum(
                "map,dap->dma", rows.W[:, error.joints_apart], own, optimize=True
            )
        found.append(tau)
        measured.append(rows.tau)
        usable.append(rows.mask)
    return np.concatenate(found, axis=1), np.concatenate(measured), np.concatenate(usable)


def band(tau, noise, rng):
    return np.quantile(tau + rng.normal(size=tau.shape) * noise, [0.05, 0.95], axis=0)


def possible_in_mujoco(result, drawn) -> str:
    """Return how many of 50 draws MuJoCo compiles, and how many of all have bodies."""
    arm = identified_arm(result, ("mjcf",), ExportOptions())
    count = 0
    for x in drawn.x[:50]:
        from dataclasses import replace

        one = replace(arm, full=model_of(arm.base, drawn.names, x, arm.full.origin))
        mujoco.MjModel.from_xml_string(FORMATS["mjcf"].text(one))
        count += 1
    bodies = constraints_of(result.base).bodies
    return f"{count} of 50; {int(np.sum(smallest_eigenvalues(drawn.x[:, bodies]).min(axis=1) > 0))} of {len(drawn)}"


def main() -> None:
    data = Path(sys.argv[1])
    print("# Draws from the posterior\n")
    print(__doc__.split("\n\n")[2].strip(), "\n")
    print(
        "| fitted | unseen | covered [%] | width | width of +-20 % | 1000 draws [s] | bodies in MuJoCo; possible |"
    )
    print("| --- | --- | --: | --: | --: | --: | --- |")
    by_arm: dict[str, list[float]] = {}
    for pair in pairs(data):
        try:
            result = identify(pair.robot, pair.fitted, IdentifyOptions(holdout=None))
        except DynidError as error:
            print(f"| {pair.name} | {error} | | | | | |")
            continue
        start = time.perf_counter()
        drawn = result.draws(COUNT)
        seconds = time.perf_counter() - start
        bodies = possible_in_mujoco(result, drawn)
        rng = np.random.default_rng(0)
        evenly = result.physical.x * rng.uniform(0.8, 1.2, drawn.x.shape) @ result.reduction.K.T
        for name, log in pair.unseen:
            options = ValidateOptions(cutoff=result.cutoff, delay=result.delay)
            checked = checked_log(log, result.robot, options, identify=False)
            there = scaled(
                condition_logs([checked], result.base.model, options, SILENT),
                result.base,
                result.theta,
            )[0]
            rows = [*LogRows(there, result.base)]
            tau, measured, usable = torques(
                rows, there, result, drawn.theta, drawn.residual, drawn.own
            )
            low, high = band(tau, drawn.noise, rng)
            covered = 100 * np.mean(((measured >= low) & (measured <= high))[usable])
            by_arm.setdefault(pair.name.split(" ")[0], []).append(covered)
            width = np.mean((high - low)[usable])
            tau, _, _ = torques(rows, there, result, evenly, None)
            low, high = band(tau, drawn.noise, rng)
            other = np.mean((high - low)[usable])
            cells = (
                pair.name,
                name,
                f"{covered:.0f}",
                f"{width:.2f}",
                f"{other:.2f}",
                f"{seconds:.1f}",
                bodies,
            )
            print(f"| {' | '.join(cells)} |", flush=True)
    print("\n| arm | covered, mean of its pairs [%] |\n| --- | --: |")
    for arm, values in by_arm.items():
        print(f"| {arm} | {np.mean(values):.0f} |")


if __name__ == "__main__":
    main()
