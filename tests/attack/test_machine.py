"""What the machine does to a run: it is killed, its disk is full, it may not write, it is not alone, its clock jumps."""

from __future__ import annotations

import os
import resource
import shutil
import subprocess
import sys
import time
from pathlib import Path

import kills
import numpy as np
import pytest
from forked import run
from odd import WHOLE

FLAGS = ["--no-input", "--force"]
#: Commands that write results of every kind, with the folder that they are to write to.
WRITING = (
    "model arm.yaml --out {}",
    "identify arm.yaml log.npz --out {}",
    "identify arm.yaml log.npz --out {} --report",
    "trajectory arm.yaml plan.yaml --preview none --out {}",
    "convert log.npz --to {}/x.mcap",
    "convert log.npz --to {}/x.bag",
    "convert log.npz --to {}/x.csv",
    "export out/parameters.npz --format urdf --out {}",
    "simulate arm.yaml out/trajectory.npz --out {}",
    "import arm.urdf --out {}/a.yaml",
    "compare out/parameters.npz --csv {}/a.csv",
    "run batch.yaml --out {}",
)
#: Bytes that are free on the disk, or that a file may have.
SIZES = (4 << 10, 64 << 10, 256 << 10, 1 << 20, 4 << 20)


@pytest.fixture
def folder(originals, tmp_path):
    shutil.copytree(originals, tmp_path / "work")
    for name in ("home", "tmp"):
        (tmp_path / name).mkdir()
    return tmp_path / "work"


@pytest.fixture
def disk(tmp_path):
    """Return a function that gives a file system of so many bytes."""
    place = tmp_path / "disk"
    place.mkdir()

    def made(size: int, how: str = "rw") -> Path:
        done = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={size},{how}", "tmpfs", place],
            capture_output=True,
        )
        if done.returncode:
            pytest.skip("file systems cannot be mounted here")
        return place

    yield made
    subprocess.run(["umount", place], capture_output=True)


def looked_at(ended, place: Path, statuses) -> None:
    assert ended.status in statuses, ended
    assert "Traceback" not in ended.err
    assert "internal error" not in ended.err
    left = [
        path for path in place.rglob("*") if path.name.startswith((".dynid-", "dynid-", "crash-"))
    ]
    assert not left
    assert [path for path in place.rglob("*") if path.is_file() and not kills.is_whole(path)] == []


@pytest.mark.parametrize("seed", range(12))
def test_a_killed_command_leaves_whole_results_and_the_next_run_works(seed, originals):
    """A dozen of the 200 whose table is in README.md."""
    rng = np.random.default_rng([20, seed])
    quick = [
        c
        for c in kills.COMMANDS
        if c.split()[0] in ("model", "convert", "identify", "check", "export", "run", "import")
    ]
    command, number = quick[rng.integers(len(quick))], kills.SIGNALS[seed % 3]
    moment, wrong = kills.kill(command, 2.5, number, originals, 10_000 + seed)
    assert wrong == [], f"{command} got {number.name} after {moment:.2f} s"


@pytest.mark.parametrize("size", SIZES)
def test_on_a_full_disk_a_result_is_whole_or_not_there(size, folder, disk):
    place = disk(size)
    for command in WRITING[size % 3 :: 3] if size != 64 << 10 else WRITING:
        ended = run([*command.format(place).split(), *FLAGS], folder)
        looked_at(ended, place, {0, 6})
        assert ended.status == 0 or "error[E6" in ended.err + ended.out


@pytest.mark.parametrize("size", SIZES)
def test_where_files_may_not_grow_a_result_is_whole_or_not_there(size, folder):
    place = folder / "out" / "new"
    for command in WRITING[size % 2 :: 2] if size != 64 << 10 else WRITING:
        ended = run(
            [*command.format("out/new").split(), *FLAGS],
            folder,
            prepare=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, size)),
        )
        looked_at(ended, place, {0, 6})
    ended = run([*WRITING[1].format("out/new").split(), *FLAGS], folder)
    looked_at(ended, place, {0})


def test_a_folder_that_may_only_be_read_is_said_to_be_so(folder, disk):
    place = disk(1 << 20, "ro")
    for command in WRITING:
        looked_at(run([*command.format(place / "new").split(), *FLAGS], folder), place, {6})
    assert not list(place.iterdir())


def test_two_runs_in_one_folder_do_not_disturb_each_other(folder):
    words = (
        "identify arm.yaml log.npz --out new",
        "identify arm.yaml other.npz --out new",
        "model arm.yaml --out new",
    )
    running = [kills.start(command, folder.parent, "two") for command in (*words, *words)]
    assert [process.wait() for process in running] == [0] * len(running)
    assert kills.litter(folder.parent) == []
    assert kills.broken(folder.parent) == []
    looked_at(run(["check", "new/parameters.npz"], folder), folder / "new", {0, 1})


@pytest.mark.parametrize("now", [-1.0, 0.0, 4e9, 1e11], ids=str)
def test_whatever_the_clock_says_a_command_does_its_job(now, folder):
    def clock() -> None:
        ticks = iter(np.tile([now, now - 3600, now + 1e6], 10_000))
        time.time = lambda: float(next(ticks))
        time.time_ns = lambda: 0

    for path in folder.rglob("*"):
        stamp = 4e9 if now > 1 else 0
        os.utime(path, (stamp, stamp))
    for command in (
        "identify arm.yaml log.npz --out out",
        "model arm.yaml --out out",
        "check log.csv --robot arm.yaml",
        "report out",
    ):
        looked_at(run([*command.split(), *FLAGS], folder, prepare=clock), folder / "out", {0, 1})


@pytest.mark.parametrize("place", ["/dev/full", "/dev/zero", "pipe", "folder", "loop"])
def test_run_yaml_that_is_no_file_is_no_trap(place, folder):
    target = folder / "out" / "run.yaml"
    target.unlink()
    if place == "pipe":
        os.mkfifo(target)
    elif place == "folder":
        target.mkdir()
    else:
        target.symlink_to(target if place == "loop" else place)
    ended = run(["identify", "arm.yaml", "log.npz", "--out", "out", *FLAGS], folder, seconds=20)
    looked_at(ended, folder / "out", {0, 6})
    ended = run(["identify", "--from", "out/run.yaml", "--out", "out", *FLAGS], folder, seconds=20)
    assert ended.status in (0, 2, 3, 6), ended


def test_without_memory_a_command_says_so_and_writes_nothing(folder):
    def nothing(*words: object, **more: object) -> None:
        raise MemoryError("Unable to allocate 2 TiB")

    words = ["identify", "arm.yaml", "log.csv", "--out", "out/new", *FLAGS]
    ended = run(words, folder, prepare=lambda: setattr(np.linalg, "qr", nothing))
    looked_at(ended, folder / "out" / "new", {6})
    assert "error[E611] there is not enough memory: Unable to allocate 2 TiB" in ended.err
    assert not (folder / "out" / "new" / "parameters.npz").exists()


@pytest.mark.parametrize("stream", [1, 2])
def test_a_terminal_on_a_full_disk_is_no_crash(stream, folder):
    def full() -> None:
        os.dup2(os.open("/dev/full", os.O_WRONLY), stream)

    for command in (
        "check log.csv --robot arm.yaml",
        "model arm.yaml --out out",
        "check missing.npz",
        "explain E201",
        "--help",
    ):
        assert run(
            [*command.split(), *(FLAGS if command[0] != "-" and "explain" not in command else [])],
            folder,
            prepare=full,
        ).status in (0, 1, 2, 3, 6)
    assert (
        not list((folder.parent / ".cache").glob("**/crash*"))
        if (folder.parent / ".cache").exists()
        else True
    )


#: Writes down every connection that a child process opens, too: Python imports a module of this name when it starts.
WATCH = """
import os, sys
def _seen(event, args):
    if event in ("socket.connect", "socket.sendto", "socket.getaddrinfo", "socket.gethostbyname", "socket.bind"):
        with open(os.environ["SEEN"], "a") as stream:
            stream.write(f"{event} {args[1:] if event != 'socket.getaddrinfo' else args}\\n")
sys.addaudithook(_seen)
"""


@pytest.fixture
def watched(tmp_path):
    """Return what watches a command and its children, and the file that it writes to."""
    (tmp_path / "watch").mkdir()
    (tmp_path / "watch" / "sitecustomize.py").write_text(WATCH)
    seen = tmp_path / "seen"

    def watch() -> None:
        path = os.pathsep.join([str(tmp_path / "watch"), *sys.path[1:]])
        os.environ.update(SEEN=str(seen), PYTHONPATH=path, ROS_MASTER_URI="http://127.0.0.1:19")
        exec(WATCH, {})

    return watch, seen


@pytest.mark.parametrize("part", range(3))
def test_no_command_opens_a_connection_but_to_the_ros_master_that_it_was_given(
    part, folder, watched
):
    watch, seen = watched
    commands = [
        *WHOLE,
        "trajectory arm.yaml plan.yaml --preview picture --out out",
        "demo --out out",
        "record arm.yaml out/trajectory.npz --out out",
    ]
    for command in commands[part::3]:
        if command.startswith("demo"):
            continue
        ended = run(
            [*command.split(), *([] if command.startswith(("explain", "completion")) else FLAGS)],
            folder,
            prepare=watch,
        )
        assert ended.status in (0, 1, 6), ended
        said = seen.read_text().splitlines() if seen.exists() else []
        ros = command.startswith(("record", "sim-driver", "doctor"))
        assert [
            line
            for line in said
            if not (ros and ("'127.0.0.1', 19" in line or line.startswith("socket.bind")))
        ] == [], command
        seen.unlink(missing_ok=True)


@pytest.mark.parametrize("size", [60, 90, 120, 180, 250, 320, 399])
@pytest.mark.parametrize(
    "command",
    [
        "identify arm.yaml log.npz --out out",
        "check log.npz",
        "explain E201",
        "convert log.npz --to out/x.csv",
        "compare out/parameters.npz",
        "report out",
        "trajectory arm.yaml --seconds 1 --preview none --out out",
    ],
)
def test_a_machine_of_few_addresses_says_so(command, size, folder):
    environment = {**os.environ, "HOME": str(folder.parent / "home"), "OMP_NUM_THREADS": "1"}
    done = subprocess.run(
        [
            "bash",
            "-c",
            f'ulimit -v {size << 10}; exec "$0" -m dynid {command} --no-input --force',
            sys.executable,
        ],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    # Why: below 60 MB Python itself does not start, and NumPy has no memory for its libraries below 120 MB.
    assert done.returncode in ((6,) if command.startswith("identify") else (0, 6)), done.stderr
    assert "Traceback" not in done.stderr
    assert "internal error" not in done.stderr
    assert ("error[E611]" in done.stderr) == (done.returncode == 6)
