"""Streams, colours, exit statuses, precedence, suggestions, crashes, interruptions: what holds for every command."""

import json
import os
import re
import signal
import subprocess
import sys

import click
import pytest

from dynid.cli.commands import COMMANDS, command_of
from dynid.cli.main import loop_map
from dynid.codes import catalogue
from dynid.errors import EXIT_MEANING, WrongUsage
from dynid.options import Options
from runner import rows

ESCAPE = "\x1b"


# ---------------------------------------------------------------- help
@pytest.mark.parametrize(
    "code",
    [
        "import dynid",
        "import dynid.cli.trajectory",
        *(
            f"import sys; sys.argv[1:] = {line.split()}; import dynid.__main__ as m; m.main()"
            for line in ("", "-h", "--version", "doctor -h", "explain E307")
        ),
    ],
)
def test_help_imports_nothing_heavy(dynid, code):
    heavy = {"numpy", "sympy", "scipy", "matplotlib", "pybullet", "rospy", "rosbags", "jinja2"}
    if code == "import dynid":
        heavy |= {"click", "rich", "yaml"}
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-c", code],
        cwd=dynid.folder,
        env=dynid.env,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0
    assert not heavy & {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}


def test_bare_dynid_prints_the_map_which_lists_the_commands_that_exist_and_no_others(dynid):
    assert dynid().out == loop_map() + "\n"
    rows, small = loop_map().split("  Also ")
    loops = re.findall(r"^ {2}(?:Loop \d|Then)? +([a-z]+) ", rows, re.M)
    assert loops + small.split("\n\n")[0].split() == list(COMMANDS)


def test_help_lists_all_exit_statuses(dynid):
    text = dynid("-h").out
    for status, meaning in EXIT_MEANING.items():
        assert re.search(rf"^ +{int(status)} +{re.escape(meaning)}$", text, re.M)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_help_with_examples_at_every_spelling(dynid, name):
    first, *others = (dynid(line) for line in (f"{name} -h", f"{name} --help", f"help {name}"))
    assert first.status == 0
    assert first.out.index("Examples:") < first.out.index("ptions:")
    assert "Docs: docs/" in first.out
    assert all(other == first for other in others)


def test_version_names_python_numpy_simulator_and_ros(dynid):
    text = dynid("--version").out
    for word in ("dynid", "Python", "numpy", "PyBullet", "ROS 1"):
        assert re.search(rf"^{word} +\S", text, re.M)


# ---------------------------------------------------------------- wrong words and errors
@pytest.mark.parametrize(
    ("line", "said"),
    rows("""
        doctr                   | no command 'doctr'; did you mean 'doctor'?
        toy values --sampels 3  | no such option: --sampels; did you mean '--samples'?
        toy values --samples x  |
        toy                     |
        toy values --color blue |
        toy nothing             |
    """),
)
def test_wrong_usage_exits_2_in_the_style_of_the_catalogue_with_the_nearest_word(dynid, line, said):
    err = dynid(line).failed(2, "fix     dynid ")
    assert err.startswith(f"error[E101] {said}")


def test_an_error_has_four_parts_and_its_exit_status_and_debug_shows_the_traceback(dynid):
    err = dynid("toy error").failed(3)
    assert re.findall(r"^ *(\S+)", err, re.M) == ["error[E306]", "where", "why", "fix"]
    assert "Traceback" in dynid("toy error --debug").err
    assert "Traceback" in dynid("toy crash", DYNID_DEBUG="1").err
    assert dynid("toy limit").status == 1


def test_an_error_is_one_json_object_too(dynid):
    done = dynid("check no_such_arm --json")
    answer = json.loads(done.out)
    error = answer["error"]
    assert (answer["schema"], answer["status"]) == ("dynid/error/1", done.status)
    assert error["code"] == "E205"
    assert "no_such_arm" in error["what"]
    assert error["fix"] in done.err


def test_an_unforeseen_exception_leaves_a_crash_file_and_status_70(dynid):
    done = dynid("toy crash")
    (file,) = (dynid.home / ".cache/dynid").glob("crash-*.txt")
    err = done.failed(70, str(file))
    assert len(err.splitlines()) == 2
    assert "Traceback" not in err
    text = file.read_text()
    assert "ZeroDivisionError: something unforeseen" in text
    assert "command: dynid toy crash" in text
    assert all(word in text for word in ("Traceback", "numpy", "Python"))


def test_codes_are_unique_and_every_class_says_why_and_how():
    classes = catalogue().values()
    assert len({cls.code for cls in classes}) == len(list(classes))
    assert all(cls.why and cls.fix and cls.__doc__ for cls in classes)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_command_says_one_line_and_leaves_no_half_file(dynid, number):
    process = dynid.start("toy wait", stdout=-1, stderr=-1)
    assert process.stdout.readline() == b"ready\n"
    assert list(dynid.folder.iterdir())
    process.send_signal(number)
    _, err = process.communicate(timeout=50)  # it would wait for a minute
    assert (process.returncode, err) == (130, b"interrupted\n")
    assert list(dynid.folder.iterdir()) == []


# ---------------------------------------------------------------- streams and colours
WARNING = "warning[W316] joint_1 reads 1.8 Nm at rest"


def test_the_answer_goes_to_stdout_and_everything_else_to_stderr(dynid):
    done, quiet = (dynid(f"toy talk joint_1 {word}") for word in ("", "-q"))
    table = "joint rms error joint_1 0.42 Nm joint_2 0.31 Nm"
    assert done.out.split() == quiet.out.split() == table.split()
    assert done.err.splitlines() == ["stage      about joint_1", WARNING]
    assert quiet.err.splitlines() == [WARNING]


def test_json_is_one_object_on_stdout_with_any_verbosity(dynid):
    for word in ("", "-vv", "-q"):
        assert dynid(f"toy talk joint_1 --json {word}").facts["joint"] == "joint_1"
    assert dynid("toy values --json").facts["rms_nm"] is None, "what is not finite is null"


def test_verbose_adds_detail_and_the_log_file_has_it_anyway(dynid):
    assert "detail" in dynid("toy talk joint_1 -v").err
    assert "detail" not in dynid("toy talk joint_1 --log-file a/b.log").err
    text = (dynid.folder / "a/b.log").read_text()
    assert "detail" in text
    assert "W316" in text


@pytest.mark.parametrize("name", ["[red]x", "<b>x", "[/]", ":smile:", "x\x1b[31m\x07"])
def test_names_are_printed_literally(dynid, name):
    done = dynid("toy talk", name, "--color", "always")
    shown = name.replace("\x1b", "\\x1b").replace("\x07", "\\x07")
    assert shown in done.out
    assert shown in done.err
    assert dynid("toy talk", name, "--json").facts["joint"] == name


def test_colour_appears_on_a_terminal_or_when_asked_for(dynid):
    assert ESCAPE in dynid.typing("toy talk j").err
    assert ESCAPE in dynid("toy talk j --color always").out
    assert ESCAPE in dynid("toy error --color always").err


@pytest.mark.parametrize("quiet", [{"NO_COLOR": "1"}, {"TERM": "dumb"}, {"DYNID_COLOR": "never"}])
@pytest.mark.parametrize("job", ["talk j", "error", "ask P1"])
def test_no_escape_codes_on_a_terminal_that_does_not_want_them(dynid, quiet, job):
    done = dynid.typing(f"toy {job}", keys=["\n"], **quiet)
    assert ESCAPE not in done.err + done.out


def test_an_ascii_locale_gets_ascii(dynid):
    done = dynid("toy talk jänt", LANG="", LC_ALL="C")
    assert (done.out + done.err).isascii()
    assert "j\\xe4nt" in done.out
    assert "jänt" in dynid("toy talk jänt").out


def test_a_table_wider_than_the_terminal_becomes_lines_with_whole_numbers(dynid):
    done = dynid("toy wide", COLUMNS="60")
    assert max(len(line) for line in done.out.splitlines()) <= 60
    assert done.out.count("1234.5678 Nm") == 9
    assert len(dynid("toy wide").out.splitlines()) == 2


def test_quick_work_shows_no_progress_and_slow_work_one_line_a_stage_or_a_bar(dynid):
    assert dynid("toy work").err.splitlines() == ["slow       ...", "slow       done"]
    shown = dynid.typing("toy work").err
    assert "quick" not in shown
    assert "\x1b[?25h" in shown  # the cursor is back
    assert "slow       done" in shown


# ---------------------------------------------------------------- who wins
def test_flag_beats_variable_beats_folder_beats_user_beats_default(dynid):
    def samples(words="", **env):
        return dynid(f"toy values {words}", **env).out.split()[1]

    user = dynid.home / ".config/dynid/config.yaml"
    user.parent.mkdir(parents=True)
    assert samples() == "200"
    user.write_text("toy: {samples: 1}\n")
    assert samples() == "1"
    (dynid.folder / "dynid.yaml").write_text("toy: {samples: 2}\n")
    assert samples() == "2"
    (dynid.folder / "other.yaml").write_text("toy:\n  samples: 9\n")
    assert samples("--config other.yaml") == "9", "it stands in for both files"
    assert samples(DYNID_SAMPLES="3") == "3"
    assert samples(DYNID_SAMPLES="3", DYNID_TOY_SAMPLES="4") == "4"
    assert samples("--samples 5", DYNID_SAMPLES="3") == "5"


def test_common_options_stand_at_the_top_of_the_file(dynid):
    (dynid.folder / "dynid.yaml").write_text("seed: 7\nquiet: yes\nout: results\n")
    assert dynid("toy values").out == "samples 200 seed 7 quiet True out results\n"


@pytest.mark.parametrize(
    ("text", "status", "message"),
    rows("""
        toy:\\n  sampels: 1 | 3 | error[E201] dynid.yaml:2: unknown key 'sampels'; did you mean 'samples'?
        seeed: 1 | 3 | error[E201] dynid.yaml:1: unknown key 'seeed'; did you mean 'seed'?
        toy:\\n  samples: many | 2 | where   dynid.yaml:2
        toy:\\n  samples: [1, 2] | 3 | error[E208] dynid.yaml:2: toy.samples must be a word
    """),
)
def test_wrong_keys_and_values_are_named_by_file_and_line(dynid, text, status, message):
    (dynid.folder / "dynid.yaml").write_text(text.replace("\\n", "\n"))
    err = dynid("toy values").failed(int(status), message)
    assert err.startswith("error[")


def test_doctor_shows_value_and_source_of_each_option(dynid):
    (dynid.folder / "dynid.yaml").write_text("out: results\ncheck:\n  sort_time: yes\n")
    settings = dynid("doctor --config --seed 4 --json", DYNID_QUIET="1").facts["settings"]
    found = {(s["command"], s["option"]): (s["value"], s["source"]) for s in settings}
    assert found["", "out"] == ("results", "dynid.yaml:1")
    assert found["", "seed"] == (4, "command line")
    assert found["", "quiet"] == ("1", "DYNID_QUIET")
    assert found["check", "sort_time"] == ("yes", "dynid.yaml:3")
    assert found["", "color"] == ("auto", "default")
    (dynid.folder / "dynid.yaml").write_text("check:\n  exclude: abc\n")
    assert "where   dynid.yaml:2" in dynid("check x").err
    assert "where   DYNID_SEED" in dynid("check x", DYNID_SEED="x").err


def kinds(kind=Options):
    return {kind}.union(*(kinds(each) for each in kind.__subclasses__()))


def test_every_number_on_the_command_line_is_one_that_can_be_measured():
    """click takes what is not a number for one in any range, and infinity where there is no upper end."""
    for param in [param for name in COMMANDS for param in command_of(name).params]:
        if isinstance(param.type, (click.types.FloatParamType, click.FloatRange)):
            small = ["1e-300", "-1"] if getattr(param.type, "min", None) == 0 else []
            *_, kind = [x for x in sorted(kinds(), key=str) if hasattr(x, param.name)]
            for text in ("nan", "inf", "-inf", "1e400", "1e13", *small):
                with pytest.raises((click.BadParameter, WrongUsage)):
                    kind(**{param.name: param.type.convert(text, param, None)})


# ---------------------------------------------------------------- questions and what happens when nobody can be asked
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


def test_a_variable_asks_nothing_on_a_terminal_either(dynid):
    assert "not asked: --no-input" in dynid.typing("toy ask P1", DYNID_NO_INPUT="1").err


# ---------------------------------------------------------------- P3
@pytest.mark.parametrize("words", ["", "-y", "--no-input", "--force -y"])
def test_nothing_but_the_typed_name_moves_the_arm(dynid, words):
    variables = dict.fromkeys(("DYNID_MOVE", "DYNID_TOY_MOVE"), "kinova_gen2")
    err = dynid(f"toy typed {words}", **variables).failed(7, "--move kinova_gen2")
    assert err.startswith("error[E703]")
    (dynid.folder / "dynid.yaml").write_text("toy:\n  move: kinova_gen2\n")
    assert "unknown key 'move'" in dynid(f"toy typed {words}").err


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
