"""The one place that reads stdin; every question has an answer for when nobody can be asked.

A question is asked only on a terminal (stdin and stderr), without --no-input and without -y. Nothing is ever read from
a pipe, so ``yes |`` answers nothing and a silent pipe blocks nothing.
"""

from __future__ import annotations

import hashlib
import json
import re
import select
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

from dynid.cli.failure import is_terminal
from dynid.cli.options import Common
from dynid.cli.terminal import plain
from dynid.disk import sha256, write_text
from dynid.errors import CannotAsk, Declined, OutputExists, WrongUsage
from dynid.text import shell, visible

#: After so many answers that are none, the terminal is taken to be a machine.
ATTEMPTS = 5


class Answer(Enum):
    """What a person may answer."""

    YES = "yes"
    NO = "no"
    RETRY = "retry"
    QUIT = "quit"


_LETTERS = {"y": Answer.YES, "n": Answer.NO, "r": Answer.RETRY, "q": Answer.QUIT}


@dataclass(frozen=True)
class Question:
    """One row of the table of questions.

    Attributes:
        text: the question; ``{name}`` is filled in.
        choices: letters that may be answered; a capital one is what Enter means.
        flag: options that answer it beforehand.
        unasked: answer when nobody can be asked.
        yes: answer with -y.
        note: what the unusual letters mean.
        unasked_text: what is said instead of yes or no when nobody was asked.
    """

    text: str
    choices: str
    flag: str
    unasked: Answer
    yes: Answer
    note: str = ""
    unasked_text: str = ""


QUESTIONS: dict[str, Question] = {
    "P1": Question(
        "Reduce to base parameters now?",
        "Ynr",
        "--reduce/--no-reduce",
        Answer.YES,
        Answer.YES,
        "r = edit the robot file, then rebuild",
    ),
    "P2": Question(
        "Does this motion look safe?",
        "yNq",
        "--accept",
        Answer.NO,
        Answer.NO,
        "n = change alpha, seed or waypoints and plan again",
        "written, marked reviewed: no",
    ),
    "P4": Question(
        "Convert to log.npz now?", "Yn", "--convert/--no-convert", Answer.YES, Answer.YES
    ),
    "P5": Question(
        "Identify now?",
        "Ynr",
        "--identify/--no-identify",
        Answer.NO,
        Answer.YES,
        "r = change the filter and stack again",
    ),
    "P6": Question("Overwrite {path}?", "yN", "--force", Answer.NO, Answer.YES),
    "P7": Question(
        "Add {effect} to a copy of the robot file?",
        "yN",
        "--apply/--no-apply",
        Answer.NO,
        Answer.NO,
    ),
    "P8": Question("{path} is stale. Rebuild?", "Yn", "--rebuild/--frozen", Answer.YES, Answer.YES),
}


def can_ask(common: Common) -> bool:
    """Return whether a person sits at the terminal and wants to be asked."""
    return not common.no_input and is_terminal(sys.stdin) and is_terminal(sys.stderr)


def ask(common: Common, id: str, *, given: bool | None = None, **fill: object) -> Answer:
    """Ask a question of the table, or answer it as the table says and tell so.

    Args:
        common: the common options.
        id: row of the table, ``"P1"`` to ``"P8"``.
        given: value of the option that answers it; None when it was not given.
        fill: values for the question's ``{name}`` places.
    """
    question = QUESTIONS[id]
    if given is not None:
        return Answer.YES if given else Answer.NO
    text = question.text.format(**fill)
    if common.yes:
        return _unasked(common, text, question, question.yes, "-y")
    if not can_ask(common):
        return _unasked(common, text, question, question.unasked, _reason(common))
    return _asked(common, text, question)


def _reason(common: Common) -> str:
    return "--no-input" if common.no_input else "no terminal"


def _unasked(common: Common, text: str, question: Question, answer: Answer, reason: str) -> Answer:
    shown = question.unasked_text if answer is Answer.NO and question.unasked_text else answer.value
    common.terminal.say(
        f"? {text} -> {shown} (not asked: {reason}; set with {question.flag})", indent=2
    )
    return answer


def _asked(common: Common, text: str, question: Question) -> Answer:
    shown = f"? {text} [{'/'.join(question.choices)}] {'  ' + question.note + '  ' if question.note else ''}"
    allowed = question.choices.lower()
    usual = next((letter.lower() for letter in question.choices if letter.isupper()), "")
    for _ in range(ATTEMPTS):
        line = _read_line(shown)
        if line is None:
            return _unasked(common, text, question, question.unasked, "end of input")
        word = line.strip().lower() or usual
        found = next(
            (letter for letter in allowed if word and _LETTERS[letter].value.startswith(word)), None
        )
        if found:
            return _LETTERS[found]
        common.terminal.say(f"  answer with one of {', '.join(allowed)}")
    tried = f"{ATTEMPTS} answers were none of {', '.join(allowed)}"
    raise CannotAsk(f'cannot ask "{text}": {tried}', fix=f"add {question.flag}")


def confirm(
    common: Common, expected: str, question: str, *, given: str | None = None, flag: str = "--move"
) -> None:
    """Have a person type a word before something dangerous (P3); -y never answers this.

    Args:
        common: the common options.
        expected: the word, such as the robot's name.
        question: what is asked, such as ``"type the robot's name to start"``.
        given: value of the option that stands in for typing.
        flag: that option.

    Raises:
        CannotAsk: nobody can be asked.
        WrongUsage: the option names something else.
        Declined: the person typed something else.
    """
    if given is not None:
        if given != expected:
            raise WrongUsage(
                f"{flag} names '{given}', but this is '{expected}'", fix=shell(flag, expected)
            )
        return
    if not can_ask(common):
        raise CannotAsk(
            f'cannot ask "{question}": {_reason(common)}', fix=f"add {shell(flag, expected)}"
        )
    line = _read_line(f"{question}: ")
    if line is None:
        raise CannotAsk(
            f'cannot ask "{question}": end of input', fix=f"add {shell(flag, expected)}"
        )
    if line.strip() != expected:
        raise Declined(
            f"'{visible(line.strip())}' is not '{expected}'", why="the arm was not moved"
        )


def ask_line(common: Common, question: str) -> str:
    """Return what a person writes after a question; an empty line at the end of input or when nobody can be asked."""
    return (_read_line(f"? {question}: ") or "").strip() if can_ask(common) else ""


def _read_line(shown: str) -> str | None:
    """Show a question on stderr and read a line from the terminal; None at the end of input."""
    sys.stderr.write(visible(shown))
    sys.stderr.flush()
    try:
        line = sys.stdin.readline()
    except (OSError, ValueError):
        line = ""
    if not line:
        sys.stderr.write("\n")
        return None
    return line


def key_pressed(common: Common) -> bool:
    """Return whether the person at the terminal has pressed Enter since the last look; False without a terminal."""
    if not can_ask(common):
        return False
    ready, _, _ = select.select([sys.stdin], [], [], 0)
    return bool(ready) and _read_line("") is not None


# ---------------------------------------------------------------- P6: overwriting
def input_hashes(
    files: Mapping[str, Path], options: Mapping[str, Any] | None = None
) -> dict[str, str]:
    """Return what a result depends on, for its header's ``inputs``: sha256 of files, and of the options as a whole."""
    hashes = {name: sha256(path) for name, path in files.items()}
    if options is not None:
        text = json.dumps(plain(options), sort_keys=True)
        hashes["options"] = hashlib.sha256(text.encode()).hexdigest()
    return hashes


def may_write(common: Common, path: Path, inputs: Mapping[str, str]) -> bool:
    """Return whether to write a result (True) or to reuse the one that is there (False).

    Args:
        common: the common options.
        path: the result.
        inputs: ``input_hashes`` of what it would be made from.

    Raises:
        OutputExists: it exists, was made from something else, and nobody can be asked.
        Declined: the person does not want it overwritten.
    """
    from dynid.files.artifact import read_header

    if common.force or not path.exists():
        return True
    found = (read_header(path) or {}).get("inputs")
    if found == dict(inputs) and not common.yes:
        common.terminal.stage(
            "reused", f"{path}       (made from the same inputs; --force makes it again)"
        )
        return False
    if not common.yes and not can_ask(common):
        difference = _difference(found, inputs)
        raise OutputExists(
            f"{path} exists and {difference}", fix="use --force, or another folder with --out"
        )
    if ask(common, "P6", path=path) is Answer.YES:
        return True
    raise Declined(f"{path} is left as it was", fix="use --force, or another folder with --out")


def write_once(common: Common, path: Path, text: str) -> None:
    """Write a text, unless the file holds it already; ask before another one is overwritten."""
    if path.is_file() and path.read_bytes() == text.encode() and not common.force:
        common.terminal.stage("reused", f"{path}       (the same bytes)")
    elif may_write(common, path, {}):
        write_text(path, text)
        common.terminal.wrote(path)


def _difference(found: object, inputs: Mapping[str, str]) -> str:
    if not isinstance(found, Mapping):
        return "does not say what it was made from"
    changed = [
        f"{name} {_brief(str(found.get(name, 'none')), str(inputs.get(name, 'none')))}"
        for name in sorted({*found, *inputs})
        if found.get(name) != inputs.get(name)
    ]
    return f"differs in inputs ({', '.join(changed)})"


def _brief(old: str, new: str) -> str:
    """Show a change: of hashes the beginning, of options all."""
    if any(re.fullmatch("[0-9a-f]{16,}", text) for text in (old, new)):
        return f"sha {old[:4]} -> {new[:4]}"
    return f"{old or 'none'} -> {new or 'none'}"
