"""One thread of the linear algebra library for matrices of the size that arms have.

With more, its threads wait for each other in a loop. From Python NumPy is loaded before dynid, with a thread for every
processor, so that setting a variable of the environment is too late; benchmarks/speed.md has what that costs.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

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
