"""Simulated arms whose truth is known: what is identified and named on them can be checked."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dynid.answer import Facts
from dynid.arguments import no_such
from dynid.disk import write_text
from dynid.estimation.result import Identification
from dynid.files import packaged
from dynid.files.robotfile import load_robot
from dynid.progress import stage
from dynid.sim.hidden import CASES, OUTSIDE, Hidden, hidden_logs
from dynid.sim.plant import read_plant

#: The arm that something is hidden in, and its true parameters.
ROBOT, TRUTH = "kuka_lwr4plus", "lwr4plus_truth.yaml"
#: Length of each motion [s]; three are driven, each twice, and the last is only for the proof.
SECONDS = 20.0
#: Half width of a 95 % interval in standard errors.
TWO_SIDED_95 = 1.96


def hidden_effect(name: str, seed: int) -> Hidden:
    """Return what is hidden.

    Args:
        name: identifier of an effect, ``"nothing"``, something that is in no catalogue, or ``"random"``.
        seed: chooses the effect when the name is ``"random"``.

    Raises:
        WrongUsage: nothing of that name can be hidden.
    """
    cases = {case.name: case for case in CASES}
    if name == "random":
        known = [case for case in cases.values() if case.size and case.name not in OUTSIDE]
        return known[int(np.random.default_rng(seed).integers(len(known)))]
    if name not in cases:
        raise no_such("--effect: no effect to hide is called", name, [*cases, "random"])
    return cases[name]


def simulate_hidden(folder: Path, hidden: Hidden, seed: int) -> tuple[Path, tuple[Path, ...]]:
    """Write the robot file and six logs of a simulated arm with something hidden in it, and return their paths.

    Args:
        folder: where to.
        hidden: what is hidden.
        seed: of motions and noise.
    """
    robot = folder / "arm.yaml"
    write_text(robot, (packaged("robots") / f"{ROBOT}.yaml").read_text(encoding="utf-8"))
    plant = read_plant(packaged("trajectories") / TRUTH)
    paths = tuple(folder / f"motion{1 + k // 2}{'ab'[k % 2]}.npz" for k in range(6))
    stage("simulate")
    rng = np.random.default_rng([seed, 1])
    logs = hidden_logs(load_robot(robot), plant, hidden, rng, SECONDS)
    for path, log in zip(paths, logs, strict=True):
        log.save(path)
    return robot, paths


def is_right_answer(hidden: Hidden, answer: Facts) -> bool:
    """Return whether the JSON answer of ``dynid gap`` says what was hidden."""
    verdict, named = answer["verdict"], answer["named"]
    if hidden.name == "nothing":
        return bool(verdict == "nothing_missing")
    if hidden.name in OUTSIDE:
        return verdict == "unexplained" and not named
    found = [(one["effect"], one["joints"]) for one in named]
    return found == [(hidden.name, [answer["gap"]["joints"][hidden.joint]])]


def shipped(stem: str) -> tuple[tuple[Path, Path], dict[str, float]]:
    """Return the two logs of an arm that come with dynid, and its true parameters by name."""
    start = packaged("trajectories") / stem
    logs = Path(f"{start}_identify.bag"), Path(f"{start}_validate.bag")
    return logs, read_plant(Path(f"{start}_truth.yaml")).parameters()


def against_truth(result: Identification, truth: dict[str, float]) -> Facts:
    """Count how many true base parameters the 95 % intervals of a result hold.

    Args:
        result: identified from a simulated arm.
        truth: its true parameters by name; a base parameter with another one in it is not counted.
    """
    names, K = result.reduction.names, result.reduction.K
    true = K @ np.array([truth.get(name, 0.0) for name in names])
    known = ~np.any(K[:, [name not in truth for name in names]] != 0, axis=1)
    inside = np.abs(result.theta - true) <= TWO_SIDED_95 * result.std_error
    return {"parameters": int(known.sum()), "inside_95_percent": int(inside[known].sum())}
