"""What the names of a table's columns say: which are positions, torques, stamps, and in which units."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from os.path import commonprefix

from dynid.units import FACTORS

#: A unit at the end of the name of a time column: time_ms, t[us], stamp (ns), Time [s].
_TIME_UNIT = re.compile(
    r"(?:^|[_\s\[(./]+)(s|secs?|seconds|ms|msec|us|usec|µs|ns|nsec|nanosec)[\])]?$"
)

#: Words of column names and what they stand for; the first kind that has one of its words is taken.
_WORDS = {
    "acceleration": "acc acceleration qdd ddq",
    "velocity": "qd dq vel velocity velocities speed qp",
    "effort": "tau torque torques trq effort efforts moment moments drehmoment load "
    "i cur curr current currents iq ampere",
    "position": "q pos position positions angle angles theta winkel",
    "joint": "joint joints j jnt axis a",
    "name": "name",
}
_KINDS = {word: kind for kind, words in reversed(_WORDS.items()) for word in words.split()}
_CURRENT = frozenset(_WORDS["effort"].partition("load ")[2].split())
#: Words of what was commanded and of what was measured, and of columns that are no joint's: tools and hands, estimates
#: of what touches the arm, statistics; names of a column that is time, without their unit.
_QUALIFIED = {
    "commanded": "ref reference target cmd command commanded des desired goal set setpoint d",
    "measured": "actual measured meas msr act state",
    "other": "tcp tool flange ee cart cartesian gripper finger ext external contact temp temperature voltage window "
    "error err std var dtau offset limit",
    "time": "t time stamp timestamp seconds duration elapsed clock zeit temps tiempo",
}
_COMMANDED, _MEASURED, _OTHER, _TIMES = (frozenset(words.split()) for words in _QUALIFIED.values())
#: Units as headers spell them, in small letters.
_UNITS = {unit.lower(): unit for units in FACTORS.values() for unit in units} | {
    "degrees": "deg",
    "°": "deg",
    "°/s": "deg/s",
    "n m": "Nm",
    "n*m": "Nm",
}


def is_time(name: str) -> bool:
    """Return whether a column is time by its name."""
    return not {name.lower(), time_unit(name)[0]}.isdisjoint(_TIMES)


def time_unit(name: str) -> tuple[str, str]:
    """Return the name of a time column in small letters without its unit, and the unit s, ms, us or ns; "" for none."""
    name = name.lower().replace("\u03bc", "\u00b5")
    match = _TIME_UNIT.search(name)
    if not match:
        return name, ""
    unit = {"s": "s", "m": "ms", "u": "us", "µ": "us", "n": "ns"}[match[1][0]]
    return name[: match.start()].strip(" _[("), unit


def unit_of(name: str, word: str = "") -> str:
    """Return the unit in brackets behind the name of a column, else the word of a line of units; "" for none."""
    bracket = re.search(r"[\[(]([^\[\]()]+)[\])]\s*$", name)
    words = (bracket[1] if bracket else "", word.strip("[]() "))
    return next((_UNITS[text.lower()] for text in words if text.lower() in _UNITS), "")


# ---------------------------------------------------------------- patterns
def matched(pattern: str, names: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Return the columns of a pattern in chain order, [] where one is missing; numbers count from 0 or 1."""
    for first in (1, 0):
        columns = [
            pattern.replace("{i}", str(first + k)).replace("{name}", joint)
            for k, joint in enumerate(joints)
        ]
        # Why: of an arm with six joints and columns 0 to 6, 0 to 5 are the arm and 6 is its gripper.
        if set(columns) <= set(names) and not (
            first and "{i}" in pattern and pattern.replace("{i}", "0") in names
        ):
            return columns
    return []


def numbered(pattern: str, names: Sequence[str]) -> list[str]:
    """Return the columns of a pattern with numbers, as many as there are."""
    return max((matched(pattern, names, [""] * k) for k in range(1, 33)), key=len)


def usual_joints(names: Sequence[str]) -> tuple[str, ...]:
    """Return the joints of columns with the usual names; () where no position has a torque or a current."""
    own = [name[2:] for name in names if name.startswith("q_") and not name.startswith("q_ref_")]
    has_effort = any(f"{kind}_{joint}" in names for joint in own for kind in ("tau", "i"))
    return tuple(own) if has_effort else ()


def members(pattern: str, names: Sequence[str]) -> list[str]:
    """Return what stands in place of ``{name}`` in the columns of a pattern, in their order."""
    form = re.escape(pattern).replace(re.escape("{name}"), "(.+)")
    return [match[1] for name in names if (match := re.fullmatch(form, name))]


def template(names: Sequence[str]) -> dict[str, str]:
    """Return patterns to fill in where the names of the columns do not tell what they hold."""
    time = next(filter(is_time, names), "TIME")
    return {"time": time, "position": "POSITION_{i}", "effort": "TORQUE_{i}"}


def snippet(patterns: Mapping[str, str]) -> str:
    """Return patterns as they stand in a robot file."""
    inside = ", ".join(
        f"{key}: {json.dumps(patterns[key], ensure_ascii=not patterns[key].isprintable())}"
        for key in ("time", "name", "position", "velocity", "effort", "reference")
        if key in patterns
    )
    return f"columns: {{{inside}}}"


def suggested(names: Sequence[str]) -> dict[str, str]:
    """Return patterns for ``driver: columns:`` that would find columns of these names; {} if none is recognised."""
    patterns = _paired(_numbers(names)) or _paired(_named(names))
    like = [name for name in names if re.search(r"time|stamp", name.lower())]
    time = next((name for name in [*filter(is_time, names), *like]), "") if patterns else ""
    return ({"time": time} if time else {}) | patterns


def _paired(members: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Return the best patterns of positions and torques that have the same members, and what goes with them."""
    families = defaultdict[str, set[str]](set)
    for pattern, member in members:
        families[pattern].add(member)
    # Why the best of each first: names full of numbers have thousands of families, and pairs without end.
    best: dict[tuple[str, frozenset[str]], tuple[int, str]] = {}
    for pattern, family in families.items():
        kind, doubt = _meaning(pattern)
        each = kind, frozenset(family)
        if kind and len(family) > 1 and doubt < best.get(each, (99, ""))[0]:
            best[each] = doubt, pattern
    pairs = [
        (doubt + best["effort", each][0], each)
        for (kind, each), (doubt, _) in best.items()
        if kind == "position" and ("effort", each) in best
    ]
    if not pairs:
        return {}
    _, chosen = min(pairs, key=lambda pair: pair[0])
    return {
        kind: best[kind, chosen][1]
        for kind in ("position", "effort", "velocity", "reference", "name")
        if (kind, chosen) in best
    }


def _meaning(pattern: str) -> tuple[str, int]:
    """Return what a family of columns is, "" for nothing of use, and how little its name says so."""
    words = _words(pattern)
    kinds = {_KINDS[word] for word in words if word in _KINDS}
    kind = next((each for each in _WORDS if each in kinds), "")
    if kind == "acceleration" or words.intersection(_OTHER):
        return "", 0
    if kind == "name":
        return ("name" if "{i}" in pattern else ""), 0
    if words.intersection(_COMMANDED):
        return ("reference" if kind == "position" else ""), 0
    doubt = 2 * (kind == "effort" and in_amperes(pattern)) + words.isdisjoint(_MEASURED)
    return ("position", doubt + 4) if kind == "joint" else (kind, doubt)


def in_amperes(pattern: str) -> bool:
    """Return whether a family of efforts is one of currents by its name."""
    # Why: a current torque is a torque.
    return {word for word in _words(pattern) if _KINDS.get(word) == "effort"} <= _CURRENT


def _words(pattern: str) -> set[str]:
    """Return the words of a name: letters between other signs, and parts that begin with a capital."""
    bare = re.sub(r"\{(i|name)\}", " ", pattern)
    bare = re.sub(r"[\[(][^\[\]()]*[\])]\s*$", " ", bare)
    bare = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", bare)
    return {part.lower() for part in re.findall(r"[A-Za-z]+", bare)}


def _numbers(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield patterns of names that differ in one number, each with the number."""
    for name in names:
        for number in re.finditer(r"\d+", name):
            yield f"{name[: number.start()]}{{i}}{name[number.end() :]}", number.group()


def _named(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield patterns of names that differ in the name of the joint, before or behind what they are, with that name."""
    for kind in ("position", "velocity", "effort"):
        meanings = [(kind, doubt) for doubt in range(4)]
        some = [name for name in names if not is_time(name) and _meaning(name) in meanings]
        start = commonprefix(some)  # noqa: RUF071 - letters are meant
        rest = [name[len(start) :] for name in some]
        end = commonprefix([name[::-1] for name in rest])[::-1]  # noqa: RUF071
        for name in rest if len(some) > 1 else ():
            yield f"{start}{{name}}{end}", name[: len(name) - len(end)]
