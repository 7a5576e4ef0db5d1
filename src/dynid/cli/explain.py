"""``dynid explain CODE``: the page of an error or warning, made from the catalogue."""

from __future__ import annotations

import click

from dynid.cli.options import Common, dynid_command
from dynid.errors import EXIT_MEANING, WARNINGS, WrongUsage, catalogue


def codes() -> list[str]:
    """Return all codes, errors and warnings of a topic together."""
    return sorted([*catalogue(), *WARNINGS], key=lambda code: (code[1:], code))


def summary(code: str) -> str:
    """Return what happened, in one sentence."""
    return WARNINGS[code] if code in WARNINGS else " ".join((catalogue()[code].__doc__ or "").split())


def page(code: str) -> dict[str, str]:
    """Return the parts of the page of a code: what, why, fix, exit; a warning has only what."""
    if code in WARNINGS:
        return {"what": summary(code)}
    mistake = catalogue()[code]
    status = mistake.status
    return {
        "what": summary(code),
        "why": mistake.why,
        "fix": mistake.fix,
        "exit": f"{int(status)}, {EXIT_MEANING[status]}",
    }


def _find(word: str) -> str:
    from dynid.files.yamlfile import closest

    code = word.strip("[]").upper()
    if code not in codes():
        raise WrongUsage(
            f"no code '{word}'{closest(code, codes())}",
            why="codes are E or W and three digits, as printed in error[E307]",
            fix="dynid explain",
        )
    return code


@dynid_command(
    "explain",
    examples=("dynid explain            all codes", "dynid explain E307       one of them"),
)
@click.argument("code", required=False)
def command(common: Common, code: str | None) -> None:
    """Say what an error or warning code means and how to get rid of it."""
    terminal = common.terminal
    if code is None:
        terminal.emit_json({"schema": "dynid/explain/1", "codes": {each: page(each) for each in codes()}})
        for each in codes():
            terminal.fact(each, summary(each))
        return
    found = _find(code)
    terminal.emit_json({"schema": "dynid/explain/1", "code": found, **page(found)})
    for label, text in page(found).items():
        terminal.fact(found if label == "what" else f"  {label}", text)
