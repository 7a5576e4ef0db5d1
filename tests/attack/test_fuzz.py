"""Broken inputs of every kind: a documented status, a message, nothing executed, nothing left, within memory and time."""

from __future__ import annotations

import shutil
import warnings

import mutate
import numpy as np
import pytest
from forked import faults, run

from conftest import first_seed, inputs_wanted

RESULTS = ("regressor", "fullregressor", "fullnumericregressor", "parameters", "estimatedmotion", "trajectory")
#: Kind of input: file, how it is broken, share of 5000 inputs, commands that read it.
KINDS = {
    "robot": ("arm.yaml", mutate.text, 800, ["check {}", "model {} --out out", "identify {} log.csv --out out"]),
    "urdf": ("arm.urdf", mutate.text, 400, ["import {} --out out/a.yaml"]),
    "csv": ("log.csv", mutate.text, 500, ["check {} --robot arm.yaml", "identify arm.yaml {} --out out"]),
    "text": ("text/position.txt", mutate.text, 300, ["identify arm.yaml text --out out"]),
    "bag": ("log.bag", mutate.data, 600, ["check {} --robot arm.yaml", "identify arm.yaml {} --out out"]),
    "log": ("log.npz", mutate.npz, 500, ["identify arm.yaml {} --out out", "check {} --robot arm.yaml"]),
    "plan": ("plan.yaml", mutate.text, 300, ["trajectory arm.yaml {} --preview none --out out"]),
    "batch": ("batch.yaml", mutate.text, 200, ["run {} --out out"]),
    "parameters": (
        "out/parameters.npz", mutate.npz, 500,
        ["check {}", "validate {} other.npz", "export {} --format urdf", "export {} --format python", "report out",
         "gap {} other.npz --no-apply", "compare {}"],
    ),
    "model": ("out/fullregressor.npz", mutate.npz, 300, ["identify arm.yaml log.csv --out out", "check {}"]),
    "regressor": ("out/regressor.npz", mutate.npz, 200, ["model arm.yaml --out out", "check {}"]),
    "stack": ("out/fullnumericregressor.npz", mutate.npz, 200, ["identify arm.yaml --out out", "check {}", "report out"]),
    "trajectory": (
        "out/trajectory.npz", mutate.npz, 200, ["check {}", "trajectory arm.yaml --review {} --accept --preview none"],
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", KINDS)
def test_a_broken_input_is_answered_as_documented(kind, originals, tmp_path):
    file, broken, count, commands = KINDS[kind]
    original = (originals / file).read_bytes()
    bad = []
    for number in range(inputs_wanted(count)):
        seed = first_seed() + number
        rng = np.random.default_rng([seed, sorted(KINDS).index(kind)])
        folder = tmp_path / str(seed) / "work"
        shutil.copytree(originals, folder)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            content = broken(rng, original.decode() if broken is mutate.text else original)
        mutate.write(folder / file, content)
        before = {
            str(path.relative_to(folder)): path.read_bytes()
            for path in folder.rglob("*")
            if path.is_file() and not str(path.relative_to(folder)).startswith("out/")
        }
        command = commands[rng.integers(len(commands))].format(file)
        flags = ["--no-input", "--force"] + (["--json"] if rng.random() < 0.3 else [])
        ended = run([*command.split(), *flags], folder)
        found = faults(ended, folder, before)
        if found:
            bad.append(f"seed {seed}: dynid {command}: {found}\n{ended.err[-600:]}")
        else:
            shutil.rmtree(tmp_path / str(seed))
    assert not bad, f"{len(bad)} of {inputs_wanted(count)}\n" + "\n".join(bad)
