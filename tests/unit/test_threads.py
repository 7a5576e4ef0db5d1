"""Linear algebra has one thread while dynid computes, and as many as before afterwards."""

import inspect
from threading import Event

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import dynid
from dynid import limits
from dynid.errors import LogNotFound
from dynid.progress import Silent
from dynid.workflows.arguments import one_thread
from dynid.workflows.logs import Ahead


def threads() -> set[int]:
    return {
        library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"
    }


@pytest.fixture
def two_threads():
    np.linalg.inv(np.eye(2))  # NumPy has its library loaded, whichever test is the first
    with threadpool_limits(limits=2, user_api="blas"):
        assert 2 in threads()
        yield threads()


def test_threads_come_back_after_the_work_and_after_a_mistake(two_threads):
    assert one_thread(threads)() == {1}
    assert threads() == two_threads

    @one_thread
    def wrong():
        raise ValueError

    with pytest.raises(ValueError):
        wrong()
    assert threads() == two_threads


def test_every_public_function_has_one_thread():
    functions = {name for name in dynid.__all__ if inspect.isfunction(getattr(dynid, name))}
    assert functions
    assert all(hasattr(getattr(dynid, name), "__wrapped__") for name in functions)


def test_what_is_told_on_the_way_is_told_with_one_thread(two_threads):
    seen = []

    class Probe(Silent):
        def stage(self, name, text=""):
            seen.append(threads())

    dynid.base_model(dynid.load_robot("kuka_lwr4plus"), progress=Probe())
    assert seen
    assert all(one == {1} for one in seen)


def test_what_is_worked_out_ahead_is_there_when_it_is_asked_for():
    begun, go_on = Event(), Event()

    def work() -> int:
        begun.set()
        assert go_on.wait(10.0)
        return 3

    ahead = Ahead(work)
    assert begun.wait(10.0)
    go_on.set()
    assert ahead.result() == ahead.result() == 3


def test_a_mistake_that_was_made_ahead_is_raised_where_the_answer_is_asked_for():
    def wrong() -> int:
        raise LogNotFound("no such log")

    ahead = Ahead(wrong)
    with pytest.raises(LogNotFound, match="no such log"):
        ahead.result()


def test_limits_that_were_raised_hold_for_what_is_worked_out_ahead():
    with limits.raised({"samples": 123.0}):
        ahead = Ahead(lambda: limits.limit("samples"))
    assert ahead.result() == 123.0
