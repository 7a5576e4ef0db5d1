"""Children end with their parent, however it ends, and import nothing from the folder that they run in."""

import os
import queue
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import dynid
from dynid import children

SOURCE = str(Path(dynid.__file__).parents[1])
#: A parent that starts a child, which writes its number and then waits for ever.
PARENT = """
import subprocess, sys, time
from dynid import children
folder = sys.argv[1]
subprocess.Popen(children.command("waiting", folder), env=children.environment())
time.sleep(60)
"""
WAITING = """
import os, sys, time
open(sys.argv[1] + "/pid.tmp", "w").write(str(os.getpid()))
os.replace(sys.argv[1] + "/pid.tmp", sys.argv[1] + "/pid")
time.sleep(60)
"""


def wait_for(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while time.monotonic() < end and not condition():
        time.sleep(0.02)
    return condition()


def gone(process: int) -> bool:
    try:
        return Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except FileNotFoundError:
        return True


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="looks into /proc")
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_child_ends_with_its_parent(number, tmp_path):
    (tmp_path / "modules").mkdir()
    (tmp_path / "modules" / "waiting.py").write_text(WAITING)
    environment = {**os.environ, "PYTHONPATH": f"{SOURCE}:{tmp_path / 'modules'}"}
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, str(tmp_path)], env=environment, stderr=subprocess.DEVNULL
    )
    assert wait_for((tmp_path / "pid").exists)
    child = int((tmp_path / "pid").read_text())
    parent.send_signal(number)
    parent.wait()
    assert wait_for(lambda: gone(child)), "the child lives on"


def test_a_child_whose_parent_is_already_gone_ends_at_once():
    environment = {**os.environ, **children.variables(), children.PARENT: "1", "PYTHONPATH": SOURCE}
    done = subprocess.run(
        children.command("dynid", "--version"), env=environment, capture_output=True
    )
    assert done.returncode == 130
    assert not done.stdout


def test_a_child_imports_nothing_from_the_folder_it_runs_in(tmp_path):
    for name in ("numpy", "json", "sitecustomize", "dynid", "click", "runpy"):
        (tmp_path / f"{name}.py").write_text(
            "import pathlib; pathlib.Path('EXECUTED').write_text('')\n"
        )
    environment = {**children.environment(), "PYTHONPATH": SOURCE}
    done = subprocess.run(
        children.command("dynid", "explain", "E201"),
        env=environment,
        cwd=tmp_path,
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "EXECUTED").exists()


def twice(number, send):
    """Send a number and its double, the work of a process in these tests."""
    sys.stdout.write("a word of a library\n")
    sys.stdout.flush()
    send(number)
    send(2 * number)


def failing(send):
    """Fail, as work of a process may."""
    raise ValueError("the reason")


def arrivals(function, *arguments):
    """What a process sends until it ends."""
    arrived = queue.SimpleQueue()
    worker = children.Worker(function, arguments, arrived)
    assert wait_for(lambda: not worker.running())
    worker.end()
    return [arrived.get_nowait() for _ in range(arrived.qsize())]


@pytest.fixture
def importable(monkeypatch):
    """Let processes import this module, as they import those of dynid."""
    monkeypatch.setenv("PYTHONPATH", f"{SOURCE}:{Path(__file__).parent}")


def test_a_process_sends_objects_and_words_of_libraries_do_not_disturb(importable):
    assert arrivals(twice, 21) == [21, 42]


def test_a_failure_in_a_process_arrives_with_its_traceback(importable):
    (failure,) = arrivals(failing)
    assert isinstance(failure, RuntimeError)
    assert "ValueError: the reason" in str(failure)


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


def test_a_script_without_a_guard_runs_once(tmp_path):
    script = started(SCRIPT.format(seconds=8), tmp_path)
    said, _ = script.communicate(timeout=120)
    assert said.splitlines() == ["the script runs", "planned True"]
    assert script.returncode == 0


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
