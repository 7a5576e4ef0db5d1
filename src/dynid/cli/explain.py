"""``dynid explain CODE|PAGE``: what an error or warning means, or a page of the documentation that comes with dynid."""

from __future__ import annotations

import click

from dynid.cli.options import Answered, completed, dynid_command
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
def command(session: Session, word: str | None) -> Answered:
    """Say what an error or warning code means and how to get rid of it, or show a page of the documentation."""
    schema = {"schema": "dynid/explain/1"}
    if word is None:
        for each in codes():
            session.fact(each, summary(each))
        session.fact("pages", ", ".join(sorted(pages())))
        return schema | {"codes": {each: page(each) for each in codes()}, "pages": sorted(pages())}
    code = word.strip("[]").upper()
    if code in codes():
        for label, text in page(code).items():
            session.fact(code if label == "what" else f"  {label}", text)
        return schema | {"code": code, **page(code)}
    if word in pages():
        text = pages()[word].read_text(encoding="utf-8")
        session.page(text)
        return schema | {"page": word, "text": text}
    raise WrongUsage(
        f"no code or page '{word}'{closest(word, [*codes(), *pages()])}",
        why="codes are E or W and three digits, as printed in error[E307]; pages have names such as robot-file",
        fix="dynid explain",
    )
