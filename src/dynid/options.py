"""Options of the workflows: frozen dataclasses whose fields carry their own documentation.

A field is declared once with ``option(default, help, ...)``. The options of the command line with their help, the keys
of configuration files and the pages of the reference are made from these declarations, and a value is read by the same
function whether it comes as text from a terminal or as a Python value from a notebook.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import Field, dataclass, field, fields
from functools import partial
from numbers import Integral, Real
from pathlib import Path
from typing import Any

from dynid.errors import WrongUsage

#: Sizes of numbers: no option and no file has a larger one, and no option that may not be negative a smaller one but 0,
#: nor what has to be there in a file, in whatever unit: it is divided by, and its powers are.
LEAST, MOST = 1e-12, 1e12
#: No driver is this late; a larger number is meant in milliseconds [s].
LONGEST_DELAY = 0.5


@dataclass(frozen=True)
class Declaration:
    """What is known about one option besides its type and default.

    Attributes:
        help: one full sentence or more, with the unit.
        metavar: what stands for the value on the command line; "" for a flag or where the choices say it.
        choices: the values that are possible; () for any.
        read: makes the value from text or from a Python value; None to take it as it is.
        flag: long option of the command line; "" to make it from the field's name.
        pair: whether a flag that is off can be switched off by ``--no-...`` too; any other one can: one that is on, or
            None, decided by the data.
        repeatable: whether it may be given several times.
        nothing: word for None on the command line, in help and in the inputs of results.
        kind: type on the command line where annotation and default do not tell it: ``"input"`` (file that exists),
            ``"level"`` (how often it is given).
        bounds: smallest and largest number, None for no bound.
        off: long option that switches a flag off; ``--no-...`` when empty.
        deliberate: whether only the command line may give it, no variable of the environment and no file.
    """

    help: str
    metavar: str = ""
    choices: tuple[str, ...] = ()
    read: Callable[[Any], Any] | None = None
    flag: str = ""
    pair: bool = False
    repeatable: bool = False
    nothing: str | None = None
    kind: str = ""
    bounds: tuple[float | None, float | None] = (None, None)
    off: str = ""
    deliberate: bool = False


def option(default: Any, help: str, **facts: Any) -> Any:  # noqa: ANN401
    """Declare a field of an options dataclass; ``facts`` are attributes of ``Declaration``."""
    return field(default=default, metadata={"option": Declaration(help, **facts)})


def declaration_of(declared: Field[Any]) -> Declaration:
    """Return the declaration of a field."""
    return declared.metadata["option"]


def flag_of(declared: Field[Any]) -> str:
    """Return the long option of a field on the command line, such as ``--sort-time``."""
    return declaration_of(declared).flag or "--" + declared.name.rstrip("_").replace("_", "-")


@dataclass(frozen=True)
class Options:
    """Base of all options: reads every value when it is made, so that holding one means that its values make sense.

    Raises:
        WrongUsage: a value is not possible; the message names the option and gives an example.
    """

    def __post_init__(self) -> None:
        for declared in fields(self):
            value = getattr(self, declared.name)
            try:
                object.__setattr__(self, declared.name, _read(declared, value))
            except (TypeError, ValueError, ArithmeticError, LookupError, AttributeError) as error:
                shown = f"{value:g}" if isinstance(value, float) else f"{value!r:.60}"
                shown = _text(value) if isinstance(value, tuple) else shown
                flag, said = flag_of(declared), declaration_of(declared)
                what = f"{flag} {shown} is not possible: {error}"
                fix = f"{flag} {said.metavar}: {said.help}" if said.metavar else said.help
                raise WrongUsage(what, where=flag, fix=fix) from error

    def texts(self) -> dict[str, str]:
        """Return the options as text, for the inputs of results: name and value, without what nobody gave."""
        texts = {}
        for each in fields(self):
            value = getattr(self, each.name)
            text = declaration_of(each).nothing if value is None else _text(value)
            if text:
                texts[each.name] = text
        return texts

    def flags(self, *names: str) -> tuple[str, ...]:
        """Return some options as words of a command, without those that nobody changed."""
        usual, words = type(self)(), list[str]()
        for each in fields(self):
            value = getattr(self, each.name)
            if each.name in names and value != getattr(usual, each.name):
                text = ",".join(map(str, value)) if isinstance(value, tuple) else str(value)
                words += [flag_of(each), text]
        return tuple(words)


#: What stands for a value in annotations of options that no function reads, and of arguments.
TYPES: dict[str, Any] = {
    "bool": bool,
    "int": Integral,
    "float": Real,
    "str": str,
    "Path": (str, Path),
    "None": type(None),
}


def _read(declared: Field[Any], value: Any) -> Any:  # noqa: ANN401
    """Return the value of an option as it is declared; what is raised says why there is none."""
    said, types = declaration_of(declared), str(declared.type).split(" | ")
    if "None" in types and (value is None or (isinstance(value, str) and value == said.nothing)):
        return None
    if isinstance(value, bytes):  # a sequence of whole numbers, which nobody means
        raise TypeError("bytes are no value")
    if said.read is not None:
        value = said.read(value)
    elif set(types) <= set(TYPES):
        fits = any(isinstance(value, TYPES[word]) for word in types)
        if not fits or (isinstance(value, bool) and "bool" not in types):
            raise TypeError(f"it must be {' or '.join(types)}")
        value = Path(value) if "Path" in types and isinstance(value, str) else value
    if said.choices and value not in (*said.choices, None):
        raise ValueError(f"it must be one of {', '.join(said.choices)}")
    several = value if isinstance(value, tuple) else (value,)
    if any(isinstance(each, float) and not abs(each) <= MOST for each in several):
        raise ValueError(f"it must be a number up to {MOST:g}")
    low, high = said.bounds
    if low is not None and value is not None:
        least, high = LEAST if low == 0 and value != 0 else low, MOST if high is None else high
        # Why so: what is not a number is neither below nor above.
        if not least <= value <= high:
            raise ValueError(f"it must be from {low:g} to {high:g}")
    return value


def _text(value: Any) -> str:  # noqa: ANN401
    if isinstance(value, tuple):
        return " ".join(_text(item) for item in value)
    return str(value)


# ---------------------------------------------------------------- readers; a ValueError says what is wrong
def number_or_nan(value: Any) -> float:  # noqa: ANN401
    """Return a number, NaN for what is none."""
    try:
        return float(value)
    except (TypeError, ValueError):
        return float("nan")


def numbers(value: Any, count: int = 0) -> tuple[float, ...]:  # noqa: ANN401
    """Return numbers given as text with commas, as a sequence, or as the only one; so many if a count is given."""
    parts = value.split(",") if isinstance(value, str) else value
    items = tuple(map(number_or_nan, (parts,) if isinstance(parts, Real) else parts))
    if len(items) != (count or len(items)) or not all(abs(each) <= MOST for each in items):
        raise ValueError(f"it is not {count or 'a list of'} number{'s' * (count != 1)}")
    return items


def quantity(value: Any, unit: str = "%", most: float = 1.0) -> float:  # noqa: ANN401
    """Return a positive number below the largest one, with its unit or without; percent become a share."""
    text = str(value).strip()
    number = number_or_nan(text.removesuffix(unit)) / (100.0 if text.endswith("%") else 1.0)
    if not 0 < number < most:
        # Why 100: shares are said in percent.
        raise ValueError(
            f"it is not a positive number of {unit} below {most * (100 if unit == '%' else 1):g}"
        )
    return number


def _delay(value: Any) -> float:  # noqa: ANN401
    delay = 0.0 if value == "off" else number_or_nan(value)
    if not abs(delay) <= LONGEST_DELAY:
        raise ValueError(f"it is neither auto, off nor a time up to {LONGEST_DELAY:g} s")
    return delay


def _intervals(value: Any) -> tuple[tuple[float, float], ...]:  # noqa: ANN401
    """Return first and last time of each interval [s]: pairs of numbers, or words such as ``3.2-3.4,5-6``."""
    number = r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*"
    ends = []
    for item in (value,) if isinstance(value, str) else value:
        for word in item.split(",") if isinstance(item, str) else (item,):
            if isinstance(word, str):
                match = re.fullmatch(f"{number}-{number}", word)
                if match is None or float(match[1]) >= float(match[2]):
                    raise ValueError(f"{word} is not an interval of time, first and last second")
                word = match.groups()
            ends.append((float(word[0]), float(word[1])))
    return tuple(ends)


@dataclass(frozen=True)
class LogOptions(Options):
    """How logs are read, checked and filtered."""

    cutoff: float | None = option(
        None,
        "Cut-off frequency [Hz] of the zero-phase low-pass filter over torques and regressor columns; "
        "auto takes it from the band of the motion.",
        metavar="auto|HZ",
        nothing="auto",
        read=partial(quantity, unit="Hz", most=MOST),
    )
    velocity: str | None = option(
        None,
        "Use velocities derived from the positions, or those that the driver measured "
        "(default: derived, after they were compared with the measured ones).",
        choices=("derived", "measured"),
    )
    exclude: tuple[tuple[float, float], ...] = option(
        (),
        "Leave out an interval of the log [s], such as 3.2-3.4; may be repeated.",
        metavar="T0-T1",
        repeatable=True,
        read=_intervals,
    )
    delay: float | None = option(
        None,
        "How much later than the positions the torques are stamped [s]; auto estimates the delay, reports it, and "
        "corrects it when it is clear.",
        metavar="auto|off|SECONDS",
        nothing="auto",
        read=_delay,
    )
    topic: str | None = option(
        None, "ROS topic of the joint states (default: the driver's).", metavar="TOPIC"
    )
    rate: float | None = option(
        None,
        "Sample rate [Hz] of text logs without a time column.",
        metavar="HZ",
        bounds=(LEAST, None),
    )
    anyway: bool = option(
        False,
        "Continue although another mapping of the columns explains the log far better (E324); the result says so.",
    )
    sort_time: bool = option(False, "Put samples whose time stamps are only shuffled in order.")
