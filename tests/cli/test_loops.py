"""model, parameters, identify, validate and demo as processes: questions, streams, interruptions, repetition.

The arm is a two-link arm whose torques come from the textbook's formulas (twolink.py), so that fits have a truth.
"""

import ctypes
import os
import random
import shutil
import signal
import subprocess
import time
from pathlib import Path

import pytest
import yaml

import twolink
from dynid.files.artifact import read_artifact
from runner import rows

OUT = "out/arm"
IDENTIFY = "identify arm.yaml log.csv"


@pytest.fixture(scope="session")
def finished(workshop):
    """A folder where the two-link arm was identified; tests get copies of it."""
    run = workshop()
    twolink.write_arm(run.folder)
    assert run(f"{IDENTIFY} --no-report").good
    return run.folder


@pytest.fixture
def done(dynid, finished):
    """The same after ``dynid identify arm.yaml log.csv``."""
    shutil.copytree(finished, dynid.folder, dirs_exist_ok=True)
    dynid.env["DYNID_IDENTIFY_REPORT"] = "no"
    return dynid


def edit(runner, old, new):
    path = runner.folder / "arm.yaml"
    path.write_text(path.read_text().replace(old, new))


# ---------------------------------------------------------------- answers are right
def test_identify_finds_friction_and_gravity_load_that_were_put_in(done):
    """Both moments about the joints: m r of the second link, and of the first with the second at its end."""
    found = done(f"{IDENTIFY} --json").facts
    values = {row["name"]: row["value"] for row in found["parameters"]}
    for joint in (1, 2):
        for name, truth in (("fv", twolink.VISCOUS), ("fc", twolink.COULOMB)):
            assert values[f"{name}{joint}"] == pytest.approx(truth[joint - 1], abs=0.01)
    (m1, m2), (r1, r2) = twolink.MASS, twolink.COM
    assert values["mcx2R"] == pytest.approx(m2 * r2, rel=0.01)
    assert values["mcx1R"] == pytest.approx(m1 * r1 + 0.4 * m2, rel=0.01)


def test_validate_is_as_good_on_the_unseen_log_as_the_sensor_noise(done):
    checked = done(f"validate {OUT}/parameters.npz unseen.csv --no-plot --json").facts
    assert checked["passed"] is True
    assert checked["relative_error_percent"] < 0.2
    assert all(joint["rms_nm"] < 0.02 for joint in checked["joints"])


# ---------------------------------------------------------------- P1, P5
@pytest.mark.parametrize(
    ("line", "question", "made", "unasked"),
    rows("""
        model arm.yaml              | ? Reduce to base parameters now? | fullregressor.npz | yes
        parameters arm.yaml log.csv | ? Identify now?                  | parameters.npz    | no
    """),
)
def test_the_next_step_is_asked_on_a_terminal_and_said_where_nobody_is(
    arm, line, question, made, unasked
):
    path = arm.folder / OUT / made
    assert f"{question} -> {unasked} (not asked: no terminal" in arm(line).good.err
    assert path.exists() is (unasked == "yes")
    names = {"regressor.npz"}
    if line.startswith("parameters"):
        names |= {"run.yaml", "fullnumericregressor.npz", "estimatedmotion.npz"}
    assert names <= {each.name for each in path.parent.iterdir()}
    for key, there in (("n\n", False), ("\n", True)):
        shutil.rmtree(path.parent)
        assert arm.typing(line, keys=[key]).good
        assert path.exists() is there


def test_the_answer_r_opens_the_editor_and_builds_again(arm):
    editor = arm.folder / "editor.sh"
    editor.write_text('#!/bin/sh\nsed -i "s/a: 0.3/a: 0.35/" "$1"\n')
    editor.chmod(0o755)
    env = dict.fromkeys(("EDITOR", "VISUAL"), str(editor))
    run = arm.typing("model arm.yaml", keys=["r\n", "y\n", "y\n"], **env).good
    assert "joints[1].a 0.3 -> 0.35" in " ".join(run.err.split())
    assert "a2 = 0.35 m" in run.out


@pytest.mark.parametrize("word", ["-y", "--identify"])
def test_parameters_goes_on_to_identify_when_told_to(arm, word):
    run = arm(f"parameters arm.yaml log.csv {word}").good
    assert (arm.folder / OUT / "parameters.npz").is_file()
    assert "total relative error" in run.out


def test_the_answer_r_changes_the_filter_and_stacks_again(arm):
    run = arm.typing("parameters arm.yaml log.csv", keys=["r\n", "3\n", "n\n"]).good
    assert "low-pass at 3 Hz" in run.err
    assert read_artifact(arm.folder / OUT / "fullnumericregressor.npz").header["cutoff_hz"] == 3.0


def test_parameters_then_identify_equals_identify_at_once_to_the_byte(arm, finished):
    assert "identify arm.yaml -o x\n" in arm("parameters arm.yaml log.csv -o x").good.err
    assert arm("parameters arm.yaml log.csv").good
    assert arm("identify arm.yaml").good
    made, expected = (folder / OUT / "parameters.yaml" for folder in (arm.folder, finished))
    assert made.read_bytes() == expected.read_bytes()
    assert arm(IDENTIFY).good.err.startswith("reused     out/arm/parameters.npz")


# ---------------------------------------------------------------- P6


@pytest.mark.parametrize(
    ("words", "named"),
    rows("""
        unseen.csv            | log 1
        unseen.csv --no-input | log 1
        log.csv --method ols  | method auto -> ols
        log.csv --cutoff 4    | cutoff auto -> 4
        log.csv --prior p.yml | prior_file none ->
    """),
)
def test_other_inputs_are_refused_and_named(done, words, named):
    (done.folder / "p.yml").write_text("cylinders: {radius: 0.05, mass: 1.0}\n")
    first = done(f"identify arm.yaml {words}").failed(7, "--force").splitlines()[0]
    assert first.startswith("error[E702] out/arm/parameters.npz exists and differs in inputs (")
    assert named in first


@pytest.mark.parametrize(
    "words",
    ["--force", *(pytest.param(w, marks=pytest.mark.slow) for w in ("-f", "-y", "--out else"))],
)
def test_the_advice_of_e702_works(done, words):
    assert done(f"identify arm.yaml unseen.csv {words}").good


def test_on_a_terminal_overwriting_is_asked(done):
    line = "identify arm.yaml unseen.csv"
    refused = done.typing(line, keys=["n\n"])
    assert refused.status == 7
    assert "error[E704]" in refused.err
    assert done.typing(line, keys=["y\n"]).good


def test_a_foreign_file_in_the_way_is_not_overwritten(arm):
    path = arm.folder / OUT / "parameters.npz"
    path.parent.mkdir(parents=True)
    path.write_text("not ours")
    assert arm(IDENTIFY).status == 7
    assert path.read_text() == "not ours"


# ---------------------------------------------------------------- P8
def test_a_changed_robot_file_is_noticed_and_refused_or_built_again(done):
    edit(done, "a: 0.3", "a: 0.35")
    was = "out/arm/regressor.npz was made from an older robot file (joints[1].a 0.3 -> 0.35)"
    done("model arm.yaml --frozen").failed(7, f"error[E701] {was}")
    assert done.typing("model arm.yaml --reduce", keys=["n\n"]).status == 7
    assert done.typing("model arm.yaml --reduce", keys=["y\n"]).good
    edit(done, "a: 0.35", "a: 0.3")
    assert done("model arm.yaml --reduce --rebuild").good
    edit(done, "a: 0.3", "a: 0.35")
    run = done("model arm.yaml").good
    assert "joints[1].a 0.3 -> 0.35" in " ".join(run.err.split())
    asked = "is stale. Rebuild? -> yes (not asked: no terminal; set with --rebuild/--frozen)"
    assert asked in run.err
    assert done("model arm.yaml --frozen").good


def test_comments_and_limits_do_not_make_a_model_stale(done):
    edit(done, "name: arm", "# a comment\nname: arm")
    edit(done, "velocity: 4", "velocity: 4.5")
    assert "reused" in done("model arm.yaml --frozen").err


# ---------------------------------------------------------------- run.yaml, limits
def test_a_run_is_repeated_from_run_yaml_without_the_variables_and_files_it_was_made_with(arm):
    (arm.folder / "dynid.yaml").write_text("seed: 7\n")
    assert arm(f"{IDENTIFY} --no-feasible", DYNID_CUTOFF="5").good
    (arm.folder / "dynid.yaml").unlink()
    del arm.env["DYNID_IDENTIFY_REPORT"]
    run = yaml.safe_load((arm.folder / OUT / "run.yaml").read_text())["identify"]
    assert run["arguments"][:2] == ["arm.yaml", "log.csv"]
    assert sorted(run["arguments"][2:]) == sorted(
        ["--seed", "7", "--no-feasible", "--cutoff", "5", "--no-report"]
    )
    before = (arm.folder / OUT / "parameters.yaml").read_bytes()
    line = f"identify --from {OUT}/run.yaml"
    assert arm(line).good.err.startswith("reused")
    assert arm(f"{line} --force").good
    assert (arm.folder / OUT / "parameters.yaml").read_bytes() == before
    assert "method" in arm(f"{line} --method ols").err
    assert "holds no run of 'parameters'; it has" in arm(f"parameters --from {OUT}/run.yaml").err
    assert arm("identify --from nowhere.yaml").status == 2


@pytest.mark.parametrize(
    ("limit", "status"),
    [
        ("max_rms_nm > 1.5", 0),
        ("max_rms_nm > 0.001", 1),
        ("heldout_relative_error_percent<0.5", 1),
        ("rank >= 12", 0),
    ],
)
def test_fail_if_gives_ci_a_threshold(done, limit, status):
    run = done(f"{IDENTIFY} --fail-if", limit)
    assert run.status == status
    assert "total relative error" in run.out
    assert ("limit " in run.err) is (status == 1)


# ---------------------------------------------------------------- whole files
def whole(folder):
    """Read every file that has its final name; a half-written one raises."""
    names = []
    for path in sorted(folder.rglob("*")):
        if not path.is_file() or path.name.startswith("."):
            continue
        names.append(path.name)
        if path.suffix == ".npz":
            read_artifact(path)
        elif path.name == "parameters.yaml":
            assert "not_identifiable" in yaml.safe_load(path.read_text())
        elif path.suffix == ".png":
            assert path.read_bytes().endswith(b"IEND\xaeB`\x82")
        elif path.suffix == ".svg":
            assert path.read_text().rstrip().endswith("</svg>")
    return names


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGINT])
def test_a_run_ended_at_any_moment_leaves_only_whole_files(arm, number):
    """A run on a log of ten minutes. Ctrl-C leaves no temporary file either, and ends it with 130.

    It works for less than a second of processor time after the signal, however busy the machine is.
    """
    del arm.env["DYNID_IDENTIFY_REPORT"]
    twolink.write_log(arm.folder / "long.csv", seed=3, seconds=600.0)
    line = "parameters arm.yaml long.csv --identify --force"
    generator, began, stopped = random.Random(5), time.monotonic(), 0
    assert arm(line).good
    longest = 0.9 * (time.monotonic() - began)
    for _ in range(5):
        shutil.rmtree(arm.folder / "out", ignore_errors=True)
        process = arm.start(line, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        time.sleep(generator.uniform(0.3, 1.0) * longest)
        stat = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
        before = sum(os.times()[2:4]) + sum(map(int, stat[11:13])) / os.sysconf("SC_CLK_TCK")
        process.send_signal(number)
        _, err = process.communicate(timeout=30)
        whole(arm.folder)
        # Why minus: Python may end itself by the signal that was handled, which a shell calls 130.
        assert process.returncode in (0, 130, -number)
        stopped += process.returncode != 0
        if number == signal.SIGINT:
            assert not [path for path in arm.folder.rglob(".*") if path.is_file()]
            assert b"Traceback" not in err
            if process.returncode:
                assert sum(os.times()[2:4]) - before < 1.0
                assert err.splitlines()[-1] == b"interrupted"
    assert stopped
    assert arm(line).good
    assert "parameters.npz" in whole(arm.folder)


def without_privileges():
    """Make permissions hold for root too: drop CAP_DAC_OVERRIDE from what the next program may have."""
    PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1
    ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)


def test_a_read_only_folder_ends_in_a_message(arm):
    arm.folder.chmod(0o555)
    try:
        for line in ("model arm.yaml", "demo"):
            run = arm.fresh(line, preexec_fn=without_privileges)
            assert "Traceback" not in run.failed(6, "error[E606] cannot write")
    finally:
        arm.folder.chmod(0o755)


@pytest.mark.slow
def test_demo_asks_nothing_and_compares_with_the_truth(dynid):
    found = dynid("demo --json").facts
    assert found["schema"] == "dynid/demo/1"
    assert found["validate"]["relative_error_percent"] < 1.0
    assert found["truth"]["inside_95_percent"] >= 0.75 * found["truth"]["parameters"]
    assert all((dynid.folder / path).is_file() for path in found["validate"]["wrote"])
