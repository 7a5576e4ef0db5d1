"""The page that a demo ends at: what was done, with which commands, and what came out, in one file."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Sequence
from pathlib import Path

from dynid.disk import write_text
from dynid.reports.templating import rendered


def write_demo_page(path: Path, robot: str, told: Sequence[str | Path], program: str) -> Path:
    """Write the page, which needs no network and no other file.

    Args:
        path: where to.
        robot: name of the arm.
        told: ``---`` before a heading, ``dynid`` before the command that does it again, a sentence, or a picture.
        program: word that starts dynid here.
    """
    page = rendered("demo.html", robot=robot, told=told, program=program, b64encode=b64encode)
    write_text(path, page)
    return path
