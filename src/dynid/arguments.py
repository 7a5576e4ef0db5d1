"""What public functions take: options as keywords or as an object, and a listener for their progress."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection
from dataclasses import fields, replace
from functools import wraps
from typing import ParamSpec, TypeVar

from dynid.errors import WrongUsage
from dynid.progress import LISTENER, heard_by
from dynid.text import closest

P = ParamSpec("P")
T = TypeVar("T")


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function during which linear algebra has one thread; after it, as many as before.

    Why: matrices are of the size that arms have, and with more threads these wait for each other in a loop. From Python
    NumPy is loaded before dynid, so that setting a variable of the environment is too late; benchmarks/speed.md has
    what that costs.
    """

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        from threadpoolctl import threadpool_limits

        # Why anew every time: what was imported in between has threads of its own.
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


def public(function: Callable[P, T]) -> Callable[P, T]:
    """Return a public function: it computes in one thread, and is given its ``options`` with ``**changes`` in them.

    Its ``progress`` hears what happens; where there is none, whoever hears already.
    """
    computing, signature = one_thread(function), inspect.signature(function)
    # What help and notebooks show: each option in the place of ``**changes``.
    shown, kind = dict(signature.parameters), None
    if shown.pop("changes", None):
        kind = function.__globals__[shown["options"].annotation]
        shown["options"] = shown["options"].replace(default=None)
        for each in fields(kind):
            own = inspect.Parameter(
                each.name,
                inspect.Parameter.KEYWORD_ONLY,
                default=each.default,
                annotation=each.type,
            )
            shown.setdefault(each.name, own)

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        name = function.__name__
        for unknown in kwargs.keys() - shown.keys():
            raise no_such(
                f"{name} has no argument or option", unknown, shown, fix=f"help(dynid.{name})"
            )
        bound = signature.bind(*args, **kwargs)
        given = bound.arguments
        if kind is not None:
            options = given.get("options")
            options = kind() if options is None else options
            instance(options, kind, "options", f"dynid.{kind.__name__}")
            given["options"] = replace(options, **given.pop("changes", {}))
        with heard_by(given.get("progress") or LISTENER.get()):
            return computing(*bound.args, **bound.kwargs)

    called.__signature__ = signature.replace(parameters=[*shown.values()])  # type: ignore[attr-defined]
    return called


def no_such(what: str, word: str, known: Collection[str], **said: str) -> WrongUsage:
    """Return the error for a word that is none of the known ones, which names the nearest of them."""
    said = {"fix": f"one of {', '.join(known)}"} | said
    return WrongUsage(f"{what} '{word}'{closest(word, known)}", **said)


def instance(value: object, kind: type[T], name: str, wanted: str) -> T:
    """Return an argument that is of a type.

    Raises:
        WrongUsage: it is of another.
    """
    if not isinstance(value, kind):
        given = "None" if value is None else f"an object of type {type(value).__name__}"
        raise WrongUsage(f"{name} must be {wanted}; given is {given}")
    return value
