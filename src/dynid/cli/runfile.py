"""run.yaml: what was run in a results folder, enough to run it again with ``--from run.yaml``.

One section a command. The stored arguments hold every option that differed from its default, wherever it came from,
so that the run does not depend on variables and configuration files of that day.
"""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from dynid.cli.commands import COMMANDS
from dynid.disk import write_text
from dynid.errors import DynidError, WrongUsage
from dynid.files.yamlfile import read_yaml
from dynid.text import yaml_text
from dynid.version import __version__

if TYPE_CHECKING:
    from dynid.files.yamlfile import Value

NAME = "run.yaml"
#: Common options about the terminal and the files, which change no result and are not repeated.
NOT_REPEATED = (
    "force",
    "yes",
    "no_input",
    "json",
    "quiet",
    "verbose",
    "color",
    "config",
    "log_file",
    "debug",
)
_KEYS = ("dynid", "command", "arguments", "inputs")


#: Options that overwrite, answer or move the arm: no variable and no file gives them.
TYPED = ("force", "yes", "move")


def key_of(option: click.Option) -> str:
    """Return the name of an option in variables and configuration files: its long name with underscores."""
    return next(word for word in option.opts if word.startswith("--"))[2:].replace("-", "_")


def is_typed(param: click.Parameter) -> bool:
    """Return whether a parameter is an option that stands on the command line alone."""
    return isinstance(param, click.Option) and not param.allow_from_autoenv


def arguments_of(ctx: click.Context) -> list[str]:
    """Return a command line that gives the same values: arguments, then options that differ from their default."""
    words: list[str] = []
    flags: list[str] = []
    for param in ctx.command.params:
        value = ctx.params.get(str(param.name))
        values = value if isinstance(value, (list, tuple)) else [value]
        if value is None or ctx.get_parameter_source(str(param.name)) is ParameterSource.DEFAULT:
            continue
        if isinstance(param, click.Argument):
            words += [str(item) for item in values]
        elif isinstance(param, click.Option) and param.name not in NOT_REPEATED:
            flags += _flag(param, value, values)
    return words + flags


def _flag(option: click.Option, value: object, values: Sequence[object]) -> list[str]:
    name = next(word for word in option.opts if word.startswith("--"))
    if isinstance(value, bool):
        other = option.secondary_opts[0] if option.secondary_opts else None
        return [name] if value else [other] if other else []
    if option.count:
        return [name] * int(str(value))
    return [word for item in values for word in (name, str(item))]


def write_run(folder: Path, inputs: Mapping[str, str]) -> Path:
    """Write this run's section of run.yaml in a results folder; sections of other commands stay.

    Args:
        folder: results folder.
        inputs: sha256 of every input by name.
    """
    ctx = click.get_current_context()
    arguments = arguments_of(ctx)
    path = folder / NAME
    runs = _others(path)
    runs[str(ctx.info_name)] = {
        "dynid": __version__,
        "command": shlex.join(["dynid", str(ctx.info_name), *arguments]),
        "arguments": arguments,
        "inputs": dict(inputs),
    }
    write_text(path, yaml_text(runs, sort_keys=True, width=10**6, default_flow_style=False))
    return path


def _others(path: Path) -> dict[str, object]:
    """Return the sections that are there, as far as they can be read."""
    # Why not what PyYAML makes of it: merged mappings in a file from somebody else could fill the memory.
    found: dict[str, object] = {}
    with suppress(OSError, DynidError):
        for name, value in read_yaml(path).entries().items():
            with suppress(DynidError):
                found[name] = _section(value)
    return found


def _section(value: Value) -> dict[str, object]:
    keys = value.mapping(_KEYS, required=("arguments",))
    words: dict[str, object] = {
        key: keys[key].text() for key in ("dynid", "command") if key in keys
    }
    inputs = keys["inputs"].entries() if "inputs" in keys else {}
    return {
        **words,
        "arguments": [item.text() for item in keys["arguments"].items()],
        "inputs": {key: item.text() for key, item in inputs.items()},
    }


def repeated(ctx: click.Context, args: Sequence[str]) -> list[str]:
    """Return a command line with ``--from FILE`` replaced by the stored arguments; what is given besides wins.

    Raises:
        WrongUsage: there is no such file, it holds no run of this command, or one that overwrites or moves.
    """
    words = list(args)
    for i, word in enumerate(words):
        if word == "--from" and i + 1 < len(words):
            return _stored(ctx, Path(words[i + 1]), words[:i] + words[i + 2 :])
        if word.startswith("--from="):
            return _stored(ctx, Path(word.removeprefix("--from=")), words[:i] + words[i + 1 :])
    return words


def _stored(ctx: click.Context, path: Path, besides: list[str]) -> list[str]:

    command = str(ctx.command.name)
    if not path.is_file():
        raise WrongUsage(f"no such file {path}", why=f"--from takes the {NAME} of a results folder")
    runs = read_yaml(path).mapping(tuple(COMMANDS))
    if command not in runs:
        raise WrongUsage(
            f"{path} holds no run of '{command}'; it has {', '.join(runs)}", where=str(path)
        )
    stored = [
        item.text()
        for item in runs[command].mapping(_KEYS, required=("arguments",))["arguments"].items()
    ]
    asked = ctx.command.make_parser(ctx).parse_args(list(stored))[0]
    typed = [
        param.opts[-1] for param in ctx.command.params if is_typed(param) and param.name in asked
    ]
    if typed:
        raise WrongUsage(
            f"{path} sets {typed[0]}", where=str(path), fix=f"give {typed[0]} yourself"
        )
    return stored + besides
