"""model, parameters, identify, validate and demo as processes: questions, streams, interruptions, repetition.

The arm is a two-link arm whose torques come from the textbook's formulas (twolink.py), so that fits have a truth.
"""

import ctypes
import json
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
from runner import Runner

ROOT = Path(__file__).parents[2]
OUT = "out/arm"
P1 = "? Reduce to base parameters now?"
P5 = "? Identify now?"


@pytest.fixture(scope="session")
def finished(tmp_path_factory):
    """A folder where the two-link arm was identified; tests get copies of it."""
    folder = tmp_path_factory.mktemp("finished")
    (folder / "home").mkdir()
    (folder / "work").mkdir()
    twolink.write_arm(folder / "work")
    run = Runner(folder / "work", folder / "home")("identify", "arm.yaml", "log.csv", "--no-report")
    assert run.status == 0, run.err
    return folder / "work"


@pytest.fixture
def done(dynid, finished):
    """The same after ``dynid identify arm.yaml log.csv``."""
    shutil.copytree(finished, dynid.folder, dirs_exist_ok=True)
    dynid.env["DYNID_IDENTIFY_REPORT"] = "no"
    return dynid


def answer(run):
    assert run.status == 0, run.err
    return json.loads(run.out)


def edit(runner, old, new):
    path = runner.folder / "arm.yaml"
    path.write_text(path.read_text().replace(old, new))


# ---------------------------------------------------------------- answers are right
def test_identify_finds_friction_and_gravity_load_that_were_put_in(done):
    """Both moments m c about the joints, in the frames at the link ends: m r = mcx + a m."""
    found = answer(done("identify", "arm.yaml", "log.csv", "--json"))
    values = {row["name"]: row["value"] for row in found["parameters"]}
    for joint in (1, 2):
        for name, truth in (("fv", twolink.VISCOUS), ("fc", twolink.COULOMB)):
            assert values[f"{name}{joint}"] == pytest.approx(truth[joint - 1], abs=0.01)
    (m1, m2), (r1, r2) = twolink.MASS, twolink.COM
    assert values["mcx2R"] + 0.3 * values["m2R"] == pytest.approx(m2 * r2, rel=0.01)
    assert values["mcx1R"] + 0.4 * values["m1R"] == pytest.approx(
        m1 * r1 + 0.4 * m2 - 0.4 * values["m2R"], rel=0.01
    )


def test_validate_is_as_good_on_the_unseen_log_as_the_sensor_noise(done):
    checked = answer(done("validate", f"{OUT}/parameters.npz", "unseen.csv", "--no-plot", "--json"))
    assert checked["passed"] is True
    assert checked["relative_error_percent"] < 0.2
    assert all(joint["rms_nm"] < 0.02 for joint in checked["joints"])


WORDS = {
    "model": ("arm.yaml", "--reduce"),
    "parameters": ("arm.yaml", "log.csv", "--no-identify"),
    "identify": ("arm.yaml", "log.csv"),
    "validate": (f"{OUT}/parameters.npz", "unseen.csv", "--no-plot"),
}


@pytest.mark.parametrize("command", list(WORDS))
def test_stdout_is_the_answer_and_stderr_the_rest(done, command):
    quiet, usual, loud = (
        done(command, *WORDS[command], "--force", *more) for more in (("-q",), (), ("-v",))
    )
    assert quiet.status == usual.status == loud.status == 0
    answered = [line for line in quiet.out.splitlines() if not line.startswith("values ")]
    assert usual.out.splitlines()[: len(answered)] == answered
    # Why only its first line: -v tells what is behind each light that the usual answer gathers in one line.
    assert loud.out.splitlines()[:1] == answered[:1]
    assert len(loud.out) >= len(usual.out)
    assert all(line.startswith("warning[") for line in quiet.err.splitlines())
    assert len(loud.err) > len(quiet.err)


# ---------------------------------------------------------------- P1
def test_model_reduces_without_being_asked_and_says_so(arm):
    run = arm("model", "arm.yaml")
    assert run.status == 0
    assert f"{P1} -> yes (not asked: " in run.err
    assert (arm.folder / OUT / "fullregressor.npz").is_file()


@pytest.mark.parametrize(("key", "reduced"), [("\n", True), ("n\n", False)])
def test_model_asks_on_a_terminal(arm, key, reduced):
    run = arm.typing("model", "arm.yaml", keys=[key])
    assert run.status == 0, run.err
    assert (arm.folder / OUT / "fullregressor.npz").is_file() is reduced
    assert (arm.folder / OUT / "regressor.npz").is_file()


def test_the_answer_r_opens_the_editor_and_builds_again(arm):
    editor = arm.folder / "editor.sh"
    editor.write_text('#!/bin/sh\nsed -i "s/a: 0.3/a: 0.35/" "$1"\n')
    editor.chmod(0o755)
    run = arm.typing(
        "model", "arm.yaml", keys=["r\n", "y\n", "y\n"], EDITOR=str(editor), VISUAL=str(editor)
    )
    assert run.status == 0, run.err
    assert "joints[1].a 0.3 -> 0.35" in run.err
    assert "a2 = 0.35 m" in run.out


# ---------------------------------------------------------------- P5
def test_parameters_leaves_identify_to_the_script_when_nobody_is_there(arm):
    run = arm("parameters", "arm.yaml", "log.csv")
    assert run.status == 0
    assert f"{P5} -> no (not asked: no terminal" in run.err
    assert not (arm.folder / OUT / "parameters.npz").exists()
    for name in ("fullnumericregressor.npz", "estimatedmotion.npz", "run.yaml"):
        assert (arm.folder / OUT / name).is_file()


@pytest.mark.parametrize("words", [("-y",), ("--identify",)])
def test_parameters_goes_on_to_identify_when_told_to(arm, words):
    run = arm("parameters", "arm.yaml", "log.csv", *words)
    assert run.status == 0
    assert (arm.folder / OUT / "parameters.npz").is_file()
    assert "total relative error" in run.out


@pytest.mark.parametrize(("key", "identified"), [("\n", True), ("n\n", False)])
def test_parameters_asks_on_a_terminal(arm, key, identified):
    run = arm.typing("parameters", "arm.yaml", "log.csv", keys=[key])
    assert run.status == 0, run.err
    assert (arm.folder / OUT / "parameters.npz").exists() is identified


def test_the_answer_r_changes_the_filter_and_stacks_again(arm):
    run = arm.typing("parameters", "arm.yaml", "log.csv", keys=["r\n", "3\n", "n\n"])
    assert run.status == 0, run.err
    assert "low-pass at 3 Hz" in run.err
    assert read_artifact(arm.folder / OUT / "fullnumericregressor.npz").header["cutoff_hz"] == 3.0


def test_parameters_then_identify_equals_identify_at_once(arm, finished):
    assert arm("parameters", "arm.yaml", "log.csv").status == 0
    assert arm("identify", "arm.yaml").status == 0
    assert (arm.folder / OUT / "parameters.yaml").read_bytes() == (
        finished / OUT / "parameters.yaml"
    ).read_bytes()
    again = arm("identify", "arm.yaml", "log.csv")
    assert again.status == 0
    assert again.err.startswith("reused")


# ---------------------------------------------------------------- P6
def test_the_same_inputs_reuse_the_result(done):
    before = (done.folder / OUT / "parameters.npz").stat().st_mtime_ns
    run = done("identify", "arm.yaml", "log.csv")
    assert run.status == 0
    assert run.err.startswith("reused     out/arm/parameters.npz")
    assert (done.folder / OUT / "parameters.npz").stat().st_mtime_ns == before


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("unseen.csv",), "log 1 sha"),
        (("log.csv", "--method", "ols"), "method auto -> ols"),
        (("log.csv", "--cutoff", "4"), "cutoff auto -> 4"),
    ],
)
def test_other_inputs_are_refused_and_named(done, words, named):
    run = done("identify", "arm.yaml", *words)
    assert (run.status, run.out) == (7, "")
    assert run.err.startswith("error[E702] out/arm/parameters.npz exists and differs in inputs (")
    assert named in run.err.splitlines()[0]


@pytest.mark.slow
@pytest.mark.parametrize("words", [("--force",), ("-f",), ("-y",), ("--out", "elsewhere")])
def test_the_advice_of_e702_works(done, words):
    assert done("identify", "arm.yaml", "unseen.csv", *words).status == 0


# ---------------------------------------------------------------- P8
def test_a_changed_robot_file_is_noticed_and_built_again(done):
    edit(done, "a: 0.3", "a: 0.35")
    run = done("model", "arm.yaml")
    assert run.status == 0
    assert "joints[1].a 0.3 -> 0.35" in run.err
    assert (
        "is stale. Rebuild? -> yes (not asked: no terminal; set with --rebuild/--frozen)" in run.err
    )


def test_frozen_refuses_a_changed_robot_file_and_names_the_entry(done):
    edit(done, "a: 0.3", "a: 0.35")
    run = done("model", "arm.yaml", "--frozen")
    assert (run.status, run.out) == (7, "")
    assert (
        "error[E701] out/arm/regressor.npz was made from an older robot file (joints[1].a 0.3 -> 0.35)"
        in run.err
    )
    assert done("model", "arm.yaml", "--rebuild").status == 0
    assert done("model", "arm.yaml", "--frozen").status == 0


@pytest.mark.parametrize(("key", "status"), [("y\n", 0), ("n\n", 7)])
def test_rebuilding_is_asked_on_a_terminal(done, key, status):
    edit(done, "a: 0.3", "a: 0.35")
    assert done.typing("model", "arm.yaml", "--reduce", keys=[key]).status == status


def test_comments_and_limits_do_not_make_a_model_stale(done):
    edit(done, "name: arm", "# a comment\nname: arm")
    edit(done, "velocity: 4", "velocity: 4.5")
    assert "reused" in done("model", "arm.yaml", "--frozen").err


# ---------------------------------------------------------------- run.yaml, limits
@pytest.mark.slow
def test_a_run_is_repeated_from_run_yaml(done):
    del done.env["DYNID_IDENTIFY_REPORT"]
    before = (done.folder / OUT / "parameters.yaml").read_bytes()
    run = yaml.safe_load((done.folder / OUT / "run.yaml").read_text())["identify"]
    assert run["arguments"] == ["arm.yaml", "log.csv", "--no-report"]
    assert done("identify", "--from", f"{OUT}/run.yaml", "--force").status == 0
    assert (done.folder / OUT / "parameters.yaml").read_bytes() == before
    assert "method" in done("identify", "--from", f"{OUT}/run.yaml", "--method", "ols").err


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
    run = done("identify", "arm.yaml", "log.csv", "--fail-if", limit)
    assert run.status == status
    assert "total relative error" in run.out
    assert ("limit " in run.err) is (status == 1)


@pytest.mark.parametrize(
    ("words", "status"),
    [
        (("--max-rms", "1", "--max-unexplained", "5%"), 0),
        (("--max-rms", "0.001"), 1),
        (("--max-unexplained", "0.01%"), 1),
        (("--max-unexplained", "lots"), 2),
        (("--max-rms", "-1"), 2),
    ],
)
def test_validate_exits_1_when_a_limit_is_not_met(done, words, status):
    run = done("validate", f"{OUT}/parameters.npz", "unseen.csv", "--no-plot", *words)
    assert run.status == status
    assert bool(run.out) is (status < 2)


def test_wrong_words_are_refused_before_anything_is_read_or_written(arm):
    for words in (
        ("--cutoff", "fast"),
        ("--exclude", "9-3"),
        ("--holdout", "120%"),
        ("--method", "magic"),
    ):
        run = arm("identify", "arm.yaml", "log.csv", *words)
        assert (run.status, run.out) == (2, ""), words
        assert not (arm.folder / "out").exists(), words


# ---------------------------------------------------------------- the same bytes, whole files
def test_two_runs_write_the_same_parameters_yaml(arm, finished):
    assert arm("identify", "arm.yaml", "log.csv").status == 0
    assert (arm.folder / OUT / "parameters.yaml").read_bytes() == (
        finished / OUT / "parameters.yaml"
    ).read_bytes()


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


def moments(count, longest):
    """Random moments within a run that took ``longest`` seconds."""
    generator = random.Random(5)
    return [generator.uniform(0.3, 1.0) * longest for _ in range(count)]


@pytest.mark.slow
def test_a_run_killed_at_any_moment_leaves_only_whole_files(arm):
    del arm.env["DYNID_IDENTIFY_REPORT"]
    words = ("parameters", "arm.yaml", "log.csv", "--identify", "--force")
    began = time.monotonic()
    assert arm(*words).status == 0
    for moment in moments(6, time.monotonic() - began):
        shutil.rmtree(arm.folder / "out", ignore_errors=True)
        process = arm.start(*words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        time.sleep(moment)
        process.kill()
        process.wait()
        whole(arm.folder)
    assert arm(*words).status == 0
    assert "parameters.npz" in whole(arm.folder)


def seconds_of(process):
    """Return the processor time of a process that runs."""
    stat = Path(f"/proc/{process.pid}/stat").read_text().rpartition(")")[2].split()
    return (int(stat[11]) + int(stat[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.slow
def test_ctrl_c_at_any_moment_ends_with_130_and_works_no_longer(arm):
    """A run on a log of ten minutes; what is left holds no half-written and no temporary file.

    It works for less than a second of processor time after the signal, however busy the machine is.
    """
    del arm.env["DYNID_IDENTIFY_REPORT"]
    twolink.write_log(arm.folder / "long.csv", seed=3, seconds=600.0)
    words = ("parameters", "arm.yaml", "long.csv", "--identify", "--force")
    began = time.monotonic()
    assert arm(*words).status == 0
    stopped = 0
    for moment in moments(5, 0.9 * (time.monotonic() - began)):
        shutil.rmtree(arm.folder / "out", ignore_errors=True)
        process = arm.start(*words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        time.sleep(moment)
        worked = sum(os.times()[2:4]) + seconds_of(process)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
        # Why minus: Python may end itself by the signal that was handled, which a shell calls 130.
        status = 130 if process.returncode == -signal.SIGINT else process.returncode
        assert status in (0, 130)
        stopped += status == 130
        if status == 130:
            assert sum(os.times()[2:4]) - worked < 1.0
            assert err.splitlines()[-1] == b"interrupted"
            assert b"Traceback" not in err
        whole(arm.folder)
        assert not [path for path in arm.folder.rglob(".*") if path.is_file()]
    assert stopped


# ---------------------------------------------------------------- places and terminals
def without_privileges():
    """Make permissions hold for root too: drop CAP_DAC_OVERRIDE from what the next program may have."""
    PR_CAPBSET_DROP, CAP_DAC_OVERRIDE = 24, 1
    ctypes.CDLL(None).prctl(PR_CAPBSET_DROP, CAP_DAC_OVERRIDE, 0, 0, 0)


def test_a_read_only_folder_ends_in_a_message(arm):
    arm.folder.chmod(0o555)
    try:
        for words in (("model", "arm.yaml"), ("demo",)):
            run = subprocess.run(
                arm.words(words),
                cwd=arm.folder,
                env=arm.env,
                capture_output=True,
                text=True,
                preexec_fn=without_privileges,
            )
            assert run.returncode == 6, run.stderr
            assert "error[E606] cannot write" in run.stderr
            assert "Traceback" not in run.stderr
    finally:
        arm.folder.chmod(0o755)


# ---------------------------------------------------------------- shipped arms and logs
def test_the_shipped_logs_go_through_all_three_loops(dynid):
    """Shortened: twenty seconds of the identification log, ten of the other."""
    fitted, unseen = (
        str(ROOT / f"trajectories/lwr4plus_{name}.bag") for name in ("identify", "validate")
    )
    words = ("--exclude", "20-1e12", "--no-report", "--json")
    found = answer(dynid("identify", "kuka_lwr4plus", fitted, *words))
    assert found["rank"] == 69
    assert found["heldout_relative_error_percent"] < 1.0
    words = ("--exclude", "10-1e12", "--no-plot", "--json")
    checked = answer(dynid("validate", "out/kuka_lwr4plus/parameters.npz", unseen, *words))
    assert checked["relative_error_percent"] < 1.0


@pytest.mark.slow
def test_demo_asks_nothing_and_compares_with_the_truth(dynid):
    found = answer(dynid("demo", "--json"))
    assert found["schema"] == "dynid/demo/1"
    assert found["validate"]["relative_error_percent"] < 1.0
    assert found["truth"]["inside_95_percent"] >= 0.75 * found["truth"]["parameters"]
    assert all((dynid.folder / path).is_file() for path in found["validate"]["wrote"])
