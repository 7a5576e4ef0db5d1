"""What only the user may say: on the command line, in a variable, or in ``~/.config/dynid/config.yaml``.

The working folder is somebody else's: logs come as a folder, with a ``dynid.yaml``, a ``run.yaml`` and a batch file in
it. Those may choose how numbers are computed. They may not name a machine to connect to, a file outside of the folder,
a limit that protects this machine, an answer to a question, or a motion of the arm.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click

from dynid.errors import WrongUsage
from dynid.text import shell
from dynid.xdg import config_file

#: Options, by their keys, that answer a question, connect or listen, start a program, write anywhere, or switch a
#: protection off.
OPTIONS = (
    "force",
    "yes",
    "log_file",
    "limit",
    "config",
    "from",
    "scheduler",
    "open",
    "accept",
    "master",
    "accept_unreviewed",
)
#: Commands that move an arm or answer on its network: none of the options that are theirs alone.
COMMANDS = ("record", "sim-driver")
#: Options that may name a file and are no paths by their type.
_FILES = ("robot", "holdout")


def require_inside(
    command: click.Command,
    name: str,
    value: Any,  # noqa: ANN401
    where: str,
    *folders: Path,
) -> None:
    """Raise where a file of a folder sets what only the user may set.

    Args:
        command: the command.
        name: parameter that is set.
        value: its value, or a list of them.
        where: the file, and the place in it.
        folders: paths may lead to what lies in one of them.

    Raises:
        WrongUsage: names the option and where it may be set.
    """
    from dynid.cli.options import COMMON_NAMES, key_of

    option = next(
        param for param in command.params if isinstance(param, click.Option) and param.name == name
    )
    word = option.opts[-1]
    asked = f"{where} sets {word}"
    if key_of(option) in OPTIONS or (command.name in COMMANDS and name not in COMMON_NAMES):
        raise _refused(f"{asked}, which only you may set", where, word)
    named = isinstance(option.type, click.Path) or key_of(option) in _FILES
    for text in map(str, value if isinstance(value, (list, tuple)) else [value]):
        if named and not inside(text, folders):
            raise _refused(f"{asked} to {text}, which leads out of the folder", where, word)


def inside(text: str, folders: Iterable[Path]) -> bool:
    """Return whether a path, all links followed, lies in one of some folders; a URL does not."""
    try:
        place = Path(text).resolve()
        return "://" not in text and any(
            place.is_relative_to(folder.resolve()) for folder in folders
        )
    except (OSError, RuntimeError, ValueError):  # a ring of links, a zero byte
        return False


def _refused(what: str, where: str, word: str) -> WrongUsage:
    why = "the folder may be somebody else's (dynid explain working-folder)"
    return WrongUsage(
        what,
        where=where,
        why=why,
        fix=f"give {word} on the command line, or in {shell(config_file())}",
    )
