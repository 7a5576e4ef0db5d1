"""Stamps that are dates: ISO 8601, the usual ways of Europe and of America, and times of day -> seconds."""

from __future__ import annotations

import re
from datetime import date

#: Seconds of a day, and days from year 1 to 1970.
DAY, EPOCH = 86400.0, date(1970, 1, 1).toordinal()
_STAMP = re.compile(
    r"""(?:(?:(?P<year>\d{4})[-/.](?P<month>\d\d?)[-/.](?P<day>\d\d?)
          |(?P<first>\d\d?)(?P<mark>[./-])(?P<second>\d\d?)(?P=mark)(?P<last>\d{4}))
        (?:T|\s+))?
        (?P<hour>\d{1,3}):(?P<minute>[0-5]\d):(?P<whole>[0-5]\d)(?:[.,](?P<part>\d{1,12}))?
        \s*(?P<zone>Z|UTC|[+-]\d\d:?\d\d)?""",
    re.VERBOSE | re.ASCII,
)


def seconds_of(word: str) -> tuple[int, float] | None:
    """Return a stamp as whole seconds since 1970 (a time of day: since midnight) and the rest; None where it is none.

    Why two: a number that counts from 1970 holds no more than tenths of microseconds.
    """
    found = _STAMP.fullmatch(word)
    if found is None:
        return None
    days = 0
    try:
        if found["year"]:
            days = date(int(found["year"]), int(found["month"]), int(found["day"])).toordinal() - EPOCH
        elif found["last"]:
            # Why: 3/14/2024 can only be American; where both can be meant, only a midnight tells them apart.
            numbers = int(found["first"]), int(found["second"])
            american = found["mark"] == "/" and numbers[0] <= 12
            month, day = numbers if american else numbers[::-1]
            days = date(int(found["last"]), month, day).toordinal() - EPOCH
    except ValueError:
        return None
    whole = int(days * DAY) + 3600 * int(found["hour"]) + 60 * int(found["minute"]) + int(found["whole"])
    zone = (found["zone"] or "Z").replace(":", "")
    if zone[0] in "+-":
        whole -= int(zone[0] + "1") * (3600 * int(zone[1:3]) + 60 * int(zone[3:5]))
    return whole, float(f"0.{found['part'] or 0}")
