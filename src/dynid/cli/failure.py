"""What a person sees when something goes wrong: four short lines and an exit status, never a traceback unasked.

Everything here writes to stderr; stdout stays empty so that ``dynid ... --json | jq`` fails cleanly.
"""

from __future__ import annotations

import errno
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any, NoReturn, TextIO

import click

from dynid import workflows
from dynid.errors import CannotWrite, DynidError, ExitStatus, WrongUsage
from dynid.text import visible
from dynid.xdg import cache_folder

#: Errors of the machine that a person can do something about; anything else is a mistake of dynid.
_MACHINE = {
    errno.EACCES,
    errno.EPERM,
    errno.EROFS,
    errno.ENOSPC,
    errno.EDQUOT,
    errno.EFBIG,
    errno.EIO,
    errno.EMFILE,
}


@dataclass
class FailureContext:
    """What is known about the run when it fails.

    Attributes:
        words: the command line after ``dynid``.
        meta: shared notes of the click contexts: ``dynid.debug``, ``dynid.json`` and ``dynid.color``.
    """

    words: Sequence[str]
    meta: dict[str, Any] = field(default_factory=dict)

    @property
    def debug(self) -> bool:
        """Whether tracebacks are wanted."""
        return bool(self.meta.get("dynid.debug")) or "--debug" in self.words

    @property
    def json(self) -> bool:
        """Whether one JSON object is wanted on stdout."""
        return bool(self.meta.get("dynid.json")) or "--json" in self.words

    @property
    def color(self) -> str:
        """The value of --color as far as it was read."""
        return str(self.meta.get("dynid.color", "auto"))


def use_color(stream: TextIO, mode: str) -> bool:
    """Return whether escape codes may go to a stream; the flag beats NO_COLOR, which beats the terminal."""
    if mode != "auto":
        return mode == "always"
    plain = os.environ.get("NO_COLOR") or os.environ.get("TERM", "dumb") in ("dumb", "unknown")
    return not plain and is_terminal(stream)


def is_terminal(stream: IO[str] | None) -> bool:
    """Return whether a stream is an open terminal."""
    try:
        return stream is not None and stream.isatty()
    except ValueError:  # closed
        return False


def utf8_locale() -> bool:
    """Return whether the locale promises UTF-8; Python alone does not tell, because it upgrades the C locale."""
    name = os.environ.get("LC_ALL") or os.environ.get("LC_CTYPE") or os.environ.get("LANG") or "C"
    return "utf" in name.lower() or sys.platform in ("win32", "darwin")


def prepare_streams() -> None:
    """Make stdout and stderr survive any text, and say ASCII where the locale does; open what was closed."""
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(
                encoding=None if utf8_locale() else "ascii", errors="backslashreplace"
            )


def silence_streams() -> None:
    """Flush; where that fails, send the rest nowhere: the reader has left, or the disk is full."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except (OSError, ValueError):
            with suppress(OSError, ValueError):
                os.dup2(nowhere, stream.fileno())
                stream.flush()


def leave(status: int) -> NoReturn:
    """Flush the streams and end the program with a status, whatever signal still arrives."""
    with suppress(ValueError):  # not the main thread: the caller handles signals
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
    silence_streams()
    sys.exit(status)


def report(error: DynidError, context: FailureContext) -> int:
    """Print an error of the catalogue and return its exit status."""
    if context.debug:
        _say(_trace(error).rstrip())
    head = f"error[{error.code}]"
    if use_color(sys.stderr, context.color):
        head = click.style(head, fg="red", bold=True)
    _say(f"{head} {visible(error.what)}")
    for label, text in (("where", error.where), ("why", error.why), ("fix", error.fix)):
        # Why: file:line usually opens the message already; saying it twice would hide the rest.
        if text and not (label == "where" and text in error.what):
            _say(f"  {label:<7} {visible(text)}")
    _answer(
        context,
        int(error.status),
        error.code,
        error.what,
        where=error.where,
        why=error.why,
        fix=error.fix,
    )
    return int(error.status)


def _answer(context: FailureContext, status: int, code: str, what: str, **more: str) -> None:
    """Print the one JSON object of a run that an error has ended; nothing without --json."""
    if not context.json:
        return
    import json

    error = {"code": code, "what": what, **{key: text for key, text in more.items() if text}}
    try:
        click.echo(
            json.dumps({"schema": "dynid/error/1", "status": status, "error": error}, indent=2)
        )
    except OSError:  # the reader has left, or the disk is full
        silence_streams()


def usage_error(error: click.ClickException) -> DynidError:
    """Return a mistake that click found in the style of the catalogue."""
    ctx = getattr(error, "ctx", None)
    path = ctx.command_path if ctx else "dynid"
    text = " ".join(error.format_message().split()).rstrip(".")
    if isinstance(error, click.NoSuchOption):
        text = f"no such option: {error.option_name}"
        text += f"; did you mean '{error.possibilities[0]}'?" if error.possibilities else ""
    fix = f"{path} -h"
    if isinstance(error, click.NoSuchOption) and path == "dynid":
        fix = f"options stand after the command: dynid COMMAND {error.option_name}"
    place = ""
    if isinstance(error, click.BadParameter) and ctx is not None and error.param is not None:
        place = ctx.meta.get("dynid.places", {}).get(error.param.name, "")
        source = ctx.get_parameter_source(error.param.name or "")
        place = place if source is click.core.ParameterSource.DEFAULT_MAP else ""
    why = "the command line cannot be understood"
    return WrongUsage(text[:1].lower() + text[1:], where=place or path, why=why, fix=fix)


def is_users(error: OSError) -> bool:
    """Return whether an error of the system is about a file or the machine, not a mistake of dynid."""
    return error.errno in _MACHINE or error.filename is not None or _folder_is_gone(error)


def _folder_is_gone(error: OSError) -> bool:
    """Return whether the current folder was removed while somebody stands in it."""
    return error.errno == errno.ENOENT and error.filename is None


def os_error(error: OSError) -> DynidError:
    """Return an error of the system in the style of the catalogue."""
    place = str(error.filename) if error.filename is not None else "the output"
    if _folder_is_gone(error):
        return CannotWrite(
            "the current folder was removed", where="the current folder", fix="cd to another one"
        )
    return CannotWrite(f"cannot read or write {place}: {error.strerror or error}", where=place)


def interrupted() -> int:
    """Say that the run was stopped; what half-done objects say while they are cleared away helps nobody."""
    sys.unraisablehook = lambda _: None
    _say("interrupted")
    return int(ExitStatus.INTERRUPTED)


def crash(error: BaseException, context: FailureContext) -> int:
    """Write a crash file, say where it is, and return status 70; what an interrupt has set off is an interrupt."""
    if _set_off_by_interrupt(error):
        return interrupted()
    trace = _trace(error)
    if context.debug:
        _say(trace.rstrip())
    file = _crash_file(f"{_facts(context)}\n{trace}")
    _say(f"internal error: {type(error).__name__}: {visible(str(error))[:200]}")
    if file:
        _say(f"  details in {file}; report it with that file, or run again with --debug")
    else:
        _say("  no crash file could be written; run again with --debug to see the details")
    _answer(
        context,
        int(ExitStatus.INTERNAL),
        "E700",
        f"{type(error).__name__}: {error}",
        where=str(file or ""),
    )
    return int(ExitStatus.INTERNAL)


def _set_off_by_interrupt(error: BaseException) -> bool:
    """Return whether Ctrl-C came first; a zip archive, for one, cannot be closed while an entry is being written."""
    before: BaseException | None = error
    while before is not None and not isinstance(before, KeyboardInterrupt):
        before = before.__context__
    return before is not None


def _trace(error: BaseException) -> str:
    import traceback  # here and below: only failures need these, and help must be fast

    return "".join(traceback.format_exception(error))


def _facts(context: FailureContext) -> str:
    import platform

    command, folder = " ".join(["dynid", *context.words]), os.environ.get("PWD", "")
    return "\n".join(
        [
            *workflows.doctor.version_lines(),
            platform.platform(),
            f"command: {command}",
            f"folder: {folder}",
            "",
        ]
    )


def _crash_file(text: str) -> Path | None:
    import tempfile
    from datetime import datetime

    name = f"crash-{datetime.now().astimezone():%Y%m%d-%H%M%S}-{os.getpid()}.txt"
    for folder in (cache_folder(), Path(tempfile.gettempdir())):
        try:
            folder.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8", errors="backslashreplace")
        except OSError:
            continue
        return folder / name
    return None


def _say(line: str) -> None:
    try:
        click.echo(line, err=True, color=True)
    except OSError:  # the reader has left, or the disk is full
        silence_streams()
