"""Simulated arms whose truth is known: what is identified and named on them can be checked."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import WrongUsage
from dynid.progress import SILENT, Progress

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.sim.hidden import Hidden

#: The arm that something is hidden in, and its true parameters.
ROBOT, TRUTH = "kuka_lwr4plus", "lwr4plus_truth.yaml"
#: Length of each motion [s]; three are driven, each twice, and the last is only for the proof.
SECONDS = 20.0
#: Half width of a 95 % interval in standard errors.
TWO_SIDED_95 = 1.96

#: Identifiers and 0-based joints of effects; () for the whole arm.
Named = tuple[tuple[str, tuple[int, ...]], ...]


@dataclass(frozen=True)
class SelfTestCase:
    """One case of the self-test and what was said.

    Attributes:
        hidden: what was hidden.
        verdict: the verdict.
        named: what was named.
        right: whether that is right.
    """

    hidden: Hidden
    verdict: str
    named: Named
    right: bool


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


def is_right(hidden: Hidden, verdict: str, named: Named) -> bool:
    """Return whether a verdict and its names say what was hidden."""
    from dynid.sim.hidden import OUTSIDE

    if hidden.name == "nothing":
        return verdict == "nothing_missing"
    if hidden.name in OUTSIDE:
        return verdict == "unexplained" and not named
    return len(named) == 1 and named[0][0] == hidden.name and named[0][1][:1] in ((), (hidden.joint,))


def is_right_answer(hidden: Hidden, answer: dict[str, Any]) -> bool:
    """Return whether the JSON answer of ``dynid gap`` says what was hidden."""
    names = answer["gap"]["joints"]
    named = tuple(
        (one["effect"], tuple(names.index(joint) for joint in one["joints"]) if len(one["joints"]) < len(names) else ())
        for one in answer["named"]
    )
    return is_right(hidden, answer["verdict"], named)


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
    import numpy as np

    from dynid.files.robotfile import load_robot, packaged
    from dynid.gap.analysis import CUTOFF, analyse_gap
    from dynid.gap.stepwise_selection import SelectionOptions
    from dynid.model.base_model import BaseModel
    from dynid.model.reduce import reduce
    from dynid.signals.conditioned_log import condition_logs
    from dynid.sim.hidden import CASES, hidden_logs
    from dynid.sim.plant import read_plant
    from dynid.workflows.model import derive_model

    progress.stage("self-test")
    model = derive_model(load_robot(ROBOT), folder).model
    base, plant = BaseModel(model, reduce(model)), read_plant(packaged("trajectories") / TRUTH)
    for k, hidden in enumerate(CASES):
        logs = hidden_logs(model.robot, plant, hidden, np.random.default_rng([seed, k]))
        conditioned = condition_logs(logs, model, cutoff=CUTOFF)
        found = analyse_gap(conditioned, base, None, SelectionOptions(), simulate=False)
        named = tuple((one.name, one.joints) for one in found.verdict.named)
        progress.advance(k + 1, len(CASES), hidden.name)
        yield SelfTestCase(hidden, found.verdict.word, named, is_right(hidden, found.verdict.word, named))
