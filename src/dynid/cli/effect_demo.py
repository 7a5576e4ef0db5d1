"""``dynid demo --effect``: something is hidden in a simulated arm, found, added, and the gap shrinks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common
from dynid.cli.selftest import ROBOT, TRUTH
from dynid.errors import ExitStatus, WrongUsage

if TYPE_CHECKING:
    from dynid.sim.hidden import Hidden

#: Length of each motion [s]; three are driven, each twice, and the last is only for the proof.
SECONDS = 20.0


def tell(common: Common, effect: str) -> ExitStatus:
    """Simulate, identify, search, add and compare with what was hidden.

    Args:
        common: the common options; the seed chooses the effect when it is ``"random"``, the motions and the noise.
        effect: identifier, ``"nothing"``, something that is in no catalogue, or ``"random"``.
    """
    from dynid.cli.gap import run_gap
    from dynid.cli.identify import run_identify
    from dynid.gap.self_test import right as is_right
    from dynid.workflows.identify import IdentifyOptions

    hidden = chosen(effect, common.seed)
    folder = common.out or Path("out") / "demo" / "effect"
    common = replace(common, out=folder, force=True)
    terminal = common.terminal
    terminal.say("--- a simulated LWR4+ with something hidden in it: three motions, each driven twice", "bold")
    robot, logs = simulate(common, folder, hidden)
    terminal.say("--- dynid identify, on the first two motions", "bold")
    run_identify(common, str(robot), logs[:4], IdentifyOptions(feasible=False), show=False, final=False)
    terminal.say("--- dynid gap, proved on the third motion", "bold")
    parameters = folder / "parameters.npz"
    added = replace(common, out=folder / "with_effect")
    answer = run_gap(added, parameters, logs, apply_="best", new_name=folder / "arm_with_effect.yaml")
    number = {name: k for k, name in enumerate(answer["gap"]["joints"])}
    found = tuple((one["effect"], tuple(number[name] for name in one["joints"])) for one in answer["named"])
    right = is_right(hidden, answer["verdict"], found)
    terminal.answer()
    where = f", {hidden.size:g} in size, at joint {hidden.joint + 1}" if hidden.size else ""
    terminal.fact("hidden", f"{hidden.name}{where} (seed {common.seed})")
    terminal.fact("verdict", f"{answer['verdict']}: {'right' if right else 'wrong'}")
    terminal.fact("picture", str(folder / "gap" / "shrink.png"))
    if found:
        terminal.fact("next", f"dynid validate {folder / 'with_effect' / 'parameters.npz'} LOG")
    facts: dict[str, Any] = {"effect": hidden.name, "joint": hidden.joint + 1, "size": hidden.size, "seed": common.seed}
    terminal.emit_json({"schema": "dynid/demo/1", "robot": ROBOT, "hidden": facts, "right": right, "gap": answer})
    return ExitStatus.DONE if right else ExitStatus.LIMIT_NOT_MET


def chosen(effect: str, seed: int) -> Hidden:
    """Return what is hidden.

    Raises:
        WrongUsage: nothing of that name can be hidden.
    """
    import numpy as np

    from dynid.files.yamlfile import closest
    from dynid.sim.hidden import CASES, OUTSIDE

    cases = {case.name: case for case in CASES}
    if effect == "random":
        known = [case for case in cases.values() if case.size and case.name not in OUTSIDE]
        return known[int(np.random.default_rng(seed).integers(len(known)))]
    if effect not in cases:
        raise WrongUsage(
            f"--effect: '{effect}' cannot be hidden{closest(effect, cases)}",
            fix=f"random, or one of {', '.join(cases)}",
        )
    return cases[effect]


def simulate(common: Common, folder: Path, hidden: Hidden) -> tuple[Path, tuple[Path, ...]]:
    """Write the robot file and the logs of an arm with something hidden in it, and return their paths."""
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
    with common.terminal.progress() as progress:
        progress.stage("simulate", "")
        logs = hidden_logs(source, plant, hidden, np.random.default_rng([common.seed, 1]), seconds=SECONDS)
    for path, log in zip(paths, logs, strict=True):
        log.save(path)
    return robot, paths
