"""The options every command has, and the rule who wins: flag, DYNID_* variable, ./dynid.yaml, user's file, default.

Top-level keys of a configuration file set an option for every command; a key that is a command's name holds that
command's options. ``./dynid.yaml`` wins over the user's file, and ``--config FILE`` stands in for both.

A command is a function ``command(common, ...)`` under ``@dynid_command("name", examples=(...))``.
"""

from __future__ import annotations

import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, update_wrapper
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.commands import COMMANDS
from dynid.cli.runfile import TYPED, key_of, repeated
from dynid.cli.terminal import Terminal
from dynid.errors import UnknownKey, WrongUsage
from dynid.files.yamlfile import read_yaml
from dynid.xdg import LOCAL_CONFIG, config_file

if TYPE_CHECKING:
    from dynid.cli.terminal import Terminal
    from dynid.files.yamlfile import Value


@dataclass(frozen=True)
class Common:
    """The values of the common options.

    Attributes:
        out: folder of the results; None for ``out/<robot>``.
        force: overwrite without asking.
        yes: answer questions with yes, except those about moving the arm.
        no_input: ask nothing.
        json: print one JSON object on stdout instead of tables.
        quiet: no stages and no progress.
        verbose: 0, 1 or 2.
        color: ``"auto"``, ``"always"`` or ``"never"``.
        config: configuration file given with --config.
        log_file: file that gets a copy of everything said on stderr.
        seed: of every random choice.
        debug: show tracebacks.
    """

    out: Path | None = None
    force: bool = False
    yes: bool = False
    no_input: bool = False
    json: bool = False
    quiet: bool = False
    verbose: int = 0
    color: str = "auto"
    config: Path | None = None
    log_file: Path | None = None
    seed: int = 0
    debug: bool = False

    @cached_property
    def terminal(self) -> Terminal:
        """The two consoles of this run."""
        return Terminal(
            json=self.json,
            quiet=self.quiet,
            verbose=self.verbose,
            color=self.color,
            log_file=self.log_file,
        )

    def folder(self, slug: str) -> Path:
        """Return the folder of the results of a robot."""
        return self.out or Path("out") / slug

    def header(self, inputs: Mapping[str, str]) -> dict[str, Any]:
        """Return what every result's header says about the run: command line, seed, hashes of the inputs."""
        return {
            "command": shlex.join(["dynid", *sys.argv[1:]]),
            "seed": self.seed,
            "inputs": dict(inputs),
        }


@dataclass(frozen=True)
class Settings:
    """What the configuration files say for one command.

    Attributes:
        values: parameter name to text or list of texts, as on the command line.
        places: parameter name to ``file:line``.
        lent: parameters that another file than the user's own sets.
    """

    values: dict[str, str | list[str]] = field(default_factory=dict)
    places: dict[str, str] = field(default_factory=dict)
    lent: list[str] = field(default_factory=list)


def settings_files(given: Path | None) -> list[Path]:
    """Return the configuration files that apply, the strongest last."""
    if given is not None:
        return [given]
    return [path for path in (config_file(), LOCAL_CONFIG) if path.is_file()]


def load_settings(
    given: Path | None, command: str, keys: Mapping[str, str], common: Sequence[str]
) -> Settings:
    """Read what the configuration files say about the options of a command.

    Args:
        given: the file of --config, or None.
        command: name of the command.
        keys: key in the file and name of the parameter that it sets.
        common: names of the options that every command has.

    Raises:
        UnknownKey: a key is neither a common option, a command, nor an option of this command.
    """
    settings = Settings()
    for path in settings_files(given):
        _read(
            path,
            command,
            keys,
            [name for name in common if name not in ("config", *TYPED)],
            settings,
        )
    return settings


def _read(
    path: Path, command: str, keys: Mapping[str, str], common: Sequence[str], settings: Settings
) -> None:

    try:
        top = read_yaml(path).mapping([*common, *COMMANDS])
        own = (
            top[command].mapping(tuple(keys)) if command in top and not top[command].is_null else {}
        )
    except UnknownKey as error:
        raise UnknownKey(
            error.what,
            where=error.where,
            fix="rename or remove the key; keys are long option names",
        ) from error
    for key, value in {**{k: v for k, v in top.items() if k in common}, **own}.items():
        if not value.is_null:
            settings.values[keys.get(key, key)] = _words(value)
            settings.places[keys.get(key, key)] = value.where
            if path != config_file():
                settings.lent.append(keys.get(key, key))


def _words(value: Value) -> str | list[str]:
    return [item.text() for item in value.items()] if value.is_list else value.text()


_FROM_FILE = click.core.ParameterSource.DEFAULT_MAP
_FILE = click.Path(dir_okay=False, path_type=Path)


def _note(ctx: click.Context, param: click.Parameter, value: Any) -> Any:  # noqa: ANN401
    """Remember a value that error messages need, even when later options are wrong."""
    ctx.meta[f"dynid.{param.name}"] = value
    return value


def configure(ctx: click.Context, param: click.Parameter, value: Path | None) -> Path | None:
    """Read the configuration files, whose values become this command's defaults."""
    settings = load_settings(value, ctx.info_name or "", known_keys(ctx.command), COMMON_NAMES)
    for option in ctx.command.params:
        name = option.name or ""
        if (
            isinstance(settings.values.get(name), list)
            and not option.multiple
            and option.nargs == 1
        ):
            raise WrongUsage(
                f"{settings.places[name]}: {name} takes one value, not a list",
                where=settings.places[name],
            )
    ctx.default_map = settings.values
    ctx.meta["dynid.places"], ctx.meta["dynid.lent"] = settings.places, settings.lent
    return value


def _say_settings(common: Common) -> None:
    """Say which options a file of the working folder has set: nobody may notice that it lies there."""
    ctx = click.get_current_context()
    used = [
        name
        for name in ctx.meta.get("dynid.lent", ())
        if ctx.get_parameter_source(name) is _FROM_FILE
    ]
    if used:
        path = ctx.meta["dynid.places"][used[0]].rsplit(":", 1)[0]
        common.terminal.stage("settings", f"{path} sets {', '.join(used)}")


FROM_OPTION = click.option(
    "--from",
    "from_",
    metavar="RUN.yaml",
    expose_value=False,
    allow_from_autoenv=False,
    help="Repeat a run of a results folder; arguments and options given besides win.",
)
CONFIG_OPTION = click.option(
    "--config",
    type=click.Path(dir_okay=False, exists=True, path_type=Path),
    metavar="FILE",
    is_eager=True,
    callback=configure,
    help="Configuration file instead of ./dynid.yaml and the user's.",
)
#: --config comes first: eager options are read in this order, and --color may stand in the file.
COMMON_OPTIONS: tuple[Callable[[Any], Any], ...] = (
    click.option(
        "-o",
        "--out",
        type=click.Path(file_okay=False, path_type=Path),
        metavar="DIR",
        help="Folder of the results (default: out/ROBOT).",
    ),
    click.option("-f", "--force", is_flag=True, help="Overwrite results without asking."),
    click.option(
        "-y",
        "--yes",
        is_flag=True,
        help="Answer questions with yes; never those that move the arm.",
    ),
    click.option("--no-input", is_flag=True, help="Ask nothing, take the documented answers."),
    click.option(
        "--json",
        is_flag=True,
        is_eager=True,
        callback=_note,
        help="Print one JSON object on stdout.",
    ),
    click.option("-q", "--quiet", is_flag=True, help="Only the answer, warnings and errors."),
    click.option("-v", "--verbose", count=True, help="More detail; twice for all."),
    click.option(
        "--color",
        type=click.Choice(["auto", "always", "never"]),
        default="auto",
        is_eager=True,
        callback=_note,
        help="Colour on the terminal.",
    ),
    click.option(
        "--log-file", type=_FILE, metavar="FILE", help="Append what is said on stderr to FILE."
    ),
    click.option(
        "--seed",
        type=click.IntRange(min=0),
        metavar="INTEGER",
        default=0,
        show_default=True,
        help="Seed of every random choice.",
    ),
    click.option("--debug", is_flag=True, is_eager=True, callback=_note, help="Show tracebacks."),
)

COMMON_NAMES = tuple(each.name for each in fields(Common))


def known_keys(command: click.Command) -> dict[str, str]:
    """Return the keys a configuration file may set for a command, each with the name of the parameter it sets."""
    return {
        key_of(param): str(param.name)
        for param in command.params
        if isinstance(param, click.Option) and param.name != "config" and param.allow_from_autoenv
    }


class Command(click.Command):
    """A command with examples in its help, variables for its options, and the common options set apart."""

    examples: Sequence[str] = ()
    repeatable = False

    def __init__(self, *args: Any, **kwargs: Any) -> None:  # noqa: ANN401
        super().__init__(*args, **kwargs)
        for param in self.params:
            if isinstance(param, click.Option) and key_of(param) in TYPED:
                param.allow_from_autoenv = False
            # Why: DYNID_SEED serves every command, DYNID_IDENTIFY_SEED one of them; the narrower name comes first.
            if (
                isinstance(param, click.Option)
                and param.allow_from_autoenv
                and param.envvar is None
            ):
                name, own = key_of(param).upper(), (self.name or "").upper().replace("-", "_")
                param.envvar = [f"DYNID_{own}_{name}", f"DYNID_{name}"]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the words of the command line, those of a former run first."""
        if self.repeatable and not ctx.resilient_parsing:
            args = repeated(ctx, args)
        rest = super().parse_args(ctx, args)
        self._refuse_options_as_values(ctx)
        return rest

    def _refuse_options_as_values(self, ctx: click.Context) -> None:
        """Raise where an option without its value took the next option for it: ``--out --json`` is no folder."""
        options = [param for param in self.params if isinstance(param, click.Option)]
        names = {name for option in options for name in (*option.opts, *option.secondary_opts)}
        for option in options:
            given = ctx.params.get(str(option.name))
            for value in given if isinstance(given, tuple) else (given,):
                if isinstance(value, (str, Path)) and (
                    str(value).startswith("--") or str(value) in names
                ):
                    raise WrongUsage(
                        f"{option.opts[-1]} needs a value, and '{value}' is an option",
                        fix=f"{option.opts[-1]} VALUE {value}, or ./{value} where a file is called so",
                    )

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write usage, what it does, examples, options, common options."""
        self.format_usage(ctx, formatter)
        self.format_help_text(ctx, formatter)
        if self.examples:
            with formatter.section("Examples"):
                for line in self.examples:
                    formatter.write(f"  {line}\n")
        self.format_options(ctx, formatter)
        formatter.write(f"\nDocs: docs/reference/cli.md#dynid-{self.name}, or dynid explain\n")

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the command's own options, then the common ones."""
        own: list[tuple[str, str]] = []
        common: list[tuple[str, str]] = []
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record and (isinstance(param, click.Option) or record[1]):
                (common if param.name in COMMON_NAMES or param.name == "help" else own).append(
                    record
                )
        for title, records in (("Options", own), ("Common options", common)):
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def dynid_command(
    name: str,
    *,
    examples: Sequence[str] = (),
    repeatable: bool = False,
    config: Callable[[Any], Any] | None = None,
) -> Callable[[Callable[..., Any]], Command]:
    """Make a command of a function that takes ``common`` first and its own options by keyword.

    Args:
        name: name of the command, the same as its module.
        examples: lines for the help.
        repeatable: whether it has ``--from run.yaml``; such a command calls ``write_run``.
        config: stands in for the common option --config.

    Returns:
        A decorator; put it above the function's own ``@click.option`` and ``@click.argument``.
    """

    def decorate(function: Callable[..., Any]) -> Command:
        def callback(**values: Any) -> Any:  # noqa: ANN401
            common = Common(**{key: values.pop(key) for key in COMMON_NAMES})
            with common.terminal:
                _say_settings(common)
                return function(common, **values)

        update_wrapper(callback, function)
        options: Mapping[str, Any] = {
            "cls": Command,
            "context_settings": {"help_option_names": ["-h", "--help"], "max_content_width": 100},
        }
        decorated: Any = callback
        for option in reversed((config or CONFIG_OPTION, *COMMON_OPTIONS)):
            decorated = option(decorated)
        if repeatable:
            decorated = FROM_OPTION(decorated)
        make: Callable[[Callable[..., Any]], Command] = click.command(name, **options)
        made = make(decorated)
        made.examples, made.repeatable = examples, repeatable
        return made

    return decorate
