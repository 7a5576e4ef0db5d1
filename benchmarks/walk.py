"""How many files, functions and own types a person meets who follows one job through the code; and how much code there is.

    PYTHONPATH=src python benchmarks/walk.py                         a table of the code as it is
    PYTHONPATH=src python benchmarks/walk.py --record after          keep it as a column of benchmarks/walk.json
    python benchmarks/walk.py --page > benchmarks/walk.md            the page: all columns that are kept

Each walk runs in a process of its own under ``sys.setprofile``. A file counts when one of its functions is entered, which
leaves out what is only imported. An own type counts when a function of dynid is handed a value of it, or constructs it in
an ``__init__`` of its own; *in any variable* looks at all local variables at the end of each function as well.
"""

from __future__ import annotations

import argparse
import ast
import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

SHIPPED = Path(__file__).parents[1] / "trajectories"
KEPT = Path(__file__).with_suffix(".json")
ARM = "kuka_lwr4plus"
IDENTIFY, UNSEEN = SHIPPED / "lwr4plus_identify.bag", SHIPPED / "lwr4plus_validate.bag"


# ---------------------------------------------------------------- the walks
def bag_to_result(folder: Path) -> Callable[[], object]:
    """Follow load_log, identify and save; the arm and its base model are at hand."""
    import dynid

    arm = dynid.load_robot(ARM)
    dynid.base_model(arm)

    def walk() -> None:
        log = dynid.load_log(IDENTIFY, arm)
        dynid.identify(arm, [log]).save(folder / "parameters.npz")

    return walk


def command(*words: str) -> Callable[[Path], Callable[[], object]]:
    """Follow one command in this process, in an empty folder."""

    def prepared(folder: Path) -> Callable[[], object]:
        from dynid.cli.main import run

        def walk() -> None:
            assert run([*words, "--quiet", "--out", str(folder)]) == 0

        return walk

    return prepared


def relations(folder: Path) -> Callable[[], object]:
    """Follow a robot file to its base parameters and their formulas."""
    import dynid

    return lambda: print(
        dynid.base_model(dynid.load_robot("scara")).reduction.formulas, file=sys.stderr
    )


def gap(folder: Path) -> Callable[[], object]:
    """Follow find_gap on a recording where nothing is missing; the result is at hand."""
    import dynid

    arm = dynid.load_robot(ARM)
    result = dynid.identify(arm, [dynid.load_log(IDENTIFY, arm)])
    log = dynid.load_log(UNSEEN, arm)
    return lambda: dynid.find_gap(result, [log])


WALKS: dict[str, Callable[[Path], Callable[[], object]]] = {
    "bag to saved result: load_log, identify, save": bag_to_result,
    "the same by command: identify LOG --no-report": command(
        "identify", ARM, str(IDENTIFY), "--no-report"
    ),
    "identify LOG, with report": command("identify", ARM, str(IDENTIFY)),
    "DH parameters to relations: load_robot, base_model": relations,
    "DH parameters to printed relations: model --groups text": command(
        "model", "scara", "--groups", "text"
    ),
    "find_gap on a recording where nothing is missing": gap,
}
COLUMNS = ("files", "functions", "own types", "own types in any variable")


def traced(prepare: Callable[[Path], Callable[[], object]]) -> dict[str, list[str]]:
    """Run one walk and return what it met, by name of the column."""
    import dynid

    root = str(Path(dynid.__file__).parent)
    files, functions, handed, held = set(), set(), set(), set()

    def own(value: object) -> Iterator[str]:
        kind = type(value)
        if kind.__module__.startswith("dynid"):
            yield f"{kind.__module__}.{kind.__qualname__}"

    def profile(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if (
            event not in ("call", "return")
            or not code.co_filename.startswith(root)
            or code.co_name == "<module>"
        ):
            return
        types = handed if event == "call" else held
        for value in frame.f_locals.values():
            types.update(own(value))
        files.add(code.co_filename[len(root) + 1 :])
        functions.add(f"{code.co_filename[len(root) + 1 :]}:{code.co_qualname}")

    with tempfile.TemporaryDirectory() as name:
        walk = prepare(Path(name))
        threading.setprofile(profile)
        sys.setprofile(profile)
        try:
            walk()
        finally:
            sys.setprofile(None)
            threading.setprofile(None)  # type: ignore[arg-type]
    return dict(zip(COLUMNS, map(sorted, (files, functions, handed, held | handed)), strict=True))


# ---------------------------------------------------------------- the code
def is_number(node: ast.AST) -> bool:
    """Return whether a node is a number that is written out, or made of such numbers."""
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float | complex) and not isinstance(node.value, bool)
    if isinstance(node, ast.UnaryOp):
        return is_number(node.operand)
    if isinstance(node, ast.BinOp):
        return all(is_number(each) or is_constant(each) for each in (node.left, node.right))
    return isinstance(node, ast.Tuple) and bool(node.elts) and all(map(is_number, node.elts))


def is_constant(node: ast.AST) -> bool:
    """Return whether a node is the name of a constant."""
    name = (
        node.id
        if isinstance(node, ast.Name)
        else node.attr
        if isinstance(node, ast.Attribute)
        else ""
    )
    return name.isupper()


def constants(tree: ast.Module) -> Iterator[str]:
    """Yield the names in capitals that a module binds to numbers."""
    for node in tree.body:
        targets = (
            node.targets
            if isinstance(node, ast.Assign)
            else [node.target]
            if isinstance(node, ast.AnnAssign)
            else []
        )
        pairs: list[tuple[ast.AST, ast.AST | None]] = [
            (target, getattr(node, "value", None)) for target in targets
        ]
        for target, value in pairs:
            if isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple):
                pairs += zip(target.elts, value.elts, strict=False)
            elif (
                isinstance(target, ast.Name)
                and target.id.isupper()
                and value is not None
                and is_number(value)
            ):
                yield target.id


def literals(tree: ast.Module) -> int:
    """Count the numbers in bodies of functions, but for -1, 0, 1 and 2."""
    inside: set[ast.AST] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            inside.update(each for statement in node.body for each in ast.walk(statement))
    return sum(
        isinstance(n, ast.Constant) and is_number(n) and n.value not in (0, 1, 2) for n in inside
    )


def size() -> dict[str, int]:
    """Return figures of the whole source."""
    import dynid

    files = sorted(Path(dynid.__file__).parent.rglob("*.py"))
    trees = [ast.parse(path.read_text()) for path in files]
    return {
        "files": len(files),
        "lines": sum(len(path.read_text().splitlines()) for path in files),
        "classes": sum(isinstance(node, ast.ClassDef) for tree in trees for node in ast.walk(tree)),
        "named numeric constants of modules": sum(1 for tree in trees for _ in constants(tree)),
        "of these in a tuning.py": sum(
            1
            for path, tree in zip(files, trees, strict=True)
            if path.name == "tuning.py"
            for _ in constants(tree)
        ),
        "numbers in functions other than -1, 0, 1, 2": sum(map(literals, trees)),
    }


# ---------------------------------------------------------------- the table
def figures() -> dict[str, dict[str, int]]:
    """Return all figures of the code as it is."""
    found = {"src": size()}
    for name in WALKS:
        words = [sys.executable, __file__, "--walk", name]
        met = json.loads(
            subprocess.run(
                words, check=True, stdout=subprocess.PIPE, text=True
            ).stdout.splitlines()[-1]
        )
        found[name] = {column: len(met[column]) for column in COLUMNS}
    return found


def page(kept: dict[str, Any]) -> str:
    """Return the page of all columns that are kept."""
    lines = [
        "# What a person meets who follows one job through the code",
        "",
        (__doc__ or "").split("\n\n")[-1].strip(),
    ]
    lines += [
        "",
        f"| | | {' | '.join(kept)} |",
        f"| --- | --- | {' | '.join('--:' for _ in kept)} |",
    ]
    for name, rows in next(iter(kept.values())).items():
        for i, row in enumerate(rows):
            cells = " | ".join(
                f"{record[name][row]:,}".replace(",", " ") for record in kept.values()
            )
            lines.append(f"| {'' if i else name} | {row} | {cells} |")
    return "\n".join(lines)


def main() -> None:
    """Trace, keep, print."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--walk", choices=WALKS, help="print what one walk meets, as JSON")
    parser.add_argument("--record", help="name of the column that is kept")
    parser.add_argument("--page", action="store_true", help="print the page of what is kept")
    given = parser.parse_args()
    if given.walk:
        print(json.dumps(traced(WALKS[given.walk])))
        return
    kept = json.loads(KEPT.read_text()) if KEPT.is_file() else {}
    if not given.page:
        now = figures()
        if given.record:
            kept[given.record] = now
            KEPT.write_text(json.dumps(kept, indent=1) + "\n")
        else:
            kept = {"now": now}
    print(page(kept))


if __name__ == "__main__":
    main()
