"""What a command takes, and the rule who wins: flag, DYNID_* variable, ./dynid.yaml, user's file, default.

Top-level keys of a configuration file set an option for every command; a key that is a command's name holds that
command's options. ``./dynid.yaml`` wins over the user's file, and ``--config FILE`` stands in for both.

A command is a function ``command(session, ...)`` under ``@dynid_command("name", examples=(...))``. It returns an
``Answer``, which is printed here and nowhere else.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import Field, fields, replace
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

import dynid
from dynid.answer import Answer
from dynid.cli.commands import COMMANDS, CONTEXT, IMPORTED, command_of, shown
from dynid.cli.runfile import repeated
from dynid.cli.session import Session
from dynid.files.yamlfile import read_yaml
from dynid.options import Options, declaration_of, flag_of
from dynid.progress import heard_by
from dynid.xdg import LOCAL_CONFIG, config_file

if TYPE_CHECKING:
    from dynid.files.yamlfile import Value
    from dynid.robot import Robot

Decorator = Callable[[Callable[..., Any]], Any]
#: Options that every command has, and those of them with one letter.
COMMON = tuple(each.name for each in fields(Session))
SHORT = ("out", "force", "yes", "quiet", "verbose")
TYPED = ParameterSource.COMMANDLINE
#: What stands for a path.
PATH = click.Path(path_type=Path)
FILE = click.Path(dir_okay=False, path_type=Path)
INPUT = click.Path(exists=True, dir_okay=False, path_type=Path)


# ---------------------------------------------------------------- single options
TIP = click.option(
    "--tip",
    metavar="LINK",
    help="Last link of the arm, where ROBOT is a URDF whose joints fork.",
)


def load_robot(session: Session, robot: str, tip: str | None) -> Robot:
    """Return the arm that ROBOT names, and say what is noticed."""
    arm = dynid.load_robot(robot, tip=tip)
    session.findings(arm.findings)
    return arm


def robot_argument(function: Callable[..., Any]) -> Any:  # noqa: ANN401
    """Give a command the argument ROBOT and the option ``--tip``; the function gets the arm."""

    @wraps(function)
    def loaded(session: Session, *, robot: str, tip: str | None, **values: Any) -> Any:  # noqa: ANN401
        return function(session, robot=load_robot(session, robot, tip), **values)

    return click.argument("robot", type=click.Path())(TIP(loaded))


def key_of(each: Field[Any]) -> str:
    """Return the name of an option in variables, configuration files and run.yaml: its flag with underscores."""
    return flag_of(each)[2:].replace("-", "_")


def options_from(
    kind: type[Options], name: str = "options", *, without: tuple[str, ...] = ()
) -> Decorator:
    """Return a decorator that gives a command one option per field of an options dataclass, and the function the whole.

    Args:
        kind: the dataclass; fields that are common options are taken from those.
        name: argument of the function.
        without: fields that the command does not offer.
    """
    own = [each for each in fields(kind) if each.name not in (*COMMON, *without)]
    shared = [each.name for each in fields(kind) if each.name in COMMON]

    def decorate(function: Callable[..., Any]) -> Any:  # noqa: ANN401
        @wraps(function)
        def made(session: Session, **values: Any) -> Any:  # noqa: ANN401
            given = {each.name: values.pop(key_of(each)) for each in own}
            options = kind(**given, **{each: getattr(session, each) for each in shared})
            return function(session, **{name: options}, **values)

        for each in reversed(own):
            made = declared_option(each)(made)
        return made

    return decorate


#: What click is told of an option by what ``Declaration.kind`` says.
KINDS: dict[str, dict[str, Any]] = {
    "input": {"type": INPUT},
    "folder": {"type": click.Path(file_okay=False, path_type=Path)},
    "level": {"count": True},
}


def declared_option(each: Field[Any], **facts: Any) -> Decorator:  # noqa: ANN401
    """Return the option of a field of an options dataclass; ``facts`` are further arguments of ``click.option``."""
    said, flag = declaration_of(each), flag_of(each)
    name, short = key_of(each), [f"-{each.name[0]}"] if each.name in SHORT else []
    facts |= {"default": each.default, "help": said.help, "metavar": said.metavar or None}
    facts |= {"multiple": said.repeatable, "allow_from_autoenv": not said.deliberate}
    facts["show_default"] = said.nothing if each.default is None else None
    if "Path" in str(each.type):
        facts["type"] = PATH
    if said.pair:
        flag += f"/{said.off or '--no-' + flag[2:]}"
    elif isinstance(each.default, bool):
        facts["is_flag"] = True
    elif said.choices:
        facts["type"] = click.Choice(said.choices)
    elif said.bounds != (None, None):
        ranged: Any = click.IntRange if "int" in str(each.type) else click.FloatRange
        facts["type"] = ranged(*said.bounds)
    elif said.read is not None:
        facts["type"] = str
    return click.option(*short, flag, name, **facts | KINDS.get(said.kind, {}))


# ---------------------------------------------------------------- configuration files
def keys_of(command: click.Command) -> dict[str, click.Option]:
    """Return the options that variables and configuration files may set, by name."""
    options = [param for param in command.params if isinstance(param, click.Option)]
    return {str(each.name): each for each in options if each.allow_from_autoenv}


def settings(command: click.Command, given: Path | None) -> dict[str, Value]:
    """Return what the configuration files say about the options of a command.

    Args:
        command: the command.
        given: the file of --config; None for ./dynid.yaml and, weaker, the user's.

    Raises:
        UnknownKey: a key is neither a common option, a command, nor an option of this command.
        WrongUsage: an option that takes one value is given a list.
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
    ctx.default_map = {name: words_of(each) for name, each in merged.items()}


def words_of(value: Value) -> str | list[str]:
    """Return a value of a configuration file as on the command line."""
    return [item.text() for item in value.items()] if value.is_list else value.text()


# ---------------------------------------------------------------- commands
class Command(click.Command):
    """A command with examples in its help, variables for its options, and the common options set apart."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the words of the command line, those of a former run first."""
        ctx.meta["dynid.given"] = ctx.params
        return super().parse_args(ctx, args if ctx.resilient_parsing else repeated(ctx, args))

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the command's own options, then the common ones."""
        for common, title in enumerate(("Options", "Common options")):
            params = [param for param in self.get_params(ctx) if (param.name in COMMON) == common]
            records = [record for param in params if (record := param.get_help_record(ctx))]
            with formatter.section(title):
                formatter.write_dl([record for record in records if record[1]])


FROM_OPTION = click.option(
    "--from",
    "from_",
    metavar="RUN.yaml",
    expose_value=False,
    allow_from_autoenv=False,
    help="Repeat a run of a results folder; arguments and options given besides win.",
)
#: It comes first: eager options are read in this order, and --color may stand in the file.
CONFIG_OPTION = click.option(
    "--config",
    type=INPUT,
    is_eager=True,
    expose_value=False,
    callback=configure,
    help="Configuration file instead of ./dynid.yaml and the user's.",
)


def dynid_command(
    name: str,
    *,
    examples: Sequence[str] = (),
    repeatable: bool = False,
    config: Decorator = CONFIG_OPTION,
) -> Callable[[Callable[..., Any]], Command]:
    """Make a command of a function that takes the session first and its own options by keyword.

    Args:
        name: name of the command.
        examples: lines for the help.
        repeatable: whether it has ``--from run.yaml``; such a command calls ``write_run``.
        config: stands in for the common option --config.

    Returns:
        A decorator; put it above the function's own ``@click.option`` and ``@click.argument``.
    """

    def decorate(function: Callable[..., Any]) -> Command:
        @wraps(function)
        def callback(**values: Any) -> Any:  # noqa: ANN401
            ctx = click.get_current_context()
            common = {key: values.pop(key) for key in COMMON}
            if ctx.obj is None:
                session = Session(**common)
            else:
                typed = {key for key in COMMON if ctx.get_parameter_source(key) is TYPED}
                session = replace(ctx.obj, **{key: common[key] for key in typed})
            with session, heard_by(session.progress):
                answer: Answer = function(session, **values)
                session.show(answer)
                facts = {**answer.facts, "wrote": [*answer.facts.get("wrote", ()), *answer.wrote]}
                if ctx.obj is not None:
                    return facts
                if session.json:
                    session.emit_json(facts)
                return int(answer.status or bool(answer.limits))

        decorated: Any = callback
        for each in reversed(fields(Session)):
            decorated = declared_option(each, is_eager=True)(decorated)
        decorated = config(decorated)
        if repeatable:
            decorated = FROM_OPTION(decorated)
        text, docs = shown(str(function.__doc__), examples), f"docs/reference/cli.md#dynid-{name}"
        epilog = f"Docs: {docs}, or dynid explain"
        kind: Any = partial(click.command, cls=Command, context_settings=CONTEXT, epilog=epilog)
        command: Command = kind(name, help=text)(decorated)
        # Why: DYNID_SEED serves every command, DYNID_IDENTIFY_SEED one of them; the narrower name comes first.
        for key, option in keys_of(command).items():
            own = f"DYNID_{name}_{key}".upper().replace("-", "_")
            option.envvar = [own, f"DYNID_{key}".upper()]
        IMPORTED[name] = command
        return command

    return decorate


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
