"""doctor, explain, completion and check."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from dynid.cli import terminal
from dynid.cli.reference import api_page, cli_page, effects_page, errors_page, limits_page, robot_page
from dynid.errors import codes
from dynid.files.artifact import Artifact, write_artifact

ROOT = Path(__file__).parents[2]


# ---------------------------------------------------------------- explain
@pytest.mark.parametrize(
    ("name", "page"),
    [
        ("errors.md", errors_page),
        ("limits.md", limits_page),
        ("cli.md", cli_page),
        ("api.md", api_page),
        ("robot-file.md", robot_page),
        ("effects.md", effects_page),
    ],
)
def test_the_reference_pages_are_made_from_the_code(name, page):
    assert (ROOT / "docs/reference" / name).read_text() == page(), "make them again: make reference"


@pytest.mark.parametrize("code", ["E307", "e307", "error[E307]"[5:]])
def test_explain_prints_what_why_and_fix(dynid, code):
    done = dynid("explain", code)
    assert (done.status, done.err) == (0, "")
    assert [line.split()[0] for line in done.out.splitlines()] == ["E307", "why", "fix", "exit"]


def test_explain_alone_lists_every_code(dynid):
    listed = [line.split()[0] for line in dynid("explain").out.splitlines()]
    assert listed == codes()
    assert {"E101", "E307", "E703", "W316"} <= set(listed)


def test_a_misspelt_code_is_suggested(dynid):
    done = dynid("explain", "E30")
    assert done.status == 2
    assert "did you mean 'E30" in done.err or "did you mean 'E3" in done.err


# ---------------------------------------------------------------- completion
@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_prints_a_script_for_dynid(dynid, shell):
    done = dynid("completion", shell)
    assert (done.status, done.err) == (0, "")
    assert "_DYNID_COMPLETE" in done.out


def test_the_completion_script_is_valid_bash(dynid):
    assert subprocess.run(["bash", "-n"], input=dynid("completion", "bash").out, text=True).returncode == 0


def test_the_shell_is_offered_commands_and_options(dynid):
    done = dynid(_DYNID_COMPLETE="bash_complete", COMP_WORDS="dynid doc", COMP_CWORD="1")
    assert done.out == "plain,doctor\n"
    done = dynid(_DYNID_COMPLETE="bash_complete", COMP_WORDS="dynid check --str", COMP_CWORD="2")
    assert done.out == "plain,--strict\n"


# ---------------------------------------------------------------- doctor
def test_doctor_says_what_works_and_what_is_lost(dynid):
    done = dynid("doctor", "--json", DISPLAY="", ROS_MASTER_URI="http://localhost:1")
    answer = json.loads(done.out)
    assert done.status == 0
    assert "numpy" in answer["works"]
    assert {"ROS master", "display"} <= set(answer["does_not_work"])
    assert "does not   ROS master; lost: record" in dynid("doctor", ROS_MASTER_URI="http://localhost:1").out


def test_doctor_does_not_wait_for_a_master_that_does_not_exist(dynid):
    assert dynid("doctor", ROS_MASTER_URI="nonsense").status == 0


def test_doctor_exits_6_when_a_package_it_needs_is_missing(dynid):
    script = "import dynid.workflows.doctor as d, dynid.cli.main as m; d.REQUIRED = ('no-such-package',); m.main()"
    done = subprocess.run(
        [sys.executable, "-c", script, "doctor"], cwd=dynid.folder, env=dynid.env, capture_output=True
    )
    assert done.returncode == 6


# ---------------------------------------------------------------- check
def test_check_describes_a_robot_with_its_tool_at_zero(dynid):
    done = dynid("check", "kuka_lwr4plus", "--json")
    (checked,) = json.loads(done.out)["checked"]
    assert checked["n_joints"] == 7
    # 0.3105 + 0.4 + 0.39 + 0.078 m, the heights of the arm stretched upwards
    assert checked["tool_at_zero_m"] == pytest.approx([0, 0, 1.1785], abs=1e-9)


def test_check_shows_the_header_of_a_result(dynid):
    header = {"robot": "arm", "inputs": {"log": "0123456789abcdef" * 4}}
    write_artifact(dynid.folder / "r.npz", Artifact("dynid/parameters/1", header, {"theta": np.zeros((3, 2))}))
    done = dynid("check", "r.npz")
    assert done.status == 0
    assert "dynid/parameters/1" in done.out
    assert "0123456789ab" in done.out
    assert "theta 3 x 2" in done.out


ROBOT = "name: arm\nconvention: standard\njoints:\n  - {name: a, twist: 1.5708, d: 0.1}\n"


@pytest.mark.parametrize(("words", "status"), [((), 0), (("--strict",), 1)])
def test_strict_turns_warnings_into_status_1(dynid, words, status):
    (dynid.folder / "arm.yaml").write_text(ROBOT)
    done = dynid("check", "arm.yaml", *words)
    assert done.status == status
    assert done.err.startswith("warning[W202]")
    assert "usable, 1 warning" in done.out


@pytest.mark.parametrize(
    ("text", "code"),
    [
        (ROBOT.replace("convention", "convetion"), "E201"),
        (ROBOT.replace("1.5708", "90"), "E202"),
        (ROBOT.replace("0.1", "1e-3"), "E203"),
        (ROBOT.replace("convention: standard\n", ""), "E204"),
        (ROBOT + "gravity: [0, 0, -981]\n", "E206"),
        (ROBOT + "name: arm\n", "E207"),
        (ROBOT.replace("- {name", "-\t{name").replace("  -", "\t-"), "E207"),
    ],
)
def test_a_faulty_robot_file_gives_its_code_status_3_and_a_place(dynid, text, code):
    (dynid.folder / "arm.yaml").write_text(text)
    done = dynid("check", "arm.yaml")
    assert (done.status, done.out) == (3, "")
    assert done.err.startswith(f"error[{code}]")
    assert "arm.yaml" in done.err
    assert len(done.err.splitlines()) <= 6


def test_an_unknown_robot_is_suggested_with_status_2(dynid):
    done = dynid("check", "kinova_gen")
    assert done.status == 2
    assert "did you mean 'kinova_gen2'?" in done.err


@pytest.mark.parametrize("content", [b"", b"not a zip", b"PK\x03\x04broken"])
def test_a_damaged_result_is_an_input_error(dynid, content):
    (dynid.folder / "r.npz").write_bytes(content)
    done = dynid("check", "r.npz")
    assert (done.status, done.out) == (3, "")
    assert "Traceback" not in done.err


def test_sentences_are_folded_between_words_where_the_terminal_ends(monkeypatch):
    """What goes to a file or a pipe keeps its lines whole."""
    console = Console(width=80)
    line = "filter     " + "word " * 30
    assert terminal.folded(line, console, 11) == [line]
    monkeypatch.setattr(terminal, "is_terminal", lambda stream: True)
    first, *more = terminal.folded(line, console, 11)
    assert first.startswith("filter     word")
    assert all(len(part) <= 80 and part.endswith("word") for part in (first, *more))
    assert all(part.startswith(" " * 11 + "word") for part in more)
    assert terminal.folded(line, console, None) == [line]
