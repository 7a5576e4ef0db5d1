"""What scripts rely on: commands, options, exit statuses, error codes, JSON keys, names and keys of files.

contract.json holds what they were when the contract was frozen. More may come; what is there stays. Where the contract
itself shall change, ``frozen.py`` writes it anew, and the difference is read line by line.
"""

import json

import pytest
from frozen import TABLE, chapter, errors, lost, options
from situations import CHAPTERS

FROZEN = json.loads(TABLE.read_text())
#: Their answers need an arm and ROS.
WITHOUT_ANSWER = {"record", "sim-driver"}


def differences(then, now):
    """Say in which ways a situation is no longer what it was."""
    for name in ("status", "errors", "answered", "schema"):
        if then.get(name) != now.get(name):
            yield f"{name} was {then.get(name)}, is {now.get(name)}"
    if missing := lost(then.get("keys", []), now.get("keys", [])):
        yield f"keys lost: {', '.join(missing)}"
    for file, inside in then.get("files", {}).items():
        if file not in now.get("files", {}):
            yield f"{file} is no longer written"
        elif missing := lost(inside, now["files"][file]):
            yield f"{file} has lost {', '.join(missing)}"


#: Chapters with searches, plans and demonstrations, and with rarer words of identify.
SLOW = {"searches", "more of identify", "motions", "a list and the rest", "a hidden effect"}


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow if name in SLOW else ()) for name in CHAPTERS],
)
def test_commands_answer_as_they_did_when_the_contract_was_frozen(name, tmp_path):
    frozen, now = FROZEN["situations"][name], chapter(name, tmp_path / "chapter")
    assert list(frozen) == list(now), "the table does not hold these command lines: run frozen.py"
    assert not [
        f"dynid {line}: {text}" for line in frozen for text in differences(frozen[line], now[line])
    ]


def test_no_command_and_no_option_is_lost(dynid):
    now = options(dynid)
    assert not [
        f"{command} {option}"
        for command, names in FROZEN["options"].items()
        for option in ["", *names]
        if option not in ["", *now.get(command, ())] or command not in now
    ]


def test_no_error_is_lost_and_each_keeps_its_exit_status(dynid):
    now = errors(dynid)
    assert {code: now.get(code) for code in FROZEN["errors"]} == FROZEN["errors"]


def test_every_command_stands_in_the_table(dynid):
    told = [line.split() for name in FROZEN["situations"] for line in FROZEN["situations"][name]]
    for command in options(dynid):
        assert any(words[0] == command for words in told), command
        answered = any(words[0] == command and "--json" in words for words in told)
        assert answered or command in WITHOUT_ANSWER, f"{command} --json"
