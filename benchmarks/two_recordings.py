"""Do the intervals of two recordings of one arm hold its parameters, when friction and offsets differ between them?

PYTHONPATH=src python benchmarks/two_recordings.py --seeds 1 22 > table.md

Random arms of ``defects.py``, of which two motions are identified one by one: once as they are, once each at a temperature
of its own (friction by 15 % and falling by up to 30 %, offsets that wander). Counted is how many parameters of both results
agree within 1.96 combined standard errors, and how many lie so near to the true ones.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from defects import arm_of, drifting
from dynid import IdentifyOptions, identify
from dynid.errors import DynidError
from real_arms import from_data


def z_of(one: np.ndarray, other: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """Return differences in standard errors."""
    return np.abs(one - other) / np.sqrt(variance)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, nargs=2, default=(1, 22), help="first and last seed")
    args = parser.parse_args()
    found: dict[tuple[str, str], list[np.ndarray]] = {}
    for seed in range(args.seeds[0], args.seeds[1] + 1):
        arm, rng = arm_of(seed), np.random.default_rng(60_000 + seed)
        seconds, share = rng.uniform(14.0, 26.0), rng.uniform(0.35, 0.7)
        logs = [arm.log(5000 * seed + k, seconds, share, ()) for k in (0, 1)]
        for state, pair in (
            ("as it is", logs),
            ("other temperature", [drifting(arm, log, rng) for log in logs]),
        ):
            try:
                a, b = (
                    identify(arm.robot, log, IdentifyOptions(holdout=None, drop_weak=True))
                    for log in pair
                )
            except DynidError as error:
                print(seed, state, error, file=sys.stderr)
                continue
            true = a.reduction.K @ np.array([arm.truth[0][name] for name in a.reduction.names])
            told = from_data(a) & from_data(b)
            for theta, covariance, name, chosen in (
                ("theta", "covariance", "in force", slice(None)),
                ("theta", "covariance", "from the data", told),
                ("plain", "plain_covariance", "plain", slice(None)),
            ):
                spread = [np.diag(getattr(each, covariance)) for each in (a, b)]
                values = [getattr(each, theta) for each in (a, b)]
                apart = z_of(*values, sum(spread))[chosen]
                off = np.concatenate(
                    [z_of(v, true, s)[chosen] for v, s in zip(values, spread, strict=True)]
                )
                found.setdefault((state, f"{name}, both"), []).append(apart)
                found.setdefault((state, f"{name}, true"), []).append(off)
            agree = z_of(a.theta, b.theta, np.diag(a.covariance) + np.diag(b.covariance))
            print(seed, state, f"{100 * np.mean(agree < 1.96):.0f} %", file=sys.stderr, flush=True)
    print("| recordings | parameters | inside 95 % | median of z |\n| - | - | - | - |")
    for (state, name), each in found.items():
        z = np.concatenate(each)
        print(
            f"| {state} | {name} | {np.sum(z < 1.96)} of {len(z)} = {100 * np.mean(z < 1.96):.0f} % | {np.median(z):.2f} |"
        )


if __name__ == "__main__":
    main()
