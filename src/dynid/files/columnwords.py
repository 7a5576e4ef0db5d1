"""What the names of a table's columns say: which are positions, torques, stamps, and in which units."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence

#: Names of a column that is time, and further ones in small letters and without their unit.
TIME_NAMES = ("t", "time", "stamp", "timestamp", "seconds", "time_s", "t_s", "t[s]", "time[s]")
_TIMES = (
    frozenset(TIME_NAMES)
    | frozenset(["zeit", "temps", "tiempo", "duration", "elapsed", "clock", "datetime"])
    | {
        "elapsed time",
        "time stamp",
    }
)
#: A unit at the end of the name of a time column: time_ms, t[us], stamp (ns), Zeit [s].
_TIME_UNIT = re.compile(
    r"(?:^|[_\s\[(./]+)(s|sec|secs|seconds|ms|msec|us|usec|µs|ns|nsec|nanosec)[\])]?$"
)
_TIME_UNITS = {
    "s": "s sec secs seconds",
    "ms": "ms msec",
    "us": "us usec µs",
    "ns": "ns nsec nanosec",
}
_STAMP_PARTS = re.compile(r"(.*?)(n|nano)?(?:secs|sec|sek)", re.IGNORECASE)

#: Words of column names and what they stand for; the first kind that has one of its words is taken.
_WORDS = {
    "acceleration": "acc acceleration qdd ddq",
    "velocity": "qd dq vel velocity velocities speed qp geschwindigkeit vitesse velocidad",
    "effort": "tau torque torques trq effort efforts moment moments load drehmoment couple "
    "i cur curr current currents iq strom courant ampere",
    "position": "q pos position positions angle angles theta winkel",
    "joint": "joint joints j jnt axis a",
}
_KINDS = {word: kind for kind, words in reversed(_WORDS.items()) for word in words.split()}
_CURRENT = frozenset(_WORDS["effort"].partition("couple ")[2].split())
#: Words of what was commanded and of what was measured, and of columns that are no joint's: tools and hands, estimates
#: of what touches the arm, statistics.
_QUALIFIED = {
    "commanded": "ref reference target cmd command commanded des desired goal set setpoint soll d",
    "measured": "actual measured meas msr act ist state",
    "other": "tcp tool flange ee cart cartesian gripper finger ext external contact temp temperature voltage window "
    "error err std var dtau offset limit",
}
_COMMANDED, _MEASURED, _OTHER = (frozenset(words.split()) for words in _QUALIFIED.values())
_UNITS = {
    "rad": "rad",
    "deg": "deg",
    "°": "deg",
    "degree": "deg",
    "degrees": "deg",
    "grad": "deg",
    "m": "m",
    "mm": "mm",
    "rad/s": "rad/s",
    "deg/s": "deg/s",
    "°/s": "deg/s",
    "rpm": "rpm",
    "1/min": "rpm",
    "m/s": "m/s",
    "mm/s": "mm/s",
    "nm": "Nm",
    "n.m": "Nm",
    "n*m": "Nm",
    "n·m": "Nm",
    "n m": "Nm",
    "mnm": "mNm",
    "n": "N",
    "a": "A",
    "ma": "mA",
}


def is_time(name: str) -> bool:
    """Return whether a column is time by its name."""
    return not {name.lower(), time_unit(name)[0]}.isdisjoint(_TIMES)


def time_unit(name: str) -> tuple[str, str]:
    """Return the name of a time column in small letters without its unit, and the unit s, ms, us or ns; "" for none."""
    name = name.lower().replace("\u03bc", "\u00b5")
    found = _TIME_UNIT.search(name)
    unit = next(
        (unit for unit, words in _TIME_UNITS.items() if found and found[1] in words.split()), ""
    )
    return name[: found.start() if found else None].strip(" _[("), unit


def stamps_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return the column of the stamps, or those of whole seconds and of the nanoseconds that are added; () for none."""
    parts: dict[tuple[str, bool], str] = {}
    for name in names:
        if told := _STAMP_PARTS.fullmatch(name):
            parts.setdefault((told[1].lower(), bool(told[2])), name)
    pairs = [
        (name, parts[key, True])
        for (key, nano), name in parts.items()
        if not nano and (key, True) in parts
    ]
    time = next((name for name in names if is_time(name)), None)
    if pairs and (time is None or time in pairs[0]):
        return pairs[0]
    return (time,) if time else ()


def unit_of(name: str, word: str = "") -> str:
    """Return the unit in brackets behind the name of a column, else the word of a line of units; "" for none."""
    bracket = re.search(r"[\[(]([^\[\]()]+)[\])]\s*$", name)
    for text in (bracket[1] if bracket else "", word.strip("[]() ")):
        if text.lower() in _UNITS:
            return _UNITS[text.lower()]
    return ""


def suggested(names: Sequence[str]) -> dict[str, str]:
    """Return patterns for ``driver: columns:`` that would find columns of these names; {} where none can be told."""
    for families in (_numbered(names), _named(names)):
        found = _paired(families)
        if found:
            like = [name for name in names if re.search(r"time|stamp", name.lower())]
            time = stamps_of(names) or tuple(like[:1])
            return ({"time": time[0]} if len(time) == 1 else {}) | found
    return {}


def _paired(families: dict[str, frozenset[str]]) -> dict[str, str]:
    """Return the best families of positions and torques that have the same members, and what goes with them."""
    families = {pattern: each for pattern, each in families.items() if len(each) > 1}
    told = {pattern: _meaning(pattern) for pattern in families}
    # Why the best of each first: names full of numbers have thousands of families, and pairs without end.
    efforts: dict[frozenset[str], str] = {}
    for pattern in sorted(
        (p for p in families if told[p][0] == "effort"), key=lambda p: told[p][1]
    ):
        efforts.setdefault(families[pattern], pattern)
    pairs = [
        (told[p][1] + told[efforts[families[p]]][1], p, efforts[families[p]])
        for p in families
        if told[p][0] in ("position", "joint") and families[p] in efforts and len(families[p]) > 1
    ]
    if not pairs:
        return {}
    _, position, effort = min(pairs, key=lambda each: each[0])
    found = {"position": position, "effort": effort}
    for key, kind in (("velocity", "velocity"), ("reference", "commanded position")):
        same = [p for p in families if told[p][0] == kind and families[p] == families[position]]
        if same:
            found[key] = min(same, key=lambda pattern: told[pattern][1])
    named = [
        p
        for p in families
        if "name" in _words(p) and families[position] == families[p] and "{i}" in p
    ]
    return found | ({"name": named[0]} if named else {})


def _meaning(pattern: str) -> tuple[str, int]:
    """Return what a family of columns is, "" for nothing of use, and how little its name says so."""
    words = _words(pattern)
    kinds = {_KINDS[word] for word in words if word in _KINDS}
    kind = next((each for each in _WORDS if each in kinds), "")
    if not kind or kind == "acceleration" or words.intersection(_OTHER):
        return "", 0
    if words.intersection(_COMMANDED):
        return ("commanded position" if kind == "position" else ""), 0
    doubt = (
        4 * (kind == "joint")
        + 2 * (kind == "effort" and in_amperes(pattern))
        + words.isdisjoint(_MEASURED)
    )
    return kind, doubt


def in_amperes(pattern: str) -> bool:
    """Return whether a family of efforts is one of currents by its name."""
    # Why: a current torque is a torque.
    return {word for word in _words(pattern) if _KINDS.get(word) == "effort"} <= _CURRENT


def members(pattern: str, names: Sequence[str]) -> list[str]:
    """Return what stands in place of ``{name}`` in the columns of a pattern, in their order."""
    form = re.escape(pattern).replace(re.escape("{name}"), "(.+)")
    return [found[1] for name in names if (found := re.fullmatch(form, name))]


def usual_joints(names: Sequence[str]) -> tuple[str, ...]:
    """Return the joints of columns with the usual names; () where no position has a torque or a current beside it."""
    own = [name[2:] for name in names if name.startswith("q_") and not name.startswith("q_ref_")]
    return (
        tuple(own)
        if any(f"{kind}_{joint}" in names for joint in own for kind in ("tau", "i"))
        else ()
    )


def _words(pattern: str) -> set[str]:
    """Return the words of a name: letters between other signs, and parts that begin with a capital."""
    plain = re.sub(r"\{(i|name)\}", " ", pattern)
    plain = re.sub(r"[\[(][^\[\]()]*[\])]\s*$", " ", plain)
    parts = re.findall(
        r"[A-Za-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])", " ", plain)
    )
    return {part.lower() for part in parts}


def _numbered(names: Sequence[str]) -> dict[str, frozenset[str]]:
    """Return families of names that differ in one number, by pattern."""
    return _families(
        (f"{name[: number.start()]}{{i}}{name[number.end() :]}", number.group())
        for name in names
        for number in re.finditer(r"\d+", name)
    )


def _named(names: Sequence[str]) -> dict[str, frozenset[str]]:
    """Return families of names that differ in the name of the joint, before or behind what they are."""

    def split() -> Iterator[tuple[str, str]]:
        for kind in ("position", "velocity", "effort"):
            some = [name for name in names if not is_time(name) and _meaning(name)[0] == kind]
            if len(some) < 2:
                continue
            start = _shared_start(some)
            end = _shared_start([name[len(start) :][::-1] for name in some])[::-1]
            for name in some:
                yield f"{start}{{name}}{end}", name[len(start) : len(name) - len(end)]

    return _families(split())


def _shared_start(words: Sequence[str]) -> str:
    """Return the letters that all words begin with."""
    first, last = min(words), max(words)
    return first[
        : next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), len(first))
    ]


def _families(members: Iterable[tuple[str, str]]) -> dict[str, frozenset[str]]:
    found: dict[str, set[str]] = {}
    for pattern, member in members:
        found.setdefault(pattern, set()).add(member)
    return {pattern: frozenset(each) for pattern, each in found.items()}
