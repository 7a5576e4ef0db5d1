"""The entry point: finds the command, runs it, and turns whatever goes wrong into a message and an exit status."""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NoReturn

import click

from dynid import workflows
from dynid.arguments import no_such
from dynid.cli import failure
from dynid.cli.commands import COMMANDS, CONTEXT, command_of, shown
from dynid.errors import EXIT_MEANING, ExitStatus
from dynid.version import __version__

HELP = """Identify the dynamic parameters of a robot arm.

Examples:
  dynid                              the map of the loops
  dynid model kinova_gen2            base regressor of a bundled arm
  dynid check my_arm.yaml            look for mistakes in a robot file
  dynid help COMMAND                 the same as dynid COMMAND -h
"""


class LazyGroup(click.Group):
    """The command ``dynid``; imports a command's module when it is called, never for help."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command:
        """Import a command, or suggest one."""
        if cmd_name not in COMMANDS:
            why = f"the commands are {', '.join(COMMANDS)}"
            raise no_such("no command", cmd_name, COMMANDS, why=why, fix="dynid -h")
        return command_of(cmd_name)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands and the exit statuses."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, entry.help) for name, entry in COMMANDS.items()])
        with formatter.section("Exit statuses"):
            formatter.write_dl([(str(int(k)), meaning) for k, meaning in EXIT_MEANING.items()])


def loop_map() -> str:
    """Return the map of the loops."""
    lines = [f"dynid {__version__}   identify the dynamic parameters of a robot arm", ""]
    above = ""
    for name, entry in COMMANDS.items():
        if entry.loop:
            arrow = f"{entry.help:<20} -> {entry.writes}" if entry.writes else entry.help
            lines.append(f"  {entry.loop * (entry.loop != above):<8} {name:<11} {arrow}")
            above = entry.loop
    also = "  ".join(name for name, entry in COMMANDS.items() if not entry.loop)
    lines += [
        f"  {'Also':<8} {also}",
        "",
        "First time?   dynid demo                whole workflow on a simulated arm, no robot, under a minute",
        "Your robot?   dynid check my_arm.yaml   Help: dynid COMMAND -h     Docs: docs/index.md",
    ]
    return "\n".join(lines)


def _version(ctx: click.Context, param: click.Parameter, value: bool) -> None:
    if value:
        click.echo("\n".join(workflows.doctor.version_lines()))
        ctx.exit()


@click.group(
    cls=LazyGroup,
    invoke_without_command=True,
    context_settings=CONTEXT,
    help=shown(HELP),
    epilog="Each command has more options: dynid COMMAND -h. Docs: docs/index.md, or dynid explain PAGE",
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
    """Print the map where no command is given."""
    if ctx.invoked_subcommand is None:
        click.echo(loop_map())


def run(args: Sequence[str]) -> int:
    """Run one command line and return its exit status; nothing escapes as a traceback."""
    words = [*args[1:], "--help"] if args[:1] == ["help"] else list(args)
    meta: dict[str, Any] = {}
    try:
        with cli.make_context("dynid", words) as ctx:
            meta = ctx.meta
            status = cli.invoke(ctx)
        sys.stdout.flush()
    except BaseException as error:  # noqa: BLE001
        return failure.ended(error, words, meta.get("dynid.context"))
    return int(status or ExitStatus.DONE)


def _complete() -> None:
    """Answer the shell's request for completions; with nothing where the words so far are wrong."""
    from click.shell_completion import shell_complete

    with suppress(Exception):
        how = os.environ["_DYNID_COMPLETE"]
        sys.exit(shell_complete(cli, {}, "dynid", "_DYNID_COMPLETE", how))
    sys.exit(1)


def main() -> NoReturn:
    """Run ``dynid``."""
    failure.prepare_streams()
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        # Why: files are closed, temporary ones removed, children ended, as with Ctrl-C.
        signal.signal(signal.SIGTERM, signal.default_int_handler)
    # Why: on small matrices threads cost more than they give, and one thread sums in the same order anywhere.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Why: a library's warning about its own code helps nobody here; what matters is raised or is a finding.
    if not sys.warnoptions and "--debug" not in sys.argv:
        warnings.simplefilter("ignore")
    if "_DYNID_COMPLETE" in os.environ:
        _complete()
    failure.leave(run(sys.argv[1:]))
