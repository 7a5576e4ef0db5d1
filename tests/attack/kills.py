"""Kill commands at random moments: whole results or none, no litter after the next run, no child alive.

    python tests/attack/kills.py [--count 200] [--first 0] [--json FILE]

Each kill takes a fresh folder, lets a command run for a random part of the time that it needs, sends SIGKILL, SIGTERM or
SIGINT, looks at what is there, and runs the command again.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import xml.etree.ElementTree as ET
import zipfile
from collections import Counter
from pathlib import Path

import inputs
import numpy as np
import yaml

COMMANDS = (
    "model arm.yaml --out new",
    "model arm.yaml --out new --rebuild",
    "trajectory arm.yaml plan.yaml --preview none --out new",
    "trajectory arm.yaml --optimise --seconds 1 --preview none --out new",
    "trajectory arm.yaml plan.yaml --preview picture --out new",
    "parameters arm.yaml log.npz --out new --no-identify",
    "identify arm.yaml log.npz --out new",
    "identify arm.yaml log.bag --out new",
    "validate out/parameters.npz other.npz --out new",
    "gap out/parameters.npz other.npz --no-apply --out new",
    "check log.mcap --robot arm.yaml --convert --out new",
    "convert log.npz --to new/x.mcap",
    "convert log.npz --to new/x.bag",
    "convert log.npz --to new/x.csv",
    "import arm.urdf --out new/a.yaml",
    "compare out/parameters.npz --csv new/a.csv --latex new/a.tex",
    "run batch.yaml --out new",
    "report new",
    "export out/parameters.npz --format urdf --out new",
    "export out/parameters.npz --format c --out new",
    "simulate arm.yaml out/trajectory.npz --out new",
)
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
#: Variable by which processes that belong to a run are found.
MARK = "DYNID_KILLED"
#: A process that was asked to end has this long [s] of a busy machine.
PATIENCE = 60.0


def start(command: str, folder: Path, mark: str) -> subprocess.Popen[bytes]:
    """Start a command in a session of its own, with a home and a folder for temporary files inside the given one."""
    for name in ("home", "tmp"):
        (folder / name).mkdir(exist_ok=True)
    environment = {
        **os.environ,
        "HOME": str(folder / "home"),
        "TMPDIR": str(folder / "tmp"),
        MARK: mark,
        "OPENBLAS_NUM_THREADS": "1",
    }
    words = [sys.executable, "-m", "dynid", *command.split(), "--no-input", "--force", "--quiet"]

    def listening() -> None:
        # Why: whoever runs this in the background ignores interrupts, and so would what is started here.
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    return subprocess.Popen(
        words,
        cwd=folder / "work",
        env=environment,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=(folder / "stderr").open("wb"),
        start_new_session=True,
        preexec_fn=listening,
    )


def alive(mark: str) -> list[str]:
    """Return the command lines of the processes that a run started and that are still there."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            if entry.name.isdigit() and f"{MARK}={mark}".encode() in (
                entry / "environ"
            ).read_bytes().split(b"\0"):
                found.append(
                    (entry / "cmdline")
                    .read_bytes()
                    .replace(b"\0", b" ")
                    .decode(errors="replace")[:120]
                )
        except OSError:
            continue
    return found


def is_whole(path: Path) -> bool:
    """Return whether a file is one of its kind from beginning to end."""
    raw = path.read_bytes()
    try:
        if path.suffix == ".npz":
            with zipfile.ZipFile(path) as archive:
                return archive.testzip() is None
        if path.suffix in (".yaml", ".yml"):
            return yaml.load(raw, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)) is not None
        if path.suffix == ".json":
            return json.loads(raw) is not None
        if path.suffix in (".urdf", ".xml", ".svg", ".sdf"):
            return ET.fromstring(raw) is not None
    except (zipfile.BadZipFile, yaml.YAMLError, ValueError, ET.ParseError, OSError):
        return False
    ends = {
        ".html": b"</html>",
        ".png": b"IEND\xaeB`\x82",
        ".mcap": b"\x89MCAP0\r\n",
        ".gif": b";",
        ".tex": b"}",
    }
    if path.suffix in ends:
        return raw.rstrip(b"\n").endswith(ends[path.suffix]) or raw.endswith(ends[path.suffix])
    if path.suffix == ".bag":
        return (
            raw.startswith(b"#ROSBAG V2.0")
            and int.from_bytes(raw[raw.index(b"index_pos=") + 10 :][:8], "little") > 0
        )
    return raw.endswith(b"\n") or path.suffix == ".log"


def litter(folder: Path) -> list[str]:
    """Return temporary files and folders of dynid, and crash files."""
    return [
        str(path.relative_to(folder))
        for path in folder.rglob("*")
        if path.name.startswith(("dynid-", ".dynid-", "crash-", "core"))
        or (path.parent == folder / "tmp")
    ]


def broken(folder: Path) -> list[str]:
    """Return files of results that are not whole."""
    work = folder / "work"
    return [
        str(path.relative_to(work))
        for path in (work / "new").rglob("*")
        if path.is_file()
        and not any(part.startswith(".dynid-") for part in path.relative_to(work).parts)
        and not is_whole(path)
    ]


def fresh(originals: Path, folder: Path) -> Path:
    """Return a folder with inputs and, as new/, results of an earlier run."""
    shutil.copytree(originals, folder / "work")
    shutil.copytree(originals / "out", folder / "work" / "new")
    return folder


def times(originals: Path, commands: tuple[str, ...]) -> dict[str, float]:
    """Return how long each command takes when nobody stops it [s]."""
    found = {}
    for command in commands:
        with tempfile.TemporaryDirectory() as name:
            folder, begin = fresh(originals, Path(name)), time.monotonic()
            status = start(command, folder, "timed").wait()
            found[command] = time.monotonic() - begin
            assert status == 0, (command, status, (folder / "stderr").read_text())
            assert not litter(folder), (command, litter(folder))
            assert not broken(folder), (command, broken(folder))
    return found


def kill(
    command: str, seconds: float, number: int, originals: Path, seed: int
) -> tuple[float, list[str]]:
    """Kill a command at a random moment; return that moment [s] and what is wrong afterwards."""
    moment = float(np.random.default_rng([seed, 77]).uniform(0, 1.02)) * seconds
    mark, wrong = f"{os.getpid()}-{seed}", []
    with tempfile.TemporaryDirectory() as name:
        folder = fresh(originals, Path(name))
        process = start(command, folder, mark)
        time.sleep(moment)
        process.send_signal(number)
        try:
            status = process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            process.kill()
            return moment, ["it goes on"]
        # A shell tells -2 as 130 and -15 as 143: signals that came before Python could take them.
        said = (folder / "stderr").read_text()
        # Python itself ends with 1 when it is interrupted before it has come to the first line of dynid.
        before = status == 1 and "KeyboardInterrupt" in said and "dynid" not in said
        if status not in (0, -number, 130, 143) and not before:
            wrong.append(f"status {status}: {said[-300:]}")
        end = time.monotonic() + PATIENCE / 6
        while (left := alive(mark)) and time.monotonic() < end:
            time.sleep(0.05)
        wrong += [f"alive: {each}" for each in left] + [
            f"half-written: {each}" for each in broken(folder)
        ]
        if number != signal.SIGKILL:
            wrong += [f"litter: {each}" for each in litter(folder)]
        status = start(command, folder, mark).wait()
        wrong += (
            [f"run again: status {status}: {(folder / 'stderr').read_text()[-300:]}"]
            if status
            else []
        )
        wrong += [f"litter after the next run: {each}" for each in litter(folder)]
        wrong += [f"half-written after the next run: {each}" for each in broken(folder)]
    return moment, wrong


def main() -> None:
    options = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    options.add_argument("--count", type=int, default=200)
    options.add_argument("--first", type=int, default=0)
    options.add_argument("--json", type=Path, default=Path("out/kills.jsonl"))
    given = options.parse_args()
    given.json.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        base = Path(name)
        originals = base / "work"
        originals.mkdir()
        inputs.make(originals, lambda words: start(" ".join(words), base, "made").wait())
        durations: dict[str, float] = {}
        for seed in range(given.first, given.first + given.count):
            command, number = COMMANDS[seed % len(COMMANDS)], SIGNALS[seed // len(COMMANDS) % 3]
            if command not in durations:
                durations |= times(originals, (command,))
            moment, wrong = kill(command, durations[command], number, originals, seed)
            with given.json.open("a") as stream:
                stream.write(
                    json.dumps(
                        {
                            "seed": seed,
                            "command": command,
                            "signal": number.name,
                            "moment": moment,
                            "of": durations[command],
                            "wrong": wrong,
                        }
                    )
                    + "\n"
                )
    rows = [json.loads(line) for line in given.json.read_text().splitlines()]
    print("| command | killed | badly |\n| --- | --- | --- |")
    for word in dict.fromkeys(command.split()[0] for command in COMMANDS):
        mine = [row for row in rows if row["command"].split()[0] == word]
        print(f"| {word} | {len(mine)} | {sum(bool(row['wrong']) for row in mine)} |")
    print(
        f"\n{len(rows)} kills: {dict(Counter(row['signal'] for row in rows))}; badly: {sum(bool(row['wrong']) for row in rows)}"
    )
    for row in rows:
        if row["wrong"]:
            print(row)


if __name__ == "__main__":
    main()
