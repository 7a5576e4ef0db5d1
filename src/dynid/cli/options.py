"""What a command takes, and the rule who wins: flag, DYNID_* variable, ./dynid.yaml, user's file, default.

Top-level keys of a configuration file set an option for every command; a key that is a command's name holds that
command's options. ``./dynid.yaml`` wins over the user's file, and ``--config FILE`` stands in for both.

A command is a function ``command(session, ...)`` under ``@dynid_command("name", examples=(...))``. It returns what its
JSON answer says, or that and an exit status: 1, which is True, where a limit is not met.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import Field, fields
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.shell_completion import CompletionItem

from dynid.cli.commands import COMMANDS, command_of
from dynid.cli.runfile import key_of, repeated
from dynid.cli.session import Session
from dynid.errors import UnknownKey, WrongUsage
from dynid.files.yamlfile import read_yaml
from dynid.options import Declaration, Options, declaration_of, flag_of
from dynid.xdg import LOCAL_CONFIG, config_file

if TYPE_CHECKING:
    from dynid.files.yamlfile import Value
    from dynid.robot import Robot

#: What a command returns.
Answered = Mapping[str, Any] | tuple[Mapping[str, Any], int]
Decorator = Callable[[Callable[..., Any]], Any]
#: Options that every command has, and those of them with one letter.
COMMON = tuple(each.name for each in fields(Session))
SHORT = ("out", "force", "yes", "quiet", "verbose")
#: What stands for a path.
PATH = click.Path(path_type=Path)
FILE = click.Path(dir_okay=False, path_type=Path)
INPUT = click.Path(exists=True, dir_okay=False, path_type=Path)
#: Types on the command line by what ``Declaration.kind`` says.
KINDS = {
    "path": PATH,
    "file": FILE,
    "input": INPUT,
    "folder": click.Path(file_okay=False, path_type=Path),
    "count": click.IntRange(min=1),
    "level": click.INT,
    "positive": click.FloatRange(min=0, min_open=True),
    "float": click.FloatRange(min=0),
    "effects": click.STRING,
}
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


# ---------------------------------------------------------------- single options
def completed(words: Callable[[], Iterable[str]], *, files: bool = False) -> Any:  # noqa: ANN401
    """Return what offers a shell the words that begin with what was typed, also after a comma, or else files."""

    def offer(ctx: click.Context, param: click.Parameter, typed: str) -> list[CompletionItem]:
        before, comma, begun = typed.rpartition(",")
        found = [f"{before}{comma}{word}" for word in words() if word.startswith(begun)]
        return [*map(CompletionItem, found)] or [CompletionItem(typed, type="file")] * files

    return offer


def _robots() -> Iterable[str]:
    from dynid.files.robotfile import known_robots

    return known_robots()


def _effects() -> Iterable[str]:
    from dynid.model.effects.catalogue import CATALOGUE

    return ["all", *CATALOGUE]


ROBOTS = completed(_robots, files=True)


TIP = click.option(
    "--tip",
    metavar="LINK",
    help="Last link of the arm, where ROBOT is a URDF whose joints fork.",
)


def load_robot(session: Session, robot: str, tip: str | None) -> Robot:
    """Return the arm that ROBOT names, and say what is noticed."""
    from dynid import loading

    arm = loading.load_robot(robot, tip=tip)
    session.findings(arm.findings)
    return arm


def robot_argument(function: Callable[..., Any]) -> Any:  # noqa: ANN401
    """Give a command the argument ROBOT and the option ``--tip``; the function gets the arm."""

    @wraps(function)
    def loaded(session: Session, *, robot: str, tip: str | None, **values: Any) -> Any:  # noqa: ANN401
        return function(session, robot=load_robot(session, robot, tip), **values)

    return click.argument("robot", shell_complete=ROBOTS)(TIP(loaded))


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
            given = {each.name: values.pop(each.name) for each in own}
            options = kind(**given, **{each: getattr(session, each) for each in shared})
            return function(session, **{name: options}, **values)

        for each in reversed(own):
            made = declared_option(each)(made)
        return made

    return decorate


def declared_option(each: Field[Any], **facts: Any) -> Decorator:  # noqa: ANN401
    """Return the option of a field of an options dataclass; ``facts`` are further arguments of ``click.option``."""
    said, flag = declaration_of(each), flag_of(each)
    facts |= {"default": each.default, "help": said.help}
    if said.deliberate:
        facts["allow_from_autoenv"] = False
    if said.shown is not None:
        facts["show_default"] = said.shown or True
    if said.pair:
        flag += f"/{said.off or '--no-' + flag[2:]}"
    elif isinstance(each.default, bool):
        facts["is_flag"] = True
    elif said.kind == "level":
        facts["count"] = True
    else:
        facts |= {"type": _type(each, said), "multiple": said.repeatable}
        facts |= {"metavar": said.metavar} if said.metavar else {}
        facts |= {"shell_complete": completed(_effects)} if said.kind == "effects" else {}
    short = [f"-{each.name[0]}"] if each.name in SHORT else []
    return click.option(*short, flag, each.name, **facts)


def _type(each: Field[Any], said: Declaration) -> Any:  # noqa: ANN401
    if said.choices:
        return click.Choice(said.choices)
    if said.kind:
        return KINDS[said.kind]
    if said.bounds != (None, None):
        kind: Any = click.IntRange if isinstance(each.default, int) else click.FloatRange
        return kind(*said.bounds)
    return str if said.read is not None or each.default in (None, ()) else type(each.default)


# ---------------------------------------------------------------- configuration files
def keys_of(command: click.Command) -> dict[str, click.Option]:
    """Return the options that variables and configuration files may set, by their keys."""
    options = [param for param in command.params if isinstance(param, click.Option)]
    return {key_of(each): each for each in options if each.allow_from_autoenv}


def settings(command: click.Command, given: Path | None) -> dict[str, Value]:
    """Return what the configuration files say about the options of a command, by the names of the parameters.

    Args:
        command: the command.
        given: the file of --config; None for ./dynid.yaml and, weaker, the user's.

    Raises:
        UnknownKey: a key is neither a common option, a command, nor an option of this command.
        WrongUsage: an option that takes one value is given a list.
    """
    keys: dict[str, click.Option] = {k: v for k, v in keys_of(command).items() if k != "config"}
    found: dict[str, Value] = {}
    common = [key for key in keys if key in COMMON]
    for path in [given] if given else filter(Path.is_file, (config_file(), LOCAL_CONFIG)):
        try:
            top = read_yaml(path).mapping([*common, *COMMANDS])
            own = top.get(str(command.name))
            inner = own.mapping(tuple(keys)) if own is not None and not own.is_null else {}
        except UnknownKey as error:
            error.fix = "rename or remove the key; keys are long option names"
            raise
        for key, value in {**{key: top[key] for key in common if key in top}, **inner}.items():
            if value.is_list and not keys[key].multiple:
                raise value.wrong(" takes one value, not a list", kind=WrongUsage)
            if not value.is_null:
                found[str(keys[key].name)] = value
    return found


def configure(ctx: click.Context, param: click.Parameter, value: Path | None) -> None:
    """Read the configuration files, whose values become this command's defaults."""
    ctx.meta["dynid.config"] = value
    # Why: what one command does for another is not what a file says of that.
    file = value if value is None or value.is_file() else None
    found = ctx.meta["dynid.settings"] = settings(ctx.command, file) if ctx.obj is None else {}
    ctx.default_map = {name: words_of(each) for name, each in found.items()}


def words_of(value: Value) -> str | list[str]:
    """Return a value of a configuration file as on the command line."""
    return [item.text() for item in value.items()] if value.is_list else value.text()


def _say_settings(session: Session) -> None:
    """Say which options a file of the working folder has set: nobody may notice that it lies there."""
    ctx = click.get_current_context()
    used = {
        name: each.file
        for name, each in ctx.meta["dynid.settings"].items()
        if each.file != config_file()
        and ctx.get_parameter_source(name) is click.core.ParameterSource.DEFAULT_MAP
    }
    if used:
        session.stage("settings", f"{next(iter(used.values()))} sets {', '.join(used)}")


# ---------------------------------------------------------------- commands
def write_examples(formatter: click.HelpFormatter, lines: Sequence[str]) -> None:
    """Write examples as they are."""
    with formatter.section("Examples"):
        for line in lines:
            formatter.write(f"  {line}\n")


class Command(click.Command):
    """A command with examples in its help, variables for its options, and the common options set apart."""

    def __init__(
        self,
        *args: Any,  # noqa: ANN401
        examples: Sequence[str] = (),
        repeatable: bool = False,
        **facts: Any,  # noqa: ANN401
    ) -> None:
        super().__init__(*args, **facts)
        self.context_settings = CONTEXT
        self.examples, self.repeatable = examples, repeatable
        self.epilog = f"Docs: docs/reference/cli.md#dynid-{self.name}, or dynid explain"
        # Why: DYNID_SEED serves every command, DYNID_IDENTIFY_SEED one of them; the narrower name comes first.
        own = str(self.name).upper().replace("-", "_")
        for key, option in keys_of(self).items():
            option.envvar = [f"DYNID_{own}_{key.upper()}", f"DYNID_{key.upper()}"]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Read the words of the command line, those of a former run first."""
        ctx.meta["dynid.given"] = ctx.params
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
                word = str(value) if isinstance(value, (str, Path)) else ""
                if word.startswith("--") or word in names:
                    flag = option.opts[-1]
                    raise WrongUsage(
                        f"{flag} needs a value, and '{word}' is an option",
                        fix=f"{flag} VALUE {word}, or ./{word} where a file is called so",
                    )

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write examples, the command's own options, then the common ones."""
        write_examples(formatter, self.examples)
        records: dict[bool, list[tuple[str, str]]] = {False: [], True: []}
        for param in self.get_params(ctx):
            record = param.get_help_record(ctx)
            if record and record[1]:
                records[param.name in (*COMMON, "config", "help")].append(record)
        for common, some in records.items():
            if some:
                with formatter.section("Common options" if common else "Options"):
                    formatter.write_dl(some)

    def format_arguments(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write nothing: examples show the arguments."""


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
    metavar="FILE",
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
        name: name of the command, the same as its module.
        examples: lines for the help.
        repeatable: whether it has ``--from run.yaml``; such a command calls ``write_run``.
        config: stands in for the common option --config.

    Returns:
        A decorator; put it above the function's own ``@click.option`` and ``@click.argument``.
    """

    def decorate(function: Callable[..., Any]) -> Command:
        @wraps(function)
        def callback(**values: Any) -> Any:  # noqa: ANN401
            with Session(**{key: values.pop(key) for key in COMMON}) as session:
                _say_settings(session)
                answer = function(session, **values)
                facts, status = answer if isinstance(answer, tuple) else (answer, 0)
                if click.get_current_context().obj is not None:
                    return facts
                if session.json and facts is not None:
                    session.emit_json(facts)
                return int(status)

        decorated: Any = callback
        for each in reversed(fields(Session)):
            decorated = declared_option(each, is_eager=True)(decorated)
        decorated = config(decorated)
        if repeatable:
            decorated = FROM_OPTION(decorated)
        command = click.command(name, cls=Command, examples=examples, repeatable=repeatable)
        return command(decorated)

    return decorate


def invoke(session: Session, name: str, *words: object, last: bool = False) -> dict[str, Any]:
    """Run a command within another one and return what its JSON answer would say.

    Args:
        session: of the outer command; its common options hold for the inner one but where ``words`` say something else.
        name: the inner command.
        words: its command line.
        last: whether it says what to do next.
    """
    common = [f"--color={session.color}", f"--seed={session.seed}", *["-v"] * session.verbose]
    for flag in ("force", "yes", "no_input", "json", "quiet"):
        common += [f"--{flag.replace('_', '-')}"] * getattr(session, flag)
    common += [f"--log-file={session.log_file}"] if session.log_file else []
    line = [*common, *map(str, words)]
    command = command_of(name)
    with command.make_context(name, line, obj=last) as ctx:
        return dict(command.invoke(ctx))
