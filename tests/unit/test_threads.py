"""Linear algebra has one thread while dynid computes, and as many as before afterwards."""

import inspect

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import dynid
from dynid.arguments import one_thread
from dynid.progress import Silent


def threads():
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

    dynid.base_model(dynid.load_robot("scara"), progress=Probe())
    assert seen
    assert all(one == {1} for one in seen)
