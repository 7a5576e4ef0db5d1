"""Seeded command lines: options with values that nobody would give, and paths to what is no file."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from mutate import WORDS

#: Commands that work, which odd options and odd paths are put into; {out} is the folder of results.
WHOLE = (
    "model arm.yaml --out out",
    "trajectory arm.yaml plan.yaml --preview none --out out",
    "trajectory arm.yaml --out out --preview none --seconds 1",
    "parameters arm.yaml log.npz --out out --no-identify",
    "identify arm.yaml log.npz --out out",
    "identify arm.yaml log.bag --out out",
    "validate out/parameters.npz other.npz --out out",
    "gap out/parameters.npz other.npz --no-apply --out out",
    "check arm.yaml log.csv",
    "check log.mcap",
    "convert log.db3 --to out/x.mcap",
    "convert log.npz --to out/x.parquet",
    "convert log.csv --to out/x.db3",
    "import arm.urdf --out out/a.yaml",
    "compare out/parameters.npz out/parameters.npz",
    "run batch.yaml --out out",
    "report out",
    "export out/parameters.npz --format urdf",
    "export out/parameters.npz --format python",
    "simulate arm.yaml out/trajectory.npz --out out",
    "record arm.yaml out/trajectory.npz --dry-run --out out",
    "doctor",
    "explain E201",
    "completion bash",
    "identify arm.yaml text --out out",
    "identify arm.yaml log.parquet --out out",
    "sim-driver arm.yaml --duration 1",
    "gap out/parameters.npz other.npz --apply best --new-name out/named.yaml --out out",
    "explain robot-file",
    "model arm.yaml -v --out out",
    "identify --from out/run.yaml --out out",
    "identify arm.yaml log.npz --update out/parameters.npz --out out",
)
VALUES = (
    "0",
    "-1",
    "1",
    "2",
    "nan",
    "inf",
    "-inf",
    "1e308",
    "1e400",
    "1e-308",
    "-0.0",
    "1e-9",
    "99999999999999999999",
    "9" * 4500,
    "0.5",
    "50%",
    "-5%",
    "150%",
    "nan%",
    "1e400%",
    "0-1",
    "1-0",
    "0-1e308",
    "nan-nan",
    "5",
    "auto",
    "none",
    "off",
    "best",
    "all",
    "all@shoulder",
    "coulomb@9",
    "1,2",
    "1,2,3",
    "0,0,nan",
    "1e200,1e200,1e200",
    "0,0,-9.81",
    ",",
    ",,,",
    "=",
    "x=",
    "=x",
    "a=b",
    "link1=0:1",
    "1=1:2",
    "1=2:1",
    "0:1",
    "1:0",
    "nan:nan",
    ":",
    "1:2:3",
    "shoulder",
    "lower",
    "lower=0,0,0:1,1,1",
    "samples=1e99",
    "samples=1",
    "samples=nan",
    "yaml_bytes=10",
    "archive_bytes=1",
    "nesting=1e9",
    "max_rms_nm > 1",
    "max_rms_nm > nan",
    "__import__('os').system('touch HACKED') > 1",
    "x > y > z",
    "arm.yaml",
    "log.npz",
    "out",
    "out/parameters.npz",
    "plan.yaml",
    "arm.urdf",
    "settings.yaml",
    "missing/x",
    ".",
    "..",
    "",
    " ",
    "-",
    "--",
    "\n",
    "'",
    '"',
    "http://localhost:1",
    "0:0",
    "0:5",
    "quintic",
    "fourier",
    "wls",
    "iv",
    "didim",
    "physical",
    "plain",
    "T",
    "/joint_states",
    "tcp://x",
    "²",
    "١",
    "0x10",
    "1_000",
    "+5",
    "true",
    "5 Hz",
    "10 deg",
)


def options(rng: np.random.Generator) -> list[str]:
    """Return a command line with one to three options of the command, or of another, set to odd values."""
    import importlib

    import click

    from dynid.cli.main import module_of

    words = WHOLE[rng.integers(len(WHOLE))].split()
    command = importlib.import_module(module_of(words[0])).command
    switches = [param for param in command.params if isinstance(param, click.Option)]
    own = [
        param
        for param in switches
        if param.name not in ("debug", "help", "open_", "limit", "config", "log_file")
    ]
    for _ in range(rng.integers(1, 4)):
        param = (
            own[rng.integers(len(own))]
            if rng.random() < 0.9
            else switches[rng.integers(len(switches))]
        )
        name = str(rng.choice([*param.opts, *param.secondary_opts]))
        if name in ("--color", "--debug", "--open", "-h", "--help", "--version", "--self-test"):
            continue
        value = (
            WORDS[rng.integers(len(WORDS))]
            if rng.random() < 0.15
            else VALUES[rng.integers(len(VALUES))]
        )
        value = value.replace("\0", "")
        if getattr(param.type, "choices", None) and rng.random() < 0.7:
            value = str(rng.choice(list(param.type.choices)))
        # Why: a result may go where its user says; the judge looks for files outside the folder out/.
        if any(word in (param.metavar or "") for word in ("FILE", "DIR", "CSV")) or param.name in (
            "out",
            "csv",
            "latex",
            "junit",
            "to",
            "sent",
        ):
            value = str(
                rng.choice(
                    ["out/x", "out", "out/x/y.yaml", "out/pipe", "arm.yaml/x", "out/" + "a" * 300]
                )
            )
        words += (
            [name]
            if param.is_flag or param.count
            else [name, value]
            if rng.random() < 0.95
            else [name]
        )
    if rng.random() < 0.1:
        del words[int(rng.integers(0, len(words)))]
    if rng.random() < 0.1:
        # Why not behind a place to write to: the judge looks for files outside the folder out/.
        free = [
            at
            for at in range(1, len(words) + 1)
            if words[at - 1] not in ("--out", "--to", "--new-name")
        ]
        words.insert(free[rng.integers(len(free))], VALUES[rng.integers(len(VALUES))])
    return words


def places(rng: np.random.Generator, folder: Path) -> list[str]:
    """Return a command line of which one path leads to something that is no such file, and make that."""
    words = WHOLE[rng.integers(len(WHOLE))].split()
    paths = [i for i, word in enumerate(words) if i and ("." in word or word in ("out", "text"))]
    if not paths:
        return words
    at = paths[rng.integers(len(paths))]
    place = folder / words[at]
    kind = rng.integers(0, 16)
    hidden = folder / f"real{place.suffix}"
    if words[at] == "out" or words[at - 1] in ("--out", "--to"):
        hidden = folder / "out" / "elsewhere"
    if place.is_dir() and kind not in (8, 9):
        kind = 14
    if kind == 0:
        place.unlink(missing_ok=True)
    elif kind <= 2:
        place.unlink(missing_ok=True)
        place.mkdir(parents=True) if kind == 1 else os.mkfifo(place)
    elif kind == 3:
        place.unlink(missing_ok=True)
        place.symlink_to(place)
    elif kind == 4:
        place.unlink(missing_ok=True)
        place.symlink_to(
            rng.choice(
                [
                    "/dev/zero",
                    "/dev/full",
                    "/dev/null",
                    "/dev/random",
                    "/dev/tty",
                    "/proc/self/mem",
                    "/proc/kmsg",
                    "/proc/self/fd/0",
                ]
            )
        )
    elif kind == 5:
        place.write_bytes(b"")
    elif kind == 6:
        place.write_bytes(bytes(int(rng.choice([1, 4096, 3 << 20]))))
    elif kind == 7:
        with place.open("wb") as stream:
            stream.truncate(1 << 40)
    elif kind == 8 and words[at - 1] not in ("--out", "--to", "out"):
        # Why not as an output: the tests may run as root, and the machine needs its devices.
        words[at] = str(
            rng.choice(
                [
                    "/dev/zero",
                    "/dev/full",
                    "/dev/stdin",
                    "/proc/self/environ",
                    "/",
                    "/etc/passwd/x",
                    "",
                    "a" * 5000,
                    "~/x",
                    "-",
                    "\x1b[31m.npz",
                    "a\nb.csv",
                    "\udcff.npz",
                    "x.npz\u202e",
                ]
            )
        )
        if words[at] == "/proc/self/environ":
            words[at] = "/proc/version"
    elif kind == 9:
        words[at] = f"./{words[at]}/" if rng.random() < 0.5 else f"../work/./out/../{words[at]}"
    elif kind == 10:
        other = folder / str(
            rng.choice(
                [
                    "arm.yaml",
                    "log.csv",
                    "log.npz",
                    "log.bag",
                    "log.mcap",
                    "log.db3",
                    "log.parquet",
                    "arm.urdf",
                    "out/parameters.npz",
                    "out/trajectory.npz",
                ]
            )
        )
        if other != place:
            place.write_bytes(other.read_bytes())
    elif kind == 11:
        place.write_bytes(rng.bytes(int(rng.choice([1, 100, 100_000]))))
    elif kind == 12 and place.is_file():
        hidden.write_bytes(place.read_bytes())
        place.unlink()
        place.symlink_to(hidden)
    elif kind == 13 and place.is_file():
        place.write_bytes(b"y" * (3 << 20) if rng.random() < 0.5 else b"\n" * (3 << 20))
    elif kind == 14 and place.is_dir():
        choice = rng.integers(0, 4)
        if choice == 0:
            (place / "loop").symlink_to(place)
        elif choice == 1:
            os.mkfifo(place / "pipe.txt")
        elif choice == 2:
            for file in sorted(place.iterdir())[:2]:
                if file.is_file():
                    file.unlink()
                    file.mkdir()
        else:
            for file in sorted(place.iterdir())[:3]:
                if file.is_file():
                    file.unlink()
                    file.symlink_to("/dev/zero")
    return words
