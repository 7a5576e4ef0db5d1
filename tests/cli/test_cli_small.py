"""doctor, explain, completion and check."""

import json
import subprocess
import sys

import numpy as np
import pytest

import twolink
from dynid.cli import session
from dynid.cli.session import Session
from dynid.codes import codes
from dynid.files.logs import read_npz_log
from runner import ROOT, rows


# ---------------------------------------------------------------- explain
def test_explain_alone_lists_every_code(dynid):
    """Each once, with a sentence."""
    *lines, pages = dynid("explain").out.splitlines()
    assert pages.startswith("pages ")
    assert [line.split()[0] for line in lines] == codes()
    assert len(set(codes())) == len(codes())
    assert all(line.endswith(".") for line in lines)


@pytest.mark.parametrize(
    ("word", "said"),
    rows("""
        E30 | no code or page 'E30'; did you mean 'E320'?
        307 | no code or page '307'; did you mean 'E307'?
        foo | no code or page 'foo'
    """),
)
def test_a_misspelt_code_is_suggested(dynid, word, said):
    assert dynid(f"explain {word}").failed(2).splitlines()[0] == f"error[E101] {said}"


def test_explain_shows_a_page_of_the_documentation(dynid):
    """Text on the terminal, the same with --json; an error's fix can be followed without a clone of the project."""
    page = (ROOT / "docs/reference/robot-file.md").read_text()
    assert dynid("explain robot-file").out.split() == page.split()
    assert dynid("explain robot-file --json").facts["text"] == page


# ---------------------------------------------------------------- completion
def test_the_shell_completes_commands_and_options(dynid):
    for line, expected in (("dynid doc", "doctor"), ("dynid check --str", "--strict")):
        words = str(len(line.split()) - 1)
        done = dynid(_DYNID_COMPLETE="bash_complete", COMP_WORDS=line, COMP_CWORD=words)
        assert f"plain,{expected}" in done.out.split()


def test_the_completion_script_is_valid_bash(dynid):
    script = dynid("completion bash").out
    assert subprocess.run(["bash", "-n"], input=script, text=True).returncode == 0


# ---------------------------------------------------------------- doctor
def test_doctor_says_what_works_and_what_is_lost(dynid):
    """Every check is in one of the two lists; what is missing comes with what is lost by it."""
    env = {"DISPLAY": "", "ROS_MASTER_URI": "http://localhost:1"}
    answer = dynid("doctor --json", **env).facts
    checks = {check["name"]: check for check in answer["checks"]}
    for key, ok in (("works", True), ("does_not_work", False)):
        assert answer[key] == [name for name, check in checks.items() if check["ok"] is ok]
    needed = "Python numpy scipy sympy pyyaml click rich rosbags"
    assert set(needed.split()) <= set(answer["works"])
    assert answer["does_not_work"][-2:] == ["ROS master", "display"]
    assert dynid("doctor", **env).out.splitlines()[-2:] == [
        "does not   ROS master; lost: record: start rosmaster --core, or set ROS_MASTER_URI",
        "does not   display; lost: preview window: pictures are saved instead",
    ]


def test_doctor_exits_6_when_a_package_it_needs_is_missing(dynid):
    script = "import dynid.workflows.doctor as d, dynid.cli.main as m; d.REQUIRED = ('no-such-package',); m.main()"
    words = [sys.executable, "-c", script, "doctor", "--json"]
    done = subprocess.run(words, cwd=dynid.folder, env=dynid.env, capture_output=True)
    assert done.returncode == 6
    assert json.loads(done.stdout)["does_not_work"][0] == "no-such-package"


# ---------------------------------------------------------------- check
def test_check_describes_a_robot_with_its_tool_at_zero(dynid):
    (checked,) = dynid("check kuka_lwr4plus --json").facts["checked"]
    assert checked["n_joints"] == 7
    # 0.3105 + 0.4 + 0.39 + 0.078 m, the heights of the arm stretched upwards
    assert checked["tool_at_zero_m"] == pytest.approx([0, 0, 1.1785], abs=1e-9)


@pytest.mark.parametrize(("word", "status"), [("", 0), ("--strict", 1)])
def test_strict_turns_warnings_into_status_1(dynid, word, status):
    text = "name: arm\nconvention: standard\njoints:\n  - {name: a, twist: 1.5708, d: 0.1}\n"
    (dynid.folder / "arm.yaml").write_text(text)
    done = dynid(f"check arm.yaml {word}")
    assert done.status == status
    assert done.err.splitlines() == [
        "warning[W202] arm.yaml:4: joints[0].twist = 1.5708 is 3.7e-06 rad from 90 deg; 90 deg is used "
        "(write `90 deg` to silence this)",
        "next       dynid model arm.yaml",
        "           Find out which parameters of the arm are identifiable.",
    ]
    assert done.out.splitlines()[0] == "arm.yaml can be used, but see the warning."


def test_sentences_are_folded_between_words_where_the_terminal_ends(monkeypatch, capsys):
    """What goes to a file or a pipe keeps its lines whole, and so do lines that are copied."""
    monkeypatch.setenv("COLUMNS", "80")
    line = "word " * 30

    def said(label):
        Session().stage(label, line)
        return capsys.readouterr().err.splitlines()

    assert said("filter") == [f"filter     {line}"]
    monkeypatch.setattr(session, "is_terminal", lambda stream: True)
    first, *more = said("filter")
    assert first.startswith("filter     word")
    assert all(len(part) <= 80 and part.endswith("word") for part in (first, *more))
    assert all(part.startswith(" " * 11 + "word") for part in more)
    assert len(said("wrote")) == 1


# ---------------------------------------------------------------- check on logs
BAG = ROOT / "trajectories/lwr4plus_identify.bag"


def test_a_log_without_a_robot_says_what_it_holds(dynid):
    shown = dynid(f"check {BAG}").good.out
    assert "/lwr/joint_states  sensor_msgs/JointState, " in shown
    assert "joint_names: [lwr_0_joint, lwr_1_joint" in shown


def test_the_robot_file_among_the_paths_serves_the_logs(arm):
    assert "matched by name: shoulder, elbow" in arm("check arm.yaml log.csv").good.out


def test_fix_repairs_without_loss_and_lists_each_repair(arm):
    def turn(columns):
        columns["q"][1500:, 1] += 2 * np.pi

    twolink.write_log(arm.folder / "log.csv", 1, turn)
    said = arm("check arm.yaml log.csv --fix").good.err
    assert "warning[W315] elbow jumps by 6.28 rad at 15.00 s; unwrapped" in said
    log = read_npz_log(arm.folder / "out/arm/log.npz")
    assert np.abs(np.diff(log.q[:, 1])).max() < 0.1
    assert arm("convert out/arm/log.npz -o log.csv -f").status == 0


def test_a_faulty_log_is_not_converted(arm):
    def broken(columns):
        columns["tau"][300:312, 1] = np.nan

    twolink.write_log(arm.folder / "log.csv", 1, broken)
    arm("check arm.yaml log.csv --convert").failed(3)
    assert not (arm.folder / "out").exists()
