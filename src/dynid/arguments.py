"""What public functions take: objects and paths alike, options as keywords or as an object, and a sentence otherwise.

A public function is decorated with ``public``, which checks arguments by their annotations, and begins with one line
for each that may stand for an object, such as ``robot = as_robot(robot)``. After it the argument is an object, or
``WrongUsage`` was raised, which says what was given, what would be right, and shows the call of the function's
docstring after ``Example:``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextvars import ContextVar
from dataclasses import fields, replace
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from dynid.errors import WrongUsage
from dynid.options import TYPES, Options
from dynid.progress import LISTENER, heard_by
from dynid.text import closest

P = ParamSpec("P")
T = TypeVar("T")


#: The public function that runs.
_running: ContextVar[Callable[..., Any] | None] = ContextVar("running", default=None)


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
    """Return a public function: it computes in one thread, and a wrong call of it is ``WrongUsage``.

    It is given its ``options`` with the single ones of ``**changes`` in them. Its ``progress``
    hears what happens; where there is none, whoever hears already.
    """
    computing, signature = one_thread(function), inspect.signature(function)
    # What help and notebooks show: each option in the place of ``**changes``.
    shown = dict(signature.parameters)
    kind = ""
    if shown.pop("changes", None):
        kind = shown["options"].annotation
        shown["options"] = shown["options"].replace(default=None)
    options: type[Options] | None = function.__globals__.get(kind)
    for each in fields(options) if options is not None else ():
        own = inspect.Parameter(
            each.name, inspect.Parameter.KEYWORD_ONLY, default=each.default, annotation=each.type
        )
        shown.setdefault(each.name, own)

    @wraps(function)
    def called(*args: P.args, **kwargs: P.kwargs) -> T:
        token = _running.set(function)
        try:
            for name in kwargs.keys() - shown.keys():
                raise refusal(f"there is no argument or option '{name}'{closest(name, shown)}")
            try:
                bound = signature.bind(*args, **kwargs)
            except TypeError as error:
                raise refusal(str(error)) from None
            given = bound.arguments
            if options is not None:
                changes = given.pop("changes", {})
                given["options"] = _merged(options, given.get("options"), changes)
            for name, value in given.items():
                words = str(signature.parameters[name].annotation).split(" | ")
                types: list[Any] = [
                    TYPES.get(word, function.__globals__.get(word)) for word in words
                ]
                # An alias or a type with brackets is read by the function itself.
                if all(isinstance(one, (type, tuple)) for one in types):
                    wrong = isinstance(value, bool) and "bool" not in words
                    if wrong or not any(isinstance(value, one) for one in types):
                        raise refused(name, " or ".join(words), value)
            listener = given.get("progress")
            with heard_by(LISTENER.get() if listener is None else listener):
                return computing(*bound.args, **bound.kwargs)
        finally:
            _running.reset(token)

    called.__signature__ = signature.replace(parameters=[*shown.values()])  # type: ignore[attr-defined]
    return called


def refusal(what: str) -> WrongUsage:
    """Return a refusal that shows how the function is called."""
    function = _running.get()
    if function is None:
        return WrongUsage(what)
    lines = (function.__doc__ or "").partition("Example:\n")[2].strip().splitlines()
    fix = f"such as {lines[0].strip()}" if lines else f"help(dynid.{function.__name__})"
    return WrongUsage(
        what, where=f"dynid.{function.__name__}", why="the function cannot use this value", fix=fix
    )


def refused(name: str, wanted: str, value: object) -> WrongUsage:
    """Return what to raise when an argument is something else than what is wanted."""
    shape = getattr(value, "shape", None)
    if value is None or isinstance(value, (str, int, float)):
        given = f"{value!r:.60}"
    elif isinstance(shape, tuple):
        given = f"an array of shape {shape}"
    else:
        given = f"an object of type {type(value).__name__}"
    return refusal(f"{name} must be {wanted}; given is {given}")


def _merged(kind: type[Options], given: Options | None, changes: Mapping[str, Any]) -> Options:
    """Return options of a kind, given as an object of it or of one that it extends, single keywords, or both."""
    if given is None:
        return kind(**changes)
    if not isinstance(given, kind):
        if not isinstance(given, Options) or not issubclass(kind, type(given)):
            wanted = f"dynid.{kind.__name__}, or single options by name"
            raise refused("options", wanted, given)
        given = kind(**{each.name: getattr(given, each.name) for each in fields(given)})
    return replace(given, **changes) if changes else given


# ---------------------------------------------------------------- single arguments
def words(value: str | Sequence[str], name: str, known: Iterable[str] = ()) -> tuple[str, ...]:
    """Return one or several words, of those that are known where there are any."""
    items = several(value, (str,), name, "a word or a list of words", empty=True)
    for word in items:
        if not isinstance(word, str) or (known and word not in known):
            among = f"one of {', '.join(known)}" if known else "words"
            raise refused(name, f"{among}{closest(str(word), known)}", word)
    return tuple(items)


def instance(value: Any, kind: type[T], name: str, wanted: str) -> T:  # noqa: ANN401
    """Return an argument that is of a type."""
    if not isinstance(value, kind):
        raise refused(name, wanted, value)
    return value


def several(
    value: Any,  # noqa: ANN401
    single: tuple[type, ...],
    name: str,
    wanted: str,
    *,
    empty: bool = False,
) -> list[Any]:
    """Return the items of a list, for which a single one may stand."""
    if isinstance(value, single):
        return [value]
    if (
        not isinstance(value, Iterable)
        or isinstance(value, (str, bytes, Mapping))
        or hasattr(value, "shape")
    ):
        raise refused(name, wanted, value)
    items = list(value)
    if not items and not empty:
        raise refusal(f"{name} is empty: it must be {wanted}")
    return items
