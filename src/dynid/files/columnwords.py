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

#: Keys of patterns in robot files.
PATTERNS = ("time", "name", "position", "velocity", "effort", "reference")
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
    "n·m": "Nm",
}
#: A unit in brackets at the end of the name of a column: q_1 [deg], tau_1(Nm).
_BRACKET = re.compile(r"\s*[\[(]([^\[\]()]+)[\])]\s*$")


def is_time(name: str) -> bool:
    """Return whether a column is time by its name."""
    return not {name.lower(), time_unit(name)[0]}.isdisjoint(_TIMES)


def time_unit(name: str) -> tuple[str, str]:
    """Return the name of a time column in small letters without its unit, and the unit s, ms, us or ns; "" for none."""
    name = name.lower()
    match = _TIME_UNIT.search(name)
    if not match:
        return name, ""
    unit = {"s": "s", "m": "ms", "u": "us", "µ": "us", "n": "ns"}[match[1][0]]
    return name[: match.start()].strip(" _[("), unit


def unit_of(name: str) -> str:
    """Return the unit in brackets behind the name of a column, "" for none."""
    bracket = _BRACKET.search(name)
    return _UNITS.get(bracket[1].lower(), "") if bracket else ""


def without_unit(name: str) -> str:
    """Return the name of a column without a unit in brackets behind it."""
    return _BRACKET.sub("", name) if unit_of(name) else name


def with_unit(name: str, word: str) -> str:
    """Return the name of a column with a word of the line below in brackets, where that is its unit."""
    named = f"{name} [{word.strip('[]() ')}]"
    return named if unit_of(named) and not unit_of(name) else name


# ---------------------------------------------------------------- patterns
def by_name(names: Sequence[str]) -> dict[str, str]:
    """Return columns by their names, and by these without a unit."""
    return {without_unit(name): name for name in names} | {name: name for name in names}


def matched(pattern: str, names: Sequence[str], joints: Sequence[str]) -> list[str]:
    """Return the columns of a pattern in chain order, [] where one is missing; numbers count from 0 or 1."""
    have = by_name(names)
    # Why from 0 first: of an arm with six joints and columns 0 to 6, 0 to 5 are the arm and 6 is its gripper.
    for first in (0, 1):
        columns = [
            pattern.replace("{i}", str(k)).replace("{name}", joint)
            for k, joint in enumerate(joints, first)
        ]
        if have.keys() >= set(columns):
            return [have[column] for column in columns]
    return []


def numbered(pattern: str, names: Sequence[str]) -> list[str]:
    """Return the columns of a pattern with numbers, as many as there are."""
    return max((matched(pattern, names, [""] * k) for k in range(1, 33)), key=len)


def joints_of(pattern: str, names: Sequence[str]) -> list[str]:
    """Return what stands in place of ``{name}`` in the columns of a pattern, or a name for each of its numbers."""
    if "{name}" not in pattern:
        return [f"joint_{k}" for k, _ in enumerate(numbered(pattern, names), 1)]
    form = re.escape(without_unit(pattern)).replace(re.escape("{name}"), "(.+)")
    bare = map(without_unit, names)
    return [match[1] for name in bare if (match := re.fullmatch(form, name))]


def usual_joints(names: Sequence[str]) -> list[str]:
    """Return the joints of columns with the usual names; [] where no position has a torque or a current."""
    own = [each for each in joints_of("q_{name}", names) if not each.startswith("ref_")]
    efforts = (matched(form, names, [each]) for form in ("tau_{name}", "i_{name}") for each in own)
    return own if any(efforts) else []


def template(names: Sequence[str]) -> dict[str, str]:
    """Return patterns to fill in where the names of the columns do not tell what they hold."""
    time = next(filter(is_time, names), "TIME")
    return {"time": time, "position": "POSITION_{i}", "effort": "TORQUE_{i}"}


def snippet(patterns: Mapping[str, str]) -> str:
    """Return patterns as they stand in a robot file."""
    inside = ", ".join(
        f"{key}: {json.dumps(patterns[key], ensure_ascii=not patterns[key].isprintable())}"
        for key in PATTERNS
        if key in patterns
    )
    return f"columns: {{{inside}}}"


def suggested(names: Sequence[str]) -> dict[str, str]:
    """Return patterns for ``driver: columns:`` that would find columns of these names; {} if none is recognised."""
    bare = dict.fromkeys(map(without_unit, names))
    # Why: another log of the arm may have no units in its header, or others.
    names = [*bare] if len(bare) == len(names) else names
    patterns = _of_same_joints(_numbers(names)) or _of_same_joints(_named(names))
    like = (name for name in names if re.search(r"time|stamp", name.lower()))
    time = next(filter(is_time, names), next(like, None))
    return {"time": time, **patterns} if time and patterns else patterns


def _of_same_joints(members: Iterable[tuple[str, str]]) -> dict[str, str]:
    """Return the least doubtful patterns of positions and torques of the same joints, and what goes with them.

    Args:
        members: patterns, each with what stands in its place in the name of one column.
    """
    families = defaultdict[str, set[str]](set)
    for pattern, member in members:
        families[pattern].add(member)
    # Why one of each kind: names full of numbers have thousands of families, and pairs without end.
    groups = defaultdict[frozenset[str], dict[str, tuple[int, str]]](dict)
    for pattern, family in families.items():
        kind, doubt = _meaning(pattern)
        group = groups[frozenset(family)]
        if kind and len(family) > 1 and (kind not in group or doubt < group[kind][0]):
            group[kind] = doubt, pattern
    pairs = [group for group in groups.values() if {"position", "effort"} <= group.keys()]
    best = min(pairs, key=lambda pair: pair["position"][0] + pair["effort"][0], default={})
    return {kind: pattern for kind, (_, pattern) in best.items()}


def _meaning(pattern: str) -> tuple[str, int]:
    """Return what a family of columns is, "" for nothing of use, and how little its name says so."""
    words = _words(pattern)
    kinds = {_KINDS.get(word) for word in words}
    kind = next((each for each in _WORDS if each in kinds), "")
    if kind == "acceleration" or words & _OTHER or (kind == "name" and "{i}" not in pattern):
        return "", 0
    if kind != "name" and words & _COMMANDED:
        return ("reference" if kind == "position" else ""), 0
    doubt = words.isdisjoint(_MEASURED) + 2 * (kind == "effort" and in_amperes(pattern))
    return ("position", doubt + 4) if kind == "joint" else (kind, doubt)


def in_amperes(pattern: str) -> bool:
    """Return whether a family of efforts is one of currents by its name."""
    # Why: a current torque is a torque.
    return {word for word in _words(pattern) if _KINDS.get(word) == "effort"} <= _CURRENT


def _words(pattern: str) -> set[str]:
    """Return the words of a name without its unit: letters between other signs, parts that begin with a capital."""
    bare = re.sub(r"\{(i|name)\}", " ", _BRACKET.sub("", pattern))
    bare = re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", bare)
    return {part.lower() for part in re.findall(r"[A-Za-z]+", bare)}


def _numbers(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield patterns of names that differ in one number, each with the number."""
    for name in names:
        for number in re.finditer(r"\d+", name):
            yield f"{name[: number.start()]}{{i}}{name[number.end() :]}", number.group()


def _named(names: Sequence[str]) -> Iterator[tuple[str, str]]:
    """Yield patterns of names that differ in the name of the joint, before or behind what they are, with that name."""
    for wanted in ("position", "velocity", "effort"):
        meanings = [(wanted, doubt) for doubt in range(4)]
        some = [name for name in names if not is_time(name) and _meaning(name) in meanings]
        start = commonprefix(some)  # noqa: RUF071 - letters are meant
        rest = [name[len(start) :] for name in some]
        end = commonprefix([name[::-1] for name in rest])[::-1]  # noqa: RUF071
        for name in rest if len(some) > 1 else ():
            yield f"{start}{{name}}{end}", name[: len(name) - len(end)]
