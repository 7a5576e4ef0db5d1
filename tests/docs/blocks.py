"""Command blocks of README and docs: found, run, compared; ``python tests/docs/blocks.py PAGE`` writes the output anew.

A fence ``console`` holds lines ``$ command`` with their output. All commands of a page run in one folder, in order, in
a shell, where ``robots`` and ``trajectories`` are those of the project. A line ``...`` stands for left out output.
Blocks with any other fence (``text``) are not run: they need an arm, ROS or a display, or they are a file.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

ROOT = Path(__file__).parents[2]
#: Recordings of a real arm, beside the project: pages that name this folder are run where it is there.
RECORDINGS = ROOT.parent / "shared" / "data" / "kuka_lwr4plus"
FENCE = re.compile(r"^```console\n(.*?)^```$", re.M | re.S)
#: What may differ between two machines: numbers, hashes, times.
VARIABLE = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?|\b[0-9a-f]{6,}\b")

#: Stages that are only shown where they take long.
PROGRESS = re.compile(
    r"(stack|read|replay|reduce|model|fit|symbolic|search|simulate|draw) +(?!derived|Newton)\S"
)


@dataclass(frozen=True)
class Command:
    line: str
    output: str


def pages():
    """README and every page that is written by hand."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]


def commands(text):
    """Return the commands of a page with the output that it shows."""
    found = []
    for block in FENCE.findall(text):
        for part in re.split(r"^\$ ", block, flags=re.M)[1:]:
            first, *rest = part.splitlines()
            more = [line[2:] for line in takewhile(lambda line: line.startswith("> "), rest)]
            output = "".join(f"{line}\n" for line in rest[len(more) :])
            found.append(Command("\n".join([first, *more]), output))
    return found


def folder_for(path, dynid="-m dynid"):
    """Make a folder as a reader has it in a clone of the project, with ``dynid`` on the path."""
    # Why a copy: what a page applies is written beside its robot file.
    shutil.copytree(ROOT / "robots", path / "robots")
    (path / "trajectories").symlink_to(ROOT / "trajectories")
    (path / "bin").mkdir()
    for name, words in (
        ("dynid", dynid),
        ("python3", ""),
        ("rosbags-convert", "-m rosbags.convert"),
    ):
        program = path / "bin" / name
        program.write_text(f'#!/bin/sh\nexec "{sys.executable}" {words} "$@"\n')
        program.chmod(0o755)
    (path / "home").mkdir()
    (path / "work").mkdir()
    for name in ("robots", "trajectories"):
        (path / name).rename(path / "work" / name)
    (path / "work" / "recordings").symlink_to(RECORDINGS)
    return path


def run(line, folder):
    """Run a command as a shell does and return (status, output with stderr in its place)."""
    env = {
        "PATH": f"{folder / 'bin'}:{os.environ['PATH']}",
        "HOME": str(folder / "home"),
        "LANG": "C.UTF-8",
        "PYTHONPATH": str(ROOT / "src"),
        "PYTHONUNBUFFERED": "1",
        "COLUMNS": "120",
        "MPLBACKEND": "agg",
    }
    done = subprocess.run(
        ["bash", "-c", line],
        cwd=folder / "work",
        env=env,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=300,
        text=True,
    )
    lines = [part.rstrip() for part in done.stdout.splitlines() if not PROGRESS.match(part)]
    return done.returncode, "".join(f"{part}\n" for part in lines)


def alike(shown, real):
    """Return whether the shown output is the real one but for numbers; ``...`` stands for any lines."""
    pattern = "".join(
        r"(.*\n)*?" if line == "..." else re.escape(line) + "\n"
        for line in masked(shown.rstrip("\n"))
    )
    return re.fullmatch(pattern, "".join(f"{line}\n" for line in masked(real))) is not None


def masked(text):
    """Return the lines of an output without numbers and the width of its columns."""
    lines = VARIABLE.sub("#", text).splitlines()
    return [re.sub(r"\s+", " ", line).strip() for line in lines]


def refreshed(text, folder):
    """Return a page with the output of its commands as it is now; blocks that leave lines out stay."""

    def block(match):
        lines = []
        for command in commands(match.group(0)):
            status, output = run(command.line, folder)
            print(f"{status} $ {command.line}", file=sys.stderr)  # noqa: T201
            keep = "..." in command.output.splitlines() and alike(command.output, output)
            typed = command.line.replace("\n", "\n> ")
            lines.append(f"$ {typed}\n{command.output if keep else output}")
        return "```console\n" + "".join(lines) + "```"

    return FENCE.sub(block, text)


if __name__ == "__main__":
    for name in sys.argv[1:]:
        with tempfile.TemporaryDirectory() as place:
            page = Path(name)
            page.write_text(refreshed(page.read_text(), folder_for(Path(place))))
            for picture in re.findall(
                r"<!-- from (\S+) -->\n!\[[^]]*\]\((\S+?)\)", page.read_text()
            ):
                shutil.copyfile(Path(place) / "work" / picture[0], page.parent / picture[1])
