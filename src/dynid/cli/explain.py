"""``dynid explain CODE|PAGE``: what an error or warning means, or a page of the documentation that comes with dynid."""

from __future__ import annotations

import click
from rich.markdown import Markdown
from rich.text import Text

from dynid.answer import Answer
from dynid.cli.failure import is_terminal
from dynid.cli.options import completed, dynid_command
from dynid.cli.session import Session
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
@click.argument(
    "word",
    required=False,
    metavar="[CODE|PAGE]",
    shell_complete=completed(lambda: [*codes(), *pages()]),
)
def command(session: Session, word: str | None) -> Answer:
    """Say what an error or warning code means and how to get rid of it, or show a page of the documentation."""
    schema = {"schema": "dynid/explain/1"}
    if word is None:
        lines = [
            *((each, summary(each)) for each in codes()),
            ("pages", ", ".join(sorted(pages()))),
        ]
        facts = {"codes": {each: page(each) for each in codes()}, "pages": sorted(pages())}
        return Answer(schema | facts, parts=lines)
    code = word.strip("[]").upper()
    if code in codes():
        lines = [
            (code if label == "what" else f"  {label}", text) for label, text in page(code).items()
        ]
        return Answer(schema | {"code": code, **page(code)}, parts=lines)
    if word in pages():
        text = pages()[word].read_text(encoding="utf-8")
        if not session.json:
            terminal = is_terminal(session.stdout.file)
            session.stdout.print(Markdown(text) if terminal else Text(text))
        return Answer(schema | {"page": word, "text": text})
    raise WrongUsage(
        f"no code or page '{word}'{closest(word, [*codes(), *pages()])}",
        why="codes are E or W and three digits, as printed in error[E307]; pages have names such as robot-file",
        fix="dynid explain",
    )
