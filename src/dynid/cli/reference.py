"""The pages of docs/reference that are made from the code: commands, codes, Python API, robot file and effects.

``python -m dynid.cli.reference docs/reference`` writes them; a test compares them with the code.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from dynid.cli.main import COMMANDS, available, cli
from dynid.cli.options import COMMON_NAMES, Command
from dynid.codes import codes, page
from dynid.errors import EXIT_MEANING
from dynid.files.artifact import write_text
from dynid.files.robotkeys import ROBOT, Key
from dynid.limits import LIMITS

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
        arguments = " ".join(
            _argument(param) for param in command.params if isinstance(param, click.Argument)
        )
        writes = COMMANDS[name].writes
        lines += [
            "",
            f"## {name}",
            "",
            f"`{f'dynid {name} {arguments}'.strip()}`",
            "",
            _text(command.help or ""),
        ]
        lines += ["", f"Gives: {' '.join(writes.split())}."] if writes else []
        lines += (
            ["", *(f"    {example}" for example in command.examples)] if command.examples else []
        )
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
    plain = (
        isinstance(option.default, (int, float, str))
        and not isinstance(option.default, bool)
        and not option.count
    )
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


def limits_page() -> str:
    """Return docs/reference/limits.md: the table of limits."""
    lines = [
        "# Limits",
        "",
        "Made by `make reference` from the table in `src/dynid/limits.py`; a test keeps both equal.",
        "",
        "A file that somebody else made may say that it holds a petabyte, nest a list a million times, or never end.",
        "Each limit is checked before memory is taken; a file beyond one is refused ([E323](errors.md#e323)). If the",
        "file can be trusted, `--limit NAME=VALUE` raises the limit for one command; in Python,",
        "`dynid.limits.raised` does.",
        "Devices, pipes and sockets are not read at all.",
        "",
        "| limit | value | unit | what is counted | why this much |",
        "| --- | --- | --- | --- | --- |",
    ]
    for name, entry in LIMITS.items():
        value = f"{entry.most:,.0f}".replace(",", " ")
        lines.append(f"| `{name}` | {value} | {entry.unit} | {entry.what} | {entry.why} |")
    return "\n".join(lines) + "\n"


def _escaped(text: str) -> str:
    return text.replace("<", "&lt;").replace("*", "\\*")


# ---------------------------------------------------------------- the Python API
_API_HEAD = """# Python API

Made by `make reference` from the docstrings; a test keeps both equal. Everything here is imported from `dynid` itself,
when it is first used. Mistakes are the exceptions of [errors](errors.md), in `dynid.errors`.
"""


def api_page() -> str:
    """Return docs/reference/api.md: every public function and class with its arguments, shapes and units."""
    import inspect

    import dynid

    names = [name for name in dynid.__all__ if name != "__version__"]
    functions = [name for name in names if inspect.isfunction(getattr(dynid, name))]
    options = [name for name in names if name.endswith("Options")]
    objects = [name for name in names if name not in (*functions, *options)]
    lines = [_API_HEAD]
    for title, group in (("Functions", functions), ("Options", options), ("Objects", objects)):
        lines += [f"## {title}", ""]
        for name in group:
            lines += [f"### {name}", "", *_described(name, getattr(dynid, name)), ""]
    return "\n".join(lines).rstrip() + "\n"


def _described(name: str, thing: Any) -> list[str]:  # noqa: ANN401
    import inspect

    lines = _prose(inspect.getdoc(thing) or "")
    if inspect.isfunction(thing):
        return [f"`dynid.{name}{_signature(thing)}`", "", *lines]
    public = [
        (key, value)
        for key, value in vars(thing).items()
        if not key.startswith("_") and (inspect.isfunction(value) or isinstance(value, property))
    ]
    for key, value in public:
        call = key if isinstance(value, property) else f"{key}{_signature(value)}"
        first = (value.__doc__ or "").strip().split("\n\n")[0]
        lines.append(f"- `.{call}`: {_escaped(_text(first))}")
    return lines


def _signature(function: Any) -> str:  # noqa: ANN401
    """Return the arguments as they are called: names and defaults, without types."""
    import inspect

    words: list[str] = []
    for one in inspect.signature(function).parameters.values():
        if one.name == "self":
            continue
        if one.kind is one.KEYWORD_ONLY and "*" not in words:
            words.append("*")
        name = f"**{one.name}" if one.kind is one.VAR_KEYWORD else one.name
        words.append(name if one.default is one.empty else f"{name}={one.default!r}")
    return f"({', '.join(words)})"


def _prose(doc: str) -> list[str]:
    """Return a docstring as Markdown: paragraphs, and one list entry per argument, attribute or error."""
    import re

    lines: list[str] = []
    section = ""
    for line in doc.split("\n"):
        if line in ("Args:", "Attributes:", "Raises:", "Returns:", "Example:"):
            section = line
            lines += [f"*{line[:-1]}*", ""]
        elif section == "Example:" and line.startswith("    "):
            lines.append(f"`{line.strip()}`")
        elif section and (found := re.match(r"    (\w+): (.*)", line)):
            lines.append(f"- `{found[1]}`: {_escaped(found[2])}")
        elif section and line.startswith("    "):
            lines.append(f"  {_escaped(line.strip())}" if lines[-1] else _escaped(line.strip()))
        else:
            section = section if line else ""
            lines.append(_escaped(line))
    return lines


_ROBOT_HEAD = """# The robot file

The tables are made by `make reference` from the keys as they are read; a test keeps both equal.

One YAML file describes one arm. Unknown keys, keys given twice, text where a number belongs and missing keys are errors
with file and line. `dynid check FILE` reads it and says what it understood.

![Frames and the four numbers of a DH row, in the standard and in the modified convention](../images/dh.svg)

The two conventions describe different robots with the same numbers. If you do not know which one you have: when `a` and
`twist` of a row belong to the *next* axis, it is standard; when they belong to the axis *before*, it is modified. Then
compare the tool of `dynid check` with a ruler.
"""
_ROBOT_FOOT = """
Angles within 1e-4 rad of a multiple of 15 degrees are taken to mean it, with warning W202: 1.5708 would otherwise break
exact zeros of the model.

YAML reads `1e-3` as text, `012` as 10, `1:30` as 90 and `off` as false. dynid refuses them instead of guessing: write
`1.0e-3`.

Examples are in `robots/`: two research arms, an industrial arm in modified DH, a SCARA with a sliding joint, an arm
with a coupled wrist.
"""


def robot_page() -> str:
    """Return docs/reference/robot-file.md: every key with its type, unit, default and meaning."""
    tables: dict[tuple[Key, ...], list[str]] = {}
    _collect(ROBOT, "", tables)
    lines = [_ROBOT_HEAD.rstrip("\n")]
    for keys, places in tables.items():
        titled = (
            ["", f"## {', '.join(f'`{place}`' for place in places)}"] if keys is not ROBOT else []
        )
        lines += [
            *titled,
            "",
            "| key | type | unit | default | meaning |",
            "| --- | --- | --- | --- | --- |",
        ]
        lines += [
            f"| `{key.name}` | {key.kind.words} | {key.unit} | {key.default} | {key.help} |"
            for key in keys
        ]
    return "\n".join([*lines, _ROBOT_FOOT])


def _collect(keys: tuple[Key, ...], place: str, tables: dict[tuple[Key, ...], list[str]]) -> None:
    """Note where each set of keys stands: the keys of a body stand in two places."""
    tables.setdefault(keys, []).append(place)
    for key in keys:
        if key.kind.keys:
            _collect(key.kind.keys, f"{place}.{key.name}".lstrip("."), tables)


# ---------------------------------------------------------------- torque effects
_EFFECTS_HEAD = """# Torque effects

Made by `make reference` from the effect classes; a test keeps both equal.

`tau_rb` is the rigid-body torque of the current model, `sign` the Coulomb sign of the robot file, `j` the joint.
Amplitudes enter linearly and are identified again whenever the robot file is; shape parameters stay as they were found.

## `formula`: a torque in words of its own

    - effect: formula
      joints: [joint_4]
      formula: a cos(2 q4) |qd4| + b tau4 qd4
      parameters: {a: 0.4, b: 0.01}

A sum of products. Signals are `q4`, `qd4`, `qdd4` and `tau4` (`tau_rb`) of joint 4, without a number those of the joint
that it acts on, and `t`, the time since the log began. Each term has one amplitude, a name such as `a`, which is
identified with everything else. There are numbers, `+ - * /`, powers `^2`, brackets, bars for sizes, and `sin`, `cos`,
`tanh`, `exp`, `sqrt`, `abs`, `sign`, `clip(x, limit)`. The text is read by a parser of its own and is never executed.
"""
_WHERE = {
    "joint": "a joint",
    "pair": "a joint, and another one it depends on",
    "arm": "the whole arm",
}
_USES = {
    ("refit", "frozen"): "found by --ask numbers and --ask changed",
    ("frozen",): "found by --ask changed only: identifying again absorbs it",
    ("arm",): "found by --ask arm: only implausible links imitate it",
}


def effects_page() -> str:
    """Return docs/reference/effects.md: every torque effect of the catalogue."""
    from dynid.model.effects.catalogue import CATALOGUE

    lines = [_EFFECTS_HEAD]
    for effect in CATALOGUE.values():
        shape = dict.fromkeys(effect.shape_units, 1.0)
        lines += [f"## `{effect.name}`: {effect.title}", "", f"    {effect.equation}", ""]
        lines += [f"- acts on {_WHERE[effect.scope]}; {_USES[effect.uses]}"]
        lines += [f"- amplitudes: {_with_units(effect.amplitudes(shape))}"]
        lines += [f"- shape: {_with_units(effect.shape_units)}"] if effect.shape_units else []
        lines += [
            f"- seen as: {effect.signature}",
            f"- to tell it from others: {effect.separate}",
            "",
        ]
    return "\n".join(lines)


def _with_units(units: dict[str, str]) -> str:
    return ", ".join(f"`{name}` [{unit or '1'}]" for name, unit in units.items())


if __name__ == "__main__":
    write_text(Path(sys.argv[1]) / "errors.md", errors_page())
    write_text(Path(sys.argv[1]) / "limits.md", limits_page())
    write_text(Path(sys.argv[1]) / "cli.md", cli_page())
    write_text(Path(sys.argv[1]) / "api.md", api_page())
    write_text(Path(sys.argv[1]) / "robot-file.md", robot_page())
    write_text(Path(sys.argv[1]) / "effects.md", effects_page())
