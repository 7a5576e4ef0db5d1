"""Every effect of the catalogue in simulators: by which means, and how far from dynid's torque.

    PYTHONPATH=src python benchmarks/exports.py          writes benchmarks/exports.md

Arm, sizes and seeds are those of tests/unit/exporters/export_cases.py: the LWR4+ with random bodies and friction (seed
1) and one effect, 1000 random states (seed 0); what remembers is compared along them, 10 ms apart.
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "unit" / "exporters"), str(ROOT / "tests" / "physics")]

from export_cases import EFFECTS as SIZES  # noqa: E402
from export_cases import with_effect  # noqa: E402

from dynid.exporters import EFFECTS, FORMATS  # noqa: E402
from dynid.exporters.simulated import simulated  # noqa: E402


def row(name: str) -> str:
    source = with_effect(name)
    where = simulated(source)
    simulators = {
        each.engine.split()[0]: each for each in EFFECTS.check(EFFECTS.text(source), source)
    }
    code = [
        each
        for key in ("c", "python")
        for each in FORMATS[key].check(FORMATS[key].text(source), source)
    ]
    phrase = next(
        (p.partition(": ")[2] for p in (*where.numbers, *where.elements) if p.startswith(name)),
        "effects.py",
    )
    left = next((p.partition(": ")[2] for p in where.left), "")
    own = (
        any(f"{key} of its joint" in phrase for key in ("viscous friction", "Coulomb friction"))
        or name == "payload"
    )
    urdf = "-" if left else phrase if own else "effects.py"
    cells = (
        f"`{name}`",
        (left and f"left out: {left}") or phrase,
        urdf,
        *(f"{simulators[key].largest:.0e}" for key in ("MuJoCo", "PyBullet")),
        f"{max(each.largest for each in code):.0e}",
    )
    return f"| {' | '.join(cells)} |"


def main() -> None:
    lines = [
        "# Effects in simulators and code",
        "",
        "Written by `benchmarks/exports.py`. Largest difference of a torque [N m] from dynid's on 1000 states; the arm's",
        "torques are of the order of 20 N m. MuJoCo: the MJCF with `effects.py`. PyBullet: the URDF with it. Code: C and",
        "Python. Dry friction is compared as a torque; in a simulation it is MuJoCo's constraint `frictionloss`. The bristle",
        "of the `lugre` element moves only along a simulation: there it stays within 1 % of the friction at steps of 1 ms",
        "(`test_the_bristle_of_mujoco_bends_as_the_formula_says`).",
        "",
        "| effect | MJCF | URDF, SDF | MuJoCo | PyBullet | code |",
        "| --- | --- | --- | --: | --: | --: |",
        *(row(name) for name in SIZES),
    ]
    (ROOT / "benchmarks" / "exports.md").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
