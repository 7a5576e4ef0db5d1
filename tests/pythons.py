"""Install dynid with every Python that is here and run the demo, a plan and a search for a gap with it.

Run by ``make test-pythons``. PyBullet is installed where it has a wheel only, so the newer Pythons show what works
without it. Wheels come from pip's cache after the first time; dynid's own is built once. Seconds are those of the
processor, which other work on the machine hardly changes.
"""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
VERSIONS = ("3.10", "3.11", "3.12", "3.13")
LOGS = "from dynid.files import packaged; print(packaged('trajectories'))"
PLAN = "trajectory ur5e --seconds 60 --duration 10 --segments 4 --restarts 1 --preview picture --accept"
GAP = "gap out/demo/kuka_lwr4plus/parameters.npz {}/lwr4plus_validate.bag --no-input"


def interpreter(version):
    """Return the Python of a version that is on the path or came with pyenv, "" where there is none."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    here = [shutil.which(f"python{version}"), *sorted(pyenv.glob(f"{version}.*/bin/python"))]
    works = ("-c", "import ensurepip, sys, venv; print(*sys.version_info[:2], sep='.')")
    for candidate in filter(None, here):
        asked = subprocess.run([candidate, *works], capture_output=True, text=True, check=False)
        if asked.stdout.strip() == version:
            return str(candidate)
    return ""


def ran(folder, *words):
    """Return what a command says that ends well and finds no mistake, within half an hour."""
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(
        list(map(str, words)),
        cwd=folder,
        env=clean | {"PIP_DISABLE_PIP_VERSION_CHECK": "1", "HOME": str(folder)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=1800.0,
        check=False,
    )
    if done.returncode or "error[" in done.stdout:
        sys.exit(f"{' '.join(map(str, words))}: status {done.returncode}\n{done.stdout[-1500:]}")
    return done.stdout


def measure(version, wheel):
    """Install with one Python, run everything, and print a row; a plan has its picture and was accepted."""
    with tempfile.TemporaryDirectory(prefix=f"python{version}-") as name:
        folder, row = Path(name), [version]
        python = folder / "venv" / "bin" / "python"
        subprocess.run([interpreter(version), "-m", "venv", folder / "venv"], check=True)
        cache = subprocess.check_output([python, "-m", "pip", "cache", "dir"], text=True).strip()
        install = f"pip install --quiet --no-compile --cache-dir {cache} {wheel}"
        for line in (install, "dynid demo --no-input", f"dynid {PLAN}", f"dynid {GAP}"):
            if line.startswith("dynid gap"):
                line = line.format(ran(folder, python, "-c", LOGS).strip())
            begin = sum(os.times()[2:4])
            text = ran(folder, python, "-m", *line.split())
            row.append(f"{sum(os.times()[2:4]) - begin:.0f} s")
            if "trajectory" in line:
                picture = folder / "out" / "ur5e" / "preview.png"
                assert picture.stat().st_size > 20_000
                assert "reviewed: yes" in text
                row[0] += ", no PyBullet" * ("W605" in text)
        print("| " + " | ".join(row) + " |", flush=True)  # noqa: T201


def main():
    """Try every Python that is here; what fails ends it with a message."""
    here = [version for version in VERSIONS if interpreter(version)]
    print("| Python | install | demo | plan | gap search |\n|" + " --- |" * 5)  # noqa: T201
    with tempfile.TemporaryDirectory() as name:
        build = f"-m pip wheel --quiet --no-deps --wheel-dir {name} {ROOT}"
        subprocess.run([interpreter(here[0]), *build.split()], check=True)
        (wheel,) = Path(name).glob("dynid-*.whl")
        for version in here:
            measure(version, wheel)
    print("not here: Python", ", ".join(set(VERSIONS) - {*here}) or "none")  # noqa: T201


if __name__ == "__main__":
    main()
