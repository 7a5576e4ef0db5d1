"""Install dynid with every Python that is here and run the demo, a plan and a search for a gap with it.

Run by ``make test-pythons``. PyBullet is installed where it has a wheel only, so the newer Pythons show what works
without it. Wheels come from pip's cache after the first time; dynid's own is built once. Seconds are those of the
processor, which other work on the machine hardly changes.
"""

from __future__ import annotations

import os
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
VERSIONS = ("3.10", "3.11", "3.12", "3.13")
#: A step that takes longer than this has failed [s].
PATIENCE = 1800.0
#: What must work, by name: the words after ``dynid``.
STEPS = {
    "demo": "demo --no-input",
    "plan": "trajectory ur5e --seconds 60 --duration 10 --segments 4 --restarts 1 --preview picture --accept",
    "gap search": "gap out/demo/kuka_lwr4plus/parameters.npz {logs}/lwr4plus_validate.bag --no-input",
}
COLUMNS = ("Python", "numpy", "pybullet", "install", *STEPS, "remark")


def interpreters() -> dict[str, str]:
    """Return the Pythons that are on the path or came with pyenv, by version."""
    found: dict[str, str] = {}
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for version in VERSIONS:
        here = [shutil.which(f"python{version}"), *sorted(pyenv.glob(f"{version}.*/bin/python"))]
        for candidate in filter(None, here):
            asked = said(candidate, "import ensurepip, sys, venv; print('Python', sys.version)")
            if re.match(rf"Python {re.escape(version)}\.", asked):
                found.setdefault(version, str(candidate))
    return found


def said(python: Path | str, code: str) -> str:
    """Return what a program prints with an interpreter."""
    words = [str(python), "-c", code]
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()


def tried(words: list[str], folder: Path) -> tuple[float, int, str]:
    """Return how long a command kept the processor busy [s], its exit status and what it said."""
    begin = processor()
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    try:
        done = subprocess.run(
            words,
            cwd=folder,
            env=clean | {"PIP_DISABLE_PIP_VERSION_CHECK": "1", "HOME": str(folder)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            timeout=PATIENCE,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return PATIENCE, -1, f"took longer than {PATIENCE:g} s"
    return processor() - begin, done.returncode, done.stdout


def processor() -> float:
    """Return the processor time of all processes that have ended [s]."""
    return sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])


def holds(step: str, folder: Path, text: str) -> bool:
    """Return whether a step did what it should: a plan has its picture and was accepted as what it is."""
    if step == "plan":
        picture = folder / "out" / "ur5e" / "preview.png"
        return picture.stat().st_size > 20_000 and "reviewed: yes" in text
    return "error[" not in text


def measure(version: str, interpreter: str, wheel: Path) -> dict[str, str]:
    """Return the row of one Python."""
    with tempfile.TemporaryDirectory(prefix=f"python{version}-") as name:
        folder = Path(name)
        python = folder / "venv" / "bin" / "python"
        subprocess.run([interpreter, "-m", "venv", folder / "venv"], check=True)
        cache = subprocess.check_output([python, "-m", "pip", "cache", "dir"], text=True).strip()
        install = f"-m pip install --quiet --no-compile --cache-dir {cache} {wheel}"
        seconds, status, text = tried([str(python), *install.split()], folder)
        row = {"Python": version, "install": f"{seconds:.0f} s", "remark": ""}
        if status:
            return row | {"install": "FAILED", "remark": text.strip().splitlines()[-1]}
        for package in ("numpy", "pybullet"):
            code = f"import importlib.metadata as m; print(m.version({package!r}))"
            row[package] = said(python, code) or "-"
        logs = said(python, "from dynid.files import packaged; print(packaged('trajectories'))")
        for step, line in STEPS.items():
            words = ["-m", "dynid", *line.format(logs=logs).split()]
            seconds, status, text = tried([str(python), *words], folder)
            fine = status == 0 and holds(step, folder, text)
            row[step] = f"{seconds:.0f} s" if fine else "FAILED"
            if not fine:
                row["remark"] += f"{step}: status {status}; {text[-1500:]}"
            elif "W605" in text:
                row["remark"] += "plan measured on capsules, drawn with Matplotlib"
        return row


def main() -> None:
    """Try every Python, print the table, and end with 1 when something failed."""
    found, rows = interpreters(), []
    print("| " + " | ".join(COLUMNS) + " |\n|" + " --- |" * len(COLUMNS))  # noqa: T201
    with tempfile.TemporaryDirectory() as name:
        build = f"-m pip wheel --quiet --no-deps --wheel-dir {name} {ROOT}"
        subprocess.run([next(iter(found.values())), *build.split()], check=True)
        (wheel,) = Path(name).glob("dynid-*.whl")
        for version, interpreter in found.items():
            rows.append(measure(version, interpreter, wheel))
            cells = (rows[-1].get(column, "-") or " " for column in COLUMNS)
            print("| " + " | ".join(cells) + " |", flush=True)  # noqa: T201
    if missing := [version for version in VERSIONS if version not in found]:
        print(f"not here: Python {', '.join(missing)}")  # noqa: T201
    sys.exit(any("FAILED" in row.values() for row in rows))


if __name__ == "__main__":
    main()
