"""One thread of the linear algebra library for matrices of the size that arms have, and a thread that reads ahead.

With more, threads of linear algebra wait for each other in a loop. From Python NumPy is loaded before dynid, with a
thread for every processor, so that setting a variable of the environment is too late; benchmarks/speed.md has what that
costs.
"""

from __future__ import annotations

from collections.abc import Callable
from contextvars import copy_context
from functools import wraps
from threading import Thread
from typing import Generic, ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """Return a function during which linear algebra has one thread; after it, as many as before."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        from threadpoolctl import threadpool_limits

        # Why anew every time: what was imported in between has threads of its own.
        with threadpool_limits(limits=1, user_api="blas"):
            return function(*args, **kwargs)

    return limited


class Ahead(Generic[T]):
    """An answer that a thread works out while the program goes on; what goes wrong is raised where it is asked for.

    Args:
        action: what returns the answer.
    """

    def __init__(self, action: Callable[[], T]) -> None:
        self._action = action
        self._answer: list[T] = []
        self._error: BaseException | None = None
        # Why a copy: limits that were raised hold for this thread as well. Why a daemon: an end need not wait for it.
        self._thread = Thread(target=copy_context().run, args=(self._run,), daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._answer.append(self._action())
        except BaseException as error:  # noqa: BLE001 - raised again by ``result``
            self._error = error

    def result(self) -> T:
        """Return the answer, when it is there."""
        self._thread.join()
        if self._error is not None:
            raise self._error
        return self._answer[0]
