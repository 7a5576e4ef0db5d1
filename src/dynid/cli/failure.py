"""What a person sees when something goes wrong: four short lines and an exit status, never a traceback unasked.

Everything here writes to stderr; with --json, stdout gets one object that says the same.
"""

from __future__ import annotations

import errno
import json
import os
import platform
import signal
import sys
import traceback
from collections.abc import Sequence
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import IO, NoReturn, TextIO

import click
from click.core import ParameterSource

from dynid import workflows
from dynid.errors import CannotWrite, DynidError, ExitStatus, OutOfMemory, WrongUsage
from dynid.text import visible
from dynid.xdg import cache_folder


# ---------------------------------------------------------------- streams
def use_color(stream: TextIO, mode: str) -> bool:
    """Return whether escape codes may go to a stream; the flag beats NO_COLOR, which beats the terminal."""
    if mode != "auto":
        return mode == "always"
    colorless = os.environ.get("NO_COLOR") or os.environ.get("TERM", "dumb") in ("dumb", "unknown")
    return not colorless and is_terminal(stream)


def is_terminal(stream: IO[str] | None) -> bool:
    """Return whether a stream is an open terminal."""
    try:
        return stream is not None and stream.isatty()
    except ValueError:  # closed
        return False


def prepare_streams() -> None:
    """Make stdout and stderr survive any text, and say ASCII where the locale does; open what was closed."""
    # Why not what Python says: it takes UTF-8 for the C locale.
    name = os.environ.get("LC_ALL") or os.environ.get("LC_CTYPE") or os.environ.get("LANG") or "C"
    utf8 = "utf" in name.lower() or sys.platform in ("win32", "darwin")
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, Path(os.devnull).open("w"))  # noqa: SIM115
        elif hasattr(stream, "reconfigure"):
            stream.reconfigure(encoding=None if utf8 else "ascii", errors="backslashreplace")


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


def echo(text: str, *, err: bool = True) -> None:
    """Write a line; where nobody reads or the disk is full, nowhere."""
    try:
        click.echo(text, err=err, color=True)
    except OSError:
        silence_streams()


# ---------------------------------------------------------------- what went wrong
def ended(error: BaseException, words: Sequence[str], ctx: click.Context | None) -> int:
    """Say what has ended a run and return its exit status.

    Args:
        error: what was raised.
        words: the command line after ``dynid``.
        ctx: of the command, as far as it was read.
    """
    given = ctx.params if ctx else {}
    if isinstance(error, click.exceptions.Exit):
        return error.exit_code
    if isinstance(error, BrokenPipeError):
        return ExitStatus.DONE
    if _interrupted(error):
        # Why: what half-done objects say while they are cleared away helps nobody.
        sys.unraisablehook = lambda _: None
        echo("interrupted")
        return ExitStatus.INTERRUPTED
    trace = "".join(traceback.format_exception(error)).rstrip()
    if given.get("debug") or "--debug" in words:
        echo(trace)
    mistake = _mistake(error) or _crash(error, words, trace)
    mistake.where = _place(ctx, error, mistake.where) if ctx else mistake.where
    said = {
        key: visible(text)
        for key in ("code", "what", "where", "why", "fix")
        if (text := getattr(mistake, key))
    }
    head = f"error[{mistake.code}]"
    if use_color(sys.stderr, str(given.get("color", "auto"))):
        head = click.style(head, fg="red", bold=True)
    echo(f"{head} {said['what']}")
    for label in ("where", "why", "fix"):
        # Why: file:line usually opens the message already; saying it twice would hide the rest.
        if label in said and not (label == "where" and mistake.where in mistake.what):
            echo(f"  {label:<7} {said[label]}")
    if given.get("json") or "--json" in words:
        answer = {"schema": "dynid/error/1", "status": int(mistake.status), "error": said}
        echo(json.dumps(answer, indent=2), err=False)
    return mistake.status


def _interrupted(error: BaseException | None) -> bool:
    """Return whether Ctrl-C came first; a zip archive, for one, cannot be closed while an entry is being written."""
    while error is not None and not isinstance(error, (KeyboardInterrupt, click.Abort)):
        error = error.__context__
    return error is not None


def _mistake(error: BaseException) -> DynidError | None:
    """Return an error in the style of the catalogue; None for a mistake of dynid."""
    match error:
        case DynidError():
            return error
        case click.ClickException():
            return _usage_error(error)
        case MemoryError():
            return OutOfMemory(f"there is not enough memory: {error or 'none is left'}")
        case OSError():
            gone = "the current folder" if error.errno == errno.ENOENT else "the output"
            place = str(error.filename or gone)
            what = f"cannot read or write {place}: {error.strerror or error}"
            return CannotWrite(what, where=place)
    return None


def _usage_error(error: click.ClickException) -> DynidError:
    ctx = getattr(error, "ctx", None)
    where = ctx.command_path if ctx else "dynid"
    fix = f"{where} -h"
    text = " ".join(error.format_message().split()).rstrip(".")
    if isinstance(error, click.NoSuchOption):
        near = error.possibilities
        text = f"no such option: {error.option_name}"
        text += f"; did you mean '{near[0]}'?" if near else ""
    why = "the command line cannot be understood"
    return WrongUsage(text[:1].lower() + text[1:], where=where, why=why, fix=fix)


def _place(ctx: click.Context, error: BaseException, where: str) -> str:
    """Return the line of a file or the variable that a wrong option has its value from, ``where`` for neither."""
    for param in ctx.command.params:
        # Why the second: what reads an option says its flag.
        if param is getattr(error, "param", None) or where in param.opts:
            match ctx.get_parameter_source(name := str(param.name)):
                case ParameterSource.DEFAULT_MAP:
                    return str(ctx.meta["dynid.settings"][name].where)
                case ParameterSource.ENVIRONMENT:
                    return next(filter(os.environ.get, param.envvar or ()))
    return where


def _crash(error: BaseException, words: Sequence[str], trace: str) -> DynidError:
    """Return a mistake of dynid, whose traceback is in a crash file where one can be written."""
    command = f"command: {' '.join(['dynid', *words])}"
    lines = *workflows.doctor.version_lines(), platform.platform(), command, "", trace
    file = cache_folder() / f"crash-{datetime.now():%Y%m%d-%H%M%S}-{os.getpid()}.txt"
    what, where = f"internal error: {type(error).__name__}: {error}"[:200], str(file)
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("\n".join(lines), encoding="utf-8", errors="backslashreplace")
    except OSError:
        where = "no file, which could not be written"
    fix = "report it with that file, or run again with --debug"
    return DynidError(f"{what}; details in {where}", where=where, fix=fix)
