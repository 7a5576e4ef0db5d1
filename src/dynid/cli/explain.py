"""``dynid explain CODE``: the page of an error or warning, made from the catalogue."""

from __future__ import annotations

import click

from dynid.cli.completed import CODE
from dynid.cli.options import Common, dynid_command
from dynid.errors import WrongUsage, codes, page, summary


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
@click.argument("code", type=CODE, required=False)
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
