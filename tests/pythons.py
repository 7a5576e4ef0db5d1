"""Install dynid with every Python that is here and run the demo, a plan and a search for a gap with it.

Run by ``make test-pythons``; ``--write FILE`` writes the table. PyBullet is installed where it has a wheel only, so the
newer Pythons show what works without it. Wheels come from pip's cache after the first time; dynid's own is built once.
Seconds are those of the processor, which other work on the machine hardly changes.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
VERSIONS = ("3.10", "3.11", "3.12", "3.13")
#: A step that takes longer than this has failed [s].
PATIENCE = 1800.0
PLAN = (
    "--seconds",
    "60",
    "--duration",
    "10",
    "--segments",
    "4",
    "--restarts",
    "1",
    "--preview",
    "picture",
    "--accept",
)
HEADER = "| Python | numpy | PyBullet | install | demo | plan | gap search | remark |"


@dataclass(frozen=True)
class Step:
    """One thing that must work: its words after ``dynid``, and what its folder and its standard error must show."""

    name: str
    words: tuple[str, ...]
    holds: Callable[[Path, str], bool]


def plan_is_there(folder: Path, said: str) -> bool:
    """Return whether the plan is there with a picture, accepted as what it is."""
    drawn = folder / "out" / "ur5e"
    return (drawn / "preview.png").stat().st_size > 20_000 and "reviewed: yes" in said


STEPS = (
    Step("demo", ("demo", "--no-input"), lambda folder, said: "error[" not in said),
    Step("plan", ("trajectory", "ur5e", *PLAN), plan_is_there),
    Step(
        "gap search",
        (
            "gap",
            "out/demo/kuka_lwr4plus/parameters.npz",
            "{logs}/lwr4plus_validate.bag",
            "--no-input",
        ),
        lambda _, said: "error[" not in said,
    ),
)


def interpreters() -> dict[str, str]:
    """Return the Pythons that are on the path or came with pyenv, by version."""
    found: dict[str, str] = {}
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for version in VERSIONS:
        candidates = [
            shutil.which(f"python{version}"),
            *sorted(pyenv.glob(f"{version}.*/bin/python")),
        ]
        for candidate in filter(None, candidates):
            words = [candidate, "-c", "import ensurepip, sys, venv; print('Python', sys.version)"]
            asked = subprocess.run(words, capture_output=True, text=True, check=False)
            if asked.returncode == 0 and re.match(rf"Python {re.escape(version)}\.", asked.stdout):
                found[version] = str(candidate)
                break
    return found


def tried(words: list[str], folder: Path) -> tuple[float, int, str]:
    """Return how long a command kept the processor busy [s], its exit status and what it said."""
    begin = processor()
    clean = {
        key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")
    }
    try:
        done = subprocess.run(
            words,
            cwd=folder,
            env=clean | {"PIP_DISABLE_PIP_VERSION_CHECK": "1", "HOME": str(folder)},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return PATIENCE, -1, f"took longer than {PATIENCE:g} s"
    return processor() - begin, done.returncode, done.stdout + done.stderr


def processor() -> float:
    """Return the processor time of all processes that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def built(folder: Path, interpreter: str) -> Path:
    """Return the wheel of this dynid."""
    words = [
        interpreter,
        "-m",
        "pip",
        "wheel",
        "--quiet",
        "--no-deps",
        "--wheel-dir",
        str(folder),
        str(ROOT),
    ]
    subprocess.run(words, check=True)
    (wheel,) = folder.glob("dynid-*.whl")
    return wheel


def version_of(python: Path, package: str) -> str:
    """Return the version of an installed package, or a dash."""
    code = f"import importlib.metadata as m; print(m.version({package!r}))"
    asked = subprocess.run([str(python), "-c", code], capture_output=True, text=True, check=False)
    return asked.stdout.strip() or "-"


def shipped_logs(python: Path) -> str:
    """Return the folder of the logs that came with the installed dynid."""
    code = "from dynid.files import packaged; print(packaged('trajectories'))"
    return subprocess.run(
        [str(python), "-c", code], capture_output=True, text=True, check=False
    ).stdout.strip()


def measure(version: str, interpreter: str, wheel: Path) -> dict[str, str]:
    """Return the row of one Python."""
    with tempfile.TemporaryDirectory(prefix=f"python{version}-") as name:
        folder = Path(name)
        python = folder / "venv" / "bin" / "python"
        row = {"Python": version}
        subprocess.run([interpreter, "-m", "venv", str(folder / "venv")], check=True)
        cache = subprocess.run(
            [str(python), "-m", "pip", "cache", "dir"], capture_output=True, text=True, check=True
        )
        install = [
            str(python),
            "-m",
            "pip",
            "install",
            "--quiet",
            "--no-compile",
            "--cache-dir",
            cache.stdout.strip(),
        ]
        install.append(str(wheel))
        seconds, status, said = tried(install, folder)
        row |= {name: version_of(python, name) for name in ("numpy", "pybullet")}
        row["install"] = f"{seconds:.0f} s" if status == 0 else "FAILED"
        row["remark"] = "" if status == 0 else said.strip().splitlines()[-1]
        for step in STEPS if status == 0 else ():
            words = [word.replace("{logs}", shipped_logs(python)) for word in step.words]
            seconds, status, said = tried([str(python), "-m", "dynid", *words], folder)
            fine = status == 0 and step.holds(folder, said)
            row[step.name] = f"{seconds:.0f} s" if fine else "FAILED"
            if not fine:
                row["remark"] += f"{step.name}: status {status}; {said[-1500:]}"
            elif "W605" in said:
                row["remark"] += "plan measured on capsules, drawn with Matplotlib"
        return row


def main() -> None:
    """Try every Python, print the table, and end with 1 when something failed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", type=Path, help="file for the table")
    parser.add_argument("--only", nargs="*", help="versions, such as 3.13")
    parser.add_argument("--store", type=Path, help="JSON of rows measured before, to go on with")
    given = parser.parse_args()
    rows = json.loads(given.store.read_text()) if given.store and given.store.is_file() else {}
    found = {
        v: path
        for v, path in interpreters().items()
        if (not given.only or v in given.only) and v not in rows
    }
    with tempfile.TemporaryDirectory() as name:
        wheel = built(Path(name), next(iter(found.values()))) if found else Path()
        for version, interpreter in found.items():
            rows[version] = measure(version, interpreter, wheel)
            print(json.dumps(rows[version]), flush=True)  # noqa: T201
            if given.store:
                given.store.write_text(json.dumps(rows))
    cells = ("Python", "numpy", "pybullet", "install", "demo", "plan", "gap search", "remark")
    lines = [HEADER, "|" + " --- |" * len(cells)]
    lines += [
        "| " + " | ".join(rows[v].get(cell, "-") or " " for cell in cells) + " |"
        for v in sorted(rows)
    ]
    intro = "# Current Pythons\n\n`make test-pythons` installs dynid with every Python that is there and runs it. "
    intro += "Seconds are those of the processor.\n\n"
    if given.write:
        given.write.write_text(intro + "\n".join(lines) + "\n")
    print("\n".join(lines))  # noqa: T201
    missing = [version for version in VERSIONS if version not in rows]
    if missing:
        print(f"not here: Python {', '.join(missing)}")  # noqa: T201
    sys.exit(any("FAILED" in row.values() for row in rows.values()))


if __name__ == "__main__":
    main()
