"""The table of questions: what is asked, what happens when nobody can be asked."""

import os
import subprocess

import pytest

from runner import rows

TABLE = rows("""
    P1 | Reduce to base parameters now?           | yes | yes | yes | --reduce/--no-reduce
    P2 | Does this motion look safe?              | no  | no  | no  | --accept
    P4 | Convert to log.npz now?                  | yes | yes | yes | --convert/--no-convert
    P5 | Identify now?                            | yes | no  | yes | --identify/--no-identify
    P6 | Overwrite x.npz?                         | no  | no  | yes | --force
    P7 | Add coulomb to a copy of the robot file? | no  | no  | no  | --apply/--no-apply
    P8 | x.npz is stale. Rebuild?                 | yes | yes | yes | --rebuild/--frozen
""")


@pytest.mark.parametrize(("row", "text", "enter", "unasked", "yes", "flag"), TABLE)
def test_the_documented_answer_is_taken_by_enter_without_a_terminal_and_by_yes(
    dynid, row, text, enter, unasked, yes, flag
):
    done = dynid(f"toy ask {row}")
    assert (done.status, done.out) == (0, unasked + "\n")
    (line,) = done.err.splitlines()
    assert line.startswith(f"? {text} -> ")
    assert line.endswith(f"(not asked: no terminal; set with {flag})")
    done = dynid.typing(f"toy ask {row} -y")
    assert done.out == yes + "\n"
    assert "not asked: -y" in done.err
    done = dynid.typing(f"toy ask {row}", keys=["\n"])
    assert done.out == enter + "\n"
    assert f"? {text} [" in done.err


@pytest.mark.parametrize(
    ("row", "keys", "answer", "said"),
    rows("""
        P1            | r   | retry |
        P1            | No  | no    |
        P2            | q   | quit  |
        P2            | y   | yes   |
        P1            | x n | no    | answer with one of y, n, r
        P1 --no-input |     | yes   | not asked: --no-input
    """),
)
def test_letters_and_words_are_understood_on_a_terminal(dynid, row, keys, answer, said):
    done = dynid.typing(f"toy ask {row}", keys=[f"{key}\n" for key in keys.split()])
    assert done.out == answer + "\n"
    assert said in done.err


def test_the_end_of_input_is_an_answer_that_nobody_gave(dynid):
    done = dynid.typing("toy ask P5", keys=["\x04"])
    assert done.out == "no\n"
    assert "not asked: end of input" in done.err


def test_a_terminal_that_never_answers_sensibly_ends_with_e703(dynid):
    done = dynid.typing("toy ask P1", keys=["x\n"] * 9)
    assert done.status == 7
    assert "error[E703]" in done.err


def test_a_variable_asks_nothing_on_a_terminal_either(dynid):
    assert "not asked: --no-input" in dynid.typing("toy ask P1", DYNID_NO_INPUT="1").err


# ---------------------------------------------------------------- P3
@pytest.mark.parametrize("words", ["", "-y", "--no-input", "--force -y"])
def test_nothing_but_the_typed_name_moves_the_arm(dynid, words):
    err = dynid(f"toy typed {words}").failed(7, "--move kinova_gen2")
    assert err.startswith("error[E703]")


def test_neither_variable_nor_file_stands_in_for_the_typed_name(dynid):
    (dynid.folder / "dynid.yaml").write_text("toy:\n  samples: 3\n")
    assert dynid("toy typed", DYNID_MOVE="kinova_gen2", DYNID_TOY_MOVE="kinova_gen2").status == 7
    (dynid.folder / "dynid.yaml").write_text("toy:\n  move: kinova_gen2\n")
    assert "unknown key 'move'" in dynid("toy typed").err


@pytest.mark.parametrize("key", ["force", "yes"])
def test_neither_variable_nor_file_overwrites_or_answers(key, dynid):
    (dynid.folder / "dynid.yaml").write_text(f"{key}: true\n")
    assert f"unknown key '{key}'" in dynid("toy ask P1").err
    (dynid.folder / "dynid.yaml").unlink()
    (dynid.folder / "run.yaml").write_text(f"toy: {{arguments: [ask, P1, --{key}]}}\n")
    assert f"run.yaml sets --{key}" in dynid("toy --from run.yaml").err
    assert dynid("toy typed", **{f"DYNID_{key.upper()}": "1"}).status == 7


def test_the_typed_name_moves_the_arm_and_no_other_word_does(dynid):
    assert dynid.typing("toy typed", keys=["kinova_gen2\n"]).out == "moved\n"
    assert dynid("toy typed --move kinova_gen2").out == "moved\n"
    assert dynid.typing("toy typed -y", keys=["y\n"]).status == 7
    assert dynid.typing("toy typed", keys=["kuka\n"]).status == 7
    assert dynid("toy typed --move kuka").status == 2


# ---------------------------------------------------------------- stdin of every kind
@pytest.mark.parametrize(
    ("words", "status"), [("ask P5", 0), ("ask P7", 0), ("ask P5 --no-input", 0), ("typed", 7)]
)
def test_a_silent_pipe_is_not_waited_for_and_answers_from_one_are_not_read(dynid, words, status):
    reader, writer = os.pipe()
    try:
        assert dynid(f"toy {words}", stdin=reader).status == status
    finally:
        os.close(reader)
        os.close(writer)
    with subprocess.Popen(["yes"], stdout=subprocess.PIPE) as yes:
        done = dynid(f"toy {words}", stdin=yes.stdout.fileno())
        yes.kill()
    assert done.status == status
    assert done.out in ("no\n", "")
