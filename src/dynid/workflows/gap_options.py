"""What `dynid gap` searches: its options, and the effects and joints that they stand for."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dynid.errors import WrongUsage
from dynid.options import LogOptions, option, share
from dynid.robot import Robot

if TYPE_CHECKING:
    from dynid.gap.candidates import SelectionOptions

#: The questions, and the names that two of them had before.
QUESTIONS = ("numbers", "arm", "changed")
MODES = {"refit": "numbers", "frozen": "changed"}


def _words(value: Any, name: str) -> tuple[str, ...]:  # noqa: ANN401
    """Return words given as text with commas or one by one; () for ``all`` and for nothing."""
    items = (
        ()
        if value is None or value == "all"
        else (value,)
        if isinstance(value, (str, int))
        else value
    )
    if not all(isinstance(item, (str, int)) for item in items):
        raise TypeError("it must be a word or a list of words")
    words = [word.strip() for item in items for word in str(item).split(",")]
    return tuple(word for word in words if word)


@dataclass(frozen=True)
class GapOptions(LogOptions):
    """What is searched. The filter keeps what happens at reversals where no other cut-off is asked for."""

    ask: str = option(
        "auto",
        "numbers: effects that remain after refitting all parameters; arm: effects that only implausible links could "
        "imitate; changed: what has changed since the model was identified; auto chooses by the logs and says why.",
        choices=("auto", *QUESTIONS),
        shown="",
    )
    mode: str | None = option(
        None,
        "Earlier names of two questions: refit is --ask numbers, frozen is --ask changed.",
        choices=tuple(MODES),
    )
    effects: tuple[str, ...] = option(
        "all",
        "Effects to try, by identifier, separated by commas.",
        metavar="all|LIST",
        shown="",
        kind="effects",
        read=_words,
    )
    joints: tuple[str, ...] = option(
        None,
        "Joints to search, by name, by number, or as a range such as 2-4 (default: all).",
        metavar="LIST",
        read=_words,
    )
    false_alarm: float = option(
        "1%",
        "Probability of naming an effect in logs where nothing is missing.",
        metavar="SHARE",
        shown="",
        read=share,
    )
    max_effects: int = option(
        3, "Largest number of effects that are selected.", shown="", kind="count"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.ask not in ("auto", self.question):
            raise WrongUsage(
                f"--mode {self.mode} is --ask {self.question}, but --ask {self.ask} was given too"
            )

    @property
    def question(self) -> str:
        """What is asked."""
        return MODES[self.mode] if self.mode else self.ask


def selection_options(robot: Robot, options: GapOptions) -> SelectionOptions:
    """Return what is searched on one arm, every name checked."""
    from dynid.gap.candidates import SelectionOptions
    from dynid.model.effects.catalogue import CATALOGUE
    from dynid.text import closest

    for word in options.effects:
        if word not in CATALOGUE:
            raise WrongUsage(
                f"--effects: no effect '{word}'{closest(word, CATALOGUE)}",
                fix=f"some of {','.join(CATALOGUE)}",
            )
    joints = joint_indices(robot.joint_names, ",".join(options.joints), "--joints")
    return SelectionOptions(options.effects, joints, 1.0 - options.false_alarm, options.max_effects)


def joint_indices(names: Sequence[str], text: str, option: str) -> tuple[int, ...]:
    """Return 0-based joints given by name, by number from 1, or as a range such as ``2-4``, separated by commas."""
    from dynid.text import closest

    found: list[int] = []
    for word in (w.strip() for w in text.split(",")):
        span = re.fullmatch(r"([0-9]{1,9})(?:-([0-9]{1,9}))?", word)
        if not word:
            continue
        if word in names:
            found.append(list(names).index(word))
        elif span and 1 <= int(span[1]) <= int(span[2] or span[1]) <= len(names):
            found += range(int(span[1]) - 1, int(span[2] or span[1]))
        else:
            raise WrongUsage(
                f"{option}: no joint '{word}'{closest(word, names)}",
                fix=f"1 to {len(names)}, or a name",
            )
    return tuple(dict.fromkeys(found))
