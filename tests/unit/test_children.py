"""Children end with their parent, however it ends, and import nothing from the folder that they run in."""

import os
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
    parent = subprocess.Popen([sys.executable, "-c", PARENT, str(tmp_path)], env=environment, stderr=subprocess.DEVNULL)
    assert wait_for((tmp_path / "pid").exists)
    child = int((tmp_path / "pid").read_text())
    parent.send_signal(number)
    parent.wait()
    assert wait_for(lambda: gone(child)), "the child lives on"


def test_a_child_whose_parent_is_already_gone_ends_at_once():
    environment = {**os.environ, **children.variables(), children.PARENT: "1", "PYTHONPATH": SOURCE}
    done = subprocess.run(children.command("dynid", "--version"), env=environment, capture_output=True)
    assert done.returncode == 130
    assert not done.stdout


def test_a_child_imports_nothing_from_the_folder_it_runs_in(tmp_path):
    for name in ("numpy", "json", "sitecustomize", "dynid", "click", "runpy"):
        (tmp_path / f"{name}.py").write_text("import pathlib; pathlib.Path('EXECUTED').write_text('')\n")
    environment = {**children.environment(), "PYTHONPATH": SOURCE}
    done = subprocess.run(
        children.command("dynid", "explain", "E201"), env=environment, cwd=tmp_path, capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert not (tmp_path / "EXECUTED").exists()
