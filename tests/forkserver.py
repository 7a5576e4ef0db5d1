"""Commands in forks of one process that has imported everything, so that a start takes 20 ms instead of a second.

Each command still is a process of its own, with its own streams, folder, environment and exit status. What only a new
interpreter shows (its imports, its start-up, the kernels and threads of BLAS) is left to those who start one.

``python tests/forkserver.py --call SOCKET WORDS...`` is the program for shells: it hands its streams over and waits.
"""

import json
import os
import select
import signal
import socket
import subprocess
import sys
import tempfile
from contextlib import suppress
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Programs of the tests by their first word; every other command line is one of dynid.
PROGRAMS = {
    "toy": ROOT / "tests" / "cli" / "toy.py",
    "watched-driver": ROOT / "tests" / "ros" / "watched_driver.py",
}
#: Imported inside functions by the commands.
LIBRARIES = [
    "jinja2",
    "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_svg",
    "matplotlib.figure",
    "mcap.reader",
    "numpy.testing",
    "rich.console",
    "rich.progress",
    "rich.table",
    "rosbags.typesys",
    "scipy.linalg",
    "scipy.optimize",
    "scipy.signal",
    "scipy.sparse.linalg",
    "scipy.special",
    "scipy.stats",
    "sqlite3",
    "sympy",
    "yaml",
]


# ---------------------------------------------------------------- whoever wants a command run
@cache
def server(ros=False):
    """Start the server of this process, which ends with it, and return its socket; ``ros`` imports rospy, too."""
    folder = tempfile.TemporaryDirectory(prefix="commands-")
    place = f"{folder.name}/socket"
    env = {
        "PATH": os.environ.get("PATH", ""),
        "PYTHONPATH": str(ROOT / "src"),
        "HOME": folder.name,
        "LANG": "C.UTF-8",
    }
    words = [sys.executable, __file__, "--serve-ros" if ros else "--serve", place]
    process = subprocess.Popen(
        words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, env=env, start_new_session=True
    )
    assert process.stdout.readline() == b"ready\n"
    _KEPT.extend((folder, process))
    return place


#: The folder is removed, and the standard input of the server ends, with this process.
_KEPT = []


def program():
    """Return what follows the name of an interpreter that stands for ``dynid`` in a shell."""
    return f'-I -S "{__file__}" --call {server()}'


class Command:
    """``dynid WORDS`` on three file descriptors, as it runs in a fork of the server."""

    def __init__(self, place, words, folder, env, streams):
        self.words = ["dynid", *map(str, words)]
        request = {"words": self.words[1:], "folder": os.fspath(folder), "env": env}
        self.connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self.connection.connect(place)
        socket.send_fds(self.connection, [json.dumps(request).encode()], streams)
        self.pid = int(self.connection.recv(64))

    def ended(self):
        """Whether ``wait`` would return at once, or has returned."""
        return self.connection.fileno() < 0 or bool(select.select([self.connection], [], [], 0)[0])

    def wait(self, seconds=None):
        """Return the exit status, -N where signal N has ended it.

        Raises:
            subprocess.TimeoutExpired: it had not ended by then, and was killed.
        """
        with self.connection:
            self.connection.settimeout(seconds)
            try:
                return int(self.connection.recv(64))
            except TimeoutError:
                os.kill(self.pid, signal.SIGKILL)
                raise subprocess.TimeoutExpired(self.words, seconds) from None


# ---------------------------------------------------------------- the server
def load(ros):
    """Import what commands import."""
    import importlib
    import pkgutil

    import dynid

    for name in LIBRARIES:
        importlib.import_module(name)
    for module in pkgutil.walk_packages(dynid.__path__, "dynid."):
        if module.name != "dynid.__main__":  # the program itself, which each command runs anew
            importlib.import_module(module.name)
    if ros:
        from dynid.drivers.ros import MODULES, import_ros

        importlib.import_module("pybullet")
        for name in MODULES:
            import_ros(name)


def derive(*names):
    """Derive the models of arms that many tests take; commands then store them as if they had derived them."""
    from dynid.files.robotfile import load_robot
    from dynid.model import regressor
    from dynid.model.base_model import key_of

    build = regressor.build_model
    rigid = {key_of(robot): build(robot).rigid for robot in map(load_robot, names)}

    def kept_or_built(robot):
        found = rigid.get(key_of(robot))
        return build(robot) if found is None else regressor.Model(robot, found)

    regressor.build_model = kept_or_built


def serve(place, ros):
    """Fork a child for each request until standard input ends."""
    import gc

    # Why: as dynid sets it, and a process of one thread may be forked.
    os.environ["OPENBLAS_NUM_THREADS"] = "1"
    # Why first: others then import the function that knows them.
    derive("kuka_lwr4plus", "kinova_gen2")
    load(ros)
    gc.freeze()
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    listener.bind(place)
    listener.listen(64)
    ended, told = os.pipe()
    os.set_blocking(told, False)
    signal.set_wakeup_fd(told)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    os.write(1, b"ready\n")
    running = {}
    while True:
        ready, _, _ = select.select([0, listener, ended], [], [])
        if 0 in ready:
            return
        if ended in ready:
            os.read(ended, 4096)
            _reap(running)
        if listener in ready:
            connection, _ = listener.accept()
            request, streams, _, _ = socket.recv_fds(connection, 1 << 20, 3)
            child = os.fork()
            if not child:
                for each in (listener, connection, *running.values()):
                    each.close()
                become(json.loads(request), streams)
            for number in streams:
                os.close(number)
            running[child] = connection
            send(connection, child)


def _reap(running):
    for child in list(running):
        found, how = os.waitpid(child, os.WNOHANG)
        if found:
            with running.pop(child) as connection:
                send(connection, os.waitstatus_to_exitcode(how))


def send(connection, number):
    with suppress(OSError):  # whoever wanted it has given up
        connection.send(str(number).encode())


def become(request, streams):
    """Turn this fork into the process that a shell would have started; never returns."""
    import atexit
    import runpy
    import threading
    import traceback

    status = 1
    try:
        signal.set_wakeup_fd(-1)
        signal.signal(signal.SIGCHLD, signal.SIG_DFL)
        signal.signal(signal.SIGINT, signal.default_int_handler)
        signal.signal(signal.SIGTERM, signal.SIG_DFL)
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
        for stream in streams:
            os.close(stream)
        os.chdir(request["folder"])
        os.environ.clear()
        os.environ.update(request["env"])
        tempfile.tempdir = None
        at_once = bool(os.environ.get("PYTHONUNBUFFERED"))
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
        sys.stdout, sys.stderr = (_writer(1, at_once), _writer(2, True))
        program = PROGRAMS.get("".join(request["words"][:1]))
        sys.argv = [str(program or "dynid"), *request["words"]]
        try:
            if program:
                runpy.run_path(str(program), run_name="__main__")
            else:
                runpy.run_module("dynid", run_name="__main__")
            status = 0
        except SystemExit as done:
            status = done.code if isinstance(done.code, int) else int(done.code is not None)
        threading._shutdown()
        atexit._run_exitfuncs()
        sys.stdout.flush()
    except BaseException:  # noqa: BLE001
        traceback.print_exc()
    finally:
        os._exit(status)


def _writer(number, at_once):
    import io

    raw = open(number, "wb", 0, closefd=False)  # noqa: SIM115
    binary = raw if at_once and number == 1 else io.BufferedWriter(raw)
    terminal = os.isatty(number) or number == 2
    return io.TextIOWrapper(
        binary, "utf-8", line_buffering=terminal, write_through=at_once and number == 1
    )


if __name__ == "__main__":
    if sys.argv[1].startswith("--serve"):
        serve(sys.argv[2], sys.argv[1] == "--serve-ros")
    else:
        sys.exit(
            Command(sys.argv[2], sys.argv[3:], str(Path.cwd()), dict(os.environ), [0, 1, 2]).wait()
            & 0xFF
        )
