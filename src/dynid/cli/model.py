"""``dynid model ROBOT``: loop 1, from the DH table to the base regressor."""

from __future__ import annotations

import re
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import Answer, ask
from dynid.errors import StaleCache, WrongUsage

if TYPE_CHECKING:
    from dynid.model.reduce import Reduction
    from dynid.model.regressor import Model
    from dynid.robot import Robot

EFFECTS = ("viscous", "coulomb", "offset", "motor_inertia")
SYMBOLS = {"alone": ("#", "bold green"), "combined": ("+", ""), "none": (".", "red"), "absent": (" ", "")}


@dataclass
class Built:
    """What the command made, for the JSON answer."""

    model: Model
    seconds: dict[str, float] = field(default_factory=dict)
    wrote: list[Path] = field(default_factory=list)
    reduction: Reduction | None = None


@dynid_command(
    "model",
    examples=(
        "dynid model kinova_gen2                      derive, ask, reduce",
        "dynid model my_arm.yaml --gravity 9.81,0,0   the same arm on a wall",
        "dynid model kuka_lwr4plus --json | jq .rank",
    ),
)
@click.argument("robot")
@click.option("--gravity", metavar="X,Y,Z", help="Gravity in frame 0 [m/s^2], instead of the robot file's.")
@click.option("--effects", metavar="LIST", help=f"Columns of every joint: some of {','.join(EFFECTS)}; or none.")
@click.option("--links", metavar="LIST", help="Links to identify, such as 1-7 or 4,5,6; the others keep the prior.")
@click.option("--reduce/--no-reduce", "reduce_now", default=None, help="Reduce to base parameters without asking.")
@click.option("--samples", type=click.IntRange(10, 100000), default=200, show_default=True, help="Random states.")
@click.option(
    "--tolerance", metavar="auto|X", default="auto", help="Relative size below which a column depends on others."
)
@click.option("--rebuild/--frozen", "rebuild", default=None, help="Rebuild a stored model without asking, or never.")
@click.option(
    "--groups", type=click.Choice(["json", "latex", "text"]), help="Print the relations of all base parameters."
)
@click.option("--at-rest", is_flag=True, help="With --groups: only what torques at rest show, as vendors publish it.")
@click.option("--latex", is_flag=True, help="Print the regressor as LaTeX.")
@click.option("--python", "--code", "python", is_flag=True, help="Print the regressor as a NumPy function.")
def command(common: Common, robot: str, **options: Any) -> None:  # noqa: ANN401
    """Derive the regressor of an arm from its DH table and group it into base parameters."""
    from dynid.files.robotfile import load_robot

    while True:
        arm = adapted(load_robot(robot), options["gravity"], options["effects"], options["links"])
        common.terminal.findings(arm.findings)
        built = derive_or_load(common, arm, options["rebuild"])
        if options["latex"] or options["python"]:
            return show_code(common, built.model, latex=options["latex"])
        if options["groups"]:
            return show_groups(common, built.model, options["groups"], still=options["at_rest"])
        answer = ask(common, "P1", given=options["reduce_now"])
        if answer is not Answer.RETRY:
            break
        click.edit(filename=str(arm.path))
    if answer is Answer.YES:
        reduce_now(common, built, samples=options["samples"], tolerance=options["tolerance"])
    report(common, built)


def adapted(robot: Robot, gravity: str | None, effects: str | None, links: str | None) -> Robot:
    """Return the robot with what the options change."""
    if gravity is not None:
        parts = gravity.split(",")
        try:
            x, y, z = (float(part) for part in parts)
        except ValueError:
            raise WrongUsage(f"--gravity '{gravity}' is not three numbers", fix="--gravity 0,0,-9.81") from None
        robot = replace(robot, gravity=(x, y, z))
    if effects is not None:
        wanted = [] if effects == "none" else [word.strip() for word in effects.split(",")]
        for word in wanted:
            if word not in EFFECTS:
                raise WrongUsage(f"--effects: no effect '{word}'", fix=f"choose from {', '.join(EFFECTS)}, or none")
        friction = tuple(word for word in wanted if word != "motor_inertia")
        joints = (replace(j, friction=friction, motor_inertia="motor_inertia" in wanted) for j in robot.joints)
        robot = replace(robot, joints=tuple(joints))
    return robot if links is None else replace(robot, links=numbers(links, robot.n))


def numbers(text: str, most: int) -> tuple[int, ...]:
    """Return the link numbers of a list such as ``1-3,5``."""
    found: set[int] = set()
    for part in text.split(","):
        first, _, last = part.strip().partition("-")
        if not first.isdigit() or (last and not last.isdigit()) or not 1 <= int(first) <= int(last or first) <= most:
            raise WrongUsage(f"--links '{text}' does not name links of 1 to {most}", fix="such as --links 1-3,5")
        found |= set(range(int(first), int(last or first) + 1))
    return tuple(sorted(found))


def derive_or_load(common: Common, robot: Robot, rebuild: bool | None) -> Built:
    """Return the stored model when it is this robot's, otherwise derive and store it."""
    from dynid.model.store import key_of, obtain_model, paths, stored_key

    terminal, path = common.terminal, paths(common.folder(robot.slug))[0]
    turning = sum(joint.revolute for joint in robot.joints)
    kinds = f"{robot.n} joints ({turning} revolute, {robot.n - turning} prismatic)"
    terminal.stage("robot", f"{robot.name}, {kinds}, {robot.convention} DH, file {robot.path}")
    key = stored_key(path)
    stale = key is not None and key != key_of(robot)
    if stale and rebuild is not True:
        if rebuild is False:
            raise StaleCache(f"{path} was made from an older robot file ({changes(path, robot)})", where=str(path))
        terminal.stage("noticed", f"{path} was made from another version of the robot file: {changes(path, robot)}")
        if ask(common, "P8", path=path) is not Answer.YES:
            raise StaleCache(
                f"{path} belongs to an older robot file and was not rebuilt", fix="answer yes, or add --rebuild"
            )
    start = time.perf_counter()
    with terminal.progress() as progress:
        progress.stage("symbolic", "")
        model, derived = obtain_model(robot, path.parent, rebuild=rebuild is True or stale)
    seconds = time.perf_counter() - start
    if derived is None:
        terminal.stage("reused", f"{path}       (key {key}; --rebuild derives it again)")
        return Built(model, {"load": seconds})
    terminal.stage(
        "symbolic", f"Newton-Euler, {model.size} parameters, {model.rigid.flops} operations, {derived:.2f} s"
    )
    terminal.wrote(path, f"key {key_of(robot)}, reused until the robot file changes")
    return Built(model, {"symbolic": derived}, [path])


def changes(path: Path, robot: Robot) -> str:
    """Say what differs between the robot of a stored model and this one."""
    from dynid.files.artifact import read_header

    header = read_header(path) or {}
    found: list[str] = []
    rows = header.get("geometry", [])
    for i, (joint, row) in enumerate(zip(robot.joints, rows, strict=False)):
        now = [joint.type, joint.a, joint.twist, joint.d, joint.theta_offset]
        for name, old, new in zip(("type", "a", "twist", "d", "theta_offset"), row, now, strict=True):
            if old != new:
                found.append(f"joints[{i}].{name} {_shown(old)} -> {_shown(new)}")
    if len(rows) != robot.n:
        found.append(f"{len(rows)} joints -> {robot.n}")
    for name, new_value in (("convention", robot.convention), ("gravity", list(robot.gravity))):
        if header.get(name) != new_value:
            found.append(f"{name} {header.get(name)} -> {new_value}")
    return "; ".join(found) or "other columns, links or version of dynid"


def _shown(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def reduce_now(common: Common, built: Built, *, samples: int, tolerance: str) -> None:
    """Group into base parameters and write them."""
    from dynid.model.reduce import DEPENDENT, base_parameters
    from dynid.model.store import key_of, load_reduction, paths, save_reduction, stored_key

    path = paths(common.folder(built.model.robot.slug))[1]
    try:
        limit = DEPENDENT if tolerance == "auto" else float(tolerance)
    except ValueError:
        raise WrongUsage(f"--tolerance '{tolerance}' is neither auto nor a number", fix="--tolerance auto") from None
    start = time.perf_counter()
    if (
        "load" in built.seconds
        and stored_key(path) == key_of(built.model.robot)
        and tolerance == "auto"
        and samples == 200
    ):
        reduction = load_reduction(path)
        common.terminal.stage("reused", str(path))
    else:
        with common.terminal.progress() as progress:
            progress.stage("reduce", "")
            reduction = base_parameters(built.model, samples=samples, seed=common.seed, tolerance=limit)
        save_reduction(path, built.model, reduction)
        built.wrote.append(path)
        gap = f"confirmed exactly; gap between kept and dropped singular values {reduction.gap:.0e}, seed {common.seed}"
        common.terminal.stage(
            "reduced", f"{len(reduction.names)} -> {reduction.rank} columns, rank {reduction.rank}, {gap}"
        )
        common.terminal.wrote(path)
    built.seconds["reduce"] = time.perf_counter() - start
    built.reduction = reduction


def report(common: Common, built: Built) -> None:
    """Print the answer: the table of classes, or JSON."""
    from dynid.model.kernels import geometry

    terminal, model, reduction = common.terminal, built.model, built.reduction
    answer: dict[str, Any] = {
        "schema": "dynid/model/1",
        "robot": model.robot.name,
        "n_joints": model.robot.n,
        "n_parameters": model.size,
        "key": model.robot.model_key,
        "operations": model.rigid.flops,
        "seconds": built.seconds,
        "wrote": built.wrote,
    }
    if reduction is None:
        terminal.emit_json({**answer, "rank": None, "classes": None, "groups": None})
        terminal.next(f"dynid model {common_name(model.robot)} --reduce")
        return
    classes = {"alone": reduction.alone, "none": reduction.none, "combined": reduction.combined}
    groups = [
        {"name": name, "terms": reduction.terms(i), "formula": reduction.formulas[i]}
        for i, name in enumerate(reduction.base_names)
    ]
    terminal.emit_json({**answer, "rank": reduction.rank, "classes": classes, "groups": groups, "gap": reduction.gap})
    class_table(common, model.robot, reduction)
    for i, name in enumerate(reduction.base_names):
        if name.endswith("R"):
            terminal.answer(f"  {reduction.formulas[i]}")
    used = set(re.findall(r"\b[ad]\d+\b", " ".join(reduction.formulas)))
    symbols = {name: value for name, value in geometry(model.robot).items() if name in used}
    terminal.answer(
        "  with " + ", ".join(f"{name} = {value:g} m" for name, value in symbols.items()) if symbols else ""
    )
    terminal.next(
        f"dynid trajectory {common_name(model.robot)}, or with a log: dynid identify {common_name(model.robot)} LOG"
    )


def class_table(common: Common, robot: Robot, reduction: Reduction) -> None:
    """Print the paper's Table 8: one row a joint, one column a parameter."""
    from dynid.robot import FRICTION_PARAMETERS, LINK_PARAMETERS

    kinds = [*LINK_PARAMETERS, *FRICTION_PARAMETERS.values()]
    known = set(reduction.names)
    kinds = [kind for kind in kinds if any(f"{kind}{j}" in known for j in range(1, robot.n + 1))]
    rows: list[list[str | tuple[str, str]]] = []
    for j, joint in enumerate(robot.joints, start=1):
        cells = [reduction.class_of(f"{kind}{j}") if f"{kind}{j}" in known else "absent" for kind in kinds]
        rows.append([f"{j} {joint.name}", *(SYMBOLS[cell] for cell in cells)])
    common.terminal.table(["joint", *kinds], rows)
    totals = (
        f"totals  {len(reduction.alone)}   {len(reduction.combined)}   {len(reduction.none)}   = {len(reduction.names)}"
    )
    common.terminal.answer(f"# alone   + combined   . none      {totals}")


def common_name(robot: Robot) -> str:
    """Return what a person types for this robot."""
    from dynid.files.robotfile import known_robots

    names = [name for name, path in known_robots().items() if path == robot.path]
    return names[0] if names else str(robot.path)


def show_groups(common: Common, model: Model, form: str, *, still: bool) -> None:
    """Print the relations, so that a vendor's grouped numbers can be named."""
    import json

    from dynid.model.exact import reduce_exactly, relations_json, relations_latex, relations_text

    exact = reduce_exactly(model, still=still)
    facts = {"schema": "dynid/model/1", "robot": model.robot.name, **relations_json(exact)}
    common.terminal.emit_json(facts)
    if form == "json":
        common.terminal.answer(json.dumps(facts, indent=2))
    else:
        common.terminal.answer(relations_latex(exact) if form == "latex" else relations_text(exact, alone=True))


def show_code(common: Common, model: Model, *, latex: bool) -> None:
    """Print the regressor for a person."""
    from dynid.model.printing import as_latex, as_python

    text = as_latex(model) if latex else as_python(model)
    common.terminal.emit_json({"schema": "dynid/model/1", "robot": model.robot.name, "text": text})
    common.terminal.answer(text)
