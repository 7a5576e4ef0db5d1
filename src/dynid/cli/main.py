"""The entry point: finds the command, runs it, and turns whatever goes wrong into a message and an exit status.

Command modules are imported only when they run, so that ``dynid --help`` stays fast; the table below holds their help.
"""

from __future__ import annotations

import importlib
import importlib.util
import os
import signal
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any, NoReturn

import click

from dynid import workflows
from dynid.cli import failure
from dynid.cli.commands import COMMANDS, Entry
from dynid.errors import EXIT_MEANING, DynidError, ExitStatus, OutOfMemory, WrongUsage
from dynid.text import closest
from dynid.version import __version__

EXAMPLES = (
    "dynid                              the map of the loops",
    "dynid model kinova_gen2            base regressor of a bundled arm",
    "dynid check my_arm.yaml            look for mistakes in a robot file",
    "dynid help COMMAND                 the same as dynid COMMAND -h",
)


def module_of(name: str) -> str:
    """Return the module of a command; ``import`` is a word of Python and cannot be one."""
    return f"dynid.cli.{'import_urdf' if name == 'import' else name.replace('-', '_')}"


def available() -> dict[str, Entry]:
    """Return the commands whose module exists."""
    return {
        name: entry for name, entry in COMMANDS.items() if importlib.util.find_spec(module_of(name))
    }


class LazyGroup(click.Group):
    """The command ``dynid``; imports a command's module when it is called, never for help."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands that exist."""
        return list(available())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command."""
        if cmd_name not in available():
            return None
        command = importlib.import_module(module_of(cmd_name)).command
        assert isinstance(command, click.Command)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, or suggest one."""
        if args and not args[0].startswith("-") and args[0] not in available():
            raise WrongUsage(
                f"no command '{args[0]}'{closest(args[0], available())}",
                why=f"the commands are {', '.join(available())}",
                fix="dynid -h",
            )
        return super().resolve_command(ctx, args)

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write examples, commands, options, exit statuses."""
        self.format_usage(ctx, formatter)
        _block(formatter, "Examples", EXAMPLES)
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.help) for name, entry in available().items()])
        self.format_options_only(ctx, formatter)
        with formatter.section("Exit statuses"):
            formatter.write_dl(
                [(str(int(status)), meaning) for status, meaning in EXIT_MEANING.items()]
            )
        formatter.write("\nDocs: docs/index.md, or dynid explain PAGE\n")

    def format_options_only(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options of ``dynid`` itself."""
        records = [
            record for param in self.get_params(ctx) if (record := param.get_help_record(ctx))
        ]
        with formatter.section("Options (each command has more: dynid COMMAND -h)"):
            formatter.write_dl(records)


def _block(formatter: click.HelpFormatter, title: str, lines: Sequence[str]) -> None:
    with formatter.section(title):
        for line in lines:
            formatter.write(f"  {line}\n")


def loop_map() -> str:
    """Return the map of the loops, with the commands that exist."""
    here = available()
    lines = [f"dynid {__version__}   identify the dynamic parameters of a robot arm", ""]
    previous = ""
    for name, entry in here.items():
        if not entry.loop:
            continue
        heading = entry.loop if entry.loop != previous else ""
        previous = entry.loop
        arrow = f"{entry.help:<20} -> {entry.writes}" if entry.writes else entry.help
        lines.append(f"  {heading:<8} {name:<11} {arrow}")
    small = [name for name, entry in here.items() if not entry.loop]
    lines += [f"  {'Also':<8} {'  '.join(small)}", ""]
    if "demo" in here:
        lines.append(
            f"{'First time?   dynid demo':<40}whole workflow on a simulated arm, no robot, under a minute"
        )
    start = f"{'Your robot?   dynid check my_arm.yaml':<40}" if "check" in here else ""
    lines.append(f"{start}Help: dynid COMMAND -h     Docs: docs/index.md")
    return "\n".join(lines)


def _version(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        click.echo("\n".join(workflows.doctor.version_lines()))
        ctx.exit()


@click.group(
    cls=LazyGroup,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_version,
    help="Show versions and exit.",
)
@click.pass_context
def cli(ctx: click.Context) -> None:
    """Identify the dynamic parameters of a robot arm."""
    if ctx.invoked_subcommand is None:
        click.echo(loop_map())


def run(args: Sequence[str]) -> int:
    """Run one command line and return its exit status; nothing escapes as a traceback."""
    words = [*args[1:], "--help"] if args[:1] == ["help"] else list(args)
    context = failure.FailureContext(words)
    with _interruptible():
        try:
            status = _invoke(words, context)
            sys.stdout.flush()
            return status
        except click.exceptions.Exit as done:
            return _flushed(done.exit_code)
        except DynidError as error:
            return failure.report(error, context)
        except click.ClickException as error:
            return failure.report(failure.usage_error(error), context)
        except (KeyboardInterrupt, click.Abort):
            return failure.interrupted()
        except BrokenPipeError:
            failure.silence_streams()
            return int(ExitStatus.DONE)
        except OSError as error:
            if not failure.is_users(error):
                return failure.crash(error, context)
            return failure.report(failure.os_error(error), context)
        except MemoryError as error:
            return failure.report(
                OutOfMemory(f"there is not enough memory: {error or 'none is left'}"), context
            )
        except Exception as error:  # noqa: BLE001
            return failure.crash(error, context)


def _invoke(words: list[str], context: failure.FailureContext) -> int:
    with cli.make_context("dynid", words) as ctx:
        context.meta = ctx.meta
        result: Any = cli.invoke(ctx)
    return int(result) if isinstance(result, int) else int(ExitStatus.DONE)


def _flushed(status: int) -> int:
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        failure.silence_streams()
    return status


@contextmanager
def _interruptible() -> Iterator[None]:
    """Let Ctrl-C and SIGTERM unwind the program: files closed, temporary ones removed, children ended."""

    def stop(number: int, frame: object) -> NoReturn:
        raise KeyboardInterrupt

    previous: dict[int, Any] = {}
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            if signal.getsignal(number) is not signal.SIG_IGN:
                previous[number] = signal.signal(number, stop)
    except ValueError:  # not the main thread: the caller handles signals
        yield
        return
    try:
        yield
    finally:
        for each, handler in previous.items():
            signal.signal(each, handler)


def _complete() -> None:
    """Answer the shell's request for completions; with nothing where the words so far are wrong."""
    from click.shell_completion import shell_complete

    # Why: the word that is completed comes back in the answer, and a shell may show it.
    typed = "".join(os.environ.get(name, "") for name in ("COMP_WORDS", "COMP_CWORD"))
    with suppress(Exception):
        if not typed.replace("\n", "").isprintable():
            sys.exit(1)
        sys.exit(shell_complete(cli, {}, "dynid", "_DYNID_COMPLETE", os.environ["_DYNID_COMPLETE"]))
    sys.exit(1)


def main() -> NoReturn:
    """Run ``dynid``."""
    failure.prepare_streams()
    # Why: on small matrices threads cost more than they give, and one thread sums in the same order anywhere.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Why: a library's warning about its own code helps nobody here; what matters is raised or is a finding.
    if not sys.warnoptions and "--debug" not in sys.argv:
        warnings.simplefilter("ignore")
    if "_DYNID_COMPLETE" in os.environ:
        _complete()
    failure.leave(run(sys.argv[1:]))
