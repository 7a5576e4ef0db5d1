"""Count how often true parameters lie within two standard errors when the noise of a log is not what it should be.

    python benchmarks/odd_noise.py [--logs 25] [--rows NAME...] [--first 0] [--json out/odd_noise.json]

An LWR with known truth (Pinocchio's inverse dynamics) moves 20 s along a random Fourier motion at 200 Hz; each row spoils its
log in one way. 95 % of the true base parameters should lie within two standard errors, whatever was done to the log.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

import dynid
from closed_loop_arms import SLOPE, Arm, arm_of, command
from dynid.errors import DynidError
from dynid.log import Log

RATE, SECONDS = 200, 20
TORQUE = np.array([0.5, 0.5, 0.3, 0.3, 0.15, 0.1, 0.06])


def clean(arm: Arm, draw: int) -> Log:
    """Return a log without noise."""
    t = np.arange(RATE * SECONDS) / RATE
    stretch = 10 / SECONDS
    q, qd, qdd = command(arm, t * stretch, 100 + draw)
    qd, qdd = qd * stretch, qdd * stretch**2
    data = arm.plant.createData()
    tau = np.array([pin.rnea(arm.plant, data, *row) for row in zip(q, qd, qdd, strict=True)])
    tau += arm.plant.armature * 0.0 + arm.viscous * qd + arm.coulomb * np.tanh(qd / SLOPE)
    return Log(t, q, tau, arm.robot.joint_names, tau_unit="Nm", dh=True)


def spoilt(row: str, log: Log, rng: np.random.Generator) -> list[Log]:
    """Return logs as a row of the table makes them."""
    noise = TORQUE * rng.standard_normal(log.tau.shape)
    tau, q = log.tau + noise, log.q + 1e-5 * rng.standard_normal(log.q.shape)
    if row == "slow torque noise":
        slow = np.zeros_like(noise)
        for k in range(1, len(slow)):
            slow[k] = 0.98 * slow[k - 1] + np.sqrt(1 - 0.98**2) * noise[k]
        tau = log.tau + slow
    if row.startswith("position noise"):
        q = log.q + float(row.split()[2]) * rng.standard_normal(log.q.shape)
    if row == "spikes":
        hit = rng.random(tau.shape) < 0.01
        tau = tau + hit * 0.3 * np.abs(tau).max(axis=0) * rng.choice([-1, 1], tau.shape)
    seen = replace(log, q=q, tau=tau)
    if row == "each sample stored twice":
        index = np.repeat(np.arange(len(log)), 2)
        return [replace(seen, t=np.arange(len(index)) / (2 * RATE), q=q[index], tau=tau[index])]
    if row == "50 Hz held in 200 Hz":
        index = np.arange(len(log)) // 4 * 4
        return [replace(seen, q=q[index], tau=tau[index])]
    if row == "30-60 Hz held in 200 Hz":
        fresh = np.cumsum(rng.integers(3, 7, len(log)))
        index = fresh[np.searchsorted(fresh, np.arange(len(log)), side="right") - 1]
        index = np.where(np.arange(len(log)) < fresh[0], 0, index)
        return [replace(seen, q=q[index], tau=tau[index])]
    if row == "positions held at 50 Hz, torques at 200 Hz":
        return [replace(seen, q=q[np.arange(len(log)) // 4 * 4])]
    if row == "the same log three times":
        return [seen] * 3
    return [seen]


ROWS = (
    "white torque noise",
    "slow torque noise",
    "position noise 1e-4 rad",
    "spikes",
    "position noise 2e-3 rad",
    "each sample stored twice",
    "50 Hz held in 200 Hz",
    "the same log three times",
    "30-60 Hz held in 200 Hz",
    "positions held at 50 Hz, torques at 200 Hz",
)


def one(arm: Arm, row: str, draw: int) -> dict:
    """Return the share inside, the largest error in standard errors, and warnings of one log; or why it is refused."""
    rng = np.random.default_rng([draw, ROWS.index(row)])
    try:
        found = dynid.identify(
            arm.robot,
            spoilt(row, clean(arm, draw), rng),
            dynid.IdentifyOptions(feasible=False),
            base=arm.base,
        )
    except DynidError as error:
        return {"refused": error.code, "text": str(error)}
    away = np.abs(found.plain - arm.beta) / found.std_error
    codes = sorted(
        {f["code"] for f in found.header["log_findings"]} | {f.code for f in found.findings}
    )
    return {
        "inside": float(np.mean(away < 2)),
        "worst": float(away.max()),
        "codes": codes,
        "method": found.method,
    }


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--logs", type=int, default=25)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--rows", nargs="*", default=ROWS)
    options.add_argument("--json", type=Path, default=Path("out/odd_noise.json"))
    given = options.parse_args()
    arm = arm_of("lwr")
    done = {}
    print(
        "| noise | logs | refused | inside two standard errors [%] | largest error [standard errors] | warnings |"
    )
    print("| --- | --- | --- | --- | --- | --- |")
    for row in given.rows:
        runs = done[row] = [
            one(arm, row, draw) for draw in range(given.first, given.first + given.logs)
        ]
        kept = [run for run in runs if "inside" in run]
        inside = f"{100 * np.mean([run['inside'] for run in kept]):.1f}" if kept else "-"
        worst = f"{max(run['worst'] for run in kept):.1f}" if kept else "-"
        codes = sorted(
            {code for run in kept for code in run["codes"]}
            | {run["refused"] for run in runs if run not in kept}
        )
        print(
            f"| {row} | {len(runs)} | {len(runs) - len(kept)} | {inside} | {worst} | {', '.join(codes)} |",
            flush=True,
        )
        given.json.parent.mkdir(parents=True, exist_ok=True)
        given.json.write_text(json.dumps(done))


if __name__ == "__main__":
    main()
