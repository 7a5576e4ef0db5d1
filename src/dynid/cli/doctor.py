"""``dynid doctor``: what works on this machine and what does not, and where each option's value comes from."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click

from dynid import workflows
from dynid.answer import Answer
from dynid.cli.commands import COMMANDS, command_of
from dynid.cli.options import COMMON, PATH, configure, dynid_command, keys_of, settings, words_of
from dynid.cli.session import Session
from dynid.table import Table

#: Value of --config that means: show the configuration.
SHOW = Path("?show")


def sources(file: Path | None) -> Iterator[dict[str, Any]]:
    """Yield value and source of the common options, then of those options of commands that lost their default."""
    ctx = click.get_current_context()
    for name in sorted(COMMANDS, key="doctor".__ne__):
        command = command_of(name)
        configured = settings(command, file)
        for key, option in keys_of(command).items():
            if key == "config":
                continue
            common = key in COMMON
            value: Any = option.get_default(ctx)
            value = value if isinstance(value, (bool, int, float, str)) else None
            source = "default"
            names = [each for each in option.envvar or () if os.environ.get(each)]
            typed = ctx.get_parameter_source(key) is click.core.ParameterSource.COMMANDLINE
            if typed and command is ctx.command:
                value, source = ctx.params[key], "command line"
            elif names:
                value, source = os.environ[names[0]], names[0]
            elif key in configured:
                value, source = words_of(configured[key]), configured[key].where
            if command is ctx.command if common else source != "default":
                where = "" if common else name
                yield {"command": where, "option": key, "value": value, "source": source}


@dynid_command(
    "doctor",
    examples=(
        "dynid doctor               what works and what does not",
        "dynid doctor --config      each option's value",
    ),
    config=click.option(
        "--config",
        type=PATH,
        metavar="[FILE]",
        is_flag=False,
        flag_value=str(SHOW),
        is_eager=True,
        expose_value=False,
        callback=configure,
        help="Show each option's value and source, those of FILE instead of ./dynid.yaml and the user's.",
    ),
)
def command(session: Session) -> Answer:
    """Look at this machine: Python, packages, simulator, ROS, display, folders, configuration."""
    config = click.get_current_context().meta["dynid.config"]
    if config is not None:
        shown = list(sources(None if config == SHOW else config))
        note = "options of single commands are listed when they differ from their default"
        facts = {"schema": "dynid/doctor/1", "settings": shown}
        return Answer(facts, parts=[Table(shown)], notes=[("note", note)])
    return workflows.doctor.doctor()
