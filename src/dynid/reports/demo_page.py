"""The page that a demo ends at: what was done, with which commands, and what came out, in one file."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dynid.disk import write_text
from dynid.reports.page import templates


@dataclass(frozen=True)
class Chapter:
    """One step of the story.

    Attributes:
        title: heading.
        text: what happened, sentence by sentence.
        commands: command lines that do it again.
        pictures: files of pictures, each with what it shows.
    """

    title: str
    text: tuple[str, ...]
    commands: tuple[str, ...]
    pictures: tuple[tuple[Path, str], ...] = ()


def write_demo_page(
    path: Path, robot: str, lead: str, chapters: Sequence[Chapter], program: str = "dynid"
) -> Path:
    """Write the page; it needs no network and no other file.

    Args:
        path: where to.
        robot: name of the arm.
        lead: the story in a sentence.
        chapters: its steps.
        program: word that starts dynid here.
    """
    page = templates().get_template("demo.html")
    facts = {"robot": robot, "lead": lead, "chapters": chapters, "program": program}
    write_text(path, page.render(facts, b64encode=b64encode))
    return path
