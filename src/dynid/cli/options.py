"""What a command takes, and the rule who wins: flag, DYNID_* variable, ./dynid.yaml, user's file, default.

Top-level keys of a configuration file set an option for every command; a key that is a command's name holds that
command's options. ``./dynid.yaml`` wins over the user's file, and ``--config FILE`` stands in for both.

A command is a function ``command(session, *, ...)`` under ``@dynid_command("name")``. Its docstring is its help, its
signature its command line: an ``Options`` dataclass stands for its fields, a parameter with ``option(...)`` is an
option, any other one an argument, optional where it has a default. It returns an ``Answer``, which only this module
prints.
"""

from __future__ import annotations

import inspect
import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import Field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import click
from click.core import ParameterSource

import dynid
from dynid.answer import Answer
from dynid.cli.commands import COMMANDS, CONTEXT, IMPORTED, command_of, shown
from dynid.cli.runfile import arguments_of, repeated
from dynid.cli.session import Session
from dynid.files.yamlfile import read_yaml
from dynid.options import Options, declaration_of, flag_of, option
from dynid.text import shell
from dynid.xdg import LOCAL_CONFIG, config_file

if TYPE_CHECKING:
    from dynid.files.yamlfile import Value
    from dynid.judgement.rules import Step

#: Options that every command has, and those of them with one letter.
COMMON = tuple(each.name for each in fields(Session))
SHORT = ("out", "force", "yes", "quiet", "verbose")
TYPED = ParameterSource.COMMANDLINE
#: Paths in the signature of a command: a file that is written, a file that is read, a file or folder that is there.
Output: TypeAlias = Path
Input: TypeAlias = Path
Existing: TypeAlias = Path
INPUT = click.Path(exists=True, dir_okay=False, path_type=Path)
#: What click is told of a value by a word of its annotation.
TYPES: dict[str, Any] = {
    "Path": click.Path(path_type=Path),
    "Output": click.Path(dir_okay=False, path_type=Path),
    "Input": INPUT,
    "Existing": click.Path(exists=True, path_type=Path),
    "Identification": click.Path(path_type=Path),
    "Robot": click.Path(),
}


# ---------------------------------------------------------------- from a signature to a command line
def type_of(annotation: object) -> Any:  # noqa: ANN401
    """Return what click is told of a value; None where its default says it."""
    words = re.findall(r"\w+", str(annotation))
    return next((TYPES[word] for word in words if word in TYPES), None)


def key_of(each: Field[Any]) -> str:
    """Return the name of an option in variables, configuration files and run.yaml: its flag with underscores."""
    return flag_of(each)[2:].replace("-", "_")


def declared_option(each: Field[Any], **facts: Any) -> click.Option:  # noqa: ANN401
    """Return the option of a declared field; ``facts`` are further arguments of ``click.Option``."""
    said, flag = declaration_of(each), flag_of(each)
    short = [f"-{each.name[0]}"] if each.name in SHORT else []
    facts |= {
        "default": each.default,
        "show_default": said.nothing if each.default is None else None,
        "type": INPUT if said.kind == "input" else type_of(each.type),
        "count": said.kind == "level",
        "is_flag": isinstance(each.default, bool) or None,
        "multiple": said.repeatable,
        "metavar": said.metavar or None,
        "help": said.help,
        "allow_from_autoenv": not said.deliberate,
    }
    # Why: what is on, or decided by the data, has to be switched off somehow.
    if said.pair or ("bool" in each.type and each.default is not False):
        flag += f"/{said.off or '--no-' + flag[2:]}"
    elif said.choices:
        facts["type"] = click.Choice(said.choices)
    elif said.bounds != (None, None):
        ranged: Any = click.IntRange if "int" in str(each.type) else click.FloatRange
        facts["type"] = ranged(*said.bounds)
    elif said.read is not None:
        facts["type"] = str
    return click.Option([*short, flag, key_of(each)], **facts)


def argument_of(each: inspect.Parameter) -> click.Argument:
    """Return the argument of a parameter; several values are named by a plural."""
    several = str(each.annotation).startswith("tuple")
    needed = each.default is inspect.Parameter.empty
    shown = f"{each.name[:-1].upper()}..."
    facts: dict[str, Any] = (
        {"nargs": -1, "metavar": shown if needed else f"[{shown}]"} if several else {}
    )
    kind = type_of(each.annotation)
    return click.Argument([each.name], required=needed, type=kind, **facts)


TIP: Any = option(
    None, "Last link of the arm, where ROBOT is a URDF whose joints fork.", metavar="LINK"
)
TIP.name, TIP.type = "tip", "str | None"


def command_line(
    function: Callable[..., Any], without: Sequence[str]
) -> tuple[list[click.Parameter], dict[str, Any]]:
    """Return what a command takes by its signature, and what is made of words, by name: options, an arm, a result.

    Args:
        function: the command; what has a decorator of click is taken as that says.
        without: fields of its options that it does not offer.
    """
    by_click = {each.name: each for each in reversed(getattr(function, "__click_params__", ()))}
    taken, kinds = list[click.Parameter](), dict[str, Any]()
    for name, each in [*inspect.signature(function).parameters.items()][1:]:
        word, declared = str(each.annotation), each.default
        kind = function.__globals__.get(word)
        if isinstance(kind, type) and issubclass(kind, Options):
            left_out, kinds[name] = (*COMMON, *without), kind
            taken += [declared_option(own) for own in fields(kind) if own.name not in left_out]
        elif isinstance(declared, Field):
            declared.name, declared.type = name, word
            taken.append(declared_option(declared))
        elif each.kind is not each.VAR_KEYWORD and name not in by_click:
            kinds[name] = word
            taken += [argument_of(each), *[declared_option(TIP)] * (word == "Robot")]
    return [*taken, *by_click.values()], kinds


def arguments(session: Session, kinds: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Return the arguments of a command's function; options that are common options are the session's."""
    for name, kind in kinds.items():
        if kind == "Robot":
            values[name] = dynid.load_robot(values[name], tip=values.pop("tip"))
        elif kind == "Identification":
            values[name] = dynid.loading.load_run(values[name])
        elif isinstance(kind, type):
            given = {
                each.name: values.pop(key_of(each), getattr(session, each.name, each.default))
                for each in fields(kind)
            }
            values[name] = kind(**given)
    return values


# ---------------------------------------------------------------- configuration files
def keys_of(command: click.Command) -> dict[str, click.Option]:
    """Return the options that variables and configuration files may set, by name."""
    return {
        str(each.name): each
        for each in command.params
        if isinstance(each, click.Option) and each.allow_from_autoenv
    }


def settings(command: click.Command, given: Path | None) -> dict[str, Value]:
    """Return what the configuration files say about the options of a command.

    Args:
        command: the command.
        given: the file of --config; None for ./dynid.yaml and, weaker, the user's.

    Raises:
        UnknownKey: a key is neither a common option, a command, nor an option of this command.
    """
    keys = keys_of(command)
    values: dict[str, Value] = {}
    common = [key for key in COMMON if key in keys]
    for path in [given] if given else filter(Path.is_file, (config_file(), LOCAL_CONFIG)):
        top = read_yaml(path).mapping([*common, *COMMANDS])
        own = top.get(str(command.name))
        inner = own.mapping([*keys]) if own and not own.is_null else {}
        found = {key: top[key] for key in common if key in top} | inner
        values |= {key: value for key, value in found.items() if not value.is_null}
    return values


def configure(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
    """Read the configuration files, whose values become this command's defaults."""
    ctx.meta["dynid.config"] = value
    # Why: what one command does for another is not what a file says of that.
    if ctx.obj is None:
        file = value if value is None or value.is_file() else None
        take_defaults(ctx, settings(ctx.command, file) | ctx.meta.get("dynid.settings", {}))


def take_defaults(ctx: click.Context, values: dict[str, Value]) -> None:
    """Make values of a file the defaults of a command, before those that it has from other files."""
    merged = ctx.meta["dynid.settings"] = ctx.meta.get("dynid.settings", {}) | values
    options = keys_of(ctx.command)
    ctx.default_map = {name: words_of(options[name], each) for name, each in merged.items()}


def words_of(option: click.Option, value: Value) -> str | tuple[str, ...]:
    """Return a value of a configuration file as on the command line."""
    return value.texts() if option.multiple else value.text()


# ---------------------------------------------------------------- commands
class Command(click.Command):
    """A command with examples in its help, variables for its options, and the common options set apart."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the words of the command line, those of a former run first."""
        ctx.meta["dynid.context"] = ctx
        return super().parse_args(ctx, args if ctx.resilient_parsing else repeated(ctx, args))

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the command's own options, then the common ones."""
        for common, title in enumerate(("Options", "Common options")):
            params = [param for param in self.get_params(ctx) if (param.name in COMMON) == common]
            records = (param.get_help_record(ctx) for param in params)
            with formatter.section(title):
                formatter.write_dl([record for record in records if record and record[1]])


#: What click is told of --from and --config, besides their names.
FROM: dict[str, Any] = {
    "metavar": "RUN.yaml",
    "expose_value": False,
    "allow_from_autoenv": False,
    "help": "Repeat a run of a results folder; options given besides win, logs given besides are added.",
}
CONFIG: dict[str, Any] = {
    "type": INPUT,
    "is_eager": True,
    "expose_value": False,
    "callback": configure,
    "help": "Configuration file instead of ./dynid.yaml and the user's.",
}


def dynid_command(
    name: str,
    *,
    repeatable: bool = False,
    without: Sequence[str] = (),
    config: dict[str, Any] = CONFIG,
) -> Callable[[Callable[..., Any]], Command]:
    """Make a command of a function that takes the session first and the rest by keyword.

    Args:
        name: name of the command.
        repeatable: whether it has ``--from run.yaml``; such a command calls ``write_run``.
        without: fields of its options that it does not offer.
        config: what click is told of the common option --config.

    Returns:
        A decorator; put it above decorators of click, for what no signature says.
    """

    def decorate(function: Callable[..., Any]) -> Command:
        own_line, kinds = command_line(function, without)

        def callback(**values: Any) -> Any:  # noqa: ANN401
            ctx = click.get_current_context()
            session = session_of(ctx, {key: values.pop(key) for key in COMMON})
            with session.heard():
                answer: Answer = function(session, **arguments(session, kinds, values))
                steps = [with_reading(ctx, step) for step in answer.next]
                session.show(replace(answer, next=steps))
                facts = {"schema": f"dynid/{name}/1", **answer.facts, "wrote": session.written}
                if ctx.obj is not None:
                    return facts
                if session.json:
                    session.emit_json(facts)
                return int(answer.status or bool(answer.limits))

        # Why in this order: eager options are read in it, and --color may stand in the file of --config.
        common_line = [
            *[click.Option(["--from", "from_"], **FROM)] * repeatable,
            click.Option(["--config"], **config),
            *(declared_option(each, is_eager=True) for each in fields(Session)),
        ]
        command = Command(
            name,
            callback=callback,
            params=[*common_line, *own_line],
            context_settings=CONTEXT,
            help=shown(function.__doc__),
            epilog=f"Docs: docs/reference/cli.md#dynid-{name}, or dynid explain",
        )
        # Why: DYNID_SEED serves every command, DYNID_IDENTIFY_SEED one of them; the narrower name comes first.
        for key, param in keys_of(command).items():
            own = f"DYNID_{name}_{key}".upper().replace("-", "_")
            param.envvar = [own, f"DYNID_{key}".upper()]
        IMPORTED[name] = command
        return command

    return decorate


def session_of(ctx: click.Context, common: dict[str, Any]) -> Session:
    """Return the session with common options; within another command its own, but for what is typed."""
    if ctx.obj is None:
        return Session(**common)
    typed = [key for key in common if ctx.get_parameter_source(key) is TYPED]
    return replace(ctx.obj, **{key: common[key] for key in typed})


def with_reading(ctx: click.Context, step: Step) -> Step:
    """Return a next step; on logs of this command with the options that were needed here to read them."""
    logs = {*arguments_of(ctx, ("log", "logs", "paths"))}
    if logs.isdisjoint(shlex.split(step.command)):
        return step
    flags = arguments_of(ctx, ("topic", "rate", "exclude", "sort_time", "anyway"))
    return replace(step, command=f"{step.command} {shell(*flags)}".rstrip())


def invoke(session: Session, name: str, *words: object) -> dict[str, Any]:
    """Run a command within another one, without its next steps, and return what its JSON answer would say.

    Args:
        session: of the outer command; its common options hold for the inner one but where ``words`` say something else.
        name: the inner command.
        words: its command line.
    """
    command = command_of(name)
    with command.make_context(name, [*map(str, words)], obj=session) as ctx:
        return dict(command.invoke(ctx))
