"""run.yaml: what was run in a results folder, enough to run it again with ``--from run.yaml``.

One section a command. The stored arguments hold every option that differed from its default, wherever it came from,
so that the run does not depend on variables and configuration files of that day.
"""

from __future__ import annotations

from collections.abc import Container, Mapping
from contextlib import suppress
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
import yaml
from click.core import ParameterSource

from dynid.cli.commands import COMMANDS
from dynid.cli.session import Session
from dynid.disk import write_text
from dynid.errors import WrongUsage
from dynid.files.yamlfile import read_yaml
from dynid.text import shell, yaml_text
from dynid.version import __version__

NAME = "run.yaml"
#: Common options about the terminal and the files, which change no result and are not repeated.
_SILENT = {each.name for each in fields(Session)} - {"out", "seed"}
_KEYS = ("dynid", "command", "arguments", "inputs")


def flag_of(param: click.Parameter) -> str:
    """Return the long name of an option."""
    return max(param.opts, key=len)


def arguments_of(ctx: click.Context, names: Container[str] = ()) -> list[str]:
    """Return a command line that gives the same values: arguments, then options that differ from their default.

    Args:
        ctx: of the command.
        names: of what is wanted, all without.
    """
    words, flags = list[str](), list[str]()
    for param in ctx.command.params:
        name = str(param.name)
        value, default = ctx.params.get(name), ParameterSource.DEFAULT
        wanted = name in names if names else name not in _SILENT
        if not wanted or value is None or ctx.get_parameter_source(name) is default:
            continue
        values = value if isinstance(value, (list, tuple)) else [value]
        if not isinstance(param, click.Option):
            words += map(str, values)
        elif isinstance(value, bool):
            flags += [flag_of(param)] if value else param.secondary_opts[:1]
        else:
            flags += [word for item in values for word in (flag_of(param), str(item))]
    return words + flags


def write_run(folder: Path, inputs: Mapping[str, str]) -> None:
    """Write this run's section of run.yaml in a results folder; sections of other commands stay.

    Args:
        folder: results folder.
        inputs: sha256 of every input by name.
    """
    ctx = click.get_current_context()
    path, arguments = folder / NAME, arguments_of(ctx)
    runs: dict[str, Any] = {}
    with suppress(OSError, ValueError, TypeError, yaml.YAMLError):
        runs = dict(yaml.safe_load(path.read_text(encoding="utf-8")))
    runs[str(ctx.info_name)] = {
        "dynid": __version__,
        "command": shell("dynid", ctx.info_name, *arguments),
        "arguments": arguments,
        "inputs": dict(inputs),
    }
    write_text(path, yaml_text(runs, sort_keys=True, width=10**6, default_flow_style=False))


def repeated(ctx: click.Context, args: list[str]) -> list[str]:
    """Return a command line after the one that is stored in the file of ``--from``, if there is one.

    Raises:
        WrongUsage: there is no such file, it holds no run of this command, or one that overwrites or moves.
    """
    command = ctx.command
    given = command.make_parser(ctx).parse_args([*args])[0].get("from_")
    if not isinstance(given, str):
        return args
    path = Path(given)
    if not path.is_file():
        raise WrongUsage(f"no such file {path}", why=f"--from takes the {NAME} of a results folder")
    runs = read_yaml(path).mapping([*COMMANDS])
    if command.name not in runs:
        what = f"{path} holds no run of '{command.name}'; it has {', '.join(runs)}"
        raise WrongUsage(what, where=path)
    keys = runs[command.name].mapping(_KEYS, required=("arguments",))
    stored = [*keys["arguments"].texts()]
    stored_values = command.make_parser(ctx).parse_args([*stored])[0]
    for param in command.params:
        if getattr(param, "allow_from_autoenv", True) is False and param.name in stored_values:
            flag = flag_of(param)
            raise WrongUsage(f"{path} sets {flag}", where=path, fix=f"give {flag} yourself")
    return stored + args
