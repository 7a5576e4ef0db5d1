"""Processes that dynid starts end with it, however it ends, and import nothing from the folder that they run in."""

import inspect
import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import dynid
from dynid import PlanOptions, children
from dynid.arguments import one_thread
from dynid.progress import Silent
from dynid.trajectory.optimise import optimise

SOURCE = str(Path(dynid.__file__).parents[1])


def wait_for(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end and not condition():
        time.sleep(0.02)
    return condition()


def gone(process):
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


def test_a_process_imports_nothing_from_the_folder_it_runs_in(tmp_path):
    for name in ("numpy", "random", "json", "sitecustomize", "dynid", "click"):
        (tmp_path / f"{name}.py").write_text(
            "import pathlib; pathlib.Path('EXECUTED').write_text('')\n"
        )
    code = "import random, json, numpy; from dynid.__main__ import main; main()"
    words = ["trajectory", "scara", "--duration", "6", "--segments", "4", "--seconds", "1"]
    words += ["--preview", "none"]
    done = subprocess.run(children.python(code, *words), cwd=tmp_path, capture_output=True)
    assert done.returncode in (0, 5), done.stderr
    assert not (tmp_path / "EXECUTED").exists()


class Unfit:
    """A problem whose search fails."""

    def of_start(self, start):
        raise ValueError("the reason")


def test_a_failure_in_a_process_arrives_with_its_traceback(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", f"{SOURCE}:{Path(__file__).parent}")
    with pytest.raises(RuntimeError, match="ValueError: the reason"):
        optimise(Unfit(), PlanOptions(processes=1, restarts=1), np.inf)


#: A script as a newcomer writes it, without a guard around what it does.
SCRIPT = """
import dynid
print("the script runs", flush=True)
plan = dynid.plan_trajectory("kuka_lwr4plus", duration=10.0, segments=5, seconds={seconds}, processes=2)
print("planned", plan.motion.t[-1] > 0)
"""


def started(script, folder):
    """A script that runs in a folder of its own."""
    (folder / "plain.py").write_text(script)
    environment = {**os.environ, "PYTHONPATH": SOURCE}
    words = [sys.executable, "plain.py"]
    return subprocess.Popen(words, cwd=folder, env=environment, stdout=subprocess.PIPE, text=True)


@pytest.mark.slow
def test_a_script_without_a_guard_runs_once(tmp_path):
    script = started(SCRIPT.format(seconds=8), tmp_path)
    said, _ = script.communicate(timeout=120)
    assert said.splitlines() == ["the script runs", "planned True"]
    assert script.returncode == 0


@pytest.mark.slow
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
def test_search_processes_end_with_a_script_that_is_killed(tmp_path):
    script = started(SCRIPT.format(seconds=100), tmp_path)

    def searching():
        names = Path(f"/proc/{script.pid}/task/{script.pid}/children").read_text().split()
        return names if len(names) == 2 else []

    processes = wait_for(searching, 60.0)
    assert processes, "no search began"
    script.kill()
    script.communicate()
    assert wait_for(lambda: all(gone(int(process)) for process in processes)), "a search lives on"


# ---------------------------------------------------------------- threads of linear algebra
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
