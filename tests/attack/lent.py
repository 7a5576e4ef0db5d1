"""Seeded working folders of somebody else: files in them that nobody has named, and that programs often obey."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
from odd import VALUES, WHOLE

#: What would be executed; the judge looks for the file.
PROGRAM = "#!/bin/sh\ntouch HACKED\n"
MODULE = "open('HACKED', 'w').close()\n"
PLACES = (
    "/tmp/lent",
    "../lent",
    "~/lent",
    "link/lent",
    "out/../../lent",
    "tcp://127.0.0.1:1",
    "http://127.0.0.1:1/x",
    "s3://b/x.npz",
    "out/x",
    "said",
    "x.csv",
)


def _settings(rng: np.random.Generator, command: str) -> dict[str, object]:
    """Return keys of a configuration file, for every command and for one, with odd values and places outside."""
    import importlib

    from dynid.cli.main import module_of
    from dynid.cli.options import COMMON_NAMES, key_of

    params = [
        param
        for param in importlib.import_module(module_of(command)).command.params
        if param.opts[0][0] == "-"
    ]
    found: dict[str, object] = {}
    for _ in range(rng.integers(1, 4)):
        key = key_of(params[rng.integers(len(params))])
        pool = PLACES if rng.random() < 0.5 else VALUES
        value: object = pool[rng.integers(len(pool))].replace("\0", "")
        value = [value, value] if rng.random() < 0.1 else True if rng.random() < 0.2 else value
        if key in COMMON_NAMES:
            found[key] = value
        else:
            own = found.setdefault(command, {})
            assert isinstance(own, dict)
            own[key] = value
    return found


def folders(rng: np.random.Generator, folder: Path) -> list[str]:
    """Return a command line that works, and put files beside its inputs that may change what it does."""
    words = WHOLE[rng.integers(len(WHOLE))].split()
    (folder / "link").symlink_to("/tmp")
    for _ in range(rng.integers(1, 3)):
        kind = rng.integers(0, 8)
        if kind <= 2:
            (folder / "dynid.yaml").write_text(json.dumps(_settings(rng, words[0])))
        elif kind == 3:
            (folder / "given.yaml").write_text(json.dumps(_settings(rng, words[0])))
            words += ["--config", "given.yaml"]
        elif kind == 4:
            found = _settings(rng, "identify")
            own = found.get("identify", {})
            assert isinstance(own, dict)
            options = [
                f"--{key.replace('_', '-')}={value}"
                for key, value in {**found, **own}.items()
                if key != "identify"
            ]
            stored = {"identify": {"arguments": ["arm.yaml", "log.npz", "--out", "out", *options]}}
            (folder / "out" / "run.yaml").write_text(json.dumps(stored))
            words = ["identify", "--from", "out/run.yaml"]
        elif kind == 5:
            name = str(
                rng.choice(
                    [
                        "cc",
                        "gcc",
                        "as",
                        "ld",
                        "octave-cli",
                        "latex",
                        "dvipng",
                        "xdg-open",
                        "ros2",
                        "python3",
                        "git",
                        "sh",
                    ]
                )
            )
            (folder / name).write_text(PROGRAM)
            (folder / name).chmod(0o755)
            os.environ["PATH"] = f".:{os.environ['PATH']}"
        elif kind == 6:
            name = str(
                rng.choice(
                    [
                        "numpy",
                        "yaml",
                        "scipy",
                        "matplotlib",
                        "sitecustomize",
                        "usercustomize",
                        "pybullet",
                        "dynid",
                        "click",
                        "six",
                        "rospy",
                    ]
                )
            )
            (folder / f"{name}.py").write_text(MODULE)
        else:
            (folder / "robots").mkdir(exist_ok=True)
            for name in ("kinova_gen2", "swing", "arm"):
                text = (
                    (folder / "arm.yaml")
                    .read_text()
                    .replace("velocity: 4", f"velocity: {VALUES[rng.integers(len(VALUES))]!r}")
                )
                (folder / "robots" / f"{name}.yaml").write_text(text)
            words = [
                word.replace("arm.yaml", "kinova_gen2") if rng.random() < 0.3 else word
                for word in words
            ]
    return words


def completions(rng: np.random.Generator, folder: Path) -> list[str]:
    """Return words of a command line that is not finished; the folder may hold settings that are wrong."""
    words = WHOLE[rng.integers(len(WHOLE))].split()[: int(rng.integers(0, 5))]
    if rng.random() < 0.5:
        (folder / "dynid.yaml").write_text(
            json.dumps(_settings(rng, words[0] if words else "check"))
        )
    extra = str(
        rng.choice(
            [
                "",
                "-",
                "--",
                "--o",
                "identfy",
                "'",
                '"',
                "\\",
                "\x1b[31m",
                "x" * 5000,
                "--config",
                "--from",
            ]
        )
    )
    return [*words, extra]
