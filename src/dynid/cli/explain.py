"""``dynid explain CODE|PAGE``: what an error or warning means, or a page of the documentation that comes with dynid."""

from __future__ import annotations

import click

from dynid.cli.arguments import CODE
from dynid.cli.options import Common, dynid_command
from dynid.codes import codes, page, summary
from dynid.errors import WrongUsage
from dynid.files import pages
from dynid.text import closest


@dynid_command(
    "explain",
    examples=(
        "dynid explain              all codes and pages",
        "dynid explain E307         a code",
        "dynid explain robot-file   a page: every key of a robot file",
    ),
)
@click.argument("word", type=CODE, required=False, metavar="[CODE|PAGE]")
def command(common: Common, word: str | None) -> None:
    """Say what an error or warning code means and how to get rid of it, or show a page of the documentation."""
    terminal = common.terminal
    if word is None:
        answer = {"codes": {each: page(each) for each in codes()}, "pages": sorted(pages())}
        terminal.emit_json({"schema": "dynid/explain/1", **answer})
        for each in codes():
            terminal.fact(each, summary(each))
        terminal.fact("pages", ", ".join(sorted(pages())))
        return
    code = word.strip("[]").upper()
    if code in codes():
        terminal.emit_json({"schema": "dynid/explain/1", "code": code, **page(code)})
        for label, text in page(code).items():
            terminal.fact(code if label == "what" else f"  {label}", text)
    elif word in pages():
        text = pages()[word].read_text(encoding="utf-8")
        terminal.emit_json({"schema": "dynid/explain/1", "page": word, "text": text})
        terminal.page(text)
    else:
        raise _unknown(word)


def _unknown(word: str) -> WrongUsage:

    return WrongUsage(
        f"no code or page '{word}'{closest(word, [*codes(), *pages()])}",
        why="codes are E or W and three digits, as printed in error[E307]; pages have names such as robot-file",
        fix="dynid explain",
    )
