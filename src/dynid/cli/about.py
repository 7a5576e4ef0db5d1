"""Commands about this machine and about dynid: doctor, explain, completion."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
from click.shell_completion import get_completion_class

from dynid import workflows
from dynid.answer import Answer
from dynid.arguments import no_such
from dynid.cli.commands import COMMANDS, command_of
from dynid.cli.options import (
    COMMON,
    CONFIG,
    TYPED,
    TYPES,
    dynid_command,
    keys_of,
    settings,
    words_of,
)
from dynid.cli.session import Session
from dynid.codes import codes, page, summary
from dynid.files import pages
from dynid.table import Table

#: Value of --config that means: show the configuration.
SHOW = Path("?show")


def sources(file: Path | None) -> Iterator[dict[str, Any]]:
    """Yield value and source of the common options, then of those options of commands that lost their default."""
    ctx = click.get_current_context()
    for name in sorted(COMMANDS, key="doctor".__ne__):
        command = command_of(name)
        configured, here = settings(command, file), command is ctx.command
        for key, option in keys_of(command).items():
            if key == "config" or (key in COMMON) is not here:
                continue
            value: Any = option.get_default(ctx)
            value = value if isinstance(value, (bool, int, float, str)) else None
            source = "default"
            names = [each for each in option.envvar or () if os.environ.get(each)]
            if here and ctx.get_parameter_source(key) is TYPED:
                value, source = ctx.params[key], "command line"
            elif names:
                value, source = os.environ[names[0]], names[0]
            elif key in configured:
                value, source = words_of(option, configured[key]), configured[key].where
            if here or source != "default":
                row = {"command": "" if here else name, "option": key}
                yield row | {"value": value, "source": source}


@dynid_command(
    "doctor",
    config=CONFIG
    | {
        "type": TYPES["Path"],
        "metavar": "[FILE]",
        "is_flag": False,
        "flag_value": str(SHOW),
        "help": "Show each option's value and source, those of FILE instead of ./dynid.yaml and the user's.",
    },
)
def doctor_command(session: Session) -> Answer:
    """Look at this machine: Python, packages, simulator, ROS, display, folders, configuration.

    Examples:
      dynid doctor               what works and what does not
      dynid doctor --config      each option's value
    """
    config = click.get_current_context().meta["dynid.config"]
    if config is not None:
        shown = list(sources(None if config == SHOW else config))
        note = "note", "options of single commands are listed when they differ from their default"
        return Answer({"settings": shown}, parts=[Table(shown)], notes=[note])
    return workflows.doctor.doctor()


@dynid_command("explain")
def explain_command(session: Session, *, word: str | None = None) -> Answer:
    """Say what an error or warning code means and how to get rid of it, or show a page of the documentation.

    Examples:
      dynid explain              all codes and pages
      dynid explain E307         a code
      dynid explain robot-file   a page: every key of a robot file
    """
    if word is None:
        names = sorted(pages())
        facts = {"codes": {each: page(each) for each in codes()}, "pages": names}
        lines = [*((each, summary(each)) for each in codes()), ("pages", ", ".join(names))]
        return Answer(facts, parts=lines)
    code = word.strip("[]").upper()
    if code in codes():
        said = page(code)
        lines = [(code if name == "what" else f"  {name}", text) for name, text in said.items()]
        return Answer({"code": code, **said}, parts=lines)
    if word in pages():
        text = pages()[word].read_text(encoding="utf-8")
        session.answer(text)
        return Answer({"page": word, "text": text})
    why = "codes are E or W and three digits, as printed in error[E307]; pages have names such as robot-file"
    raise no_such("no code or page", word, [*codes(), *pages()], why=why, fix="dynid explain")


@dynid_command("completion")
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion_command(session: Session, shell: str) -> Answer:
    """Print the completion script of a shell.

    Examples:
      eval "$(dynid completion bash)"                                   in ~/.bashrc
      eval "$(dynid completion zsh)"                                    in ~/.zshrc
      dynid completion fish > ~/.config/fish/completions/dynid.fish
    """
    made, root = get_completion_class(shell), click.get_current_context().find_root().command
    assert made is not None
    script = made(root, {}, "dynid", "_DYNID_COMPLETE").source()
    session.answer(script)
    return Answer({"shell": shell, "script": script})
