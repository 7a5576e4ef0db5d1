"""Hold the code to its budget: tokens by folder, imports inside functions, circles, long functions.

    python .ci/budget.py            # the table; exit status 1 above a budget, or well below it
    python .ci/budget.py --lower    # write the figures that are lower now into pyproject.toml

A token is what Python's tokenizer returns without comments, docstrings and line breaks: packed lines
and missing documentation lower no figure. Circles are those of all imports of own modules, inside
functions and for type checkers too. A folder that has become smaller lowers its budget in the same
commit, so one that is well below it fails as well.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

try:
    import tomllib
except ImportError:  # Python 3.10
    import tomli as tomllib

ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "src" / "dynid"
#: Tokens that no reader reads.
LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
#: Lines that a function may have without its docstring.
LONG = 50
#: How far below its budget a figure may be before the budget must be lowered: this share of it, and this many at least.
SLACK, LEAST = 0.01, 150


@dataclass
class Count:
    """What was counted: tokens by folder, imports inside functions, circles of modules, long functions."""

    tokens: Counter[str] = field(default_factory=Counter)
    lazy: int = 0
    circles: list[list[str]] = field(default_factory=list)
    long: dict[str, int] = field(default_factory=dict)


def docstring(node: ast.AST) -> ast.Constant | None:
    """Return the docstring of a module, class or function that has one."""
    if isinstance(node, (ast.Module, ast.ClassDef, *FUNCTION)) and ast.get_docstring(node):
        return node.body[0].value
    return None


def tokens(source: str, tree: ast.AST) -> int:
    """Count the tokens of code in a file."""
    doc = {found.lineno for node in ast.walk(tree) if (found := docstring(node))}
    return sum(
        token.type not in LAYOUT and not (token.type == tokenize.STRING and token.start[0] in doc)
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
    )


def functions(tree: ast.AST, above: str = "") -> Iterator[tuple[str, ast.AST]]:
    """Yield functions with their qualified names."""
    for node in ast.iter_child_nodes(tree):
        named = isinstance(node, (ast.ClassDef, *FUNCTION))
        name = f"{above}.{node.name}" if named else above
        if isinstance(node, FUNCTION):
            yield name.lstrip("."), node
        yield from functions(node, name)


def length(function: ast.AST) -> int:
    """Count the lines of a function without its docstring."""
    doc = docstring(function)
    return (
        function.end_lineno - function.lineno + 1 - (doc.end_lineno - doc.lineno + 1 if doc else 0)
    )


def imported(tree: ast.AST, modules: set[str]) -> Iterator[str]:
    """Yield the own modules that a file imports anywhere in it; imports are absolute here."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in modules else node.module


def circles(edges: dict[str, set[str]]) -> list[list[str]]:
    """Return the sets of modules that reach each other, by what each one reaches."""

    def reached(start: str) -> set[str]:
        seen: set[str] = set()
        todo = [start]
        while todo:
            new = edges[todo.pop()] - seen
            seen |= new
            todo.extend(new)
        return seen

    reach = {name: reached(name) for name in edges}
    alike = {frozenset(b for b in reach[a] if a in reach[b]) for a in edges if a in reach[a]}
    return sorted(sorted(circle) for circle in alike)


def count() -> Count:
    """Count the package by folder, and tests and benchmarks as one each."""
    found = Count()
    for folder in ("tests", "benchmarks"):
        for path in sorted((ROOT / folder).rglob("*.py")):
            source = path.read_text(encoding="utf-8")
            found.tokens[folder] += tokens(source, ast.parse(source))
    trees = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        source = path.read_text(encoding="utf-8")
        parts = path.relative_to(PACKAGE.parent).with_suffix("").parts
        name = ".".join(parts).removesuffix(".__init__")
        tree = trees[name] = ast.parse(source)
        found.tokens["dynid/" + parts[1] if len(parts) > 2 else "dynid"] += tokens(source, tree)
        for function, node in functions(tree):
            found.lazy += sum(
                isinstance(inner, ast.ImportFrom) and (inner.module or "").startswith("dynid")
                for inner in ast.walk(node)
            )
            if (lines := length(node)) > LONG:
                found.long[f"{name}:{function}"] = lines
    modules = set(trees)
    edges = {
        name: {n for n in imported(tree, modules) if n in modules and n != name}
        for name, tree in trees.items()
    }
    found.circles = circles(edges)
    return found


def figures(found: Count) -> dict[str, int]:
    """Return every figure that has a budget."""
    package = sum(n for folder, n in found.tokens.items() if folder.startswith("dynid"))
    return {
        **dict(sorted(found.tokens.items())),
        "package": package,
        "imports inside functions": found.lazy,
        "modules in circles": sum(map(len, found.circles)),
    }


def complaints(now: dict[str, int], budget: dict[str, int]) -> Iterator[str]:
    """Say what is above its budget, well below it, or has none."""
    for name in now.keys() | budget.keys():
        have, most = now.get(name, 0), budget.get(name)
        if most is None:
            yield f"{name}: {have:,} and no budget; a new folder takes its tokens from another one"
        elif have > most:
            yield f"{name}: {have:,} are {have - most:,} above the budget of {most:,}"
        elif have < most - max(SLACK * most, LEAST if most > 10 * LEAST else 0):
            yield f"{name}: {have:,}; lower its budget of {most:,} in this commit (--lower)"


def lowered(text: str, now: dict[str, int], long: dict[str, int]) -> str:
    """Return pyproject.toml with budgets that are no higher than before."""
    for name, have in now.items():
        line = re.compile(rf'^("{re.escape(name)}" = )(\d+)$', re.M)
        text = line.sub(lambda match, have=have: f"{match[1]}{min(have, int(match[2]))}", text)
    still = [
        line
        for line in re.findall(r'^    "(dynid[\w.]*:[\w.]+)",\n', text, re.M)
        if line not in long
    ]
    for name in still:
        text = text.replace(f'    "{name}",\n', "")
    return text


def main() -> int:
    """Print the table and what is wrong with it."""
    path = ROOT / "pyproject.toml"
    found = count()
    now = figures(found)
    if "--lower" in sys.argv:
        path.write_text(
            lowered(path.read_text(encoding="utf-8"), now, found.long), encoding="utf-8"
        )
    house = tomllib.loads(path.read_text(encoding="utf-8"))["tool"]["house"]
    budget, allowed = house["budget"], set(house["long_functions"])
    print(f"{'':<26}{'now':>9}{'budget':>9}")
    for name, have in now.items():
        print(f"{name:<26}{have:>9,}{budget.get(name, 0):>9,}")
    wrong = sorted(complaints(now, budget))
    wrong += [
        f"circle: {', '.join(c)}"
        for c in found.circles
        if sum(map(len, found.circles)) > budget["modules in circles"]
    ]
    wrong += [
        f"{name}: {found.long[name]} lines, at most {LONG}"
        for name in sorted(found.long.keys() - allowed)
    ]
    wrong += [
        f"{name} is no longer too long: take it off the list"
        for name in sorted(allowed - found.long.keys())
    ]
    print(f"functions of more than {LONG} lines: {len(found.long)}")
    print(*wrong, sep="\n")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main())
