"""Run dynid in its own process with an empty home, an empty folder and no DYNID_* variables."""

import json
import os
import pty
import re
import select
import shlex
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass

from forkserver import PROGRAMS, ROOT, Command, server

#: A command that has not ended by then hangs [s].
LIMIT = 300


@dataclass
class Ended:
    status: int
    out: str
    err: str

    @property
    def good(self):
        """The same, of a command that went well."""
        assert self.status == 0, self.err
        return self

    @property
    def facts(self):
        """The JSON answer of a command that went well."""
        return json.loads(self.good.out)

    def failed(self, status, *said):
        """Return what a command said on stderr that ended so, without an answer; it said all of this."""
        assert (self.status, self.out) == (status, ""), self.err
        for each in said:
            assert each in self.err, self.err
        return self.err


class Runner:
    """Commands are lines as a person types them; words after the line are taken as they are."""

    #: Whether commands run in forks of a process that knows rospy.
    ros = False

    def __init__(self, folder, home):
        self.folder, self.home = folder, home
        for each in (folder, home):
            each.mkdir(exist_ok=True)
        self.env = {
            "PATH": os.environ.get("PATH", ""),
            "PYTHONPATH": str(ROOT / "src"),
            "HOME": str(home),
            "TERM": "xterm-256color",
            "LANG": "C.UTF-8",
            "PYTHONDONTWRITEBYTECODE": "1",
        }

    def forked(self, words, streams, env):
        return Command(server(self.ros), words, self.folder, {**self.env, **env}, streams)

    def __call__(self, line="", *more, stdin=None, **env):
        """Run with stdin not a terminal, in a fork; extra keywords are variables of the environment."""
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            nothing = os.open(os.devnull, os.O_RDONLY)
            streams = [nothing if stdin is None else stdin, out.fileno(), err.fileno()]
            status = self.forked(split(line, *more), streams, env).wait(LIMIT)
            os.close(nothing)
            return Ended(status, *(read(each) for each in (out, err)))

    def fresh(self, *words, **options):
        """Run the same in a new interpreter, where its start matters; keywords in capitals are variables."""
        env = {name: options.pop(name) for name in list(options) if name.isupper()}
        process = self.start(
            *words, env={**self.env, **env}, stdout=-1, stderr=-1, text=True, **options
        )
        out, err = process.communicate(timeout=LIMIT)
        return Ended(process.returncode, out, err)

    def start(self, line, *more, **options):
        words = split(line, *more)
        program = [PROGRAMS[words[0]]] if words[0] in PROGRAMS else ["-m", "dynid"]
        return subprocess.Popen(
            [sys.executable, *program, *words],
            **{"cwd": self.folder, "env": self.env, "stdin": subprocess.DEVNULL, **options},
        )

    def typing(self, line, *more, keys=(), **env):
        """Run on a pseudo-terminal, in a fork; each key sequence is typed when the program waits for one."""
        master, slave = pty.openpty()
        with tempfile.TemporaryFile() as out:
            process = self.forked(split(line, *more), [slave, out.fileno(), slave], env)
            os.close(slave)
            shown, keys, end = b"", list(keys), time.monotonic() + LIMIT
            while time.monotonic() < end:
                if select.select([master], [], [], 0.05)[0]:
                    try:
                        shown += os.read(master, 65536)
                    except OSError:
                        break
                elif keys and shown.rstrip(b" ").endswith((b"]", b":", b"again", b"rebuild")):
                    os.write(master, keys.pop(0).encode())
                elif process.ended():
                    break
            status = process.wait(5)
            os.close(master)
            return Ended(status, read(out), shown.decode())


def rows(text):
    """Return the rows of a table that is written as text, its cells between bars."""
    lines = (re.split(r" \|(?: |$)", line) for line in text.strip().splitlines())
    return [tuple(cell.strip() for cell in line) for line in lines]


def split(line, *more):
    return [*shlex.split(line), *map(str, more)]


def read(stream):
    stream.seek(0)
    return stream.read().decode()
