"""Text that came from outside, made harmless for the place it is written to: one function for each kind of place.

Names of robots, joints, links, parameters and logs come from files that anybody may have written. Nothing that these
functions return can end a comment, a string, a cell or an element, or start a command. Letters, digits, ``_``, ``-``,
``.`` and the space stay as they are everywhere.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable, Mapping
from typing import Any

#: What a name may hold in source code without being written out; ASCII, because compilers guess the encoding.
_CODE = frozenset("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-. +(),")
#: What LaTeX gives a meaning.
_LATEX = {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    **{c: f"\\{c}" for c in "_&%$#{}"},
}
#: Words that YAML reads as something else than text.
_YAML = re.compile("(?i)y|n|yes|no|on|off|true|false|null|nan|inf")
#: Longest label and title of a figure and longest name of a file, in characters; what is longer is cut.
LABEL_LENGTH, TITLE_LENGTH, FILE_LENGTH = 60, 120, 100


def printable(text: str, fine: Callable[[str], bool] = str.isprintable) -> str:
    """Return text with control characters, line separators and invisible or reordering characters as ``<U+202E>``."""
    return "".join(c if fine(c) else f"<U+{ord(c):04X}>" for c in text)


def visible(text: str) -> str:
    """Return text for the terminal: one line, control characters written out, so that a name cannot steer it."""
    return "".join(c if c.isprintable() else " " if c.isspace() else repr(c)[1:-1] for c in text)


def whole_number(text: str) -> int:
    """Return the whole number that up to nine digits are, -1 for any other text: Python refuses to read thousands."""
    return int(text) if re.fullmatch("[0-9]{1,9}", text) else -1


def shell(*words: object) -> str:
    """Return words as a command that a person can paste into a shell."""
    from shlex import join  # here and below: help must be fast

    return visible(join(str(word) for word in words))


def code(text: str) -> str:
    r"""Return text for a comment of C, Python or MATLAB: ASCII without quotes, ``* / \ ? %`` and line ends."""
    return printable(text, _CODE.__contains__)


def identifier(text: str) -> str:
    """Return a name that C, Python and MATLAB accept for a function: ASCII letters, digits and ``_``."""
    name = re.sub(r"[^A-Za-z0-9_]", "_", text)[:FILE_LENGTH]
    return name if name[:1].isalpha() else f"arm_{name}"


def file_name(text: str) -> str:
    """Return the name of a file without suffix: letters, digits, ``_``, ``-``, ``.`` and spaces, not hidden."""
    name = "".join(c if c.isalnum() or c in "_-. " else "_" for c in text)[:FILE_LENGTH].strip(" .")
    return name or "arm"


def xml_comment(text: str) -> str:
    """Return the inside of an XML comment, which must not hold ``--`` nor end in ``-``."""
    return re.sub("-(?=-|$)", "- ", f" {printable(text).strip()} ")


def html(text: str) -> str:
    """Return text for an HTML or SVG element or a quoted attribute of one."""
    from html import escape

    return escape(printable(text), quote=True)


def markdown(text: str) -> str:
    """Return text that Markdown shows as it is, on one line."""
    line = printable(" ".join(text.split()))
    return "".join(f"\\{c}" if c in "\\`*_[]<>|#~&!" else c for c in line)


def latex(text: str) -> str:
    """Return text with the characters that mean something in LaTeX written out."""
    return "".join(_LATEX.get(c, c) for c in printable(text))


def csv_row(cells: Iterable[object]) -> str:
    """Return a line of a CSV file without its end; None is an empty cell."""
    import csv
    import io

    stream = io.StringIO()
    csv.writer(stream, lineterminator="").writerow(
        printable(cell) if isinstance(cell, str) else cell for cell in cells
    )
    return stream.getvalue()


def yaml_text(document: Mapping[str, Any], head: str | None = None, **style: Any) -> str:  # noqa: ANN401
    """Return a YAML document under one line of comment; text in it is read back exactly.

    Args:
        document: mappings, sequences, text and numbers.
        head: the comment, without ``#``; none when None.
        **style: of PyYAML's ``dump``, where it is not the usual one.
    """
    import yaml

    style = {"sort_keys": False, "width": 120, "default_flow_style": None, **style}
    # Why libyaml where it is there: a table of parameters takes a quarter of the time.
    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
    body = yaml.dump(document, Dumper=dumper, allow_unicode=True, **style)
    return f"# {printable(head)}\n{body}" if head is not None else body


def yaml_word(text: str) -> str:
    """Return text as one word of YAML that is read back exactly, quoted where it could be anything else."""
    import json

    return (
        text
        if re.fullmatch(r"[A-Za-z_/][A-Za-z0-9_/]*", text) and not _YAML.fullmatch(text)
        else json.dumps(text)
    )


def column(text: str) -> str:
    """Return the name of a column: one cell in a table of any dialect."""
    return printable(text, lambda c: c.isprintable() and c not in ',;|"')


def label(text: str, most: int = LABEL_LENGTH) -> str:
    """Return a label of a figure: one line of at most so many characters, without the ``$`` that starts a formula."""
    line = printable(text)
    line = line if len(line) <= most else f"{line[: most - 1]}…"
    return line.replace("$", r"\$")


def closest(word: str, known: Iterable[str]) -> str:
    """Return ``; did you mean 'x'?`` for the nearest known word, or an empty string."""
    near = difflib.get_close_matches(word, list(known), n=1, cutoff=0.6)
    return f"; did you mean '{near[0]}'?" if near else ""
