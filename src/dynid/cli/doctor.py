"""``dynid doctor``: what works on this machine and what does not, and where each option's value comes from."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid import workflows
from dynid.cli.options import (
    COMMON_NAMES,
    Command,
    Common,
    configure,
    dynid_command,
    known_keys,
    load_settings,
)
from dynid.cli.runfile import key_of
from dynid.errors import ExitStatus

if TYPE_CHECKING:
    from dynid.cli.terminal import Cell

#: Value of --config that means: show the configuration.
SHOW = Path("?show")


@dataclass(frozen=True)
class Setting:
    """One option's value and where it comes from."""

    command: str
    option: str
    value: Any
    source: str


def settings(given: Path | None) -> Iterator[Setting]:
    """Yield the common options, then those options of the commands that no longer have their default."""
    from dynid.cli.main import LazyGroup, cli

    assert isinstance(cli, LazyGroup)
    group = click.Context(cli)
    for name in ["doctor", *(name for name in cli.list_commands(group) if name != "doctor")]:
        command = cli.get_command(group, name)
        assert isinstance(command, Command)
        keys = known_keys(command)
        found = load_settings(given, name, keys, COMMON_NAMES)
        for param in command.params:
            if not isinstance(param, click.Option) or key_of(param) not in keys:
                continue
            value, source = _resolved(param, found.values, found.places)
            if name == "doctor" and param.name in COMMON_NAMES:
                yield Setting("", key_of(param), value, source)
            elif source != "default" and param.name not in COMMON_NAMES:
                yield Setting(name, key_of(param), value, source)


def _resolved(
    param: click.Option, values: dict[str, Any], places: dict[str, str]
) -> tuple[Any, str]:
    ctx = click.get_current_context()
    name = str(param.name)
    if (
        param in ctx.command.params
        and ctx.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
    ):
        return ctx.params[name], "command line"
    for variable in param.envvar if isinstance(param.envvar, list) else []:
        if os.environ.get(variable):
            return os.environ[variable], variable
    if name in values:
        return values[name], places[name]
    default = param.get_default(ctx)
    return default if isinstance(default, (bool, int, float, str)) else None, "default"


def _show_or_configure(
    ctx: click.Context, param: click.Parameter, value: Path | None
) -> Path | None:
    configure(ctx, param, None if value == SHOW else value)
    return value


def _show_settings(common: Common) -> None:
    terminal = common.terminal
    found = list(settings(None if common.config == SHOW else common.config))
    terminal.emit_json(
        {"schema": "dynid/doctor/1", "settings": [asdict(setting) for setting in found]}
    )
    rows = [
        (f"{s.command} {s.option}".strip(), "-" if s.value is None else str(s.value), s.source)
        for s in found
    ]
    terminal.table(("option", "value", "source"), rows, numbers=False)
    terminal.stage(
        "note", "options of single commands are listed when they differ from their default"
    )


@dynid_command(
    "doctor",
    examples=(
        "dynid doctor               what works and what does not",
        "dynid doctor --config      each option's value",
    ),
    config=click.option(
        "--config",
        type=click.Path(dir_okay=False, path_type=Path),
        metavar="[FILE]",
        is_flag=False,
        flag_value=str(SHOW),
        is_eager=True,
        callback=_show_or_configure,
        help="Show each option's value and source, those of FILE instead of ./dynid.yaml and the user's.",
    ),
)
def command(common: Common) -> ExitStatus:
    """Look at this machine: Python, packages, simulator, ROS, display, folders, configuration."""
    if common.config is not None:
        _show_settings(common)
        return ExitStatus.DONE
    terminal = common.terminal
    found = workflows.doctor.doctor()
    terminal.emit_json(
        {
            "schema": "dynid/doctor/1",
            "checks": [asdict(check) for check in found.checks],
            "works": found.works,
            "does_not_work": [check.name for check in found.missing],
        }
    )
    words: dict[bool | None, Cell] = {True: "ok", False: ("missing", "yellow"), None: ""}
    terminal.table(
        ("what", "state", "found"),
        [(c.name, words[c.ok], c.value) for c in found.checks],
        numbers=False,
    )
    terminal.answer()
    terminal.fact("works", ", ".join(found.works))
    for check in found.missing:
        terminal.fact("does not", f"{check.name}; lost: {check.lost}")
    return ExitStatus.DONE if found.usable else ExitStatus.MACHINE
