"""What commands take: ROBOT, words that the shell completes, and the options of a workflow's dataclass."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import Field, fields
from functools import update_wrapper
from pathlib import Path
from typing import Any, TypeVar

import click
from click.shell_completion import CompletionItem

from dynid.errors import WrongUsage
from dynid.options import LEAST, MOST, Declaration, Options, declaration_of, flag_of

Given = TypeVar("Given", bound=Options)


class Completed(click.ParamType):  # type: ignore[type-arg]  # generic from click 8.2 on
    """Text with words to choose from.

    Args:
        words: returns the words.
        files: whether a file may be named instead.
        listed: whether several words may follow each other with commas between.
    """

    name = "text"

    def __init__(
        self, words: Callable[[], Iterable[str]], *, files: bool = False, listed: bool = False
    ) -> None:
        self._words, self._files, self._listed = words, files, listed

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:  # noqa: ANN401
        """Return the text as it is."""
        return str(value)

    def shell_complete(
        self, ctx: click.Context, param: click.Parameter, incomplete: str
    ) -> list[CompletionItem]:
        """Return the words that begin with what was typed, and files where a path was begun or no word fits."""
        before, comma, begun = incomplete.rpartition(",") if self._listed else ("", "", incomplete)
        found = [
            CompletionItem(f"{before}{comma}{word}")
            for word in self._words()
            if word.startswith(begun)
        ]
        path = "/" in incomplete or Path(incomplete).suffix
        return (
            [*found, CompletionItem(incomplete, type="file")]
            if self._files and (path or not found)
            else found
        )


def _robots() -> Iterable[str]:
    from dynid.files.robotfile import known_robots

    return known_robots()


def _effects() -> Iterable[str]:
    from dynid.model.effects.catalogue import CATALOGUE

    return ["all", *CATALOGUE]


def _codes() -> Iterable[str]:
    from dynid.codes import codes
    from dynid.files import pages

    return [*codes(), *pages()]


ROBOT = Completed(_robots, files=True)
EFFECTS = Completed(_effects, listed=True)
CODE = Completed(_codes)


def robot_argument(function: Callable[..., Any]) -> Callable[..., Any]:
    """Give a command the argument ROBOT and the option ``--tip``; the function gets one word, ``arm.urdf#LINK``."""

    def joined(*args: Any, robot: str, tip: str | None, **values: Any) -> Any:  # noqa: ANN401
        from dynid.loading import URDF

        if tip is not None and not robot.lower().endswith(URDF):
            raise WrongUsage(f"{robot} is not a URDF: its chain has one tip", fix="leave out --tip")
        return function(*args, robot=robot if tip is None else f"{robot}#{tip}", **values)

    update_wrapper(joined, function)
    option = click.option(
        "--tip",
        metavar="LINK",
        help="Last link of the arm, where ROBOT is a URDF whose joints fork.",
    )
    return click.argument("robot", type=ROBOT)(option(joined))


class Number(click.types.FloatParamType):
    """A number that can be measured."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401
        """Return the number."""
        found = super().convert(value, param, ctx)
        if not abs(found) <= MOST:
            self.fail(f"{value} is nothing that can be measured", param, ctx)
        return found


class NumberInRange(click.FloatRange):
    """A number in a range that can be measured; click takes what is not a number for one in any range."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401
        """Return the number."""
        found = super().convert(Number().convert(value, param, ctx), param, ctx)
        if self.min == 0 and 0 < found < LEAST:
            self.fail(f"{value} is nothing that can be measured", param, ctx)
        return found


def options_from(
    kind: type[Options], *, without: tuple[str, ...] = ()
) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator that gives a command one option per field of an options dataclass.

    Args:
        kind: the dataclass.
        without: fields that the command does not offer.
    """

    def decorate(function: Callable[..., Any]) -> Any:  # noqa: ANN401
        for each in reversed([each for each in fields(kind) if each.name not in without]):
            function = _click_option(each)(function)
        return function

    return decorate


def options_of(kind: type[Given], values: Mapping[str, Any], **more: Any) -> Given:  # noqa: ANN401
    """Return the options dataclass from the values of a command line.

    Raises:
        WrongUsage: a value makes no sense.
    """
    names = {each.name for each in fields(kind)}
    return kind(**{name: value for name, value in {**values, **more}.items() if name in names})


def _click_option(each: Field[Any]) -> Callable[[Any], Any]:
    declared, flag = declaration_of(each), flag_of(each)
    facts: dict[str, Any] = {"help": declared.help, "default": each.default}
    if declared.deliberate:
        facts["allow_from_autoenv"] = False
    if declared.shown is not None:
        facts["show_default"] = not declared.shown
        # Why not by click, which puts a text in brackets of its own.
        facts["help"] += f"  [default: {declared.shown}]" if declared.shown else ""
    if declared.pair:
        return click.option(f"{flag}/{declared.off or '--no-' + flag[2:]}", each.name, **facts)
    if isinstance(each.default, bool):
        return click.option(flag, each.name, is_flag=True, **facts)
    if declared.metavar:
        facts["metavar"] = declared.metavar
    return click.option(
        flag, each.name, type=_type(each, declared), multiple=declared.repeatable, **facts
    )


def _type(each: Field[Any], declared: Declaration) -> Any:  # noqa: ANN401
    if declared.choices:
        return click.Choice(list(declared.choices))
    if declared.kind == "effects":
        return EFFECTS
    if declared.kind == "path":
        return click.Path(path_type=Path)
    if declared.kind == "input":
        return click.Path(exists=True, dir_okay=False, path_type=Path)
    if declared.kind == "file":
        return click.Path(dir_okay=False, path_type=Path)
    if declared.bounds != (None, None):
        low, high = declared.bounds
        if isinstance(each.default, int):
            return click.IntRange(
                None if low is None else int(low), None if high is None else int(high)
            )
        return NumberInRange(low, high)
    if declared.kind == "count":
        return click.IntRange(min=1)
    if declared.kind in ("positive", "float") or (
        isinstance(each.default, float) and declared.read is None
    ):
        return (
            NumberInRange(min=0, min_open=declared.kind == "positive")
            if declared.kind
            else Number()
        )
    return str if declared.read is not None or each.default in (None, ()) else type(each.default)
