"""Simulated arms whose truth is known: what is identified and named on them can be checked."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import WrongUsage
from dynid.progress import SILENT, Progress

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.gap.self_test import SelfTestCase
    from dynid.sim.hidden import Hidden

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
    import numpy as np

    from dynid.files.yamlfile import closest
    from dynid.sim.hidden import CASES, OUTSIDE

    cases = {case.name: case for case in CASES}
    if name == "random":
        known = [case for case in cases.values() if case.size and case.name not in OUTSIDE]
        return known[int(np.random.default_rng(seed).integers(len(known)))]
    if name not in cases:
        raise WrongUsage(
            f"--effect: '{name}' cannot be hidden{closest(name, cases)}", fix=f"random, or one of {', '.join(cases)}"
        )
    return cases[name]


def simulate_hidden(
    folder: Path, hidden: Hidden, seed: int, progress: Progress = SILENT
) -> tuple[Path, tuple[Path, ...]]:
    """Write the robot file and six logs of a simulated arm with something hidden in it, and return their paths.

    Args:
        folder: where to.
        hidden: what is hidden.
        seed: of motions and noise.
        progress: told that the arm is simulated.
    """
    import numpy as np

    from dynid.files.artifact import write_text
    from dynid.files.robotfile import load_robot, packaged
    from dynid.sim.hidden import hidden_logs
    from dynid.sim.plant import read_plant

    source = load_robot(ROBOT)
    assert source.path is not None
    robot = folder / "arm.yaml"
    write_text(robot, source.path.read_text(encoding="utf-8"))
    plant = read_plant(packaged("trajectories") / TRUTH)
    paths = tuple(folder / f"motion{1 + k // 2}{'ab'[k % 2]}.npz" for k in range(6))
    progress.stage("simulate")
    logs = hidden_logs(source, plant, hidden, np.random.default_rng([seed, 1]), seconds=SECONDS)
    for path, log in zip(paths, logs, strict=True):
        log.save(path)
    return robot, paths


def is_right(hidden: Hidden, answer: dict[str, Any]) -> bool:
    """Return whether the JSON answer of ``dynid gap`` says what was hidden."""
    from dynid.gap.self_test import right

    number = {name: k for k, name in enumerate(answer["gap"]["joints"])}
    named = tuple((one["effect"], tuple(number[name] for name in one["joints"])) for one in answer["named"])
    return right(hidden, answer["verdict"], named)


def against_truth(result: Identification, truth: Path) -> dict[str, Any]:
    """Count how many true base parameters the 95 % intervals of a result hold.

    Args:
        result: identified from a simulated arm.
        truth: the YAML file of its true parameters.
    """
    import numpy as np

    from dynid.sim.plant import read_plant

    gamma = read_plant(truth).parameters()
    true = result.reduction.K @ np.array([gamma[name] for name in result.reduction.names])
    inside = np.abs(result.theta - true) <= TWO_SIDED_95 * result.std_error
    return {"parameters": len(true), "inside_95_percent": int(inside.sum())}


def self_test_gap(seed: int, folder: Path, progress: Progress = SILENT) -> Iterator[SelfTestCase]:
    """Hide effects, and nothing, in a simulated arm one by one, and yield what is named each time.

    Args:
        seed: of motions and noise.
        folder: where the arm's model is kept.
        progress: told how far the work is.
    """
    from dynid.files.robotfile import load_robot, packaged
    from dynid.gap.self_test import self_test
    from dynid.sim.hidden import CASES
    from dynid.sim.plant import read_plant
    from dynid.workflows.model import derive_model

    progress.stage("self-test")
    model = derive_model(load_robot(ROBOT), folder).model
    for k, case in enumerate(self_test(model, read_plant(packaged("trajectories") / TRUTH), seed), start=1):
        progress.advance(k, len(CASES), case.hidden.name)
        yield case
