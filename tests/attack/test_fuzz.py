"""Broken inputs of every kind: a documented status, a message, nothing executed, nothing left, within memory and time."""

from __future__ import annotations

import os
import shutil
import warnings
from pathlib import Path

import lent
import mutate
import numpy as np
import odd
import pytest
import richer
import structured
from forked import Ended, contents, faults, run
from inputs import first_seed, inputs_wanted

from dynid.cli import main

#: Kind of input: file, how it is broken, share of 5000 inputs, commands that read it.
KINDS = {
    "robot": (
        "arm.yaml",
        mutate.text,
        800,
        ["check {}", "model {} --out out", "identify {} log.csv --out out"],
    ),
    "urdf": ("arm.urdf", mutate.text, 400, ["import {} --out out/a.yaml"]),
    "csv": (
        "log.csv",
        mutate.text,
        500,
        ["check {} --robot arm.yaml", "identify arm.yaml {} --out out"],
    ),
    "text": ("text/position.txt", mutate.text, 300, ["identify arm.yaml text --out out"]),
    "bag": (
        "log.bag",
        mutate.data,
        600,
        ["check {} --robot arm.yaml", "identify arm.yaml {} --out out"],
    ),
    "log": (
        "log.npz",
        mutate.npz,
        500,
        ["identify arm.yaml {} --out out", "check {} --robot arm.yaml"],
    ),
    "plan": ("plan.yaml", mutate.text, 300, ["trajectory arm.yaml {} --preview none --out out"]),
    "batch": ("batch.yaml", mutate.text, 200, ["run {} --out out"]),
    "parameters": (
        "out/parameters.npz",
        mutate.npz,
        500,
        [
            "check {}",
            "validate {} other.npz",
            "export {} --format urdf",
            "export {} --format python",
            "report out",
            "gap {} other.npz --no-apply",
            "compare {}",
        ],
    ),
    "model": (
        "out/fullregressor.npz",
        mutate.npz,
        300,
        ["identify arm.yaml log.csv --out out", "check {}"],
    ),
    "regressor": ("out/regressor.npz", mutate.npz, 200, ["model arm.yaml --out out", "check {}"]),
    "stack": (
        "out/fullnumericregressor.npz",
        mutate.npz,
        200,
        ["identify arm.yaml --out out", "check {}", "report out"],
    ),
    "trajectory": (
        "out/trajectory.npz",
        mutate.npz,
        200,
        ["check {}", "trajectory arm.yaml --review {} --accept --preview none"],
    ),
    "robot values": (
        "arm.yaml",
        structured.document,
        500,
        [
            "check {}",
            "model {} --out out",
            "identify {} log.csv --out out",
            "gap out/parameters.npz other.npz --no-apply",
            "simulate {} out/trajectory.npz --out out",
            "trajectory {} plan.yaml --preview none --out out",
        ],
    ),
    "urdf elements": (
        "arm.urdf",
        structured.urdf,
        400,
        [
            "import {} --out out/a.yaml",
            "check {}",
            "import {} --tip lower --out out/a.yaml",
            "import {} --tip ring_a --out out/a.yaml",
            "model {} --out out",
            "identify {} log.csv --out out",
        ],
    ),
    "table": (
        "log.csv",
        structured.table,
        400,
        [
            "check {} --robot arm.yaml",
            "identify arm.yaml {} --out out",
            "check {}",
            "convert {} --to out/x.npz",
        ],
    ),
    "tsv": (
        "log.tsv",
        structured.table,
        100,
        ["check {} --robot arm.yaml", "identify arm.yaml {} --out out", "check {}"],
    ),
    "waypoints": (
        "way.csv",
        structured.table,
        100,
        ["trajectory arm.yaml --from-waypoints {} --preview none --out out"],
    ),
    "signals": (
        "log.npz",
        structured.signals,
        600,
        [
            "identify arm.yaml {} --out out",
            "check {} --robot arm.yaml",
            "validate out/parameters.npz {} --out out",
            "gap out/parameters.npz {} --no-apply --out out",
            "simulate arm.yaml {} --out out",
            "identify arm.yaml other.npz {} --out out",
            "parameters arm.yaml {} --out out --no-identify",
            "convert {} --to out/x.csv",
        ],
    ),
    "plan values": (
        "plan.yaml",
        structured.document,
        300,
        ["trajectory arm.yaml {} --preview none --out out"],
    ),
    "batch values": ("batch.yaml", structured.document, 150, ["run {} --out out"]),
    "settings": (
        "settings.yaml",
        structured.document,
        200,
        [
            "check log.npz --robot arm.yaml --config {} --out out",
            "identify arm.yaml log.npz --config {} --out out",
            "trajectory arm.yaml plan.yaml --preview none --config {} --out out",
        ],
    ),
    "store": (
        "log.db3",
        structured.store,
        300,
        [
            "check {}",
            "identify arm.yaml {} --out out",
            "check {} --robot arm.yaml",
            "convert {} --to out/x.mcap",
        ],
    ),
    "mcap": (
        "log.mcap",
        structured.mcap,
        300,
        ["check {}", "identify arm.yaml {} --out out", "check {} --robot arm.yaml"],
    ),
    "parquet": (
        "log.parquet",
        structured.parquet,
        200,
        ["check {}", "identify arm.yaml {} --out out", "check {} --robot arm.yaml"],
    ),
    "result": (
        "out/parameters.npz",
        structured.result,
        400,
        [
            "check {}",
            "validate {} other.npz",
            "export {} --format urdf",
            "export {} --format python",
            "export {} --format c",
            "export {} --format matlab",
            "export {} --format yaml",
            "export {} --format sdf",
            "export {} --format mjcf",
            "report out",
            "gap {} other.npz --no-apply",
            "compare {} {}",
            "identify arm.yaml other.npz --update {} --out out",
            "identify arm.yaml other.npz --payload-from {} --out out",
            "identify arm.yaml other.npz --payload-from {} --out out/x",
            "trajectory arm.yaml plan.yaml --earlier {} --preview none --out out",
            "trajectory arm.yaml --seconds 1 --earlier {} --preview none --out out",
            "identify arm.yaml log.npz --out out",
            "record arm.yaml out/trajectory.npz --parameters {} --dry-run --out out",
            "gap {} other.npz --apply best --new-name out/g.yaml --out out/g",
            "compare out --baseline {} --csv out/a.csv --latex out/a.tex --junit out/a.xml",
        ],
    ),
    "motion": (
        "out/trajectory.npz",
        structured.result,
        100,
        [
            "check {}",
            "trajectory arm.yaml --from-trajectory {} --preview none --out out",
            "simulate arm.yaml {} --out out",
            "record arm.yaml {} --dry-run --out out",
        ],
    ),
    "robot keys": (
        "arm.yaml",
        richer.robot_keys,
        600,
        [
            "check {}",
            "model {} --out out",
            "identify {} log.npz --out out",
            "identify {} log.csv --out out",
            "parameters {} log.npz --out out --no-identify",
            "simulate {} out/trajectory.npz --out out",
            "trajectory {} plan.yaml --preview none --out out",
            "trajectory {} --seconds 1 --preview none --out out",
            "check {} log.mcap",
            "record {} out/trajectory.npz --dry-run --out out",
            "identify {} log.npz --out out --method idim-iv",
        ],
    ),
    "spreadsheet": (
        "log.csv",
        richer.spreadsheet,
        300,
        [
            "check {}",
            "check {} --robot arm.yaml",
            "identify arm.yaml {} --out out",
            "convert {} --to out/x.npz",
            "convert {} --robot arm.yaml --to out/x.mcap",
        ],
    ),
    "batch keys": (
        "batch.yaml",
        richer.batch_keys,
        250,
        [
            "run {} --out out/b",
            "run {} --out out/b --junit out/j.xml",
            "run {} --out out/b --json-lines",
            "check {}",
        ],
    ),
    "run file": (
        "out/run.yaml",
        richer.run_file,
        150,
        [
            "model arm.yaml --out out",
            "identify --from out/run.yaml --out out",
            "report out",
            "check out",
            "compare out",
        ],
    ),
    "names": (
        "log.npz",
        richer.names,
        400,
        [
            "check {}",
            *(
                f"convert {{}} --to out/x.{suffix}"
                for suffix in ("mcap", "db3", "bag", "npz", "csv", "tsv", "parquet")
            ),
            "identify arm.yaml {} --out out",
            "check {} --robot arm.yaml",
            "validate out/parameters.npz {} --out out",
            "gap out/parameters.npz {} --no-apply --out out",
            "run batch.yaml --out out/b",
        ],
    ),
    "gap": (
        "out/gap.npz",
        mutate.npz,
        200,
        [
            "check {}",
            "report out",
            "report out",
            "trajectory arm.yaml --for-gap {} --seconds 1 --preview none --out out",
            "identify arm.yaml other.npz --out out",
        ],
    ),
    "fit": (
        "out/estimatedmotion.npz",
        structured.result,
        150,
        [
            "check {}",
            "report out",
            "validate out/parameters.npz other.npz --out out",
            "compare out",
        ],
    ),
    "validation": (
        "out/validation/other/estimatedmotion.npz",
        structured.result,
        100,
        ["check {}", "report out"],
    ),
}
ORDER = list(KINDS)
TEXT = (
    mutate.text,
    structured.document,
    structured.urdf,
    structured.table,
    richer.robot_keys,
    richer.spreadsheet,
    richer.batch_keys,
    richer.run_file,
)


#: Command lines that are odd themselves: how they are made, share of 5000 inputs.
LINES = {
    "options": (lambda rng, folder: odd.options(rng), 500),
    "places": (odd.places, 500),
    "folders": (lent.folders, 600),
}


def attempt(kind: str, seed: int, originals: Path, folder: Path) -> tuple[Ended, list[str]]:
    """Break one input as a seed says, in a copy of the originals; return how a command that reads it ended, and what is wrong with that."""
    shutil.copytree(originals, folder)
    if kind in LINES:
        rng = np.random.default_rng([seed, 100 + list(LINES).index(kind)])
        words = [*LINES[kind][0](rng, folder), "--no-input", "--force"]
    else:
        file, broken, _, commands = KINDS[kind]
        rng = np.random.default_rng([seed, ORDER.index(kind)])
        original = (originals / file).read_bytes()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = broken(rng, original.decode() if broken in TEXT else original)
        mutate.write(folder / file, content)
        words = [*commands[rng.integers(len(commands))].replace("{}", file).split(), "--no-input"]
        # Why not always: without it a result that is there is read, and compared with what would be made.
        words += ["--force"] if rng.random() < 0.8 else []
        words += ["--json"] if rng.random() < 0.3 else []
    before = contents(folder)
    ended = run(words, folder)
    return ended, faults(ended, folder, before)


def told(seed: int, ended: Ended, found: list[str]) -> str:
    return f"seed {seed}: dynid {' '.join(ended.words)}: {found}\n{ended.err[-600:]}"


@pytest.mark.parametrize("kind", [*KINDS, *LINES])
def test_a_broken_input_is_answered_as_documented(kind, originals, tmp_path):
    count, bad = inputs_wanted(KINDS[kind][2] if kind in KINDS else LINES[kind][1]), []
    for seed in range(first_seed(), first_seed() + count):
        ended, found = attempt(kind, seed, originals, tmp_path / str(seed) / "work")
        if found:
            bad.append(told(seed, ended, found))
        else:
            shutil.rmtree(tmp_path / str(seed))
    assert not bad, f"{len(bad)} of {count}\n" + "\n".join(bad)


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_a_line_that_is_not_finished_is_completed_or_not_in_silence(shell, originals, tmp_path):
    for seed in range(first_seed(), first_seed() + inputs_wanted(150)):
        folder = tmp_path / str(seed) / "work"
        shutil.copytree(originals, folder)
        rng = np.random.default_rng([seed, 200])
        words = lent.completions(rng, folder)
        given = {
            "_DYNID_COMPLETE": f"{shell}_complete",
            "COMP_WORDS": " ".join(["dynid", *words]),
            "COMP_CWORD": str(len(words)),
        }
        if rng.random() < 0.2:
            given[str(rng.choice(sorted(given)))] = str(
                rng.choice(["", "x", "-1", "99", "bash_source"])
            )
        before = contents(folder)
        ended = run(
            [], folder, command=main.main, prepare=lambda given=given: os.environ.update(given)
        )
        found = [
            each
            for each in faults(ended, folder, before)
            if each not in ("status 99", "no message")
        ]
        assert not found, (seed, words, found, ended)
        assert not ended.err, (seed, words, ended)
        shutil.rmtree(tmp_path / str(seed))
