"""The table of questions: what is asked, what happens when nobody can be asked."""

import os
import subprocess

import pytest

# question, letters, Enter, nobody there, with -y
TABLE = [
    ("P1", "Reduce to base parameters now?", "yes", "yes", "yes", "--reduce/--no-reduce"),
    ("P2", "Does this motion look safe?", "no", "no", "no", "--accept"),
    ("P4", "Convert to log.npz now?", "yes", "yes", "yes", "--convert/--no-convert"),
    ("P5", "Identify now?", "yes", "no", "yes", "--identify/--no-identify"),
    ("P6", "Overwrite x.npz?", "no", "no", "yes", "--force"),
    ("P7", "Add coulomb to a copy of the robot file?", "no", "no", "no", "--apply/--no-apply"),
    ("P8", "x.npz is stale. Rebuild?", "yes", "yes", "yes", "--rebuild/--frozen"),
]
EACH = pytest.mark.parametrize(("row", "text", "enter", "unasked", "yes", "flag"), TABLE)


@EACH
def test_without_a_terminal_the_documented_answer_is_taken_and_said_in_one_line(
    dynid, row, text, enter, unasked, yes, flag
):
    done = dynid("toy", "ask", row)
    assert (done.status, done.out) == (0, unasked + "\n")
    (line,) = done.err.splitlines()
    assert line.startswith(f"? {text} -> ")
    assert line.endswith(f"(not asked: no terminal; set with {flag})")


@EACH
def test_yes_gives_the_documented_answer_even_on_a_terminal(
    dynid, row, text, enter, unasked, yes, flag
):
    done = dynid.typing("toy", "ask", row, "-y")
    assert done.out == yes + "\n"
    assert "not asked: -y" in done.err


@EACH
def test_enter_on_a_terminal_means_the_capital_letter(dynid, row, text, enter, unasked, yes, flag):
    done = dynid.typing("toy", "ask", row, keys=["\n"])
    assert done.out == enter + "\n"
    assert f"? {text} [" in done.err


@pytest.mark.parametrize(
    ("row", "key", "answer"),
    [("P1", "r", "retry"), ("P1", "No", "no"), ("P2", "q", "quit"), ("P2", "y", "yes")],
)
def test_letters_and_words_are_understood(dynid, row, key, answer):
    assert dynid.typing("toy", "ask", row, keys=[key + "\n"]).out == answer + "\n"


def test_a_letter_that_is_no_answer_is_asked_again(dynid):
    done = dynid.typing("toy", "ask", "P1", keys=["x\n", "n\n"])
    assert done.out == "no\n"
    assert "answer with one of y, n, r" in done.err


def test_a_terminal_that_never_answers_sensibly_ends_with_e703(dynid):
    done = dynid.typing("toy", "ask", "P1", keys=["x\n"] * 9)
    assert done.status == 7
    assert "error[E703]" in done.err


def test_end_of_input_on_a_terminal_counts_as_nobody_there(dynid):
    done = dynid.typing("toy", "ask", "P5", keys=["\x04"])
    assert done.out == "no\n"
    assert "not asked: end of input" in done.err


@pytest.mark.parametrize("words", [("--no-input",), ()])
def test_no_input_asks_nothing_on_a_terminal(dynid, words):
    done = dynid.typing("toy", "ask", "P1", *words, **({} if words else {"DYNID_NO_INPUT": "1"}))
    assert done.out == "yes\n"
    assert "not asked: --no-input" in done.err


# ---------------------------------------------------------------- P3
@pytest.mark.parametrize("words", [(), ("-y",), ("--no-input",), ("--force", "-y")])
def test_nothing_but_the_typed_name_moves_the_arm(dynid, words):
    done = dynid("toy", "typed", *words)
    assert (done.status, done.out) == (7, "")
    assert done.err.startswith("error[E703]")
    assert "--move kinova_gen2" in done.err


def test_neither_variable_nor_file_stands_in_for_the_typed_name(dynid):
    (dynid.folder / "dynid.yaml").write_text("toy:\n  samples: 3\n")
    assert dynid("toy", "typed", DYNID_MOVE="kinova_gen2", DYNID_TOY_MOVE="kinova_gen2").status == 7
    (dynid.folder / "dynid.yaml").write_text("toy:\n  move: kinova_gen2\n")
    assert "unknown key 'move'" in dynid("toy", "typed").err


@pytest.mark.parametrize("key", ["force", "yes"])
def test_neither_variable_nor_file_overwrites_or_answers(key, dynid):
    (dynid.folder / "dynid.yaml").write_text(f"{key}: true\n")
    assert f"unknown key '{key}'" in dynid("toy", "ask", "P1").err
    (dynid.folder / "dynid.yaml").unlink()
    (dynid.folder / "run.yaml").write_text(f"toy: {{arguments: [ask, P1, --{key}]}}\n")
    assert f"run.yaml sets --{key}" in dynid("toy", "--from", "run.yaml").err
    variables = {f"DYNID_{key.upper()}": "1"}
    assert dynid("toy", "typed", **variables).status == 7


def test_the_typed_name_moves_the_arm(dynid):
    assert dynid.typing("toy", "typed", keys=["kinova_gen2\n"]).out == "moved\n"
    assert dynid("toy", "typed", "--move", "kinova_gen2").out == "moved\n"


def test_y_does_not_stand_in_for_the_name_on_a_terminal(dynid):
    assert dynid.typing("toy", "typed", "-y", keys=["y\n"]).status == 7


def test_another_name_is_refused(dynid):
    assert dynid.typing("toy", "typed", keys=["kuka\n"]).status == 7
    assert dynid("toy", "typed", "--move", "kuka").status == 2


# ---------------------------------------------------------------- P6
@pytest.fixture
def written(dynid):
    (dynid.folder / "log.csv").write_text("t\n1\n")
    assert dynid("toy", "write", "log.csv").status == 0
    return dynid


def test_a_result_of_the_same_inputs_is_reused(written):
    before = (written.folder / "out/arm/result.npz").stat().st_mtime_ns
    done = written("toy", "write", "log.csv")
    assert done.status == 0
    assert done.err.startswith("reused")
    assert (written.folder / "out/arm/result.npz").stat().st_mtime_ns == before


@pytest.mark.parametrize("words", [(), ("--no-input",)])
def test_a_result_of_other_inputs_is_not_overwritten(written, words):
    (written.folder / "log.csv").write_text("t\n2\n")
    done = written("toy", "write", "log.csv", *words)
    assert (done.status, done.out) == (7, "")
    assert done.err.startswith(
        "error[E702] out/arm/result.npz exists and differs in inputs (log sha "
    )
    assert "--force" in done.err


@pytest.mark.parametrize("word", ["--force", "-f", "-y"])
def test_force_and_yes_overwrite(written, word):
    (written.folder / "log.csv").write_text("t\n2\n")
    done = written("toy", "write", "log.csv", word)
    assert done.status == 0
    assert "wrote" in done.err


def test_on_a_terminal_overwriting_is_asked(written):
    (written.folder / "log.csv").write_text("t\n2\n")
    done = written.typing("toy", "write", "log.csv", keys=["n\n"])
    assert done.status == 7
    assert "error[E704]" in done.err
    assert written.typing("toy", "write", "log.csv", keys=["y\n"]).status == 0


def test_a_foreign_file_in_the_way_is_not_overwritten(dynid):
    (dynid.folder / "log.csv").write_text("t\n1\n")
    (dynid.folder / "out/arm").mkdir(parents=True)
    (dynid.folder / "out/arm/result.npz").write_text("not ours")
    assert dynid("toy", "write", "log.csv").status == 7


# ---------------------------------------------------------------- stdin of every kind


@pytest.mark.parametrize("words", [("ask", "P5"), ("ask", "P5", "--no-input"), ("typed",)])
def test_a_silent_pipe_is_not_waited_for(dynid, words):
    reader, writer = os.pipe()
    try:
        assert dynid("toy", *words, stdin=reader).status == (7 if words == ("typed",) else 0)
    finally:
        os.close(reader)
        os.close(writer)


@pytest.mark.parametrize(("words", "status"), [(("ask", "P7"), 0), (("typed",), 7)])
def test_answers_from_a_pipe_are_not_read(dynid, words, status):
    with subprocess.Popen(["yes"], stdout=subprocess.PIPE) as yes:
        done = dynid("toy", *words, stdin=yes.stdout)
        yes.kill()
    assert done.status == status
    assert done.out in ("no\n", "")
