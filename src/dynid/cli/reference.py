"""The pages of docs/reference that are made from the code: commands and codes.

``python -m dynid.cli.reference docs/reference`` writes them; a test compares them with the code.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click

from dynid.cli.explain import codes, page
from dynid.cli.main import COMMANDS, available, cli
from dynid.cli.options import COMMON_NAMES, Command
from dynid.errors import EXIT_MEANING
from dynid.files.artifact import write_text

#: Topics by the first digit of a code.
TOPICS = {
    "1": "The command line",
    "2": "Robot file",
    "3": "Logs and results",
    "4": "What the data can tell",
    "5": "Safety",
    "6": "The machine",
    "7": "Decisions",
}


_CLI_HEAD = """# Commands

Made by `make reference` from the commands themselves; a test keeps both equal. `dynid COMMAND -h` shows the same.

stdout carries the answer and nothing else; stages, warnings, questions and errors go to stderr.

An option's value comes from the first of: the command line, `DYNID_COMMAND_OPTION`, `DYNID_OPTION`, `./dynid.yaml`,
`~/.config/dynid/config.yaml`, the default; `dynid doctor --config` shows which. In the files, keys are long option
names with underscores: common options at the top, those of one command under its name.

Nothing is ever read from a pipe: where nobody can be asked, a question takes its documented answer and says so in one
line, or the command ends with status 7.
"""


def cli_page() -> str:
    """Return docs/reference/cli.md: every command with its examples and options."""
    context = click.Context(cli)
    commands = {name: cli.get_command(context, name) for name in available()}
    lines = [_CLI_HEAD, "## Exit statuses", "", "| status | meaning |", "| --- | --- |"]
    lines += [f"| {int(status)} | {meaning} |" for status, meaning in EXIT_MEANING.items()]
    first = commands["check"]
    assert first is not None
    lines += ["", "## Common options", "", *_options(first, common=True)]
    for name, command in commands.items():
        assert isinstance(command, Command)
        arguments = " ".join(_argument(param) for param in command.params if isinstance(param, click.Argument))
        writes = COMMANDS[name].writes
        lines += ["", f"## {name}", "", f"`{f'dynid {name} {arguments}'.strip()}`", "", _text(command.help or "")]
        lines += ["", f"Gives: {' '.join(writes.split())}."] if writes else []
        lines += ["", *(f"    {example}" for example in command.examples)] if command.examples else []
        own = _options(command, common=False)
        lines += ["", *own] if own else []
    return "\n".join(lines) + "\n"


def _text(text: str) -> str:
    return " ".join(text.split())


def _argument(argument: click.Argument) -> str:
    if isinstance(argument.type, click.Choice) and argument.metavar is None:
        return "|".join(str(choice) for choice in argument.type.choices)
    word = argument.metavar or str(argument.name).upper()
    return word if argument.required or word.startswith("[") else f"[{word}]"


def _options(command: click.Command, *, common: bool) -> list[str]:
    """Return the options of a command as a list, either the common ones or its own."""
    return [
        f"- `{_names(param)}`: {_text(param.help or '')}{_default(param)}"
        for param in command.params
        if isinstance(param, click.Option) and (param.name in COMMON_NAMES) is common
    ]


def _default(option: click.Option) -> str:
    plain = isinstance(option.default, (int, float, str)) and not isinstance(option.default, bool) and not option.count
    return f" Default: {option.default}." if plain and option.default != "" else ""


def _names(option: click.Option) -> str:
    names = ", ".join(option.opts) + "".join(f" / {word}" for word in option.secondary_opts)
    if option.is_flag or option.count:
        return names
    if isinstance(option.type, click.Choice):
        return f"{names} {'|'.join(str(choice) for choice in option.type.choices)}"
    return f"{names} {option.metavar or option.type.name.upper().removesuffix(' RANGE')}"


def errors_page() -> str:
    """Return docs/reference/errors.md: every code of the catalogue."""
    lines = [
        "# Errors and warnings",
        "",
        "Made by `make reference` from the catalogue in `src/dynid/errors.py`; a test keeps both equal.",
        "The first digit of a code is its topic. `E` stops the run, `W` is a warning and the run goes on.",
    ]
    topic = ""
    for code in codes():
        if code[1] != topic:
            topic = code[1]
            lines += ["", f"## {TOPICS[topic]}"]
        lines += ["", f"### {code}", ""]
        parts = page(code)
        lines.append(parts.pop("what"))
        if parts:
            lines.append("")
        lines += [f"- **{label}**: {_escaped(text)}" for label, text in parts.items()]
    return "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;").replace("*", "\\*")


if __name__ == "__main__":
    write_text(Path(sys.argv[1]) / "errors.md", errors_page())
    write_text(Path(sys.argv[1]) / "cli.md", cli_page())
