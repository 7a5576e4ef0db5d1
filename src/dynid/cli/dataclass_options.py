"""Options of a command made from the options dataclass of its workflow."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import Field, fields
from pathlib import Path
from typing import Any, TypeVar

import click

from dynid.cli.completed import EFFECTS
from dynid.options import LEAST, MOST, Declaration, Options, declaration_of, flag_of

Given = TypeVar("Given", bound=Options)


class Number(click.FloatRange):
    """A number that can be measured; click takes what is not a number for one in any range."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:  # noqa: ANN401
        """Return the number."""
        found = super().convert(value, param, ctx)
        if not abs(found) <= MOST or (self.min == 0 and 0 < found < LEAST):
            self.fail(f"{value} is nothing that can be measured", param, ctx)
        return found


def options_from(kind: type[Options], *, without: tuple[str, ...] = ()) -> Callable[[Callable[..., Any]], Any]:
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
    said, flag = declaration_of(each), flag_of(each)
    facts: dict[str, Any] = {"help": said.help, "default": each.default}
    if said.deliberate:
        facts["allow_from_autoenv"] = False
    if said.shown is not None:
        facts["show_default"] = said.shown or True
    if said.pair:
        return click.option(f"{flag}/{said.off or '--no-' + flag[2:]}", each.name, **facts)
    if isinstance(each.default, bool):
        return click.option(flag, each.name, is_flag=True, **facts)
    if said.metavar:
        facts["metavar"] = said.metavar
    return click.option(flag, each.name, type=_type(each, said), multiple=said.repeatable, **facts)


def _type(each: Field[Any], said: Declaration) -> Any:  # noqa: ANN401
    if said.choices:
        return click.Choice(list(said.choices))
    if said.kind == "effects":
        return EFFECTS
    if said.kind == "path":
        return click.Path(path_type=Path)
    if said.kind == "input":
        return click.Path(exists=True, dir_okay=False, path_type=Path)
    if said.kind == "file":
        return click.Path(dir_okay=False, path_type=Path)
    if said.bounds != (None, None):
        low, high = said.bounds
        if isinstance(each.default, int):
            return click.IntRange(None if low is None else int(low), None if high is None else int(high))
        return Number(low, high)
    if said.kind == "count":
        return click.IntRange(min=1)
    if said.kind in ("positive", "float") or (isinstance(each.default, float) and said.read is None):
        return Number(min=0 if said.kind else None, min_open=said.kind == "positive")
    return str if said.read is not None or each.default in (None, ()) else type(each.default)
