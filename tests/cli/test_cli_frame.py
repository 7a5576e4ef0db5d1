"""Streams, colours, exit statuses, precedence, suggestions, crashes, interruptions: what holds for every command."""

import json
import re
import signal
import subprocess
import sys

import click
import pytest
import yaml

from dynid.cli.commands import COMMANDS, command_of
from dynid.cli.main import loop_map
from dynid.codes import catalogue
from dynid.errors import EXIT_MEANING, WrongUsage
from dynid.options import Options

ESCAPE = "\x1b"


# ---------------------------------------------------------------- help
def imported_by(dynid, *args):
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "dynid", *args],
        cwd=dynid.folder,
        env=dynid.env,
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0
    return {line.rsplit("|", 1)[-1].strip() for line in done.stderr.splitlines() if "|" in line}


@pytest.mark.parametrize(
    "args", [(), ("-h",), ("--help",), ("--version",), ("doctor", "-h"), ("explain", "E307")]
)
def test_help_imports_nothing_heavy(dynid, args):
    heavy = {"numpy", "sympy", "scipy", "matplotlib", "pybullet", "rospy", "rosbags", "jinja2"}
    assert not imported_by(dynid, *args) & heavy


def test_the_map_lists_the_commands_that_exist_and_no_others():
    rows, small = loop_map().split("  Also ")
    listed = (
        re.findall(r"^ {2}(?:Loop \d|Then)? +([a-z]+) ", rows, re.M)
        + small.split("\n\n")[0].split()
    )
    assert listed == list(COMMANDS)


def test_bare_dynid_prints_the_map(dynid):
    done = dynid()
    assert (done.status, done.err) == (0, "")
    assert done.out == loop_map() + "\n"


def test_help_lists_all_exit_statuses(dynid):
    text = dynid("-h").out
    for status, meaning in EXIT_MEANING.items():
        assert re.search(rf"^ +{int(status)} +{re.escape(meaning)}$", text, re.M)


@pytest.mark.parametrize("name", sorted(COMMANDS))
def test_every_command_has_help_with_examples_at_every_spelling(dynid, name):
    first, *others = (dynid(*args) for args in ((name, "-h"), (name, "--help"), ("help", name)))
    assert first.status == 0
    assert first.out.index("Examples:") < first.out.index("ptions:")
    assert "Docs: docs/" in first.out
    assert all(other == first for other in others)


def test_version_names_python_numpy_simulator_and_ros(dynid):
    text = dynid("--version").out
    for word in ("dynid", "Python", "numpy", "PyBullet", "ROS 1"):
        assert re.search(rf"^{word} +\S", text, re.M)


# ---------------------------------------------------------------- wrong words
def test_a_misspelt_command_is_suggested(dynid):
    done = dynid("doctr")
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("error[E101] no command 'doctr'; did you mean 'doctor'?")


def test_a_misspelt_option_is_suggested(dynid):
    done = dynid("toy", "values", "--sampels", "3")
    assert (done.status, done.out) == (2, "")
    assert "no such option: --sampels; did you mean '--samples'?" in done.err


@pytest.mark.parametrize(
    "words", [("values", "--samples", "x"), (), ("values", "--color", "blue"), ("nothing",)]
)
def test_wrong_usage_exits_2_in_the_style_of_the_catalogue(dynid, words):
    done = dynid("toy", *words)
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("error[E101] ")
    assert "fix     dynid toy -h" in done.err


# ---------------------------------------------------------------- errors
def test_an_error_has_four_parts_and_its_exit_status(dynid):
    done = dynid("toy", "error")
    assert (done.status, done.out) == (3, "")
    assert [line.split()[0] for line in done.err.splitlines()] == [
        "error[E306]",
        "where",
        "why",
        "fix",
    ]


def test_debug_shows_the_traceback(dynid):
    assert "Traceback" in dynid("toy", "error", "--debug").err
    assert "Traceback" in dynid("toy", "crash", DYNID_DEBUG="1").err


def test_a_limit_that_is_not_met_exits_1(dynid):
    assert dynid("toy", "limit").status == 1


def test_an_unforeseen_exception_leaves_a_crash_file_and_status_70(dynid):
    done = dynid("toy", "crash")
    assert (done.status, done.out) == (70, "")
    assert len(done.err.splitlines()) == 2
    assert "Traceback" not in done.err
    (file,) = (dynid.home / ".cache/dynid").glob("crash-*.txt")
    assert str(file) in done.err
    text = file.read_text()
    for word in (
        "ZeroDivisionError: something unforeseen",
        "Traceback",
        "command: dynid toy crash",
        "numpy",
        "Python",
    ):
        assert word in text


def test_codes_are_unique_and_every_class_says_why_and_how():
    classes = catalogue().values()
    assert len({cls.code for cls in classes}) == len(list(classes))
    assert all(cls.why and cls.fix and cls.__doc__ for cls in classes)


# ---------------------------------------------------------------- interruptions
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_command_says_one_line_and_leaves_no_half_file(dynid, number):
    process = dynid.start("toy", "wait", stdout=-1, stderr=-1)
    assert process.stdout.readline() == b"ready\n"
    assert list(dynid.folder.iterdir())
    process.send_signal(number)
    _, err = process.communicate(timeout=50)  # it would wait for a minute
    assert (process.returncode, err) == (130, b"interrupted\n")
    assert list(dynid.folder.iterdir()) == []


# ---------------------------------------------------------------- streams and colours
def test_the_answer_goes_to_stdout_and_everything_else_to_stderr(dynid):
    done = dynid("toy", "talk", "joint_1")
    assert done.out.split() == [
        "joint",
        "rms",
        "error",
        "joint_1",
        "0.42",
        "Nm",
        "joint_2",
        "0.31",
        "Nm",
    ]
    assert done.err.splitlines() == [
        "stage      about joint_1",
        "warning[W316] joint_1 reads 1.8 Nm at rest",
    ]


def test_json_is_one_object_on_stdout_with_any_verbosity(dynid):
    for words in ((), ("-vv",), ("-q",)):
        assert (
            json.loads(dynid("toy", "talk", "joint_1", "--json", *words).out)["joint"] == "joint_1"
        )


def test_what_is_not_finite_is_null_in_json(dynid):
    assert json.loads(dynid("toy", "values", "--json").out)["rms_nm"] is None


def test_quiet_leaves_answer_and_warnings(dynid):
    done = dynid("toy", "talk", "joint_1", "-q")
    assert done.err.splitlines() == ["warning[W316] joint_1 reads 1.8 Nm at rest"]
    assert "0.42 Nm" in done.out


def test_verbose_adds_detail_and_the_log_file_has_it_anyway(dynid):
    assert "detail" in dynid("toy", "talk", "joint_1", "-v").err
    assert "detail" not in dynid("toy", "talk", "joint_1", "--log-file", "a/b.log").err
    text = (dynid.folder / "a/b.log").read_text()
    assert "detail" in text
    assert "W316" in text


@pytest.mark.parametrize("name", ["[red]x", "<b>x", "[/]", ":smile:", "x\x1b[31m\x07"])
def test_names_are_printed_literally(dynid, name):
    done = dynid("toy", "talk", name, "--color", "always")
    shown = name.replace("\x1b", "\\x1b").replace("\x07", "\\x07")
    assert shown in done.out
    assert shown in done.err
    assert json.loads(dynid("toy", "talk", name, "--json").out)["joint"] == name


def test_colour_appears_on_a_terminal_or_when_asked_for(dynid):
    assert ESCAPE in dynid.typing("toy", "talk", "j").err
    assert ESCAPE in dynid("toy", "talk", "j", "--color", "always").out
    assert ESCAPE in dynid("toy", "error", "--color", "always").err


@pytest.mark.parametrize("quiet", [{"NO_COLOR": "1"}, {"TERM": "dumb"}, {"DYNID_COLOR": "never"}])
@pytest.mark.parametrize("job", [("talk", "j"), ("error",), ("ask", "P1")])
def test_no_escape_codes_on_a_terminal_that_does_not_want_them(dynid, quiet, job):
    done = dynid.typing("toy", *job, keys=["\n"], **quiet)
    assert ESCAPE not in done.err + done.out


def test_an_ascii_locale_gets_ascii(dynid):
    done = dynid("toy", "talk", "jänt", LANG="", LC_ALL="C")
    assert (done.out + done.err).isascii()
    assert "j\\xe4nt" in done.out
    assert "jänt" in dynid("toy", "talk", "jänt").out


def test_a_table_wider_than_the_terminal_becomes_lines_with_whole_numbers(dynid):
    done = dynid("toy", "wide", COLUMNS="60")
    assert max(len(line) for line in done.out.splitlines()) <= 60
    assert done.out.count("1234.5678 Nm") == 9
    assert len(dynid("toy", "wide").out.splitlines()) == 2


# ---------------------------------------------------------------- progress
def test_quick_work_shows_no_progress_and_slow_work_one_line_a_stage(dynid):
    assert dynid("toy", "work").err.splitlines() == ["slow       link 1", "slow       done"]


def test_slow_work_shows_a_bar_on_a_terminal_and_takes_it_away(dynid):
    shown = dynid.typing("toy", "work").err
    assert "quick" not in shown
    assert "\x1b[?25h" in shown  # the cursor is back
    assert "slow       done" in shown


# ---------------------------------------------------------------- who wins
def test_flag_beats_variable_beats_folder_beats_user_beats_default(dynid):
    def samples(*args, **env):
        return dynid("toy", "values", *args, **env).out.split()[1]

    user = dynid.home / ".config/dynid/config.yaml"
    user.parent.mkdir(parents=True)
    assert samples() == "200"
    user.write_text("toy: {samples: 1}\n")
    assert samples() == "1"
    (dynid.folder / "dynid.yaml").write_text("toy: {samples: 2}\n")
    assert samples() == "2"
    assert samples(DYNID_SAMPLES="3") == "3"
    assert samples(DYNID_SAMPLES="3", DYNID_TOY_SAMPLES="4") == "4"
    assert samples("--samples", "5", DYNID_SAMPLES="3") == "5"


def test_common_options_stand_at_the_top_of_the_file(dynid):
    (dynid.folder / "dynid.yaml").write_text("seed: 7\nquiet: yes\nout: results\n")
    assert dynid("toy", "values").out == "samples 200 seed 7 quiet True out results\n"


def test_config_stands_in_for_both_files(dynid):
    (dynid.folder / "dynid.yaml").write_text("seed: 7\n")
    (dynid.folder / "other.yaml").write_text("toy:\n  samples: 9\n")
    assert dynid("toy", "values", "--config", "other.yaml").out.startswith("samples 9 seed 0")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("toy:\n  sampels: 1\n", "dynid.yaml:2: unknown key 'sampels'; did you mean 'samples'?"),
        ("seeed: 1\n", "dynid.yaml:1: unknown key 'seeed'; did you mean 'seed'?"),
    ],
)
def test_unknown_keys_are_named_by_file_and_line(dynid, text, message):
    (dynid.folder / "dynid.yaml").write_text(text)
    done = dynid("toy", "values")
    assert (done.status, done.out) == (3, "")
    assert done.err.startswith(f"error[E201] {message}")


def test_a_wrong_value_in_the_file_is_named_by_file_and_line(dynid):
    (dynid.folder / "dynid.yaml").write_text("toy:\n  samples: many\n")
    done = dynid("toy", "values")
    assert done.status == 2
    assert "where   dynid.yaml:2" in done.err


def test_doctor_shows_value_and_source_of_each_option(dynid):
    (dynid.folder / "dynid.yaml").write_text("out: results\ncheck:\n  sort_time: yes\n")
    done = dynid("doctor", "--config", "--seed", "4", "--json", DYNID_QUIET="1")
    found = {
        (s["command"], s["option"]): (s["value"], s["source"])
        for s in json.loads(done.out)["settings"]
    }
    assert found["", "out"] == ("results", "dynid.yaml:1")
    assert found["", "seed"] == (4, "command line")
    assert found["", "quiet"] == ("1", "DYNID_QUIET")
    assert found["check", "sort_time"] == ("yes", "dynid.yaml:3")
    assert found["", "color"] == ("auto", "default")


# ---------------------------------------------------------------- run.yaml
def test_a_run_can_be_repeated_without_the_variables_and_files_it_was_made_with(dynid):
    (dynid.folder / "log.csv").write_text("t\n1\n")
    (dynid.folder / "dynid.yaml").write_text("seed: 7\n")
    assert dynid("toy", "write", "log.csv", "--not-given", DYNID_SAMPLES="5").status == 0
    (dynid.folder / "dynid.yaml").unlink()
    run = yaml.safe_load((dynid.folder / "out/arm/run.yaml").read_text())["toy"]
    assert run["arguments"][:2] == ["write", "log.csv"]
    assert sorted(run["arguments"][2:]) == sorted(["--seed", "7", "--not-given", "--samples", "5"])
    assert set(run["inputs"]) == {"log", "options"}
    assert dynid("toy", "--from", "out/arm/run.yaml").err.startswith("reused")
    assert "options sha" in dynid("toy", "--from", "out/arm/run.yaml", "--samples", "6").err


def test_a_run_of_another_command_cannot_be_repeated(dynid):
    (dynid.folder / "run.yaml").write_text("model: {arguments: [kinova_gen2]}\n")
    done = dynid("toy", "--from", "run.yaml")
    assert done.status == 2
    assert "holds no run of 'toy'; it has model" in done.err
    assert dynid("toy", "--from", "nowhere.yaml").status == 2


# ---------------------------------------------------------------- errors as JSON
def test_an_error_is_one_json_object_too(dynid):
    done = dynid("check", "no_such_arm", "--json")
    answer = json.loads(done.out)
    assert (answer["schema"], answer["status"], answer["error"]["code"]) == (
        "dynid/error/1",
        done.status,
        "E205",
    )
    assert "no_such_arm" in answer["error"]["what"]
    assert answer["error"]["fix"] in done.err


def kinds(kind=Options):
    return {kind}.union(*(kinds(each) for each in kind.__subclasses__()))


def test_every_number_on_the_command_line_is_one_that_can_be_measured():
    """click takes what is not a number for one in any range, and infinity where there is no upper end."""
    for param in [param for name in COMMANDS for param in command_of(name).params]:
        if isinstance(param.type, (click.types.FloatParamType, click.FloatRange)):
            small = ["1e-300", "-1"] if getattr(param.type, "min", None) == 0 else []
            kind, *_ = [each for each in kinds() if hasattr(each, param.name)]
            for text in ("nan", "inf", "-inf", "1e400", "1e13", *small):
                with pytest.raises((click.BadParameter, WrongUsage)):
                    kind(**{param.name: param.type.convert(text, param, None)})
