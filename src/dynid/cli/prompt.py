"""The one place that reads stdin; every question has an answer for when nobody can be asked.

A question is asked only on a terminal (stdin and stderr), without --no-input and without -y. Nothing is ever read from
a pipe, so ``yes |`` answers nothing and a silent pipe blocks nothing.
"""

from __future__ import annotations

import select
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Literal, NamedTuple, get_args

from dynid.cli.failure import is_terminal
from dynid.cli.session import Session
from dynid.disk import write_text
from dynid.errors import CannotAsk, Declined, OutputExists, WrongUsage
from dynid.text import shell, visible

#: What a person may reply.
Reply = Literal["yes", "no", "retry", "quit"]
REPLIES: tuple[Reply, ...] = get_args(Reply)


class Question(NamedTuple):
    """One row of the table of questions.

    Attributes:
        text: the question; ``{name}`` is filled in.
        choices: letters that may be answered; a capital one is what Enter means.
        flag: options that answer it beforehand.
        unasked: answer when nobody can be asked.
        yes: answer with -y.
        note: what the unusual letters mean.
        unasked_text: what is said instead of no when nobody was asked.
    """

    text: str
    choices: str
    flag: str
    unasked: Reply
    yes: Reply
    note: str = ""
    unasked_text: str = "no"


QUESTIONS: dict[str, Question] = {
    "P1": Question(
        "Reduce to base parameters now?",
        "Ynr",
        "--reduce/--no-reduce",
        "yes",
        "yes",
        "r = edit the robot file, then rebuild",
    ),
    "P2": Question(
        "Does this motion look safe?",
        "yNq",
        "--accept",
        "no",
        "no",
        "n = change alpha, seed or waypoints and plan again",
        "written, marked reviewed: no",
    ),
    "P4": Question("Convert to log.npz now?", "Yn", "--convert/--no-convert", "yes", "yes"),
    "P5": Question(
        "Identify now?",
        "Ynr",
        "--identify/--no-identify",
        "no",
        "yes",
        "r = change the filter and stack again",
    ),
    "P6": Question("Overwrite {path}?", "yN", "--force", "no", "yes"),
    "P7": Question(
        "Add {effect} to a copy of the robot file?", "yN", "--apply/--no-apply", "no", "no"
    ),
    "P8": Question("{path} is stale. Rebuild?", "Yn", "--rebuild/--frozen", "yes", "yes"),
}


def obstacle(session: Session) -> str:
    """Return why nobody can be asked; empty if a person is at the terminal."""
    if session.no_input:
        return "--no-input"
    return "" if is_terminal(sys.stdin) and is_terminal(sys.stderr) else "no terminal"


def can_ask(session: Session) -> bool:
    """Return whether a person sits at the terminal and wants to be asked."""
    return not obstacle(session)


def ask(session: Session, id: str, *, given: bool | None = None, **fill: object) -> Reply:
    """Ask a question of the table, or answer it as the table says and tell so.

    Args:
        session: of the command.
        id: row of the table, ``"P1"`` to ``"P8"``.
        given: value of the option that answers it; None when it was not given.
        fill: values for the question's ``{name}`` places.
    """
    question = QUESTIONS[id]
    if given is not None:
        return "yes" if given else "no"
    text, letters = question.text.format(**fill), "/".join(question.choices)
    answer, reason = question.unasked, obstacle(session)
    if session.yes:
        answer, reason = question.yes, "-y"
    if not reason:
        note = f"  {question.note}  " if question.note else ""
        usual = "".join(letter.lower() for letter in question.choices if letter.isupper())
        while (line := _read_line(session, f"? {text} [{letters}] {note}")) is not None:
            word = line.strip().lower() or usual
            for each in REPLIES:
                if word and each.startswith(word) and each[0] in letters.lower():
                    return each
            session.say(f"  answer with one of {', '.join(question.choices.lower())}")
    shown = question.unasked_text if answer == "no" else answer
    why = f"not asked: {reason or 'end of input'}; set with {question.flag}"
    session.say(f"? {text} -> {shown} ({why})", indent=2)
    return answer


def confirm(session: Session, robot: str, given: str | None) -> None:
    """Have a person type a robot's name before it moves (P3); -y never answers this.

    Args:
        session: of the command.
        robot: the name.
        given: value of --move, which stands in for typing.

    Raises:
        CannotAsk: nobody can be asked.
        WrongUsage: the option names something else.
        Declined: the person typed something else.
    """
    question, option = "type the robot's name to start", shell("--move", robot)
    why, reason = "the arm was not moved", obstacle(session)
    if given is None:
        line = None if reason else _read_line(session, f"{question}: ")
        if line is None:
            what = f'cannot ask "{question}": {reason or "end of input"}'
            raise CannotAsk(what, fix=f"add {option}")
        if line.strip() != robot:
            raise Declined(f"'{visible(line.strip())}' is not '{robot}'", why=why)
    elif given != robot:
        raise WrongUsage(f"--move names '{given}', this is '{robot}'", why=why, fix=option)


def _read_line(session: Session, shown: str) -> str | None:
    """Show a question on stderr and read a line from the terminal; None at the end of input."""
    session.progress.end()
    sys.stderr.write(visible(shown))
    sys.stderr.flush()
    line = _line()
    if not line:
        sys.stderr.write("\n")
    return line or None


def _line() -> str:
    try:
        return sys.stdin.readline()
    except (OSError, ValueError):
        return ""


def key_pressed(session: Session) -> bool:
    """Return whether the person at the terminal has pressed Enter since the last look; False without a terminal."""
    return can_ask(session) and bool(select.select([sys.stdin], [], [], 0)[0]) and bool(_line())


# ---------------------------------------------------------------- P6: overwriting
def may_write(
    session: Session,
    path: Path,
    inputs: Mapping[str, str] | None = None,
    other: str = "another folder with --out",
) -> bool:
    """Return whether to write a file (True) or to reuse the one that is there (False).

    Args:
        session: of the command.
        path: the file.
        inputs: what it would be made from, by name; None for a file that does not say it.
        other: how it is written somewhere else.

    Raises:
        OutputExists: it exists, was made from something else, and nobody can be asked.
        Declined: the person does not want it overwritten.
    """
    if session.force or not path.exists():
        return True
    fix, stored = f"use --force, or {other}", None
    if inputs is not None:
        from dynid.files.artifact import read_header  # with NumPy, and help must be fast

        stored = read_header(path).get("inputs")
        if stored == dict(inputs) and not session.yes:
            session.stage(
                "reused", f"{path}       (made from the same inputs; --force makes it again)"
            )
            return False
    if not session.yes and not can_ask(session):
        difference = "" if inputs is None else f" and {_difference(stored, inputs)}"
        raise OutputExists(f"{path} exists{difference}", fix=fix)
    if ask(session, "P6", path=path) != "yes":
        raise Declined(f"{path} is left as it was", fix=fix)
    return True


def write_once(session: Session, path: Path, text: str) -> None:
    """Write a text, unless the file holds it already; ask before another one is overwritten."""
    if path.is_file() and path.read_bytes() == text.encode() and not session.force:
        session.stage("reused", f"{path}       (the same bytes)")
        session.written.append(path)  # for the JSON answer it is as if it had been written
    elif may_write(session, path):
        write_text(path, text)
        session.wrote(path)


def _difference(stored: object, inputs: Mapping[str, str]) -> str:
    if not isinstance(stored, Mapping):
        return "does not say what it was made from"
    changes = []
    for name in sorted({*stored, *inputs}):
        old, new = (str(each.get(name, "none")) for each in (stored, inputs))
        if old != new:
            changes.append(f"{name} {old:.12} -> {new:.12}")
    return f"differs in inputs ({', '.join(changes)})"
