"""Stretches of time on the command line: ``3.2-3.4``."""

from __future__ import annotations

import re
from collections.abc import Sequence

from dynid.errors import WrongUsage

_NUMBER = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
_STRETCH = re.compile(f"{_NUMBER}-{_NUMBER}")


def stretches(words: Sequence[str], flag: str = "--exclude") -> tuple[tuple[float, float], ...]:
    """Return first and last time of each stretch [s]; one word may hold several, with commas between.

    Raises:
        WrongUsage: a word is not of the form ``T0-T1``, or ends before it begins.
    """
    found = []
    for word in (part for words_ in words for part in words_.split(",")):
        match = _STRETCH.fullmatch(word)
        if match is None or float(match[1]) >= float(match[2]):
            raise WrongUsage(
                f"{flag} {word} is not a stretch of time", fix=f"write first and last second: {flag} 3.2-3.4"
            )
        found.append((float(match[1]), float(match[2])))
    return tuple(found)
